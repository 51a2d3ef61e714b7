"""The monitors of all columns, reading the same events."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Self, cast

from rvaft.engine.monitor import Engine
from rvaft.errors import TooLarge
from rvaft.monitoring.columns import Column
from rvaft.monitors import Ended, Explanation, Monitor
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict


class Bank:
    """One monitor for each column; the first is that of the whole.

    Events have the numbers that the caller gives them, which rise, and may leave some out: explanations name events by these numbers.
    Raises `TooLarge` as its monitors do.
    """

    def __init__(self, columns: Sequence[Column], make: Callable[[RVAFT], Monitor], semantics: Semantics) -> None:
        self.columns = tuple(columns)
        self.monitors: tuple[Monitor, ...] = tuple(make(column.part) for column in columns)
        self.since: dict[int, int] = {}
        """For each column whose verdict is final the number of the event that made it so."""
        self.semantics = semantics
        self.serves = False
        """Whether an explanation may name the last event."""
        self.concerned = False
        """Whether the last event was relevant to the tree, or may be part of a match all the same."""
        self._live = tuple(range(len(self.monitors)))
        self._read = 0
        # Under `strict` every event counts, so numbers cannot be skipped; a match is short there.
        self._numbers: list[int] | None = [] if semantics is Semantics.STRICT else None

    def fork(self) -> Self:
        """An independent bank that has read the same events."""
        twin = copy(self)
        twin.monitors = tuple(monitor.fork() for monitor in self.monitors)
        twin.since = dict(self.since)
        vars(twin)["_numbers"] = None if self._numbers is None else list(self._numbers)
        return twin

    def step(self, event: Json, number: int) -> Sequence[int]:
        """Read one event and return the columns whose verdict it changed."""
        self.serves = False
        first = self.monitors[0]
        if not isinstance(first, Engine):
            self.concerned = True
            for column in self._live:
                self.monitors[column].step(event)
            return self.changes(number)
        reading = first.read(event)
        self.concerned = bool(reading.relevant if self.semantics is Semantics.PROJECTED else reading.hits)
        if not self._live:
            return ()
        if self._numbers is not None:
            self._numbers.append(number)
        elif not self.concerned:
            return ()
        else:
            passed_over = number - 1 - self._read
            self._read = number
            for column in self._live if passed_over else ():
                engine = self.monitors[column]
                assert isinstance(engine, Engine)
                engine.skip(passed_over)
        for column in self._live:
            if column:
                self.monitors[column].step(event)
            else:
                first.take(reading)
        if reading.hits:
            self.serves = any(cast("Engine", self.monitors[column]).noted for column in self._live)
        return self.changes(number)

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
        found = self.monitors[column].explanation
        if found is None:
            return None
        matched = {node: self._number(position) for node, position in found.matched.items()}
        return replace(found, matched=matched)

    def ended(self, column: int) -> Ended | None:
        """After ⊥ in that column, how its last hope ended, where the monitor knows the tree and what it waited for is not too much to say."""
        try:
            found = self.monitors[column].ended
        except TooLarge:
            return None
        return None if found is None else Ended(self._number(found.event), found.pending)

    def _number(self, position: int) -> int:
        return position if self._numbers is None else self._numbers[position - 1]
