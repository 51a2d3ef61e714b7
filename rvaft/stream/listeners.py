"""Listeners, which are notified of the events and verdicts of a run, and what they receive."""

from abc import abstractmethod
from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self, TypeAlias

from rvaft.core.classifier import Scope
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
        self._new: deque[tuple[Sequence[tuple[int, Json]], int, Sequence[int | None]]] = deque()
        """The events since the last look at them: they are many, and most are never asked for."""
        self._size = 0
        """The number of new events."""

    def remember(self, number: int, event: Json, line: int | None = None) -> None:
        """Keep an event that may become part of a match."""
        self.remember_all([(number, event)], number - 1, [line])

    def remember_all(
        self, events: Sequence[tuple[int, Json]], before: int = 0, lines: Sequence[int | None] = ()
    ) -> None:
        """Keep numbered events that may become part of a match; `lines` are those of the events after `before`."""
        self._new.append((events, before, lines))
        self._size += len(events)
        while self._size - len(self._new[0][0]) >= BOUND:
            self._size -= len(self._new.popleft()[0])

    @property
    def known(self) -> OrderedDict[int, Json]:
        """The events that are kept, by number."""
        self._look()
        return self._known

    @property
    def lines(self) -> dict[int, int | None]:
        """The lines of the events that are kept."""
        self._look()
        return self._lines

    def _look(self) -> None:
        for events, before, lines in self._new:
            for number, event, *_ in events:
                self._known[number] = event
                self._lines[number] = lines[number - before - 1] if lines else None
        self._new.clear()
        self._size = 0
        for _ in range(len(self._known) - BOUND):
            self._lines.pop(self._known.popitem(last=False)[0], None)

    def events(self, numbers: Collection[int], *, ended: bool = False) -> Mapping[int, Json]:
        """Return the available events with these numbers; `ended` after the run."""
        kept = self.known
        known = {number: kept[number] for number in numbers if number in kept}
        missing = set(numbers) - set(known) if ended or not self.late else set()
        if missing and self.path is not None and self.reader is not None:
            with suppress(RvaftError, OSError), source_of(self.reader, str(self.path)) as source:
                log = Log(self.reader, source, str(self.path), self.reads)
                for number, event in islice(enumerate(log.events(), 1), max(missing)):
                    if number in missing:
                        known[number], self.lines[number] = event, log.line_read
        elif missing and self.path is not None:
            with suppress(RvaftError, ValueError, *failures_of(str(self.path))), opened(self.path) as stream:
                first = stream.readline().removeprefix(BOM)
                lines = ((at, line) for at, line in enumerate(chain([first], stream), 1) if line.strip(BLANK))
                for number, (at, line) in enumerate(lines, 1):
                    if number in missing:
                        self.lines[number] = at
                        known[number] = decode(line.removesuffix(b"\n"), reads=self.reads)
                        if len(known) == len(numbers):
                            break
        return known


@dataclass(slots=True)
class MonitoredTrace:
    """The monitors of a trace or key, with the number of their events."""

    trace: str
    monitors: MonitorSet
    key: tuple[Json, ...] | None = None
    buffer: EventBuffer = field(default_factory=EventBuffer)
    events: int = 0

    @property
    def state(self) -> TraceState:
        """The state for `TraceRun.restore`; it changes only together with `events`."""
        return self.key, self.monitors.snapshot, self.events


class VerdictChange:
    """The verdicts changed by one event."""

    def __init__(
        self, watch: MonitoredTrace, number: int, event: Json, columns: Sequence[int], line: int | None = None
    ) -> None:
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
        wanted = matched_events(self.explanations.values()) - {self.number}
        return {**self.watch.buffer.events(wanted), self.number: self.event}

    @cached_property
    def lines(self) -> Mapping[int, int | None]:
        """The lines, or rows of a table, of `events` in the input; None if it has no lines."""
        known = {number: self.watch.buffer.lines.get(number) for number in self.events}
        return {**known, self.number: self.line}

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
