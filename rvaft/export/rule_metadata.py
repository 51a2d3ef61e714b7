"""The metadata that a tree gives to rules and alerts: title, id, description, level and tags."""

import re
from functools import lru_cache
from typing import Any, Final
from uuid import NAMESPACE_URL, UUID, uuid5

from rvaft.language.printer import dumps
from rvaft.model.nodes import Kind, Node
from rvaft.model.tree import RVAFT

ODD: Final = re.compile(r"[\0-\2\ud800-\udfff]")
"""Characters that YAML cannot write."""


def rule_id(tree: RVAFT, name: str = "") -> str:
    """Return a UUID that depends on the tree and the name of a rule."""
    return str(uuid5(_tree_id(tree), name) if name else _tree_id(tree))


@lru_cache(maxsize=16)
def _tree_id(tree: RVAFT) -> UUID:
    return uuid5(NAMESPACE_URL, f" {dumps(tree)}")


def about(tree: RVAFT, name: str, node: Node) -> dict[str, Any]:
    """Return title, id and description of a rule, or of the whole with an empty name."""
    shown = ODD.sub("?", node.label or node.name.replace("_", " ")).strip()[:100] or "tree"
    title = " ".join(word[:1].upper() + word[1:] for word in shown.split())
    what = f"The event {name} of the" if name else "The"
    return {
        "title": title,
        "id": rule_id(tree, name),
        "status": dict(tree.nodes[tree.root].attributes).get("status", "experimental"),
        "description": f"{what} attack-fault tree {ODD.sub('?', tree.root)[:100]}",
    }


def origin(tree: RVAFT) -> dict[str, Any]:
    """Return author and date, if the root has these attributes."""
    attributes = dict(tree.nodes[tree.root].attributes)
    return {key: attributes[key] for key in ("author", "date") if key in attributes}


def rule_metadata(tree: RVAFT) -> dict[str, Any]:
    """Return the metadata of a whole tree, from the label and the attributes of its root.

    >>> import rvaft
    >>> rule_metadata(rvaft.loads('top or a b label "Break-in" tags="attack.t1110" level=high;'))["tags"]
    ['attack.t1110']
    """
    attributes = dict(tree.nodes[tree.root].attributes)
    found = {**about(tree, "", tree.nodes[tree.root]), **origin(tree)}
    if "tags" in attributes:
        found["tags"] = attributes["tags"].split(",")
    kinds = {node.kind for node in tree.top_down()}
    return {**found, "level": attributes.get("level", "high" if Kind.ATTACK in kinds else "medium")}
