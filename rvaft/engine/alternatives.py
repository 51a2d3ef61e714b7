"""A property of which one of several alternatives has to be observed: one strategy for each."""

from collections.abc import Hashable, Mapping, Sequence
from copy import copy
from typing import Any, Self

from rvaft.engine.compiled_tree import NOTHING, EventClass, Reading, TreeLetters
from rvaft.engine.explanation import explain, pending, together
from rvaft.engine.partial_matches import Following
from rvaft.engine.scattered_linear import LinearMonitor
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation, Pending


class Alternatives:
    """The strategies of alternatives side by side: true where one of them is, false where all are.

    `letters` are those of all alternatives together, which say of an event whether it can concern any.
    """

    def __init__(self, letters: TreeLetters, parts: Sequence[Following | LinearMonitor]) -> None:
        self.letters = letters
        self.parts = tuple(parts)
        self.verdicts = [Verdict.UNKNOWN] * len(self.parts)
        self._last = self.verdicts

    @property
    def noted(self) -> bool:
        """Whether the last event may be part of a match."""
        return any(strategy.noted for strategy in self.parts)

    def read(self, event: Mapping[str, Json], event_class: EventClass | None = None) -> Reading:
        """What an event means to each."""
        if not (self.letters.classify(event) if event_class is None else event_class).letters:
            return NOTHING
        readings = [strategy.read(event) for strategy in self.parts]
        return Reading(any(one.relevant for one in readings), readings if any(one.hits for one in readings) else ())

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        self._last = list(self.verdicts)
        for number, strategy in enumerate(self.parts):
            if self.verdicts[number] is Verdict.UNKNOWN:
                own = reading.hits[number] if reading.hits else Reading(reading.relevant, ())
                self.verdicts[number] = strategy.advance(own, position)
        if Verdict.TRUE in self.verdicts:
            return Verdict.TRUE
        return Verdict.UNKNOWN if Verdict.UNKNOWN in self.verdicts else Verdict.FALSE

    def forget(self, floor: int) -> None:
        """No event with an earlier time than this will count any more."""
        for strategy in self.parts:
            strategy.forget(floor)

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        twin.parts = tuple(strategy.fork() for strategy in self.parts)
        twin.verdicts = list(self.verdicts)
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        pairs = zip(self.verdicts, self.parts, strict=True)
        return tuple(strategy.state if verdict is Verdict.UNKNOWN else verdict for verdict, strategy in pairs)

    def snapshot(self) -> tuple[list[Verdict], list[Verdict], list[Any]]:
        """What `restore` needs to bring fresh strategies of the same property into this state."""
        return list(self.verdicts), self._last, [strategy.snapshot() for strategy in self.parts]

    def restore(self, snapshot: tuple[list[Verdict], list[Verdict], list[Any]]) -> None:
        """Take over a snapshot."""
        verdicts, self._last, states = snapshot
        self.verdicts = list(verdicts)
        for strategy, state in zip(self.parts, states, strict=True):
            strategy.restore(state)

    def explanation(self) -> Explanation:
        """After detection, one match of the lowest-numbered branch that has one."""
        pairs = zip(self.verdicts, self.parts, strict=True)
        found = [explain(strategy) for verdict, strategy in pairs if verdict is Verdict.TRUE]
        return min(found, key=lambda one: (one.branch is None, one.branch or 0))

    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:
        """What each live branch waits for; with `before`, what was waited for before the event of that number."""
        verdicts = self.verdicts if before is None else self._last
        found = [
            one
            for verdict, strategy in zip(verdicts, self.parts, strict=True)
            if verdict is Verdict.UNKNOWN
            for one in pending(strategy, limit=limit, before=before)
        ]
        return tuple(sorted(together(found), key=lambda one: (one.branch is None, one.branch or 0)))
