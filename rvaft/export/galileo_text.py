"""Trees in Galileo's format, and what is lost in it.

Galileo has no SAND: it becomes `pand`, which is equivalent over single events.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Final

from rvaft.errors import OptionError
from rvaft.export.layout import turn
from rvaft.model.expressions import WORD, bare_value
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics


def galileo_text(tree: RVAFT) -> str:
    """Return the reachable nodes as Galileo statements, parents first; raises `OptionError`.

    >>> import rvaft
    >>> print(galileo_text(rvaft.loads("top sand_rl a b; a fault;")), end="")
    toplevel "top";
    "top" pand "b" "a";
    "a";
    "b";
    """
    return "\n".join([f"toplevel {_name(tree.root)};", *map(_statement, tree.top_down())]) + "\n"


def losses(tree: RVAFT) -> Iterator[str]:
    """Yield what the Galileo text lacks, one clause each."""
    nodes = list(tree.top_down())
    several = _with_several_leaves(tree)
    ordered = sum(node.gate in _SEQUENCES and not several.isdisjoint(node.children) for node in nodes)
    again = len(_failing_again(tree))
    unwritable = sum(not _is_plain(*pair) for node in nodes for pair in node.attributes)
    unrated = sum(node.leaf and not node.attributes for node in nodes)
    for lost, what in (
        (ordered, "sand gate{} written as pand, which orders how parts end, and not all that is in them"),
        (again, "gate{} written as pand, of which a later input may fail again, or together: in Galileo it fails once"),
        (sum(node.on is not None for node in nodes), "runtime event{} left out"),
        (sum(node.times > 1 for node in nodes), "number{} of events (times) left out"),
        (sum(node.within is not None for node in nodes), "window{} (within) left out"),
        (sum(len(node.without) for node in nodes), "absent event{} (without) left out"),
        (sum(node.when is not None for node in nodes), "guard{} left out"),
        (sum(node.kind is not None for node in nodes), "fault or attack mark{} left out"),
        (sum(node.label is not None for node in nodes), "label{} left out"),
        (unwritable, "attribute{} left out whose name or value Galileo cannot write"),
    ):
        if lost:
            yield f"{lost} {what.format('s' * (lost != 1))}"
    for declared, what in (
        (tree.ignores, "ignore declarations"),
        (tree.topics, "topic declarations"),
        (tree.causality is Causality.BOTTOM_UP, "causality bottom_up"),
        (tree.time, "the time of events"),
        (tree.assumes, "assumptions"),
    ):
        if declared:
            yield f"{what} left out"
    if tree.semantics != Semantics.SCATTERED:
        yield f"semantics {tree.semantics or 'projected'} left out; the file is read as scattered: failures persist"
    if unrated:
        yield f"{unrated} basic event{'s' * (unrated != 1)} without a rate or probability, which most tools require"


def _with_several_leaves(tree: RVAFT) -> set[str]:
    """Return the nodes with several leaves in some scenario."""
    most: dict[str, int] = {}
    for node in tree.bottom_up():
        below = [most[child] for child in node.children]
        most[node.name] = min(2, max(below) if node.gate is Gate.OR else sum(below)) if below else 1
    return {name for name, leaves in most.items() if leaves > 1}


def _failing_again(tree: RVAFT) -> set[str]:
    """Return the ordered gates whose inputs in order of their ends are not those in order of their failures.

    They are, if every match of each input but the first ends when it fails, and no two can end with one event.
    """
    found: set[str] = set()
    choosing: set[str] = set()
    last: dict[str, frozenset[str]] = {}
    for node in tree.bottom_up():
        children = _written_children(node)
        if node.gate in (Gate.OR, Gate.VOT) and (node.threshold or 1) < len(children):
            choosing.add(node.name)
        if not node.leaf and _GATES[node.gate] == "pand":  # type: ignore[index]
            last[node.name] = last[children[-1]]
            if any(y in choosing or last[x] & last[y] for x, y in pairwise(children)):
                found.add(node.name)
            choosing.update([node.name] if children[-1] in choosing else ())
            continue
        last[node.name] = (
            frozenset[str]().union(*[last[child] for child in children]) if children else frozenset([node.name])
        )
        choosing.update([node.name] if not choosing.isdisjoint(children) else ())
    return found


_GATES: Final[Mapping[Gate, str]] = {
    Gate.AND: "and",
    Gate.OR: "or",
    Gate.SAND: "pand",
    Gate.SAND_RL: "pand",
    Gate.PAND: "pand",
    Gate.VOT: "{}of{}",
}
assert set(_GATES) == set(Gate), "every gate has a word"
_SEQUENCES: Final = frozenset(gate for gate, word in _GATES.items() if word == "pand") - {Gate.PAND}


def _statement(node: Node) -> str:
    gate = [] if node.gate is None else [_GATES[node.gate].format(node.threshold, len(node.children))]
    children = _written_children(node)
    attributes = [f"{key}={value}" for key, value in node.attributes if _is_plain(key, value)]
    return " ".join([_name(node.name), *gate, *map(_name, children), *attributes]) + ";"


def _written_children(node: Node) -> list[str]:
    """Return the children in the order in which Galileo has them."""
    turns = {child: turn(node, place) for place, child in enumerate(node.children)}
    return sorted(node.children, key=turns.__getitem__)


def _name(name: str) -> str:
    if '"' in name or "\\" in name or not name.isprintable():
        raise OptionError(f"Galileo cannot write the name {name!r}: rename the node")
    return f'"{name}"'


def _is_plain(key: str, value: str) -> bool:
    """Whether Galileo, which does not quote values, can write an attribute."""
    return WORD.fullmatch(key) is not None and bare_value(value)
