"""A tree for other programs: all of it as JSON, and its static part in Galileo's format for fault-tree tools.

Schema of the JSON, version 1 (fields are only ever added)::

    {"format": "rvaft", "version": 1, "root": NAME, "causality": "top_down" | "bottom_up",
     "nodes":   [{"name", "gate": null | "or" | "and" | "sand" | "sand_rl" | "vot", "threshold": null | K,
                  "children": [NAME], "on": null | CALL, "when": null | GUARD, "kind": null | "fault" | "attack",
                  "label": null | TEXT, "attributes": [[KEY, VALUE]]}],
     "events":  [{"name", "parameters": [NAME], "pattern": PATTERN}],
     "ignores": [{"on": CALL, "when": null | GUARD}],
     "topics":  [{"name", "type", "publishers": [NAME]}]}

CALL is `{"event": NAME, "arguments": [PATTERN]}`; PATTERN one of `{"literal": VALUE}`, `{"variable": NAME}`, `{"any": true}`,
`{"object": {FIELD: PATTERN}}`, `{"list": [PATTERN]}`; GUARD a text in the language of guards. Nodes stand in the order of
their declaration.

Galileo has no SAND: it becomes the priority AND (`pand`), `sand_rl` with its children turned round. Events, guards,
kinds, labels and `ignore` have no form there either; `losses` says what is lost, so that nobody takes the result for the tree.
"""

import json
from collections.abc import Iterator
from typing import Any, assert_never

from rvaft.errors import OptionError
from rvaft.model.expressions import WORD, bare_value, guard_text
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json


def json_text(tree: RVAFT) -> str:
    """The tree as one JSON object.

    >>> import rvaft
    >>> [node["kind"] for node in json.loads(json_text(rvaft.loads("top or a b; a fault;")))["nodes"]]
    [None, 'fault', None]
    """
    value = {
        "format": "rvaft",
        "version": 1,
        "root": tree.root,
        "causality": tree.causality,
        "nodes": [
            _record(node, "name gate threshold children on when kind label attributes") for node in tree.nodes.values()
        ],
        "events": [_record(event, "name parameters pattern") for event in tree.events.values()],
        "ignores": [_record(ignore, "on when") for ignore in tree.ignores],
        "topics": [_record(topic, "name type publishers") for topic in tree.topics.values()],
    }
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def _record(thing: object, names: str) -> dict[str, Any]:
    """These parts of something, as JSON."""
    found: dict[str, Any] = {}
    for name in names.split():
        found[name] = value = getattr(thing, name)
        if name == "on" and value is not None:
            found[name] = {"event": value.event, "arguments": list(map(_pattern, value.arguments))}
        elif name == "when" and value is not None:
            found[name] = guard_text(value)
        elif name == "pattern":
            found[name] = _pattern(value)
    return found


def _pattern(pattern: Pattern) -> Json:
    match pattern:
        case Literal(value):
            return {"literal": value}
        case Variable(name):
            return {"variable": name}
        case Anything():
            return {"any": True}
        case ObjectPattern(fields):
            return {"object": {name: _pattern(inner) for name, inner in fields}}
        case ListPattern(items):
            return {"list": list(map(_pattern, items))}
        case _ as never:
            assert_never(never)


def galileo_text(tree: RVAFT) -> str:
    """The reachable nodes as Galileo statements, parents first; raises `OptionError` for a name it cannot write.

    >>> import rvaft
    >>> print(galileo_text(rvaft.loads("top sand_rl a b; a fault;")), end="")
    toplevel "top";
    "top" pand "b" "a";
    "a";
    "b";
    """
    return "\n".join([f"toplevel {_name(tree.root)};", *map(_statement, tree.top_down())]) + "\n"


def losses(tree: RVAFT) -> Iterator[str]:
    """What the Galileo text does not say, one clause each."""
    nodes = list(tree.top_down())
    counts = {
        "sand gate{} written as pand, which orders failures, not runtime events": sum(
            _gate(node)[0] == "pand" for node in nodes
        ),
        "runtime event{} left out": sum(node.on is not None for node in nodes),
        "guard{} left out": sum(node.when is not None for node in nodes),
        "fault or attack mark{} left out": sum(node.kind is not None for node in nodes),
        "label{} left out": sum(node.label is not None for node in nodes),
        "attribute{} left out whose name or value Galileo cannot write": sum(
            not _is_plain(*pair) for node in nodes for pair in node.attributes
        ),
    }
    yield from (f"{lost} {what.format('s' * (lost != 1))}" for what, lost in counts.items() if lost)
    if tree.ignores:
        yield "ignore declarations left out"
    if tree.topics:
        yield "topic declarations left out"
    if tree.causality is Causality.BOTTOM_UP:
        yield "causality bottom_up left out"
    if count := sum(node.leaf and not node.attributes for node in nodes):
        yield f"{count} basic event{'s' * (count != 1)} without a rate or probability, which most tools require"


def _gate(node: Node) -> tuple[str, tuple[str, ...]]:
    """The gate as Galileo calls it, and the children in its order."""
    match node.gate:
        case None:
            return "", node.children
        case Gate.VOT:
            return f"{node.threshold}of{len(node.children)}", node.children
        case Gate.SAND:
            return "pand", node.children
        case Gate.SAND_RL:
            return "pand", node.children[::-1]
        case Gate.AND | Gate.OR:
            return node.gate.value, node.children
        case _ as never:
            assert_never(never)


def _statement(node: Node) -> str:
    gate, children = _gate(node)
    attributes = [f"{key}={value}" for key, value in node.attributes if _is_plain(key, value)]
    return " ".join(filter(None, [_name(node.name), gate, *map(_name, children), *attributes])) + ";"


def _name(name: str) -> str:
    if '"' in name or not name.isprintable():
        raise OptionError(f"Galileo cannot write the name {name!r}: rename the node")
    return f'"{name}"'


def _is_plain(key: str, value: str) -> bool:
    """Whether an attribute can be written; Galileo has no quotes around what comes after a name."""
    return WORD.fullmatch(key) is not None and bare_value(value)
