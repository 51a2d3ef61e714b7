"""Columns (a tree and its branches or kinds) and their monitors, which read the same events.

These are the options (a), (b) and (c) of the paper, section 4.3, with the monitor names of its
Tables 2 and 3.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import KW_ONLY, InitVar, dataclass, replace
from enum import StrEnum
from itertools import islice
from math import inf
from typing import Final, Self, TypeAlias, cast

from rvaft.core.branches import branches
from rvaft.engine.compiled_tree import QUIET, EventClass
from rvaft.engine.monitor import Engine
from rvaft.engine.strategy import BatchEvent, Noted
from rvaft.errors import OptionError, TooLarge, TreeError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor, Ended, Explanation, Monitor, Repetition, twin
from rvaft.rules.validity import valid_part
from rvaft.stream.statistics import EventTypeIndex

MOST: Final = 1_000
_UNKNOWN: Final = Verdict.UNKNOWN


class Per(StrEnum):
    """The parts of a tree with separate verdicts."""

    TREE = "tree"
    BRANCH = "branch"
    KIND = "kind"


@dataclass(frozen=True, slots=True)
class Column:
    """A monitored part: `label` for programs, `title` for people."""

    label: str
    title: str
    part: RVAFT


def columns(tree: RVAFT, per: Per = Per.TREE) -> tuple[Column, ...]:
    """Return the column of a tree or part, then those of its branches or kinds.

    Parts without a feasible scenario have no column. Raises `TreeError`, and `TooLarge` beyond
    `MOST` branches.

    >>> import rvaft
    >>> [column.title for column in columns(rvaft.loads("top or a b; a; b;"), Per.BRANCH)]
    ['φ', 'φ1', 'φ2']
    """
    found = [Column("tree", "φ", valid_part(tree))]
    wanted: list[tuple[str, str, int | None, Kind | None]] = []
    if per is Per.BRANCH:
        numbers = [branch.number for branch in islice(branches(tree), MOST + 1)]
        if len(numbers) > MOST:
            remedy = "take one for each kind with --per kind, or one branch with --branch N"
            raise TooLarge(f"a monitor for each branch of {tree.root}", limit=MOST, remedy=remedy)
        wanted = [(str(number), f"φ{number}", number, None) for number in numbers]
    elif per is Per.KIND:
        present = {node.kind for node in tree.top_down()}
        wanted = [(kind.value, kind.value, None, kind) for kind in Kind if kind in present]
    for label, title, branch, kind in wanted:
        try:
            found.append(Column(label, title, valid_part(tree, branch, kind)))
        except TreeError as infeasible:
            if infeasible.rule != "no-scenario":
                raise
    return tuple(found)


@dataclass(slots=True)
class DetectionCount:
    """The detections of one monitor: count, and event, explanation and time of the last.

    `suppressed` counts the others, `between` those between the last two reports.
    """

    notified: int = 0
    last: int | None = None
    explanation: Explanation | None = None
    time: int | None = None
    suppressed: int = 0
    first_suppressed: int | None = None
    between: int = 0
    _before: int = 0

    def add(self, number: int, time: int | None, cooldown: int | None) -> bool:
        """Count a detection; return whether `cooldown` ns have passed since the last report."""
        if cooldown and time is not None and self.time is not None and abs(time - self.time) < cooldown:
            self.suppressed += 1
            self.first_suppressed = self.first_suppressed or number
            return False
        self.notified += 1
        self.between, self._before = self.suppressed - self._before, self.suppressed
        self.last, self.time = number, self.time if time is None else time
        return True

    @property
    def fields(self) -> dict[str, int]:
        """The counts for JSON output."""
        return {"detection": self.notified, **({"suppressed": self.between} if self.between else {})}


Snapshots: TypeAlias = tuple[list[dict[str, Json]], dict[int, int], list[DetectionCount]]


@dataclass(eq=False)
class MonitorSet:
    """One monitor for each column; the first column is the whole.

    The caller numbers events increasingly, perhaps with gaps. `types` classifies an event once for
    all monitors. `since` maps columns with a final verdict to the deciding event, `found` counts
    detections. After each step:

    - `concerned`: the event is relevant, or may be part of a match;
    - `serves`: an explanation may name the event;
    - `late`: the event came too late for a match.

    With `repeat` monitors restart after each detection, and ⊤ is not final. A detection within
    `cooldown` nanoseconds of the last report of its column is suppressed. Raises `TooLarge` as its
    monitors do, and `OptionError` for a cooldown with a tree without times.
    """

    columns: Sequence[Column]
    make: InitVar[Callable[[RVAFT], Monitor]]
    semantics: Semantics
    _: KW_ONLY
    repeat: bool = False
    cooldown: int | None = None

    def __post_init__(self, make: Callable[[RVAFT], Monitor]) -> None:
        self.time = self.columns[0].part.time
        if self.cooldown is not None and not self.repeat:
            raise OptionError("--cooldown needs --repeat")
        if self.cooldown is not None and self.time is None:
            raise OptionError("--cooldown needs the time of events: add `time FIELD as FORMAT;` to the tree")
        self._projected = self.semantics.projects
        self._strict = self.semantics is Semantics.STRICT
        made = [make(column.part) for column in self.columns]
        self._take_over(tuple(map(Repetition, made)) if self.repeat else tuple(made))
        self.types = EventTypeIndex(self.columns[0].part, [engine.letters for engine in self.engines])
        self.since: dict[int, int] = {}
        self.found = [DetectionCount() for _ in self.columns]
        self.serves = self.concerned = self.late = False
        self.may_be_late = bool(self.engines) and self.time is not None and self.time.late is not None
        self.sees_times = any(engine.sees_times for engine in self.engines)
        """Whether the time of any event may change a verdict."""
        self.counts_all = self._strict or not self.engines or self.sees_times
        """Whether any event may change a verdict."""
        self.skips_irrelevant = self._projected and bool(self.engines)
        """Whether irrelevant events change nothing."""
        self.skips_irrelevant &= not any(engine.sees_irrelevant for engine in self.engines)
        self._live = tuple(range(len(self.monitors)))
        self._resting: tuple[int, ...] = ()
        """The columns that restart with the next event."""

    def _take_over(self, monitors: tuple[Monitor, ...]) -> None:
        self.monitors = monitors
        current = [monitor.current if isinstance(monitor, Repetition) else monitor for monitor in monitors]
        engines = tuple(monitor for monitor in current if isinstance(monitor, Engine))
        self.engines = engines if len(engines) == len(monitors) else ()
        """The monitors, if all are engines, else ()."""
        self.evaluate_prefixes = any(isinstance(monitor, DetectionMonitor) for monitor in current)
        """Whether a monitor evaluates all events after each event that was not announced."""
        if self.engines:
            self._read = self.engines[0].read

    def fork(self) -> Self:
        """Return independent monitors in the same state."""
        made = twin(self)
        made._take_over(tuple(monitor.fork() for monitor in self.monitors))  # noqa: SLF001
        made.since = dict(self.since)
        made.found = [replace(count) for count in self.found]
        return made

    @classmethod
    def beside(cls, sets: Sequence["MonitorSet"]) -> "MonitorSet":
        """Return a read-only union of several sets."""
        if len(sets) == 1:
            return sets[0]
        one = copy(sets[0])
        one.columns = [column for some in sets for column in some.columns]
        one.monitors = tuple(monitor for some in sets for monitor in some.monitors)
        one.found = [count for some in sets for count in some.found]
        one.since = {at: some.since[0] for at, some in enumerate(sets) if 0 in some.since}
        return one

    @property
    def snapshot(self) -> Snapshots:
        """The state for `resumed`; for engines only."""
        return [engine.snapshot() for engine in self.engines], self.since, self.found

    def resumed(self, snapshot: Snapshots) -> Self:
        """Return a copy of these fresh monitors in the state of a snapshot."""
        twin = self.fork()
        states, twin.since, twin.found = snapshot
        for engine, state in zip(twin.engines, states, strict=True):
            engine.restore(state)
        twin._live = tuple(column for column in self._live if column not in twin.since)  # noqa: SLF001
        twin._resting = tuple(column for column in twin._live if twin.engines[column].verdict.final)  # noqa: SLF001
        return twin

    def expect(self, events: Sequence[Json]) -> None:
        """Announce the next events to the monitors."""
        for monitor in self.monitors:
            monitor.expect(events)

    def begin_again(self) -> None:
        """Restart the monitors that have detected."""
        if self._resting:
            for column in self._resting:
                cast("Repetition", self.monitors[column]).begin_again()
            self._resting = ()
            self._take_over(self.monitors)

    def step(
        self, event: Json, number: int, classes: Sequence[EventClass] | None = None, *, late: bool | None = None
    ) -> Sequence[int]:
        """Read one event of these classes and return the columns whose verdict changed.

        `late` is what `is_late` of the first engine returned, or None if it was not called.
        """
        self.serves = False
        if self._resting:
            self.begin_again()
        engines = self.engines
        if not engines:
            self.concerned = True
            for column in self._live:
                self.monitors[column].step(event)
            return self._changed(number, event)
        if self.may_be_late:
            self.late = engines[0].is_late(event, number) if late is None else late
            for column in self._live:
                if engines[column].latest != engines[0].latest:
                    engines[column].reach(engines[0].latest)
            if self.late:
                classes = self.types.late.classes
        if classes is None:
            classes = self.types.of(event).classes
        if not self._live and self._projected:
            self.concerned = classes[0].relevant
            return ()
        reading = self._read(event, classes[0])
        if reading is QUIET and (not self._live or self._live[-1] == 0):
            self.concerned = True
            return ()
        concerned = self.concerned = reading.relevant if self._projected else bool(reading.hits)
        if not (concerned or self._strict or (reading.hits and not self.skips_irrelevant)):
            return ()
        final = serves = False
        for column in self._live:
            engine = engines[column]
            if engine.take(engine.read(event, classes[column]) if column else reading, number) is not _UNKNOWN:
                final = True
            serves = serves or engine.noted
        self.serves = serves and bool(reading.hits)
        return self._changed(number, event) if final else ()

    def told(self, tell: Callable[[Monitor], Verdict], number: int) -> Sequence[int]:
        """Tell the monitors something without an event; return the columns whose verdict changed."""
        self.begin_again()
        for column in self._live:
            tell(self.monitors[column])
        return self._changed(number, {})

    @property
    def deadline(self) -> float:
        """The least time after which a time decides a verdict; infinite if there is none."""
        return min((self.engines[column].deadline for column in self._live), default=inf) if self.engines else inf

    def step_all(self, events: Iterator[BatchEvent], noted: Noted) -> Sequence[int]:
        """Read events, none late, up to the first that changes a verdict; return the changed columns, () at the end.

        The caller sets the maximum event time.
        """
        while self._live == (0,) and self.engines and not self._strict:
            if self._resting:
                self.begin_again()
            last = self.engines[0].take_all(events, noted)
            if last is None:
                return ()
            if changed := self._changed(*last[:2]):
                return changed
        for one in events:
            if changed := self.step_one(one, noted):
                return changed
        return ()

    def step_one(self, one: BatchEvent, noted: Noted) -> Sequence[int]:
        """As `step_all`, for one event."""
        number, event, classes, _, watermark = one
        if self._live == (0,) and self.engines and not self._strict:
            if self._resting:
                self.begin_again()
            return () if self.engines[0].take_one(one, noted) is _UNKNOWN else self._changed(number, event)
        if watermark is not None:
            for engine in self.engines:
                engine.forget(watermark)
        changed = self.step(event, number, classes, late=False)
        if self.concerned:
            noted.concerned.append(one)
        if self.serves:
            noted.served.append(one)
        return changed

    def reach(self, latest: int | None) -> None:
        """Set the maximum event time of all monitors."""
        for column in {0, *self._live}:
            if self.engines[column].latest != latest:
                self.engines[column].reach(latest)

    @property
    def until(self) -> float:
        """The greatest time of an event that can matter together with those so far, if none has detected."""
        if not self.engines or self.since or any(count.last or count.suppressed for count in self.found):
            return inf
        return max(engine.until for engine in self.engines)

    @property
    def live_columns(self) -> tuple[int, ...]:
        """The columns whose verdict may still change."""
        return self._live

    @property
    def rests(self) -> bool:
        """Whether some monitors restart with the next event."""
        return bool(self._resting)

    def _changed(self, number: int, event: Json) -> Sequence[int]:
        """Return the columns that detected, or whose verdict became final."""
        changed, suppressed = [], []
        for column in self._live:
            verdict = self.monitors[column].verdict
            if verdict is _UNKNOWN:
                continue
            if verdict is Verdict.TRUE:
                time = None if self.time is None or self.cooldown is None else self.time.read(event)
                if not self.found[column].add(number, time, self.cooldown):
                    suppressed.append(column)
                    continue
            changed.append(column)
            if verdict is Verdict.FALSE or not self.repeat:
                self.since[column] = number
        if suppressed:
            self._resting = tuple(suppressed)
            self.begin_again()
        if changed:
            self._live = tuple(column for column in self._live if column not in self.since)
            self._resting = tuple(column for column in changed if column not in self.since)
        return changed

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The current verdict of each column."""
        return tuple(monitor.verdict for monitor in self.monitors)

    @property
    def live(self) -> bool:
        """Whether some verdict may still change."""
        return bool(self._live)

    def explanation(self, column: int) -> Explanation | None:
        """The explanation of a detection in that column; None for backends."""
        return self.monitors[column].explanation

    def ended(self, column: int) -> Ended | None:
        """Why the column can no longer detect; None if unknown."""
        try:
            return self.monitors[column].ended
        except TooLarge:
            return None
