"""Listeners, which are notified of the events and verdicts of a run, and what they receive."""

from abc import abstractmethod
from bisect import bisect_left, bisect_right
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from itertools import chain, islice
from operator import attrgetter, itemgetter
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple, Self, TypeAlias

from rvaft.core.fields_to_read import Scope
from rvaft.errors import RvaftError, ToolFailed, ToolMissing
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation
from rvaft.readers.json_lines import BLANK, decode
from rvaft.readers.log import BOM, Log, LogReader, failures_of, source_of
from rvaft.stream.detection import matched_events, unlike
from rvaft.stream.monitor_set import DetectionCount, MonitorSet, Snapshots
from rvaft.support.files import opened
from rvaft.support.plugins import entry_points

GROUP: Final = "rvaft.publishers"
BOUND: Final = 10_000
TraceState: TypeAlias = tuple[tuple[Json, ...] | None, Snapshots, int]
"""The key, the state of the monitors, and the number of events."""


class _Row(NamedTuple):
    """Events in order, each after its number; `first` is that of the first, and `start` how many came in other rows.

    `lines` are those of the events after `before`, or ().
    """

    first: int
    start: int
    events: Sequence[tuple[Any, ...]]
    before: int
    lines: Sequence[int | None]

    def line(self, place: int) -> int | None:
        """Return the line of an event."""
        return self.lines[self.events[place][0] - self.before - 1] if self.lines else None


class EventBuffer:
    """The recent events of one trace by number, for explanations.

    Older events are read again from the regular file `path`, by `reader` unless it is JSON Lines;
    with `late`, only after the run. `reads` are the parts read.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        reads: Scope | None = None,
        reader: LogReader | None = None,
        late: bool = False,
    ) -> None:
        self.path = path
        self.late = late
        self.reads = reads
        self.reader = reader
        self._known: OrderedDict[int, Json] = OrderedDict()  # a dict finds its first key slowly after removals
        self._lines: dict[int, int | None] = {}
        self._rows: list[_Row] = []
        """Later events, in rows as they came, since few of them are ever asked for."""
        self._end = 0
        """The number of events of all rows so far."""

    def remember(self, number: int, event: Json, line: int | None = None) -> None:
        """Keep an event that may become part of a match."""
        self.known[number], self._lines[number] = event, line
        self._shorten()

    def remember_all(
        self, events: Sequence[tuple[Any, ...]], before: int = 0, lines: Sequence[int | None] = ()
    ) -> None:
        """Keep events, each after its number; the numbers follow those so far.

        `lines` are those of the events after `before`. Further values of the tuples are not read.
        """
        self._rows.append(_Row(events[0][0], self._end, events, before, lines))
        self._end += len(events)
        while self._rows[0].start + len(self._rows[0].events) <= self._end - BOUND:
            del self._rows[0]
        self._shorten()

    def _shorten(self) -> None:
        in_rows = self._end - self._rows[0].start if self._rows else 0
        for _ in range(min(len(self._known), len(self._known) + in_rows - BOUND)):
            self._lines.pop(self._known.popitem(last=False)[0], None)

    @property
    def known(self) -> OrderedDict[int, Json]:
        """The events that are kept, by number."""
        self._empty_rows()
        return self._known

    @property
    def lines(self) -> dict[int, int | None]:
        """The lines of the events that are kept."""
        self._empty_rows()
        return self._lines

    def _empty_rows(self) -> None:
        for row in self._rows:
            for place, (number, event, *_) in enumerate(row.events):
                self._known[number], self._lines[number] = event, row.line(place)
        self._rows.clear()
        self._shorten()

    def _find(self, number: int) -> tuple[Json, int | None] | None:
        """Return a kept event with its line."""
        if number in self._known:
            return self._known[number], self._lines.get(number)
        row = bisect_right(self._rows, number, key=attrgetter("first")) - 1
        if row < 0:
            return None
        events, start = self._rows[row].events, self._rows[row].start
        place = bisect_left(events, number, key=itemgetter(0))
        if place == len(events) or events[place][0] != number or start + place < self._end - BOUND:
            return None
        return events[place][1], self._rows[row].line(place)

    def line_of(self, number: int) -> int | None:
        """Return the line of a kept event, or of one that was read again; None if it has no line."""
        found = self._find(number)
        return self._lines.get(number) if found is None else found[1]

    def events(self, numbers: Collection[int], *, ended: bool = False) -> Mapping[int, Json]:
        """Return the available events with these numbers; `ended` after the run."""
        known = {number: found[0] for number in numbers if (found := self._find(number)) is not None}
        missing = set(numbers) - set(known) if ended or not self.late else set()
        if missing and self.path is not None and self.reader is not None:
            with suppress(RvaftError, OSError), source_of(self.reader, str(self.path)) as source:
                log = Log(self.reader, source, str(self.path), self.reads)
                for number, event in islice(enumerate(log.events(), 1), max(missing)):
                    if number in missing:
                        known[number], self._lines[number] = event, log.line_read
        elif missing and self.path is not None:
            with suppress(RvaftError, ValueError, *failures_of(str(self.path))), opened(self.path) as stream:
                first = stream.readline().removeprefix(BOM)
                lines = ((at, line) for at, line in enumerate(chain([first], stream), 1) if line.strip(BLANK))
                for number, (at, line) in enumerate(lines, 1):
                    if number in missing:
                        self._lines[number] = at
                        known[number] = decode(line.removesuffix(b"\n"), reads=self.reads)
                        if len(known) == len(numbers):
                            break
        return known


@dataclass(slots=True, eq=False)
class MonitoredTrace:
    """The monitors of a trace or key, with the number of their events."""

    trace: str
    monitors: MonitorSet
    key: tuple[Json, ...] | None = None
    buffer: EventBuffer = field(default_factory=EventBuffer)
    events: int = 0
    told: int = 0
    """How often the monitors were told something without an event."""

    @property
    def changes(self) -> int:
        """A number that grows with each change of the state, which only events and what is told make."""
        return self.events + self.told

    @property
    def state(self) -> TraceState:
        """The state for `TraceRun.restore`; it changes only together with `changes`."""
        return self.key, self.monitors.snapshot, self.events


def time_told(time: Json | datetime) -> str:
    """Return how a change names a time that monitors were told."""
    return f"time {time.isoformat() if isinstance(time, datetime) else time}"


class VerdictChange:
    """The verdicts changed by one event; or, after event `number`, by a time or the end, which `passed` names."""

    def __init__(
        self,
        watch: MonitoredTrace,
        number: int,
        event: Json,
        columns: Sequence[int],
        line: int | None = None,
        *,
        passed: str = "",
    ) -> None:
        self.passed = passed
        self.watch = watch
        self.number = number
        self.event = event
        self.line = line
        self.columns = columns
        self.verdicts = watch.monitors.verdicts
        self.detected = [column for column in columns if self.verdicts[column] is Verdict.TRUE]
        self.counts = {column: watch.monitors.found[column] for column in self.detected if watch.monitors.repeat}

    @cached_property
    def explanations(self) -> Mapping[int, Explanation]:
        """The explanations of detecting columns, except for backends."""
        found = {column: self.watch.monitors.explanation(column) for column in self.detected}
        return {column: explanation for column, explanation in found.items() if explanation is not None}

    @cached_property
    def events(self) -> Mapping[int, Json]:
        """The available events in the explanations."""
        own = {} if self.passed else {self.number: self.event}
        return {**self.watch.buffer.events(matched_events(self.explanations.values()) - own.keys()), **own}

    @cached_property
    def lines(self) -> Mapping[int, int | None]:
        """The lines, or rows of a table, of `events` in the input; None if it has no lines."""
        known = {number: self.watch.buffer.line_of(number) for number in self.events}
        return known if self.passed else {**known, self.number: self.line}

    @cached_property
    def detections(self) -> Sequence[tuple[Explanation | None, frozenset[Kind], DetectionCount | None]]:
        """The distinct detections: explanation, kinds of the monitors, and count (with repeat).

        Monitors of branches or kinds replace the monitor of the tree.
        """
        parts = [column for column in self.detected if column] or self.detected
        if parts and not self.explanations:
            return [(None, frozenset(), self.counts.get(parts[0]))]
        found: list[tuple[Explanation | None, frozenset[Kind], DetectionCount | None]] = []
        for columns, explanation in unlike({place: one for place, one in self.explanations.items() if place in parts}):
            wholes = [self.watch.monitors.columns[column].part.part_of for column in columns]
            kinds = frozenset(whole.kind for whole in wholes if whole is not None and whole.kind is not None)
            found.append((explanation, kinds, self.counts.get(columns[0])))
        return found


class Listener:
    """A listener that ignores all notifications.

    With `every` it receives every event, with `concerned` relevant events while a verdict may
    change, else only events that change a verdict. With `whole` these events have all fields. Without
    `whole`, and with a single trace, `events` reports a range of events instead of `event` each.
    """

    every = False
    concerned = False
    whole = False
    each_key = True
    """Whether it needs all keys at the end, also those that have detected nothing."""
    reported_before = 0
    """The last event whose detections an earlier run reported."""

    def begin(self, watch: MonitoredTrace) -> None:
        """Called when a trace begins, or at the first event of a key."""

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """Called with an event that changed no verdict, if `every` or `concerned`."""

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:
        """Called with a range of events that did not change these verdicts, if `every`."""

    def change(self, change: VerdictChange) -> None:
        """Called when an event changed verdicts."""

    def end(self, watch: MonitoredTrace) -> None:
        """Called at the regular end of a trace."""

    def stop(self, watch: MonitoredTrace) -> None:
        """Called when a trace cannot be read further."""


class Audience(NamedTuple):
    """The listeners for events without a change: for each, for ranges, for relevant events."""

    each: Sequence[Listener]
    in_rows: Sequence[Listener]
    of_concern: Sequence[Listener]

    @classmethod
    def of(cls, listeners: Iterable[Listener], *, one_by_one: bool) -> "Audience":
        """Sort listeners; `one_by_one` excludes ranges."""
        found = list(listeners)
        every = [listener for listener in found if listener.every]
        each = [listener for listener in every if listener.whole or one_by_one]
        in_rows = [listener for listener in every if listener not in each]
        return cls(each, in_rows, [one for one in found if one.concerned and not one.every])


class Publisher(Listener):
    """A context manager that reports to a file or to clients of a port.

    `name` names the tree in messages, `key` returns the key of a trace, `warn` receives failures.
    """

    url = ""

    @abstractmethod
    def __init__(
        self,
        tree: RVAFT,
        target: str,
        *,
        name: str = "tree",
        key: Callable[[MonitoredTrace], Mapping[str, Json]] = lambda _: {},
        warn: Callable[[str], object] = lambda _: None,
    ) -> None: ...

    @classmethod
    @abstractmethod
    def serves(cls, target: str) -> bool:
        """Whether the target is a port, not a file; raises `OptionError`."""

    @abstractmethod
    def close(self) -> None:
        """Stop the server or finish the file; raises `OSError`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def publisher_class(name: str) -> type[Publisher]:
    """Import the publisher of that name; raises `ToolMissing` and `ToolFailed`."""
    for entry in entry_points(group=GROUP, name=name):
        try:
            made: type[Publisher] = entry.load()
        except Exception as error:
            reason = f"it cannot be loaded: {type(error).__name__}: {error}"
            raise ToolFailed(f"the publisher {name}", reason=reason) from error
        return made
    raise ToolMissing(f"the publisher {name}", remedy="install rvaft again, in a checkout with pip install -e .")
