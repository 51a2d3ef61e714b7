"""The events worth keeping under `scattered`, so that the match of every branch can still be found at detection.

What one branch can match depends on when each of its nodes starts, and that differs between branches. An event is worth keeping for
an occurrence only if, since the last one kept for it, something was kept that may precede it: the earliest match of
any branch takes, for each occurrence, the first event after those of its predecessors. So the number of events kept depends on
the tree, not on the length of the trace.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from typing import NamedTuple, Self

from rvaft.engine.plan import Plan
from rvaft.engine.starts import Starts
from rvaft.values import Json


class Entry(NamedTuple):
    """An event: its position, the occurrences it can serve, and the values each saw."""

    position: int
    served: tuple[tuple[int, Mapping[str, Json]], ...]


class Log:
    """The events kept so far."""

    def __init__(self, plan: Plan, starts: Starts) -> None:
        self.plan = plan
        self.starts = starts
        self.entries: list[Entry] = []
        self._own: dict[int, int] = {}
        """The position of the last event kept for a node's own occurrence."""
        self._latest: dict[int, int] = {}
        """The same for a node and everything below it."""

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        vars(twin).update(entries=list(self.entries), _own=dict(self._own), _latest=dict(self._latest))
        return twin

    def note(self, position: int, served: Sequence[tuple[int, Mapping[str, Json]]]) -> None:
        """Keep an event for the occurrences it may be needed for."""
        kept = tuple((node, values) for node, values in served if self._useful(node))
        if kept:
            self.entries.append(Entry(position, kept))
            for node, _ in kept:
                self._own[node] = position
                self._raise(node, position)

    def has(self, node: int) -> bool:
        """Whether an event was ever kept for a node's own occurrence."""
        return node in self._own

    def _useful(self, node: int) -> bool:
        last = self._own.get(node)
        if last is None:
            return True
        if not self.plan.top_down and any(self._latest.get(child, 0) >= last for child in self.plan.children[node]):
            return True
        for gate, slot in self.starts.chain(node):
            # a later child of an ordered gate comes after the gate's own event too, whatever stands between: it may be silent
            if self.plan.top_down and self._own.get(gate, 0) >= last:
                return True
            if any(self._latest.get(elder, 0) >= last for elder in self.plan.children[gate][:slot]):
                return True
        return False

    def _raise(self, node: int, position: int) -> None:
        agenda = [node]
        while agenda:
            above = agenda.pop()
            if self._latest.get(above) != position:
                self._latest[above] = position
                agenda.extend(self.starts.parents[above])
