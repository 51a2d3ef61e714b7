"""Listeners: who is notified of what happens in a trace, and what they see of it."""

from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import entry_points
from itertools import chain, islice
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

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
from rvaft.stream.monitor_set import DetectionCount, MonitorSet
from rvaft.support.files import opened

GROUP: Final = "rvaft.publishers"
BOUND: Final = 10_000
"""How many events are remembered for explanations."""


class EventBuffer:
    """The events of one trace, by their numbers, that explanations may name.

    The latest that may become part of a match are `known`. Others are looked up in a regular file,
    `path`, whose events are numbered as they stand; in a stream they are gone. `reads` is what was
    read of them, by that `reader` if not by lines of JSON.
    """

    def __init__(
        self, path: Path | None = None, *, reads: Scope | None = None, reader: LogReader | None = None
    ) -> None:
        self.path = path
        self.reads = reads
        self.reader = reader
        self.known: OrderedDict[int, Json] = OrderedDict()  # a dict looks for its first key among all that were removed

    def remember(self, number: int, event: Json) -> None:
        """An event that may become part of a match."""
        if len(self.known) >= BOUND:
            self.known.popitem(last=False)
        self.known[number] = event

    def events(self, numbers: Collection[int]) -> Mapping[int, Json]:
        """The events with these numbers, as far as they are known; what has changed in the file
        since it was read is left out.
        """
        known = {number: self.known[number] for number in numbers if number in self.known}
        missing = set(numbers) - set(known)
        if missing and self.path is not None and self.reader is not None:
            with suppress(RvaftError, OSError), source_of(self.reader, str(self.path)) as source:
                found = enumerate(Log(self.reader, source, str(self.path), self.reads).events(), 1)
                known.update((number, event) for number, event in islice(found, max(missing)) if number in missing)
        elif missing and self.path is not None:
            with suppress(RvaftError, ValueError, *failures_of(str(self.path))), opened(self.path) as stream:
                first = stream.readline().removeprefix(BOM)
                lines = (line for line in chain([first], stream) if line.strip(BLANK))
                for number, line in enumerate(lines, 1):
                    if number in missing:
                        known[number] = decode(line.removesuffix(b"\n"), reads=self.reads)
                        if len(known) == len(numbers):
                            break
        return known


@dataclass(slots=True)
class MonitoredTrace:
    """The monitors of one trace, or of one value of a key in it, and how many events they were given."""

    trace: str
    monitors: MonitorSet
    key: tuple[Json, ...] | None = None
    buffer: EventBuffer = field(default_factory=EventBuffer)
    events: int = 0


class VerdictChange:
    """What one event changed: the columns whose verdict is another, those of them that detect, and
    how that came about.
    """

    def __init__(self, watch: MonitoredTrace, number: int, event: Json, columns: Sequence[int]) -> None:
        self.watch = watch
        self.number = number
        self.event = event
        self.columns = columns
        self.verdicts = watch.monitors.verdicts
        self.detected = [column for column in columns if self.verdicts[column] is Verdict.TRUE]
        self.counts = {column: watch.monitors.found[column] for column in self.detected if watch.monitors.repeat}
        """Where monitors repeat, for each column that detects its detections with this one."""

    @cached_property
    def explanations(self) -> Mapping[int, Explanation]:
        """How the tree matched, for each column that detects and whose monitor knows the tree."""
        found = {column: self.watch.monitors.explanation(column) for column in self.detected}
        return {column: explanation for column, explanation in found.items() if explanation is not None}

    @cached_property
    def events(self) -> Mapping[int, Json]:
        """The events that the explanations refer to, as far as they are known."""
        wanted = matched_events(self.explanations.values()) - {self.number}
        return {**self.watch.buffer.events(wanted), self.number: self.event}

    @cached_property
    def detections(self) -> Sequence[tuple[Explanation | None, frozenset[Kind], DetectionCount | None]]:
        """What was detected, each match once, with the kinds whose monitors it detected; where
        these repeat, with the detections of the first.

        By the monitors of branches or kinds where these are monitored, else by that of the tree. A
        backend does not explain.
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
    """Is notified of what happens in a run; this one does nothing.

    With `every` a listener is notified of every event, with `concerned` of those that concern the
    tree while a verdict may still change, else only of events that change a verdict. With `whole`
    it sees all fields of an event. Without `whole`, and with a single trace, `events` reports
    events in a row instead of `event` each.
    """

    every = False
    concerned = False
    whole = False
    told_before = 0
    """The number of the last event whose detections an earlier run reported."""

    def begin(self, watch: MonitoredTrace) -> None:
        """A trace begins, or the first event of a key came."""

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """The event of that number was read and changed no verdict; only with `every` or `concerned`."""

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:
        """The events from `first` to `last` were read and did not change these verdicts; only with `every`."""

    def change(self, change: VerdictChange) -> None:
        """An event changed verdicts."""

    def end(self, watch: MonitoredTrace) -> None:
        """The trace ends, and was not malformed."""

    def stop(self, watch: MonitoredTrace) -> None:
        """The trace was malformed, or could not be read further: no event and no end comes any more."""


class Audience(NamedTuple):
    """The listeners that are notified of events without a change: of `each` event, of events in a
    row, or of those of concern.
    """

    each: Sequence[Listener]
    in_rows: Sequence[Listener]
    of_concern: Sequence[Listener]

    @classmethod
    def of(cls, listeners: Iterable[Listener], *, one_by_one: bool) -> "Audience":
        """The audience among listeners; `one_by_one` says that events in a row cannot be reported together."""
        found = list(listeners)
        every = [listener for listener in found if listener.every]
        each = [listener for listener in every if listener.whole or one_by_one]
        in_rows = [listener for listener in every if listener not in each]
        return cls(each, in_rows, [one for one in found if one.concerned and not one.every])


class Publisher(Listener):
    """A listener that reports to a file, or to the clients of a port; a context manager.

    `name` names the tree in messages, `key` gives the key of a trace, and `warn` is called with each failure to report.
    """

    url = ""
    """The address that clients connect to, if there is a server."""

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
        """Whether the target is a port, not a file; raises `OptionError` for anything else."""

    @abstractmethod
    def close(self) -> None:
        """End the server, or write the rest of the file; raises `OSError` where this fails."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def publisher_class(name: str) -> type[Publisher]:
    """Import the publisher of that name.

    Raises `ToolMissing` where there is none, and `ToolFailed` where it is broken.
    """
    for entry in entry_points(group=GROUP, name=name):
        try:
            made: type[Publisher] = entry.load()
        except Exception as error:  # a third party's module may fail in any way
            reason = f"it cannot be loaded: {type(error).__name__}: {error}"
            raise ToolFailed(f"the publisher {name}", reason=reason) from error
        return made
    raise ToolMissing(f"the publisher {name}", remedy="install rvaft again, in a checkout with pip install -e .")
