"""The strategy of a property with several alternatives: one strategy per alternative."""

from collections.abc import Collection, Hashable, Mapping, Sequence
from copy import copy
from itertools import chain
from typing import Any, Self

from rvaft.core.classifier import GuardTable, joined_tables
from rvaft.engine.compiled_tree import NOTHING, EngineLetters, EventClass, Reading
from rvaft.engine.explanation import together
from rvaft.engine.strategy import Measured, Strategy
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation, Pending


class AlternativeLetters(EngineLetters):
    """The letters of several alternatives, with a class per alternative."""

    def __init__(self, letters: Sequence[EngineLetters]) -> None:
        self._letters = letters
        super().__init__(dict.fromkeys(pattern for one in letters for pattern in one.patterns))

    def table(self, possible: Collection[Pattern]) -> GuardTable[EventClass]:
        """Return the table from events to classes."""

        def join(parts: tuple[EventClass, ...]) -> EventClass:
            serving = tuple(chain.from_iterable(one.serving for one in parts))
            return EventClass(serving, any(one.relevant for one in parts), parts=parts)

        return joined_tables([one.table(possible) for one in self._letters], join)


class Alternatives(Strategy):
    """The strategies of the alternatives: true if one is true, false if all are false."""

    def __init__(self, parts: Sequence[Measured]) -> None:
        self.letters = AlternativeLetters([one.letters for one in parts])
        self.parts = tuple(parts)
        self.verdicts = [Verdict.UNKNOWN] * len(self.parts)
        self._last = self.verdicts

    @property
    def noted(self) -> bool:  # type: ignore[override]
        """Whether the last event may be part of a match."""
        return any(strategy.noted for strategy in self.parts)

    @property
    def joins(self) -> bool:  # type: ignore[override]
        """Whether events are joined with many partial matches.

        Without `late` in all alternatives: the others also decide which events the monitor regards.
        """
        joined = [strategy.joins for strategy in self.parts]
        time = self.parts[0].compiled.prop.time
        return any(joined) and (all(joined) or (time is not None and time.late is not None))

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the readings by the alternatives."""
        if not event_class.serving and not event_class.relevant:
            return NOTHING
        readings = [one.read(event, own) for one, own in zip(self.parts, event_class.parts, strict=True)]
        return Reading(event_class.relevant, readings if any(one.hits for one in readings) else ())

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        self._last = list(self.verdicts)
        for number, strategy in enumerate(self.parts):
            if self.verdicts[number] is Verdict.UNKNOWN:
                own = reading.hits[number] if reading.hits else Reading(reading.relevant, ())
                self.verdicts[number] = strategy.advance(own, position)
        if Verdict.TRUE in self.verdicts:
            return Verdict.TRUE
        return Verdict.UNKNOWN if Verdict.UNKNOWN in self.verdicts else Verdict.FALSE

    def forget(self, watermark: int) -> None:
        """Set the watermark."""
        for strategy in self.parts:
            strategy.forget(watermark)

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = copy(self)
        twin.parts = tuple(strategy.fork() for strategy in self.parts)
        twin.verdicts = list(self.verdicts)
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        pairs = zip(self.verdicts, self.parts, strict=True)
        return tuple(strategy.state if verdict is Verdict.UNKNOWN else verdict for verdict, strategy in pairs)

    def snapshot(self) -> object:
        """Return the state for `restore`."""
        return list(self.verdicts), self._last, [strategy.snapshot() for strategy in self.parts]

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same property."""
        verdicts, self._last, states = snapshot
        self.verdicts = list(verdicts)
        for strategy, state in zip(self.parts, states, strict=True):
            strategy.restore(state)

    def explain(self) -> Explanation:
        """Return a match of the lowest-numbered branch."""
        pairs = zip(self.verdicts, self.parts, strict=True)
        found = [strategy.explain() for verdict, strategy in pairs if verdict is Verdict.TRUE]
        return min(found, key=lambda one: (one.branch is None, one.branch or 0))

    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:
        """Return the awaited events of each live branch."""
        verdicts = self.verdicts if before is None else self._last
        found = [
            one
            for verdict, strategy in zip(verdicts, self.parts, strict=True)
            if verdict is Verdict.UNKNOWN
            for one in strategy.pending(limit, before=before)
        ]
        return tuple(sorted(together(found), key=lambda one: (one.branch is None, one.branch or 0)))
