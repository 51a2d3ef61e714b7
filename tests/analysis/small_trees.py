"""All small trees: every way to share and to order the children of a few nodes, every gate, events on gates, constant guards."""

from collections.abc import Iterator
from itertools import permutations, product

from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Causality, EventType, Gate, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT

_E = EventType("e", ("n",), ObjectPattern((("event", Variable("n")),)))
_FALSE: Guard = Operation(Operator.LT, (Literal(2), Literal(1)))
_OPEN: Guard = Operation(Operator.LT, (Variable("X"), Literal(1)))


def small_trees(size: int) -> Iterator[RVAFT]:
    """Every tree of so many nodes where a child comes after its parents (but for names); of guards and events every kind in turn."""
    turn = 0
    later = [
        [chosen for count in range(size - own) for chosen in permutations(range(own + 1, size), count)]
        for own in range(size)
    ]
    for below in product(*later):
        reached = {0}
        for own in range(size):
            if own in reached:
                reached.update(below[own])
        if len(reached) < size:
            continue
        ways = [[(None, None)] if not children else list(_gates(len(children))) for children in below]
        for joined in product(*ways):
            turn += 1
            nodes = [
                _node(own, gate, children, threshold, turn * 7 + own * 3)
                for own, ((gate, threshold), children) in enumerate(zip(joined, below, strict=True))
            ]
            yield RVAFT("n0", nodes, [_E], causality=list(Causality)[turn % 2])


def _gates(children: int) -> Iterator[tuple[Gate, int | None]]:
    for gate in Gate:
        for threshold in range(1, children + 1) if gate is Gate.VOT else (None,):
            yield gate, threshold


def _node(own: int, gate: Gate | None, children: tuple[int, ...], threshold: int | None, turn: int) -> Node:
    has_event = turn % 5 in (0, 1) or (gate is None and turn % 5 in (2, 3))
    when = {0: _FALSE, 3: _OPEN, 6: _OPEN}.get(turn % 11)
    on = On("e", (Literal(f"n{own}"),)) if has_event else None
    return Node(f"n{own}", gate, tuple(f"n{child}" for child in children), threshold, on, when)
