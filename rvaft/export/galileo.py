"""The static part of a tree in Galileo's format, for fault-tree tools.

Galileo has no SAND: it becomes the priority AND (`pand`), `sand_rl` with its children turned round. Events, guards,
kinds, labels and `ignore` have no form there either; `losses` says what is lost, so that nobody takes the result for the tree.
"""

from collections.abc import Iterator, Sized
from typing import assert_never

from rvaft.errors import OptionError
from rvaft.model.expressions import WORD, bare_value
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT


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
    counts: dict[str, Sized] = {
        "sand gate{} written as pand, which orders failures, not runtime events": [
            n for n in nodes if n.gate is not None and n.gate.ordered
        ],
        "runtime event{} left out": [n for n in nodes if n.on is not None],
        "guard{} left out": [n for n in nodes if n.when is not None],
        "fault or attack mark{} left out": [n for n in nodes if n.kind is not None],
        "label{} left out": [n for n in nodes if n.label is not None],
        "attribute{} left out whose name or value Galileo cannot write": [
            pair for n in nodes for pair in n.attributes if not _is_plain(*pair)
        ],
    }
    yield from (f"{len(lost)} {what.format('s' * (len(lost) != 1))}" for what, lost in counts.items() if lost)
    if tree.ignores:
        yield "ignore declarations left out"
    if tree.topics:
        yield "topic declarations left out"
    if tree.causality is Causality.BOTTOM_UP:
        yield "causality bottom_up left out"
    if count := sum(node.leaf and not node.attributes for node in nodes):
        yield f"{count} basic event{'s' * (count != 1)} without a rate or probability, which most tools require"


def _statement(node: Node) -> str:
    match node.gate:
        case None:
            gate = []
        case Gate.VOT:
            gate = [f"{node.threshold}of{len(node.children)}"]
        case Gate.SAND | Gate.SAND_RL:
            gate = ["pand"]
        case Gate.AND | Gate.OR:
            gate = [node.gate.value]
        case _ as never:
            assert_never(never)
    children = node.children[::-1] if node.gate is Gate.SAND_RL else node.children
    attributes = [f"{key}={value}" for key, value in node.attributes if _is_plain(key, value)]
    return " ".join([_name(node.name), *gate, *map(_name, children), *attributes]) + ";"


def _name(name: str) -> str:
    if '"' in name or not name.isprintable():
        raise OptionError(f"Galileo cannot write the name {name!r}: rename the node")
    return f'"{name}"'


def _is_plain(key: str, value: str) -> bool:
    """Whether an attribute can be written; Galileo has no quotes around what comes after a name."""
    return WORD.fullmatch(key) is not None and bare_value(value)
