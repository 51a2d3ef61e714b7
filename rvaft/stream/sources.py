"""The sources of batches: what some trees read of the events of their log, many events at a time.

JSON Lines are read in blocks where no listener needs every event as it stands. Other logs, and events
of which all fields count, are collected to batches.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from io import BufferedIOBase, IOBase
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias, cast

from rvaft.core.fields_to_read import TreeReads
from rvaft.errors import RvaftError
from rvaft.model.nodes import Assumption
from rvaft.model.values import Json, JsonObject
from rvaft.readers import parallel_blocks
from rvaft.readers.json_blocks import JsonBlockReader, exact_times, plain_fields
from rvaft.readers.json_lines import LinesRead, event_on, numbered
from rvaft.readers.log import ALL, Batch, Interest, Log, lines_of
from rvaft.stream.bulk import groups, needs_no_warning
from rvaft.stream.data_warnings import DataWarnings, checked
from rvaft.stream.detection import identifying_fields
from rvaft.stream.dispatch import Dispatch
from rvaft.stream.follow import FollowedFile
from rvaft.stream.monitor_set import MonitorSet
from rvaft.stream.order import Ordering
from rvaft.stream.plan import TIME, MonitoringPlan
from rvaft.stream.run import TraceRun
from rvaft.stream.statistics import EventKind, EventTypeIndex
from rvaft.stream.trace_progress import Turn
from rvaft.support.files import opened

ENABLED: Final = True
STRETCH: Final = parallel_blocks.STRETCH
"""Bytes per read of a process."""
BLOCK: Final = 500
"""The number of events of a batch that is collected."""
Source: TypeAlias = BinaryIO | Log | Iterable[Json]


def _times_count(monitors: MonitorSet) -> bool:
    """Whether the time of every event matters."""
    return monitors.may_be_late or monitors.sees_times if monitors.engines else monitors.time is not None


class LogReading:
    """How the log of some plans, which differ in their trees only, is read for all of them."""

    def __init__(self, plans: Sequence[MonitoringPlan]) -> None:
        self.plans = plans
        self.plan = plans[0]
        self.dispatch = Dispatch([plan.monitors.types for plan in plans]) if len(plans) > 1 else None
        self.index = self.dispatch or plans[0].monitors.types
        self._times_count = any(_times_count(plan.monitors) for plan in plans)
        self._readers: dict[tuple[bool, bool], JsonBlockReader | None] = {}
        self._interests: dict[bool, Interest] = {}

    @cached_property
    def reads(self) -> TreeReads:
        """The parts of an event that are read."""
        first, *others = self.plans
        if not others:
            return first.reads
        tree = first.monitors.types.tree
        return TreeReads(tree, [field.path for field in first.fields], others=[plan.reads for plan in others])

    @cached_property
    def _fields(self) -> tuple[str, ...]:
        """The fields that are shown of an event, besides those that are matched."""
        shown = (name for plan in self.plans for name in identifying_fields(plan.monitors.types.tree))
        return tuple(dict.fromkeys((TIME, *shown)))

    @property
    def _exact(self) -> frozenset[str]:
        """The fields whose numbers are checked to be exact."""
        trees = [plan.monitors.types.tree for plan in self.plans]
        checks = [check for tree in trees if (check := checked(tree)) and Assumption.EXACT in check.assumptions]
        return frozenset(str(path[0]) for check in checks for path in check.paths)

    def interest(self, *, whole: bool = False) -> Interest:
        """Return the parts of an event that are read from logs of other formats than JSON Lines."""
        if whole not in self._interests:
            also = (name for one in self.plan.fields for name in (one.text, one.path[0]))
            found = Interest.of(self.reads, (*self._fields, *also))
            # key, place and time of irrelevant events may still matter
            assumed = any(plan.monitors.types.tree.assumes - {Assumption.ORDER} for plan in self.plans)
            counted_only = self.plan.plain and not (self._times_count or assumed) and found.fields is not None
            found = replace(found, may_be=self.index.may_be) if counted_only else found
            self._interests[whole] = replace(found, fields=None) if whole else found
        return self._interests[whole]

    def block_reader(self, *, whole: bool = False, timed: bool = False) -> JsonBlockReader | None:
        """Return a block reader for JSON Lines, or None if every event must be read in full.

        With `timed` it may return the times of irrelevant events instead of these.
        """
        if (whole, timed) not in self._readers:
            self._readers[whole, timed] = self._new_reader(whole=whole, timed=self._time_field if timed else "")
        return self._readers[whole, timed]

    @property
    def _time_field(self) -> str:
        """The field of all times that matter in irrelevant events, or ""."""
        late = [plan.monitors for plan in self.plans if _times_count(plan.monitors)]
        fields = {() if one.time is None or one.counts_all else one.time.field for one in late}
        field = fields.pop() if len(fields) == 1 else ()
        return field[0] if self.plan.plain and len(field) == 1 else ""

    def _new_reader(self, *, whole: bool, timed: str) -> JsonBlockReader | None:
        plan, reads = self.plan, self.reads
        # if every event counts, monitors of keys need the irrelevant events too
        each = plan.key is not None and any(one.monitors.counts_all for one in self.plans)
        if each or any(len(field.path) > 1 for field in plan.fields):
            return None
        names = [field.text for field in plan.fields]
        possible = (lambda _: True) if self._times_count and not timed else self.index.possible
        fields, exact = plain_fields(reads, (*self._fields, *names)), exact_times(reads) | self._exact
        if not fields or not exact.isdisjoint(names):
            return None
        return JsonBlockReader(
            reads, possible, fields, exact=exact, strict=plan.strict_json, kept=names, whole=whole, timed=timed
        )

    def batches(
        self,
        runs: Sequence[TraceRun],
        source: Source,
        name: str,
        *,
        line: int = 1,
        by_blocks: bool = True,
        live: bool = False,
        jobs: int = 1,
        log: Path | None = None,
    ) -> Iterator[Batch]:
        """Return the events of a source for the runs of one trace, in batches.

        Without `by_blocks` a batch has one event. Of a `live` source a batch has the events that have
        come. `line` is the number of the first line of a stream. `jobs` processes decode a regular
        file. `log` is that of restored runs, in which irrelevant events may be held back without their
        fields. The iterator raises what `rvaft.readers.json_lines.read` raises.
        """
        whole = any(one.whole for run in runs for one in run.listeners)
        quickly = by_blocks and ENABLED and all(run.assumes_in_bulk and run.distinct is None for run in runs)
        quickly = quickly and (live or all(plan.monitors.engines for plan in self.plans))
        for run in runs:
            quickly = quickly and not any(one.every and (one.whole or run.one_by_one) for one in run.listeners)
            quickly = quickly and not (whole and run.plan.monitors.counts_all)
        if quickly and isinstance(source, IOBase) and (reader := self.block_reader(whole=whole, timed=jobs == 1)):
            stream = cast("BufferedIOBase", source)
            reached: Callable[[int, int], None] = (
                source.reach if isinstance(source, LinesRead) else lambda _size, _lines: None
            )
            if jobs > 1:
                return parallel_blocks.read_in_processes(reader, stream, name, jobs=jobs, line=line, reached=reached)
            return reader.read(stream, name, line=line, live=live, reached=reached)
        if isinstance(source, Log):
            source.interest = self.interest(whole=whole) if quickly and runs[0].ordering is None else ALL
        for run in runs:
            if run.ordering is not None:
                _complete(run.ordering, log, run, self.reads)
        return self._collected(source, name, line, most=1 if live or not by_blocks else BLOCK)

    def _collected(self, source: Source, name: str, line: int, *, most: int) -> Iterator[Batch]:
        """Yield the events of a source in batches of at most so many; an error comes last."""
        held, lines = list[tuple[int, JsonObject]](), list[int | None]()
        try:
            for number, event in self._events(source, name, line):
                if event is not None:
                    held.append((len(lines), cast("JsonObject", event)))
                lines.append(number)
                if len(lines) >= most:
                    yield Batch(len(lines), held, lines=lines)
                    held, lines = [], []
        except (RvaftError, OSError):
            if lines:
                yield Batch(len(lines), held, lines=lines)
            raise
        if lines:
            yield Batch(len(lines), held, lines=lines)

    def _events(self, source: Source, name: str, line: int) -> Iterator[tuple[int | None, Json]]:
        """Yield the events with their lines, None for those that a reader found irrelevant."""
        stream = source.source if isinstance(source, Log) else source
        found: Iterable[tuple[int | None, Json]]
        if isinstance(source, Log):
            found = ((source.line_read, event) for event in source.events())
        elif isinstance(source, IOBase):
            found = numbered(cast("BinaryIO", source), name, self.reads, line, strict=self.plan.strict_json)
        else:
            found = ((None, event) for event in cast("Iterable[Json]", source))
        if not isinstance(stream, FollowedFile):
            yield from found
            return
        for _, event in found:
            yield stream.given, event  # a followed file may be replaced by another


def _complete(ordering: Ordering[Turn], log: Path | None, run: TraceRun, reads: TreeReads) -> None:
    """Replace the stand-ins in an order by their events, which are read again by their lines."""
    lines = {line for _, _, (line, event) in ordering.held if type(event) is tuple and line is not None}
    if not lines or log is None:
        return
    found: dict[int | None, JsonObject] = {}
    strict = run.plan.strict_json
    with opened(log) as stream:
        for number, text in islice(lines_of(stream, run.trace, 1), max(lines)):
            event = (
                event_on(text.removesuffix(b"\n"), run.trace, number, reads, strict=strict) if number in lines else None
            )
            if event is not None:
                found[number] = event
    ordering.held = [
        (place, number, (line, found[line] if type(event) is tuple else event))
        for place, number, (line, event) in ordering.held
    ]


def events_of_concern(
    reads: TreeReads,
    types: EventTypeIndex,
    stream: BufferedIOBase,
    log: str,
    *,
    strict_json: bool,
    warnings: DataWarnings,
    concerns: Callable[[EventKind], bool],
) -> Iterator[tuple[int, JsonObject]] | None:
    """Yield the possibly relevant events with their numbers, or return None if batches are
    unusable.

    `concerns` returns whether events of a kind matter. If no event of a block matters or causes a
    warning, the last event stands for the block.
    """
    time = types.tree.time
    quick = ENABLED and not types.tree.assumes - {Assumption.ORDER}
    fields = plain_fields(reads, time.field[:1] if time else ()) if quick else ()
    if not fields:
        return None
    times_count = time is not None and time.late is not None

    def is_quiet(events: Sequence[JsonObject]) -> bool:
        found = groups(types, events) if set(map(type, events)) == {dict} else None
        return bool(found) and not any(
            concerns(kind) or not needs_no_warning(warnings, group, kind) for kind, group in found or ()
        )

    def numbered(reader: JsonBlockReader) -> Iterator[tuple[int, JsonObject]]:
        before = 0
        for block in reader.read(stream, log):
            quiet = not times_count and is_quiet([event for _, event in block.events])
            yield from ((before + place + 1, found) for place, found in block.events[-1 if quiet else 0 :])
            before += block.total

    possible = (lambda _: True) if times_count else types.possible
    return numbered(JsonBlockReader(reads, possible, fields, exact=exact_times(reads), strict=strict_json))


@lru_cache(maxsize=16)
def reading_of(plans: tuple[MonitoringPlan, ...]) -> LogReading:
    """Return how the log of these plans is read."""
    return LogReading(plans)
