"""What the signs of a drawing mean: those that are in it, in a fixed order."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from rvaft.drawing.captions import gate_text
from rvaft.drawing.marks import Marks
from rvaft.drawing.view import View
from rvaft.model import Gate, Kind, Node


class Sign(Enum):
    """How the sample of an entry is drawn."""

    FAULT = "fault"
    ATTACK = "attack"
    CONDITION = "condition"
    GATE = "gate"
    FOLDED = "folded"
    AGAIN = "again"
    ORDER = "order"
    MARKED = "marked"


@dataclass(frozen=True, slots=True)
class Entry:
    """A sample and what it means; the sample of a gate has that gate's outline."""

    sign: Sign
    sample: str
    meaning: str
    gate: Gate | None = None


_MEANINGS = {
    Gate.OR: "one of them",
    Gate.AND: "all, in any order",
    Gate.SAND: "all, from left to right",
    Gate.SAND_RL: "all, from right to left",
}


def entries(view: View, marks: Marks | None, *, graph: bool) -> Iterator[Entry]:
    """The entries for what a drawing has.

    A `graph` has a shared node once and numbers children that may stand out of order, other formats draw a tree and refer.
    """
    kinds = {node.kind for node in view.nodes}
    if Kind.FAULT in kinds:
        yield Entry(Sign.FAULT, "fault", "caused by a fault")
    if Kind.ATTACK in kinds:
        yield Entry(Sign.ATTACK, "attack", "caused by an attack")
    if any(is_condition(node) for node in view.nodes):
        yield Entry(Sign.CONDITION, "condition", "holds, without an event")
    gates = {node.gate: node for node in view.nodes if view.children(node)}
    for gate, meaning in _MEANINGS.items():
        if gate in gates:
            yield Entry(Sign.GATE, gate_text(gates[gate]) or "", meaning, gate)
    if Gate.VOT in gates:
        yield Entry(Sign.GATE, "VOT k/n", "at least k of the n", Gate.VOT)
    if any(view.folded.values()):
        yield Entry(Sign.FOLDED, "+n", "n nodes not drawn")
    if not all(view.folded.values()):
        yield Entry(Sign.FOLDED, "…", "nodes drawn elsewhere")
    if view.shared and not graph:
        yield Entry(Sign.AGAIN, "name", "drawn in full elsewhere")
    if graph and view.numbered:
        yield Entry(Sign.ORDER, "1, 2", "the order under a SAND")
    if marks is not None:
        yield Entry(Sign.MARKED, "bold", marks.meaning)


def is_condition(node: Node) -> bool:
    """Whether a node is a leaf with a guard alone."""
    return node.leaf and node.on is None and node.when is not None
