"""What has a verdict of its own, the tree and beside it each of its branches or kinds, and their
monitors, which read the same events.

These are the options (a), (b) and (c) of the paper, section 4.3, with the names that its Tables 2
and 3 give to the monitors.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import KW_ONLY, InitVar, dataclass, replace
from enum import StrEnum
from itertools import islice
from typing import Final, Self, TypeAlias, cast

from rvaft.api import narrowed
from rvaft.core.branches import branches
from rvaft.engine.compiled_tree import QUIET
from rvaft.engine.monitor import Engine
from rvaft.errors import OptionError, TooLarge, TreeError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Ended, Explanation, Monitor, Repetition
from rvaft.stream.statistics import EventKind, EventTypeIndex

MOST: Final = 1_000
"""How many branches are monitored one by one."""
_UNKNOWN: Final = Verdict.UNKNOWN  # looked up for every event


class Per(StrEnum):
    """What has a verdict of its own."""

    TREE = "tree"
    BRANCH = "branch"
    KIND = "kind"


@dataclass(frozen=True, slots=True)
class Column:
    """One monitor: `label` for programs (`tree`, the number of a branch, a kind), `title` for
    people, and what it monitors.
    """

    label: str
    title: str
    part: RVAFT


def columns(tree: RVAFT, per: Per = Per.TREE) -> tuple[Column, ...]:
    """The monitor of a tree (or of the part of one), and beside it those of its branches, from 1,
    or of the kinds that it has.

    A part without a feasible scenario, where nothing can ever be detected, has none. Raises
    `TreeError` for a tree that breaks a rule, and `TooLarge` beyond `MOST` branches.

    >>> import rvaft
    >>> [column.title for column in columns(rvaft.loads("top or a b; a; b;"), Per.BRANCH)]
    ['φ', 'φ1', 'φ2']
    """
    found = [Column("tree", "φ", narrowed(tree))]
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
            found.append(Column(label, title, narrowed(tree, branch, kind)))
        except TreeError as infeasible:
            if infeasible.rule != "no-scenario":
                raise
    return tuple(found)


@dataclass(slots=True)
class DetectionCount:
    """What one monitor has detected: how many detections were reported, the event of the last, how it
    came about and when that was.

    Others were `suppressed`: so many, the first of them at that event, and so many `between` the
    last two that were reported.
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
        """Count the detection at the event of that number, and say whether it is reported.

        It is not where its time is less than `cooldown` from that of the last one that was reported.
        """
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
        """The number of the last detection, and how many before it were suppressed, as JSON has it."""
        return {"detection": self.notified, **({"suppressed": self.between} if self.between else {})}


Snapshots: TypeAlias = tuple[list[dict[str, Json]], dict[int, int], list[DetectionCount]]
"""The snapshots of the engines, the numbers of the events that made verdicts final, and the counts of detections."""


@dataclass(eq=False)
class MonitorSet:
    """One monitor for each column; the first is that of the whole.

    Events have the numbers that the caller gives them, which rise, and may leave some out:
    explanations name events by these numbers. `types` says what events are to the tree: one look-up
    serves the counts and all monitors. `since` has, for each column whose verdict is final, the
    number of the event that made it so. `concerned` says whether the last event was relevant to the
    tree, or may be part of a match all the same, `serves` whether an explanation may name it,
    `late` whether it came too late for any. `found` counts the detections of each column.

    With `repeat` monitors begin afresh after each detection, and true is no final verdict; for
    `cooldown` nanoseconds after one that was reported others of the same column are suppressed:
    counted, and otherwise as if nothing had been detected. Raises `TooLarge` as its monitors do,
    and `OptionError` for a cooldown of a tree without times.
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
        self.counts_all = self._strict or not self.engines
        """Whether an event that fits nothing may change a verdict."""
        self._live = tuple(range(len(self.monitors)))
        self._resting: tuple[int, ...] = ()
        """The columns that detected with the last event and begin afresh with the next."""

    def _take_over(self, monitors: tuple[Monitor, ...]) -> None:
        self.monitors = monitors
        current = (monitor.current if isinstance(monitor, Repetition) else monitor for monitor in monitors)
        engines = tuple(monitor for monitor in current if isinstance(monitor, Engine))
        self.engines = engines if len(engines) == len(monitors) else ()
        """The same where all are engines, else none."""
        if self.engines:
            self._read = self.engines[0].read

    def fork(self) -> Self:
        """Independent monitors that have read the same events."""
        twin = copy(self)
        twin._take_over(tuple(monitor.fork() for monitor in self.monitors))  # noqa: SLF001 (its own)
        twin.since = dict(self.since)
        twin.found = [replace(count) for count in self.found]
        return twin

    @classmethod
    def beside(cls, sets: Sequence["MonitorSet"]) -> "MonitorSet":
        """The monitors of several sets, which step them, as one that is only looked at."""
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
        """What `resumed` needs to go on from here; for engines alone."""
        return [engine.snapshot() for engine in self.engines], self.since, self.found

    def resumed(self, snapshot: Snapshots) -> Self:
        """A copy of these monitors, which have read nothing, that goes on from a snapshot."""
        twin = self.fork()
        states, twin.since, twin.found = snapshot
        for engine, state in zip(twin.engines, states, strict=True):
            engine.restore(state)
        twin._live = tuple(column for column in self._live if column not in twin.since)  # noqa: SLF001 (its own)
        twin._resting = tuple(column for column in twin._live if twin.engines[column].verdict.final)  # noqa: SLF001
        return twin

    def begin_again(self) -> None:
        """Let the monitors that repeat and have detected with the last event begin afresh."""
        if self._resting:
            for column in self._resting:
                cast("Repetition", self.monitors[column]).begin_again()
            self._resting = ()
            self._take_over(self.monitors)

    def step(self, event: Json, number: int, event_kind: EventKind | None = None) -> Sequence[int]:
        """Read one event and return the columns whose verdict it changed; `event_kind` is what `types` says of it."""
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
            self.late = engines[0].is_late(event)
            for column in self._live:
                if engines[column].latest != engines[0].latest:
                    engines[column].pass_time(engines[0].latest)
            if self.late:
                event_kind = self.types.late
        classes = (event_kind or self.types.of(event)).classes
        if not self._live and self._projected:
            self.concerned = classes[0].relevant
            return ()
        reading = self._read(event, classes[0])
        if reading is QUIET and (not self._live or self._live[-1] == 0):
            self.concerned = True
            return ()
        concerned = self.concerned = reading.relevant if self._projected else bool(reading.hits)
        if not (concerned or self._strict):
            return ()
        final = serves = False
        for column in self._live:
            engine = engines[column]
            verdict = engine.take(engine.read(event, classes[column]) if column else reading, number)
            final = final or verdict is not _UNKNOWN
            serves = serves or engine.noted
        self.serves = serves and bool(reading.hits)
        return self._changed(number, event) if final else ()

    @property
    def live_columns(self) -> tuple[int, ...]:
        """The columns whose verdict may still change."""
        return self._live

    @property
    def rests(self) -> bool:
        """Whether monitors begin afresh with the next event."""
        return bool(self._resting)

    def _changed(self, number: int, event: Json) -> Sequence[int]:
        """The columns that detected with the event of that number, or whose verdict it made final."""
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
        """After ⊥ in that column, how its last hope ended, where the monitor knows the tree and
        what it waited for is not too much to say.
        """
        try:
            return self.monitors[column].ended
        except TooLarge:
            return None
