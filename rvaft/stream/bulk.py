"""Batch processing of events, for speed; the results do not depend on it.

A log that no listener reads event by event is read in blocks. Irrelevant events are only counted,
with their key and their place in the order. Other events are grouped by class. If no group can
change the state, only counts change; otherwise the run takes the events one by one.
"""

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from io import BufferedIOBase, IOBase
from itertools import chain, count, islice
from operator import eq, gt, itemgetter, le, lt
from pathlib import Path
from sys import float_info
from typing import Final, TypeAlias, TypeVar, cast

import msgspec

from rvaft.core.classifier import GuardTable, TreeReads, key_at
from rvaft.errors import RvaftError, TooLarge
from rvaft.model.nodes import Assumption
from rvaft.model.values import Json, JsonObject, exact
from rvaft.readers import parallel_blocks
from rvaft.readers.json_blocks import EventBlock, JsonBlockReader, exact_time, plain_fields
from rvaft.readers.json_lines import LinesRead, event_on
from rvaft.readers.log import ALL, Interest, Log, lines_of
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.detection import identifying_fields
from rvaft.stream.listeners import MonitoredTrace, VerdictChange
from rvaft.stream.monitor_set import MonitorSet
from rvaft.stream.order import Ordering, Place
from rvaft.stream.plan import TIME, MonitoringPlan
from rvaft.stream.run import Source, TraceRun
from rvaft.stream.statistics import EventKind, EventTypeIndex
from rvaft.support.files import opened

ENABLED: Final = True
STRETCH: Final = parallel_blocks.STRETCH
"""Bytes per read of a process."""
FEW: Final = 32
"""Smaller blocks are not batches; also the maximum pause after failures."""
BLOCK: Final = 500
FEW_VALUES: Final = 16
"""Maximum number of distinct values that are tested instead of all events."""
_NO_EVENT: Final[JsonObject] = {}
"""The stand-in for events that match no pattern."""
_NUMBERS: Final = frozenset({int, float})
_OWN_KEYS: Final = frozenset({str, int})
"""Types whose values compare as themselves."""
_LARGEST: Final = float_info.max
_END: Final = EventBlock(0, ())
T = TypeVar("T")
H = TypeVar("H")
KeyValues: TypeAlias = tuple[Json, ...]
"""An irrelevant event: its values in the key fields, or () if it lacks one."""
Turn: TypeAlias = tuple[int | None, JsonObject | KeyValues]
"""An event, or what stands for an irrelevant one, after its line."""


def read(
    run: TraceRun,
    source: Source,
    name: str,
    *,
    line: int = 1,
    by_blocks: bool = True,
    live: bool = False,
    jobs: int = 1,
    log: Path | None = None,
) -> Iterator[bool]:
    """Read all events of a source as `run.read` does, and pause after each block.

    Without `by_blocks`, under assumptions, and with distinct ids, events are read one by one. A `live` source is read
    as events arrive. `jobs` processes decode a regular file. `log` is that of a restored run, in which
    irrelevant events may be held back without their fields.
    """
    if not (live or run.plan.monitors.engines):
        return run.read(source, name, line=line, whole=True)
    if ENABLED and by_blocks and run.assumed is None and run.distinct is None:
        reading = BulkReading(run)
        blocks = reading.blocks(source, name, line, live=live, jobs=jobs)
        if blocks is not None:
            return reading.read(blocks)
    if run.ordering is not None:
        _complete(cast("Ordering[Turn]", run.ordering), log, run)
    return run.read(source, name, line=line)


def _complete(ordering: Ordering[Turn], log: Path | None, run: TraceRun) -> None:
    """Replace the stand-ins in an order by their events, which are read again by their lines."""
    lines = {line for _, _, (line, event) in ordering.held if type(event) is tuple and line is not None}
    if not lines or log is None:
        return
    found: dict[int | None, JsonObject] = {}
    reads, strict = run.plan.reads, run.plan.strict_json
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


def _times_count(monitors: MonitorSet) -> bool:
    """Whether the time of every event matters."""
    return monitors.may_be_late if monitors.engines else monitors.time is not None


@lru_cache(maxsize=16)
def interest(plan: MonitoringPlan, *, whole: bool = False) -> Interest:
    """Return the parts of an event that are read."""
    types = plan.monitors.types
    also = (name for one in plan.fields for name in (one.text, one.path[0]))
    found = Interest.of(plan.reads, (TIME, *identifying_fields(types.tree), *also))
    # key, place and time of irrelevant events may still matter
    counted_only = plan.plain and not _times_count(plan.monitors) and found.fields is not None
    found = replace(found, may_be=types.may_be) if counted_only else found
    return replace(found, fields=None) if whole else found


@lru_cache(maxsize=16)
def block_reader(plan: MonitoringPlan, *, whole: bool = False) -> JsonBlockReader | None:
    """Return a block reader for JSON Lines, or None if every event must be read in full."""
    # if every event counts, monitors of keys need the irrelevant events too
    each = plan.key is not None and plan.monitors.counts_all
    if each or any(len(field.path) > 1 for field in plan.fields):
        return None
    types, names = plan.monitors.types, [field.text for field in plan.fields]
    possible = (lambda _: True) if _times_count(plan.monitors) else types.possible
    fields, time = plain_fields(plan.reads, (TIME, *identifying_fields(types.tree), *names)), exact_time(types.tree)
    if not fields or time in names:
        return None
    return JsonBlockReader(plan.reads, possible, fields, time=time, strict=plan.strict_json, kept=names, whole=whole)


def _blocks_of(log: Log) -> Iterator[EventBlock]:
    """Yield the events of a log in blocks."""
    held, lines = list[tuple[int, JsonObject]](), list[int | None]()
    try:
        for event in log.events():
            if event is not None:
                held.append((len(lines), event))
            lines.append(log.line_read)
            if len(lines) == BLOCK:
                yield EventBlock(BLOCK, held, lines=lines)
                held, lines = [], []
    except RvaftError:
        yield EventBlock(len(lines), held, lines=lines)
        raise
    yield EventBlock(len(lines), held, lines=lines)


def _block_of(turns: Sequence[Turn]) -> EventBlock:
    lines, events = [line for line, _ in turns], [event for _, event in turns]
    found = [(place, event) for place, event in enumerate(events) if type(event) is not tuple]
    passed = [place for place, event in enumerate(events) if type(event) is tuple]
    kept = [events[place] for place in passed]
    return EventBlock(len(turns), cast("list[tuple[int, JsonObject]]", found), passed, kept, lines)


class EventGroup:
    """Events with the same fields; columns of values are computed once."""

    __slots__ = ("_ends", "_types", "_values", "events")

    def __init__(self, events: Sequence[JsonObject]) -> None:
        self.events = events
        self._values: dict[str, list[Json]] = {}
        self._types: dict[str, set[type]] = {}
        self._ends: dict[str, Sequence[Json]] = {}

    def values(self, field: str) -> list[Json]:
        """Return the values of a field."""
        found = self._values.get(field)
        if found is None:
            found = self._values[field] = [event[field] for event in self.events]
        return found

    def types(self, field: str) -> set[type]:
        """Return the types of the values."""
        found = self._types.get(field)
        if found is None:
            found = self._types[field] = set(map(type, self.values(field)))
        return found

    def ends(self, field: str) -> Sequence[Json]:
        """Return the least and the greatest value if all are finite numbers, else ()."""
        found = self._ends.get(field)
        if found is None:
            values, types, found = self.values(field), self.types(field), ()
            if types == {int} or (types <= _NUMBERS and all(map(eq, values, values))):  # NaN is not equal to itself
                least, most = min(values), max(values)
                found = (least, most) if least >= -_LARGEST and most <= _LARGEST else ()
            self._ends[field] = found
        return found


def groups(types: EventTypeIndex, events: Sequence[JsonObject]) -> list[tuple[EventKind, EventGroup]] | None:
    """Group events by kind; None for unhashable values of literal fields."""
    index = types.shapes
    try:
        found = _by_shape(index.texts, events)
        if index.others or not all(map(_have_the_same_fields, found)):
            by_shape = defaultdict[Hashable, list[JsonObject]](list)
            for event in events:
                by_shape[*event, *[key_at(event, field) for field in (*index.texts, *index.others)]].append(event)
            found = by_shape.values()
    except TypeError:  # a list or an object in the field of a literal
        return None
    return [one for group in found for one in _split(index.of(group[0]), EventGroup(group))]


def _by_shape(fields: tuple[str, ...], events: Sequence[JsonObject]) -> Collection[Sequence[JsonObject]]:
    """Group events by number of fields and these values, without a call per event."""
    found = defaultdict[Hashable, list[JsonObject]](list)
    match fields:
        case (one,):
            for event in events:
                found[len(event), event.get(one)].append(event)
        case (one, two):
            for event in events:
                found[len(event), event.get(one), event.get(two)].append(event)
        case (one, two, three):
            for event in events:
                found[len(event), event.get(one), event.get(two), event.get(three)].append(event)
        case _:
            for event in events:
                found[len(event), *map(event.get, fields)].append(event)
    return found.values()


def _have_the_same_fields(events: Sequence[JsonObject]) -> bool:
    try:
        deque(map(itemgetter(*events[0]), events) if events[0] else (), maxlen=0)
    except KeyError:
        return False
    return True


def _split(table: GuardTable[H], group: EventGroup) -> list[tuple[H, EventGroup]]:
    if _has_one_entry(table, group):
        return [(table.of(group.events[0]), group)]
    found: dict[H, list[JsonObject]] = {}
    for event in group.events:
        found.setdefault(table.of(event), []).append(event)
    return [(entry, EventGroup(events)) for entry, events in found.items()]


def _has_one_entry(table: GuardTable[H], group: EventGroup) -> bool:
    """Whether a cheap test shows that the same guards hold."""
    if not table.guards:
        return True
    if table.field is None:
        return False
    few: Collection[Json] = ()
    if table.ordered:
        few = group.ends(table.field)
    if not few and group.types(table.field) in ({str}, {int}):
        few = set(group.values(table.field))
    return 0 < len(few) <= FEW_VALUES and len({table.held({table.field: value}) for value in few}) == 1


def needs_no_warning(warnings: DataWarnings, group: EventGroup, event_kind: EventKind) -> bool:
    """Whether events of one kind are known to cause no warning."""
    if event_kind.checks.looked_at == ():
        return True
    if event_kind.checks.good is None or event_kind.checks.good[:2] != (warnings, warnings.version):
        return False
    if warnings.time is not None and event_kind.entries and None in map(warnings.time.read, group.events):
        return False
    _, _, fields, known = event_kind.checks.good
    if not fields:
        return fields is not None and () in known
    if len(fields) == 1:
        return all((kind,) in known for kind in group.types(fields[0]))
    return known.issuperset(zip(*(map(type, group.values(field)) for field in fields), strict=True))


def changes_nothing(monitors: MonitorSet, group: EventGroup, event_kind: EventKind, *, keyed: bool) -> bool | None:
    """Return whether events of a kind that change nothing are relevant.

    Return None if an event may change something, or if the monitor of a key is unknown.
    """
    projects, event_class = monitors.semantics.projects, event_kind.classes[0]
    if not event_kind.relevant and (projects or not event_kind.serves):
        return False
    if keyed or monitors.rests:
        return None
    if projects:
        return None if monitors.live else True
    if monitors.live and monitors.live_columns != (0,):
        return None
    if not event_class.serving:
        return False
    engine = monitors.engines[0]
    inert = engine.inert(event_class)
    if inert is None:
        return None
    for letter, fields in inert.letters:
        if fields is None:
            return None
        values = [
            group.values(field) if group.types(field) <= _OWN_KEYS else [*map(exact, group.values(field))]
            for field in fields
        ]
        if not all(name in inert.known for name in zip([letter] * len(group.events), *values, strict=True)):
            return None
    return bool(engine.read(group.events[0], event_class).hits)


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
    return numbered(JsonBlockReader(reads, possible, fields, time=exact_time(types.tree), strict=strict_json))


class BulkOrdering:
    """Batches of events for an `Ordering`."""

    def __init__(self, ordering: Ordering[Turn]) -> None:
        self._ordering = ordering
        self._as_they_came = False
        """Whether held events are sorted both by place and by number."""

    def add(self, block: EventBlock, values: Sequence[Json], others: Sequence[KeyValues]) -> list[Turn]:
        """Add the events of a block and return the events that are due.

        `values` and `others` are the order fields and the stand-ins of the irrelevant events.
        """
        ordering = self._ordering
        own: list[JsonObject | KeyValues] = [event for _, event in block.events]
        came = list(zip(block.lines, _in_places(block, others, own), strict=True))
        places: list[Place | None]
        if ordering.time is None and ordering.holds_times is False and _NUMBERS.issuperset(map(type, values)):
            places = _in_places(block, values, [ordering.place(event) for _, event in block.events])
        else:  # the first value fixes the type of the field
            known, name = dict(zip(block.passed, values, strict=True)), ordering.field.text
            stand_ins = ({name: known[place]} if place in known else one for place, (_, one) in enumerate(came))
            places = list(map(ordering.place, stand_ins))
        if None not in places and (found := self._add_sorted(cast("list[Place]", places), came)) is not None:
            return found
        self._as_they_came = False
        return [event for event in map(ordering.put, places, came) if event is not None]

    def _add_sorted(self, places: Sequence[Place], events: Sequence[Turn]) -> list[Turn] | None:
        """Add events in one step; return None, without an effect, if one is late."""
        ordering = self._ordering
        held = ordering.held
        known = [*held, *zip(places, count(ordering.came + 1), events)]
        turns = max(0, len(known) - ordering.window)
        last = held[-1][0] if held else ordering.latest
        if not (self._as_they_came and places and last <= places[0] and all(map(le, places, islice(places, 1, None)))):
            known.sort(key=itemgetter(0, 1))
            numbers = [number for _, number, _ in known]
            self._as_they_came = all(map(lt, numbers, islice(numbers, 1, None)))
            # each event has to be present when it is due
            full = ordering.came + 1 + ordering.window - len(held)
            if turns and (known[0][0] < ordering.latest or any(map(gt, numbers[:turns], count(full)))):
                return None
        due = known[:turns]
        if ordering.came <= ordering.window:
            ordering.count_steps(places[: ordering.window + 1 - ordering.came])
        ordering.came += len(events)
        ordering.held = known[turns:]
        if places:
            ordering.before = places[-1]
        if due:
            ordering.latest = due[-1][0]
        return [event for _, _, event in due]


def _in_places(block: EventBlock, others: Sequence[T], own: Sequence[T]) -> list[T]:
    """Merge items of the events and of irrelevant events in order."""
    if len(own) < len(others):
        found = list(others)
        for (place, _), one in zip(block.events, own, strict=True):
            found.insert(place, one)
        return found
    places = chain(block.passed, (place for place, _ in block.events))
    return [one for _, one in sorted(zip(places, chain(others, own), strict=True), key=itemgetter(0))]


def _numbered(
    some: Iterable[EventGroup], events: Iterable[tuple[int, JsonObject]], before: int
) -> list[tuple[int, JsonObject]]:
    wanted = {id(event) for one in some for event in one.events}
    return [(before + place + 1, event) for place, event in events if id(event) in wanted]


class BulkReading:
    """The batch reader of a run."""

    def __init__(self, run: TraceRun) -> None:
        self.run = run
        self._tries = self._pause = 0
        self._ordering = None
        if run.ordering is not None:
            self._ordering = BulkOrdering(cast("Ordering[Turn]", run.ordering))

    def blocks(self, source: Source, name: str, line: int, *, live: bool, jobs: int) -> Iterator[EventBlock] | None:
        """Return the events in blocks, or None to read them one by one."""
        run, plan = self.run, self.run.plan
        whole = any(one.whole for one in run.listeners)
        quickly = not any(one.every and (one.whole or run.one_by_one) for one in run.listeners)
        quickly = quickly and not (whole and plan.monitors.counts_all)
        if isinstance(source, Log):
            if run.ordering is not None:
                return None
            source.interest = interest(plan, whole=whole) if quickly else ALL
            return _blocks_of(source)
        reader = block_reader(plan, whole=whole) if quickly and isinstance(source, IOBase) else None
        if reader is None:
            return None
        stream = cast("BufferedIOBase", source)
        reached: Callable[[int, int], None] = (
            source.reach if isinstance(source, LinesRead) else lambda _size, _lines: None
        )
        if jobs > 1:
            return parallel_blocks.read_in_processes(reader, stream, name, jobs=jobs, line=line, reached=reached)
        return reader.read(stream, name, line=line, live=live, reached=reached)

    def read(self, blocks: Iterable[EventBlock]) -> Iterator[bool]:
        """Process blocks, pausing after each; yield False once the trace has ended."""
        self.run.prepare()
        for block in self._in_turn(blocks):
            self._process(block)
            self.run.notify_unchanged(self.run.number)
            yield block is not _END

    def _in_turn(self, blocks: Iterable[EventBlock]) -> Iterator[EventBlock]:
        """Yield blocks in time order; an error comes last."""
        run, failure = self.run, None
        try:
            for block in blocks:
                yield block if run.plan.plain else self._turns(block)
        except (RvaftError, OSError) as error:
            failure = error
        else:
            yield _END
        run.ended = True
        if run.ordering is not None and (rest := list(run.ordering.rest())):
            yield _block_of(rest)
        if failure is not None:
            raise failure

    def _turns(self, block: EventBlock) -> EventBlock:
        """Return the events due after a block."""
        key = self.run.plan.key
        places: Sequence[Json] = block.kept
        keys: Sequence[KeyValues] = [()] * len(places)
        if key is not None:
            found = block.kept
            if self._ordering is not None:
                places, found = [values[0] for values in found], [values[1:] for values in found]
            elif len(key.fields) == 1:
                found = [(value,) for value in found]
            keys = [() if msgspec.UNSET in values else values for values in found]
        if self._ordering is None:
            return block._replace(kept=keys)
        return _block_of(self._ordering.add(block, places, keys))

    def _process(self, block: EventBlock) -> None:
        """Process a block as a batch if only counts change, else event by event."""
        run, before = self.run, self.run.number
        run.lines = before, block.lines
        events = block.events if run.keys is None or not block.passed else self._with_new_keys(block)
        monitors = run.plan.monitors
        together = not (run.audience.each or monitors.counts_all or monitors.may_be_late)
        try:
            if together and self._process_in_bulk(events, before):
                run.number = before + events[-1][0] + 1
            else:
                run.take(self._filled(events, before) if monitors.counts_all else events, before)
        except TooLarge:
            if run.keys is None:
                run.watch.events = run.number
            else:
                self._count_passed(block, events, run.number - before - 1)
            raise
        if len(events) < block.total:
            self._pass_over(block, events, before + block.total)

    def _process_in_bulk(self, events: Sequence[tuple[int, JsonObject]], before: int) -> bool:
        """Process events as a batch: without a step if none can change the state.

        Return False, without an effect, if an event may cause a warning, or if a listener needs
        each. Places count from the event `before`. After a failure the next blocks are not tried;
        the pause doubles up to `FEW` blocks.
        """
        run = self.run
        self._tries -= 1
        keyed_by = "" if run.keys is None or len(run.keys.names) != 1 else run.keys.names[0]
        if len(events) < FEW or self._tries > 0 or (run.keys is not None and not keyed_by):
            return False
        self._pause = self._tries = min(2 * self._pause + 1, FEW)
        bodies = [event for _, event in events]
        totals, monitors = run.totals, run.watch.monitors
        if set(map(type, bodies)) != {dict}:
            return False
        if keyed_by and {str} != {type(event.get(keyed_by)) for event in bodies}:
            return False
        found = groups(run.plan.monitors.types, bodies)
        if found is None:
            return False
        concerned, stepped = list[EventGroup](), None in map(self._watch_of, bodies)
        for event_kind, group in found:
            if not needs_no_warning(totals.data_warnings, group, event_kind):
                return False
            fits = changes_nothing(monitors, group, event_kind, keyed=bool(keyed_by))
            stepped = stepped or fits is None
            if fits is not False:
                concerned.append(group)
        if concerned and run.audience.of_concern and monitors.live:
            return False
        self._pause = self._tries = 0
        if stepped:
            try:
                run.take(events, before, {id(event): kind for kind, group in found for event in group.events})
            except BaseException:  # count the events so far
                came = {id(one) for place, one in events if before + place < run.number and self._watch_of(one)}
                some = [(kind, [one for one in group.events if id(one) in came]) for kind, group in found]
                found = [(kind, EventGroup(group)) for kind, group in some if group]
                raise
            finally:
                self._count(found, events, before)
            return True
        self._count(found, events, before)
        if run.clock is not None and concerned:
            run.clock.see_all(_numbered(concerned, events, before))
        return True

    def _count(
        self, found: Iterable[tuple[EventKind, EventGroup]], events: Sequence[tuple[int, JsonObject]], before: int
    ) -> None:
        """Count events that cause no warning."""
        run = self.run
        statistics, hint = run.totals.statistics, run.totals.semantics_hint
        if statistics is not None:
            for event_kind, group in found:
                if event_kind.entries:
                    statistics.events += len(group.events)
                    statistics.seen |= event_kind.types
                    if event_kind.relevant is not None:
                        statistics.tally[event_kind.relevant] += len(group.events)
            for number, event in _numbered([group for kind, group in found if not kind.entries], events, before):
                statistics.add(event, number, run.prefix)
        watches = {id(run.watch)}
        if run.keys is None:
            run.watch.events += sum(len(group.events) for _, group in found)
        else:
            values = Counter(event[run.keys.names[0]] for _, group in found for event in group.events)
            known = [(run.keys.known[value,], number) for value, number in values.items()]
            watches = {id(watch) for watch, _ in known}
            for watch, number in known:
                if watch is not None:
                    watch.events += number
        if hint is not None and not all(map(hint.is_full, watches)):
            for number, event in _numbered([group for kind, group in found if kind.entries], events, before):
                hint.keep(id(self._watch_of(event)), number, event)

    def _watch_of(self, event: JsonObject) -> MonitoredTrace | None:
        """Return the monitored trace of an event, or None for a new key."""
        keys = self.run.keys
        return self.run.watch if keys is None else keys.known.get((event[keys.names[0]],))

    def _with_new_keys(self, block: EventBlock) -> Sequence[tuple[int, JsonObject]]:
        """Return the events, with a stand-in for the first of each new key."""
        keys = self.run.keys
        assert keys is not None, "only events with keys are kept by them"
        new = [values for values in dict.fromkeys(block.kept) if not self._is_known(values)]
        if not new:
            return block.events
        names = [field.text for field in keys.key.fields]
        also = [(block.passed[block.kept.index(values)], dict(zip(names, values, strict=False))) for values in new]
        return sorted([*block.events, *also], key=itemgetter(0))

    def _is_known(self, values: KeyValues) -> bool:
        """Whether this key, or for () its absence, is known."""
        keys = self.run.keys
        assert keys is not None, "only events with keys are kept by them"
        if values not in keys.known:
            watch = keys.find(values)
            if watch is None and (values or not keys.lacking):
                return False
            keys.known[values] = watch
        return True

    def _count_passed(self, block: EventBlock, events: Sequence[tuple[int, JsonObject]], end: int) -> None:
        """Count the skipped events before place `end` for their keys."""
        keys = self.run.keys
        assert keys is not None, "only events with keys are kept by them"
        looked_at = {place for place, _ in events}
        passed = zip(block.passed, block.kept, strict=True)
        for values, number in Counter(key for place, key in passed if place < end and place not in looked_at).items():
            if not self._is_known(values):
                continue
            watch = keys.known[values]
            if watch is None:
                keys.lacking += number
            else:
                watch.events += number

    def _pass_over(self, block: EventBlock, events: Sequence[tuple[int, JsonObject]], last: int) -> None:
        """Count the skipped events of a block."""
        run, passed = self.run, block.total - len(events)
        if run.plan.monitors.counts_all:
            self._fill(last + 1)
        if run.totals.statistics is not None:
            run.totals.statistics.events += passed
        run.number = last
        if run.keys is None:
            run.watch.events += passed
        else:
            self._count_passed(block, events, block.total)

    def _filled(self, events: Iterable[tuple[int, JsonObject]], before: int) -> Iterator[tuple[int, JsonObject]]:
        """Yield events, after stepping over irrelevant ones."""
        for place, event in events:
            self._fill(before + place + 1)
            yield place, event

    def _fill(self, number: int) -> None:
        """Step monitors over irrelevant events, which `strict` and backends count."""
        run, monitors = self.run, self.run.watch.monitors
        kind = run.plan.monitors.types.of(_NO_EVENT)
        while monitors.live and run.number + 1 < number:
            run.number += 1
            if changed := monitors.step(_NO_EVENT, run.number, kind):
                run.notify(VerdictChange(run.watch, run.number, _NO_EVENT, changed, run.line_of(run.number)))
