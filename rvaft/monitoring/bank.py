"""The monitors of all columns, reading the same events."""

from collections.abc import Callable, Sequence
from copy import copy
from typing import Final, Self

from rvaft.engine.monitor import Engine
from rvaft.errors import TooLarge
from rvaft.monitoring.columns import Column
from rvaft.monitors import Ended, Explanation, Monitor
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

_UNKNOWN: Final = Verdict.UNKNOWN  # looked up for every event


class Bank:
    """One monitor for each column; the first is that of the whole.

    Events have the numbers that the caller gives them, which rise, and may leave some out: explanations name events by these numbers.
    Raises `TooLarge` as its monitors do.
    """

    def __init__(self, columns: Sequence[Column], make: Callable[[RVAFT], Monitor], semantics: Semantics) -> None:
        self.columns = tuple(columns)
        self.monitors: tuple[Monitor, ...] = tuple(make(column.part) for column in columns)
        self._engines = _engines(self.monitors)
        self.since: dict[int, int] = {}
        """For each column whose verdict is final the number of the event that made it so."""
        self.semantics = semantics
        self._projected = semantics is Semantics.PROJECTED
        self._strict = semantics is Semantics.STRICT
        self.serves = False
        """Whether an explanation may name the last event."""
        self.concerned = False
        """Whether the last event was relevant to the tree, or may be part of a match all the same."""
        self._live = tuple(range(len(self.monitors)))

    def fork(self) -> Self:
        """An independent bank that has read the same events."""
        twin = copy(self)
        twin.monitors = tuple(monitor.fork() for monitor in self.monitors)
        vars(twin)["_engines"] = _engines(twin.monitors)
        twin.since = dict(self.since)
        return twin

    def step(self, event: Json, number: int) -> Sequence[int]:
        """Read one event and return the columns whose verdict it changed."""
        self.serves = False
        engines = self._engines
        if not engines:
            self.concerned = True
            for column in self._live:
                self.monitors[column].step(event)
            return self.changes(number)
        reading = engines[0].read(event)
        concerned = self.concerned = reading.relevant if self._projected else bool(reading.hits)
        if not self._live or not (concerned or self._strict):
            return ()
        if len(engines) == 1:
            final = engines[0].take(reading, number) is not _UNKNOWN
            self.serves = concerned and engines[0].noted
            return self.changes(number) if final else ()
        final = serves = False
        for column in self._live:
            engine = engines[column]
            verdict = engine.take(engine.read(event) if column else reading, number)
            final = final or verdict is not _UNKNOWN
            serves = serves or engine.noted
        self.serves = serves and bool(reading.hits)
        return self.changes(number) if final else ()

    def changes(self, number: int) -> Sequence[int]:
        """The columns whose verdict the event of that number changed, for who has given it to the monitors himself."""
        changed = [column for column in self._live if self.monitors[column].verdict is not Verdict.UNKNOWN]
        if changed:
            self.since.update(dict.fromkeys(changed, number))
            self._live = tuple(column for column in self._live if column not in self.since)
        return changed

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The verdict of each column so far."""
        return tuple(monitor.verdict for monitor in self.monitors)

    @property
    def live(self) -> bool:
        """Whether some verdict may still change."""
        return bool(self._live)

    def explanation(self, column: int) -> Explanation | None:
        """After ⊤ in that column, how it was detected, where the monitor knows the tree."""
        return self.monitors[column].explanation

    def ended(self, column: int) -> Ended | None:
        """After ⊥ in that column, how its last hope ended, where the monitor knows the tree and what it waited for is not too much to say."""
        try:
            return self.monitors[column].ended
        except TooLarge:
            return None


def _engines(monitors: Sequence[Monitor]) -> tuple[Engine, ...]:
    found = tuple(monitor for monitor in monitors if isinstance(monitor, Engine))
    return found if len(found) == len(monitors) else ()
