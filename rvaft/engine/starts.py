"""When a node may start under `scattered`, and where each node has but one start.

A node starts with its parent, except a later child of an ordered gate (when those before it are complete) and a child of a
gate whose own event comes first (when that has come). Whatever precedes a node's event is found along its starts.
"""

from collections.abc import Iterator
from typing import NamedTuple

from rvaft.engine.plan import Plan
from rvaft.model import Gate


class Start(NamedTuple):
    """After the children of an ordered gate that stand before a slot, or (slot 0) after the gate's own event."""

    gate: int
    slot: int


class Starts(NamedTuple):
    """The parents of every node, and its start: None stands for the beginning of the trace."""

    parents: tuple[tuple[int, ...], ...]
    start: tuple[Start | None, ...]

    def chain(self, node: int) -> Iterator[Start]:
        """The starts of a node, the last first."""
        start = self.start[node]
        while start is not None:
            yield start
            start = self.start[start.gate]


def starts_of(plan: Plan) -> Starts | None:
    """The one start of every node; None where a shared node has several."""
    parents: list[list[int]] = [[] for _ in plan.names]
    found: list[Start | None] = [None] * len(plan.names)
    known = {plan.root}
    for node, children in enumerate(plan.children):
        gate = plan.gates[node]
        for slot, child in enumerate(children):
            parents[child].append(node)
            start = found[node]
            if gate in (Gate.SAND, Gate.SAND_RL) and slot > 0:
                start = Start(node, slot)
            elif plan.own[node] and plan.top_down:
                start = Start(node, 0)
            if child in known and found[child] != start:
                return None
            known.add(child)
            found[child] = start
    return Starts(tuple(map(tuple, parents)), tuple(found))
