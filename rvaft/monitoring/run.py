"""One trace from its first event to its last: events are put in order and told apart by a key, the monitors read them, listeners are told."""

from collections import Counter, OrderedDict
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from heapq import heappush, heappushpop
from io import BufferedIOBase, IOBase
from itertools import chain, count, islice
from math import inf
from operator import gt, itemgetter, le, lt
from pathlib import Path
from typing import Any, BinaryIO, Final, Self, cast

import msgspec

from rvaft.core.classifier import Scope, TreeReads
from rvaft.errors import OptionError, RvaftError, TooLarge
from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.guards import Alike
from rvaft.model.nodes import Kind
from rvaft.model.values import Json, at, is_finite, is_number
from rvaft.model.values import key as value_key
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.detection import counted, matched_events, told_fields, unlike
from rvaft.monitoring.fast_reader import Batch, FastReader, exact_time, plain_fields
from rvaft.monitoring.hindsight import Hindsight
from rvaft.monitoring.monitor_set import DetectionCount, MonitorSet
from rvaft.monitoring.near_misses import Sight, Statistics
from rvaft.monitoring.oversights import Oversights
from rvaft.monitoring.parallel_reader import read_in_processes
from rvaft.monitors import Explanation
from rvaft.readers.json_lines import BLANK, LinesRead, NonFiniteEvent, decode, read
from rvaft.readers.log import ALL, BOM, Interest, Log, LogReader, failures_of, source_of
from rvaft.support.files import opened

TIME: Final = "time"
"""The field that is watched for going back, in the events that concern the tree."""
MAX_KEYS: Final = 100_000
"""How many values of a key are told apart."""
DEFAULT_WINDOW: Final = 1_000
"""How many events are held back unless told otherwise."""
BOUND: Final = 10_000
"""How many events are remembered for explanations."""
FEW: Final = 32
"""Fewer events are not taken all at once; after as many batches at most that is tried again where it was in vain."""
BATCH: Final = 500
"""Events of a log in another format than JSON Lines that are looked at together."""
_NO_EVENT: Final[dict[str, Json]] = {}
"""Stands for any event that fits no pattern: where there are such, no pattern is without a literal."""
_NUMBERS: Final = frozenset({int, float})
_PLAIN_KEYS: Final = frozenset({str, int})
"""Types of values that are their own keys, and that no other value but a double equals."""
_END: Final = Batch(0, ())
_ISO: Final = EventTime((), TimeFormat.ISO8601)
"""Reads a value that is a time itself."""


def _batched(events: Iterable[dict[str, Json] | None]) -> Iterator[Batch]:
    """Events in batches, those of no interest only counted; where the log cannot be read on, those before it come first."""
    total, held = 0, list[tuple[int, dict[str, Json]]]()
    try:
        for event in events:
            if event is not None:
                held.append((total, event))
            total += 1
            if total == BATCH:
                yield Batch(total, held)
                total, held = 0, []
    except RvaftError:
        yield Batch(total, held)
        raise
    yield Batch(total, held)


# -- fields, keys, orders -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Field:
    """A field of an event by its dotted path; one whose own name has dots is found under its whole name.

    >>> Field.parse("robot.id").of({"robot": {"id": 7}})
    (7,)
    """

    text: str
    path: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Raises `OptionError` for what is no path."""
        path = tuple(text.split("."))
        if not all(path):
            raise OptionError(f"{text!r} is no field: write a name, or names with dots between")
        return cls(text, path)

    def of(self, event: Json) -> tuple[Json] | None:
        """The value, in a tuple since it may be null, or None where the event has none."""
        if isinstance(event, Mapping) and self.text in event:
            return (event[self.text],)
        found = at(event, self.path, _END)
        return None if found is _END else (found,)


@dataclass(frozen=True, slots=True)
class Key:
    """The fields that together say which of many an event is about.

    >>> Key.parse(["user", "src"]).of({"user": "bob", "src": 1, "x": 2})
    ('bob', 1)
    """

    fields: tuple[Field, ...]

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Self:
        """Raises `OptionError` for what is no path."""
        return cls(tuple(map(Field.parse, dict.fromkeys(texts))))

    def of(self, event: Json) -> tuple[Json, ...] | None:
        """The value of each field, or None where the event lacks one of them."""
        found = [field.of(event) for field in self.fields]
        return None if None in found else tuple(value[0] for value in found if value is not None)

    def told(self, values: tuple[Json, ...]) -> Json:
        """The key as JSON: the value of a single field, or an object with those of several."""
        if len(self.fields) == 1:
            return values[0]
        return {field.text: value for field, value in zip(self.fields, values, strict=True)}


class OrderedField:
    """A field by which events are in order: by the `time` of the tree, where that is there, else by numbers or times of ISO 8601.

    Which of the two it holds the first that comes says; the other is then no place. Raises `OptionError` for what is no field.
    """

    def __init__(self, field: str, time: EventTime | None = None) -> None:
        self.time = time if time is not None and ".".join(time.field) == field else None
        self.field = Field.parse(field) if self.time is None else Field(field, self.time.field)
        self._holds: bool | None = None
        """Whether times of ISO 8601 stand there."""

    def place(self, event: Json) -> int | float | None:
        """The number or time that an event has there; a boolean is none, nor is what is not finite."""
        if self.time is not None:
            return self.time.read(event)
        plain = type(event) is dict and self.field.text in event  # mostly; asked of every event
        value = event[self.field.text] if plain else (self.field.of(event) or (None,))[0]
        if type(value) is float and self._holds is False and value - value == 0:
            return value
        is_time = isinstance(value, str)
        place: int | float | None = _ISO.read(value) if is_time else value if is_number(value) else None
        if place is None or place - place != 0 or self._holds is (not is_time):
            return None
        self._holds = is_time
        return place


def _in_places(batch: Batch, others: Sequence[Any], own: Sequence[Any]) -> list[Any]:
    """What stands for each event of a batch: one of its `own`, or for those that concern nothing one of the others."""
    if len(own) < len(others):
        found = list(others)
        for (place, _), one in zip(batch.events, own, strict=True):
            found.insert(place, one)
        return found
    found = [None] * batch.total
    for place, one in zip(chain(batch.passed, (place for place, _ in batch.events)), chain(others, own), strict=True):
        found[place] = one
    return found


class Ordering(OrderedField):
    """Holds back up to `window` events and gives the one with the smallest place first, events with equal ones as they came.

    The order is right wherever no event stands more than `window` places behind its own. An event that comes later than that
    is given at once, and counted as `late`. An event without a place stays behind the one before it, and is counted in `without`.
    Can be pickled with the events that it holds.

    >>> ordering = Ordering("time", window=1)
    >>> [ordering.add({"time": time}) for time in (2, 1, 3)]
    [None, {'time': 1}, {'time': 2}]
    """

    def __init__(self, field: str, *, window: int = DEFAULT_WINDOW, time: EventTime | None = None) -> None:
        super().__init__(field, time)
        self.window = window
        self.late = self.without = 0
        self.first_late = self.first_without = 0
        """The numbers of the first such events, as read."""
        self._came = 0
        self._held: list[tuple[int | float, int, Any]] = []
        """Events with the number in the field and that in the trace."""
        self._as_they_came = False
        """Whether those that are held are in the order of their places and of their numbers alike."""
        self._before: int | float = -inf
        self._given: int | float = -inf

    def add(self, event: dict[str, Json]) -> dict[str, Json] | None:
        """Take the next event of the trace; the event whose turn it is then, if the window is full."""
        given: dict[str, Json] | None = self._add(self.place(event), event)
        return given

    def add_all(self, batch: Batch, values: Sequence[Any], others: Sequence[Any]) -> list[Any]:
        """Take the next events of the trace; those whose turn it is then.

        Those of the batch that concern nothing have these `values` in the field, and what stands for them among the events are the `others`.
        """
        came = _in_places(batch, others, [event for _, event in batch.events])
        places: list[int | float | None]
        if self.time is None and self._holds is False and _NUMBERS.issuperset(map(type, values)):
            places = _in_places(batch, values, [self.place(event) for _, event in batch.events])
        else:  # the first of all says what the field holds
            known, name = dict(zip(batch.passed, values, strict=True)), self.field.text
            told = ({name: known[place]} if place in known else event for place, event in enumerate(came))
            places = list(map(self.place, told))
        if None not in places and (given := self._add_sorted(places, came)) is not None:
            return given
        return [event for event in map(self._add, places, came) if event is not None]

    def _add_sorted(self, places: Sequence[Any], events: Sequence[Any]) -> list[Any] | None:
        """Take events all at once, and give those whose turn it is; None, and nothing is taken, where one of them is too late."""
        known = [*self._held, *zip(places, count(self._came + 1), events)]
        turns = max(0, len(known) - self.window)
        last = self._held[-1][0] if self._held else self._given
        if not (self._as_they_came and places and last <= places[0] and all(map(le, places, islice(places, 1, None)))):
            known.sort()  # by place and number, which differ
            numbers = [number for _, number, _ in known]
            self._as_they_came = all(map(lt, numbers, islice(numbers, 1, None)))
            # Each has to be there when its turn comes: with the first event that has no room in the window, the second, and so on.
            full = self._came + 1 + self.window - len(self._held)
            if turns and (known[0][0] < self._given or any(map(gt, numbers[:turns], count(full)))):
                self._as_they_came = False
                return None
        due = known[:turns]
        self._came += len(events)
        self._held = known[turns:]
        if places:
            self._before = places[-1]
        if due:
            self._given = due[-1][0]
        return [event for _, _, event in due]

    def _add(self, place: int | float | None, event: Any) -> Any:
        self._came += 1
        self._as_they_came = False
        if place is None:
            place = self._before
            self.without += 1
            self.first_without = self.first_without or self._came
        elif place < self._given:
            self.late += 1
            self.first_late = self.first_late or self._came
        self._before = place
        entry = (place, self._came, event)
        if len(self._held) < self.window:
            heappush(self._held, entry)
            return None
        # Once something was given the window stays full, so what is late is the smallest here and comes straight back.
        given = heappushpop(self._held, entry)
        self._given = max(self._given, given[0])
        return given[2]

    def rest(self) -> Iterator[dict[str, Json]]:
        """The events still held, in order: the trace has ended."""
        rest, self._held = sorted(self._held), []
        yield from (event for _, _, event in rest)


class Backwards(OrderedField):
    """Counts how often a place is before the last one, and at which event first; can be pickled."""

    count = first = 0
    _last: int | float = -inf

    def see_all(self, events: Sequence[Json], numbers: Iterable[int]) -> None:
        """Look at the next events; they have these numbers."""
        if self.time is None and self._holds is False and len(self.field.path) == 1:
            name = self.field.text
            places: list[Any] = [event.get(name) for event in events]
            rises = _NUMBERS.issuperset(map(type, places)) and all(map(le, chain((self._last,), places), places))
            if rises and places and places[-1] < inf:  # nor is any before it infinite, or not a number
                self._last = places[-1]
                return
        for number, event in zip(numbers, events, strict=True):
            self.see(number, event)

    def see(self, number: int, event: Json) -> None:
        """Look at the next event; one without a place is passed over."""
        place = self.place(event)
        if place is not None:
            if place < self._last:
                self.count += 1
                self.first = self.first or number
            self._last = place


# -- what listeners are told --------------------------------------------------------------------------------------------


class EventBuffer:
    """The events of one trace, by their numbers, that explanations may name.

    The latest that may become part of a match are `known`. Others are looked up in a regular file, `path`, whose events are numbered as they
    stand; in a stream they are gone. `reads` is what was read of them, by that `reader` if not by lines of JSON.
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
        """The events with these numbers, as far as they are known; what has changed in the file since it was read is left out."""
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
    """What one event changed: the columns whose verdict is another, those of them that detect, and how that came about."""

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
        """What was detected, each match once, with the kinds whose monitors it detected; where these repeat, with the detections of the first.

        By the monitors of branches or kinds where these are monitored, else by that of the tree. A backend does not explain.
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
    """Told of what happens in a run; does nothing with it.

    With `every` it is told of every event, with `concerned` of those that concern the tree while a verdict may still change, else only of those that
    change one; with `whole` it has to see all of an event. Otherwise events may be read quickly, and where one trace is watched who is told of
    every one is told of many `events` at once.
    """

    every = False
    concerned = False
    whole = False
    told_before = 0
    """The number of the last event of which an earlier run told what it detected."""

    def begin(self, watch: MonitoredTrace) -> None:
        """A trace begins, or the first event of a key came."""

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """The event of that number was read and changed no verdict; only with `every` or `concerned`."""

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:
        """The events with these numbers, and those between, were read and did not change these verdicts; only with `every`."""

    def change(self, change: VerdictChange) -> None:
        """An event changed verdicts."""

    def end(self, watch: MonitoredTrace) -> None:
        """The trace ends, and was not malformed."""

    def stop(self, watch: MonitoredTrace) -> None:
        """The trace was malformed, or could not be read further: no event and no end comes any more."""


def _tell_all(
    listeners: Iterable[Listener], watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]
) -> None:
    """Tell of events in a row that changed nothing, if there are any."""
    for listener in listeners if first <= last else ():
        listener.events(watch, first, last, verdicts)


def _batch_of(events: Sequence[Any]) -> Batch:
    """Events in a row; a tuple stands for one that concerns nothing, and is what was kept of it."""
    found = [(place, event) for place, event in enumerate(events) if type(event) is not tuple]
    if not found:
        return Batch(len(events), (), range(len(events)), events)
    passed = [place for place, event in enumerate(events) if type(event) is tuple]
    return Batch(len(events), found, passed, [events[place] for place in passed])


# -- the run ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MonitoringPlan:
    """What is done with every trace: `monitors` have read nothing; `also` are fields that somebody else looks at."""

    monitors: MonitorSet
    key: Key | None = None
    max_keys: int = MAX_KEYS
    order_by: str | None = None
    window: int = DEFAULT_WINDOW
    strict_json: bool = False
    also: tuple[Field, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether every event goes to the same monitors, in the order in which it stands."""
        return self.key is None and self.order_by is None

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of the order, of the key, and those that somebody else looks at."""
        order = () if self.order_by is None else (Field.parse(self.order_by),)
        return (*order, *(self.key.fields if self.key else ()), *self.also)

    @cached_property
    def reads(self) -> TreeReads:
        """What is read of an event."""
        return TreeReads(self.monitors.types.tree, [field.path for field in self.fields])

    @property
    def every(self) -> bool:
        """Whether the time of each event counts; a text of a backend does not say what it makes of times."""
        monitors = self.monitors
        return monitors.may_be_late if monitors.engines else monitors.time is not None

    @cached_property
    def interest(self) -> Interest:
        """What of an event is looked at, where nobody wants to see all of it."""
        also = (name for one in self.fields for name in (one.text, one.path[0]))
        found = Interest.of(self.reads, (TIME, *told_fields(self.monitors.types.tree), *also))
        # What concerns nothing is counted by the key that it has, has its place in the order, and is late or not.
        counted_only = self.plain and not self.every and found.fields is not None
        return replace(found, may_be=self.monitors.types.may_be) if counted_only else found

    @cached_property
    def fast_reader(self) -> FastReader | None:
        """What reads files quickly, or None where every event has to be seen as it stands."""
        # Where every event counts, those that concern nothing would have to be given to the monitors of their keys.
        each = self.key is not None and self.monitors.counts_all
        if each or any(len(field.path) > 1 for field in self.fields):
            return None
        types, names = self.monitors.types, [field.text for field in self.fields]
        possible = (lambda _: True) if self.every else types.possible
        fields, time = plain_fields(self.reads, (TIME, *told_fields(types.tree), *names)), exact_time(types.tree)
        if not fields or time in names:
            return None
        return FastReader(self.reads, possible, fields, time=time, strict=self.strict_json, kept=names)


@dataclass(slots=True)
class Totals:
    """What several traces held, if that is wanted, what was doubtful about them, and what other semantics makes of those that ended in ⊥."""

    statistics: Statistics | None
    oversights: Oversights
    hindsight: Hindsight | None = None

    def merge(self, other: Self) -> None:
        """Add those of later traces."""
        if self.statistics is not None and other.statistics is not None:
            self.statistics.merge(other.statistics)
        self.oversights.merge(other.oversights)
        if self.hindsight is not None and other.hindsight is not None:
            self.hindsight.merge(other.hindsight)


@dataclass(eq=False)
class TraceRun:
    """One trace, which `totals` count, too; `prefix` is what they put before a place in it.

    `read` takes the events, from wherever they come, and `begin` and `end` (or `stop`) go before and after it. `number` is that of the last
    event, `detected` that of the last one that detected something; once it has `ended` only events that were held back come.
    """

    plan: MonitoringPlan
    trace: str
    listeners: Sequence[Listener]
    totals: Totals
    _: KW_ONLY
    buffer: EventBuffer
    prefix: str = ""

    def __post_init__(self) -> None:
        if self.totals.hindsight is not None:
            self.totals.hindsight.forget()
        monitors, by = self.plan.monitors, self.plan.order_by
        self.ordering = None if by is None else Ordering(by, window=self.plan.window, time=monitors.time)
        name = TIME if monitors.time is None else ".".join(monitors.time.field)
        self.clock = None if by is not None or monitors.may_be_late else Backwards(name, monitors.time)
        self.number = self.detected = 0
        self._tries = self._pause = 0
        self.begun = self.ended = False
        self.watch = MonitoredTrace(self.trace, monitors.fork(), buffer=self.buffer)
        """What is watched; with a key what is copied for each value of it."""
        self._without_key = self._first_without_key = 0
        self._keyed: dict[Hashable, MonitoredTrace] = {}
        names = [] if self.plan.key is None else self.plan.key.fields
        self._key_names = tuple(one.text for one in names) if all(len(one.path) == 1 for one in names) else ()
        self._passed: dict[tuple[Json, ...], MonitoredTrace | None] = {}
        """By what an event has in the fields of the key the watch that it is for; nothing stands for an event that lacks one."""

    @property
    def watches(self) -> list[MonitoredTrace]:
        """What was watched: the trace, or each key that came, in the order in which they came."""
        return [self.watch] if self.plan.key is None else list(self._keyed.values())

    def begin(self) -> None:
        """The trace begins, or goes on."""
        self.begun = True
        for watch in self.watches:
            for listener in self.listeners:
                listener.begin(watch)

    def read(  # noqa: PLR0915 (what is done for each event, without a call more than it takes)
        self,
        source: BinaryIO | Log | Iterable[Json],
        name: str,
        *,
        line: int = 1,
        by_blocks: bool = False,
        live: bool = False,
        jobs: int = 1,
    ) -> Iterator[bool]:
        """Read all events of a stream of JSON Lines, of another log, or events as they are, and pause after each batch of them.

        Gives False once where the trace has ended; events that were held back come after that. `line` is the number of the line where a
        stream goes on; `by_blocks` says that many lines may be read at once, if it is `live` only those that are there, and those of
        a regular file by so many processes. Raises what `rvaft.readers.json_lines.read` raises.
        """
        prefix, key, fresh = self.prefix, self.plan.key, self.plan.monitors
        every = [listener for listener in self.listeners if listener.every]
        each = [listener for listener in every if listener.whole or self._one_by_one]
        many = [listener for listener in every if listener not in each]
        of_concern = [listener for listener in self.listeners if listener.concerned and not listener.every]
        skips = fresh.semantics.projects and bool(fresh.engines)  # what is not relevant changes nothing
        unfit = fresh.semantics is Semantics.SCATTERED and fresh.finds_no_more
        keyed_by, known = self._key_names[0] if len(self._key_names) == 1 else "", self._passed
        fills = fresh.counts_all
        look_up, may_be_late = fresh.types.of, fresh.may_be_late
        oversights, hindsight = self.totals.oversights, self.totals.hindsight
        for batch in self._batches(source, name, line, by_blocks=by_blocks, live=live, jobs=jobs):
            before, statistics, clock = self.number, self.totals.statistics, self.clock
            watch: MonitoredTrace | None = self.watch
            told, verdicts = before, self.watch.monitors.verdicts if many else ()
            events = batch.events if key is None or not batch.passed else self._with_new_keys(key, batch)
            if not (each or fills or may_be_late) and self._take(events, before, keyed_by, of_concern):
                looked_at, events = events, ()
                self.number = before + looked_at[-1][0] + 1
            else:
                looked_at = events
            # From here on every call counts: this is done for each event of a log.
            try:
                for place, event in events:
                    number = before + place + 1
                    if fills:
                        self._fill(number)
                    self.number = number
                    sight = look_up(event)
                    if key is not None:
                        value = event.get(keyed_by) if keyed_by else None
                        watch = known.get((value,)) if type(value) is str else None
                        watch = watch or self._watch_of(key, event, number)
                    late = may_be_late and watch is not None and watch.monitors.engines[0].is_late(event)
                    relevant = True
                    if watch is not None and late:
                        oversights.note_late(event, number, prefix, watch.monitors.engines[0].latest)
                    elif sight.looked_at or type(event) is not dict:
                        oversights.see(event, number, prefix, sight)
                    if statistics is not None:
                        if late or (sight.plain and sight.noted is statistics):
                            statistics.events += 1
                            statistics.tally[() if late else sight.constant] += 1  # type: ignore[index] # plain says so
                        else:
                            relevant = statistics.add(event, number, prefix, sight)
                    elif skips and sight.ignored and not (late or sight.decided.open):
                        relevant = not any(admits(event) for admits in sight.ignored)
                    if watch is None:
                        continue
                    watch.events += 1
                    if hindsight is not None and not late and (sight.entries or sight.decided.open):
                        hindsight.keep(id(watch), number, event)
                    if relevant or not (skips or (unfit and not sight.ignored and not sight.decided.open)):
                        monitors = watch.monitors
                        changed = monitors.step(event, number, sight)
                        if clock is not None and monitors.concerned:
                            clock.see(number, event)
                        if monitors.serves:
                            watch.buffer.remember(number, event)
                        if changed:
                            if many:
                                _tell_all(many, watch, told + 1, number - 1, verdicts)
                            self._tell(VerdictChange(watch, number, event, changed))
                            if many:
                                told, verdicts = number, monitors.verdicts
                            continue
                        if of_concern and monitors.live and (monitors.concerned or not (skips or late or not relevant)):
                            for listener in of_concern:
                                listener.event(watch, number, event)
                    for listener in each:
                        listener.event(watch, number, event)
            except TooLarge:
                _tell_all(many, self.watch, told + 1, self.number - 1, verdicts)
                if key is None:
                    self.watch.events = self.number
                else:
                    self._count_passed(batch, events, self.number - before - 1)
                raise
            if len(looked_at) < batch.total:
                self._pass_over(batch, looked_at, before + batch.total)
            _tell_all(many, self.watch, told + 1, self.number, verdicts)
            yield batch is not _END

    def _take(
        self, events: Sequence[tuple[int, Json]], before: int, keyed_by: str, of_concern: Sequence[Listener]
    ) -> bool:
        """Take events all at once; False, and nothing is done, unless all are seen to change nothing but counts.

        They are the numbers `before` with their places on. Where that was in vain it is not tried with as many of the next ones.
        """
        self._tries -= 1
        if len(events) < FEW or self._tries > 0 or (self.plan.key is not None and not keyed_by):
            return False
        self._pause = self._tries = min(2 * self._pause + 1, FEW)
        bodies: list[Any] = [event for _, event in events]
        watches = self._watches_of(bodies, keyed_by)
        totals, monitors, types = self.totals, self.watch.monitors, self.plan.monitors.types
        if watches is None or set(map(type, bodies)) != {dict}:
            return False
        groups = types.groups(bodies)
        if groups is None:
            return False
        strange, concerned, entries = list[Alike](), list[Alike](), list[Alike]()
        counts = list[tuple[Sight, tuple[str, ...] | None, int]]()
        for sight, group in groups:
            calm = set[bool | None]()
            parts = sight.parted(group) if totals.oversights.are_good(group, sight) else None
            for names, some in parts or ():
                if sight.constant != ():
                    counts.append((sight, names, len(some.events)))
                if monitors.passes(sight, relevant=bool(names)):
                    calm.add(False)
                else:
                    calm.add(None if keyed_by else monitors.calm(some, sight))
            if calm not in ({True}, {False}):
                return False
            for belongs, those in (
                (True in calm, concerned),
                (sight.constant == (), strange),
                (sight.entries, entries),
            ):
                if belongs:
                    those.append(group)
        if concerned and of_concern and monitors.live:
            return False
        self._pause = self._tries = 0

        def numbered(some: Sequence[Alike]) -> Iterable[tuple[int, Json]]:
            if len(some) in (0, len(groups)):
                return ((before + place + 1, event) for place, event in events if some)
            own = {id(event) for one in some for event in one.events}
            return ((before + place + 1, event) for place, event in events if id(event) in own)

        if totals.statistics is not None:
            for sight, names, number in counts:
                totals.statistics.add_all(sight, names, number)
            for number, event in numbered(strange):
                totals.statistics.add(event, number, self.prefix)
        for watch, number in watches:
            watch.events += number
        if totals.hindsight is not None and not all(totals.hindsight.is_full(id(watch)) for watch, _ in watches):
            for number, event in numbered(entries):
                own = self._passed[event[keyed_by],] if keyed_by else self.watch
                totals.hindsight.keep(id(own), number, event)
        if self.clock is not None and concerned:
            told = bodies if len(concerned) == len(groups) else [event for _, event in numbered(concerned)]
            self.clock.see_all(told, (number for number, _ in numbered(concerned)))
        return True

    def _watches_of(self, events: Sequence[Any], keyed_by: str) -> Sequence[tuple[MonitoredTrace, int]] | None:
        """What watches events, and how many of them; None where that has to be asked of each."""
        if not keyed_by:
            return [(self.watch, len(events))]
        values = [event.get(keyed_by) if type(event) is dict else None for event in events]
        if set(map(type, values)) != {str}:
            return None
        found = [(self._passed.get((value,)), count) for value, count in Counter(values).items()]
        return None if any(watch is None for watch, _ in found) else found  # type: ignore[return-value] # none is

    @property
    def _one_by_one(self) -> bool:
        """Whether every listener that is told of every event is told of one after the other."""
        return self.plan.key is not None or self.plan.monitors.counts_all

    def _batches(
        self, source: BinaryIO | Log | Iterable[Json], name: str, line: int, *, by_blocks: bool, live: bool, jobs: int
    ) -> Iterator[Batch]:
        plan, ordering, failure = self.plan, self.ordering, None
        found: Iterable[Any] = source if not isinstance(source, Log) else source.events()
        quick: Iterable[Batch] = ()
        quickly = by_blocks and not any(one.whole or (one.every and self._one_by_one) for one in self.listeners)
        if isinstance(source, Log):
            source.interest = plan.interest if quickly else ALL
            if by_blocks and ordering is None:
                quick, found = _batched(found), ()
        elif isinstance(source, IOBase):
            if quickly and plan.fast_reader is not None:
                how: dict[str, Any] = {"reached": source.reach} if isinstance(source, LinesRead) else {}
                given, found = cast("BufferedIOBase", source), ()
                if jobs > 1:
                    quick = read_in_processes(plan.fast_reader, given, name, jobs=jobs, line=line, **how)
                else:
                    quick = plan.fast_reader.read(given, name, line=line, live=live, **how)
            else:
                found = read(cast("BinaryIO", source), name=name, reads=plan.reads, line=line, strict=plan.strict_json)
        try:
            for batch in quick:
                yield batch if plan.plain else self._in_turn(batch)
            for event in found:
                turn = event if ordering is None else ordering.add(event)
                if turn is not None:
                    yield Batch(1, ((0, event),)) if ordering is None else _batch_of([turn])
        except (RvaftError, OSError) as error:
            failure = error  # the events that are held come before it
        else:
            yield _END
        self.ended = True
        if ordering is not None and (rest := list(ordering.rest())):
            yield _batch_of(rest)
        if failure is not None:
            raise failure

    def _in_turn(self, batch: Batch) -> Batch:
        """The events whose turn it is after those of a batch; of those that concern nothing the key is kept, and nothing where there is none."""
        ordering, key = self.ordering, self.plan.key
        places: Sequence[Any] = batch.kept
        keys: Sequence[tuple[Json, ...]] = [()] * len(places)
        if key is not None:
            found = batch.kept
            if ordering is not None:
                places, found = [values[0] for values in found], [values[1:] for values in found]
            elif len(key.fields) == 1:
                found = [(value,) for value in found]
            keys = [() if msgspec.UNSET in values else values for values in found]
        if ordering is None:
            return batch._replace(kept=keys)
        return _batch_of(ordering.add_all(batch, places, keys))

    def _with_new_keys(self, key: Key, batch: Batch) -> Sequence[tuple[int, Json]]:
        """The events of a batch, and of those that concern nothing the first of each key, with that alone."""
        new = [values for values in dict.fromkeys(batch.kept) if not self._is_known(values)]
        if not new:
            return batch.events
        names = [field.text for field in key.fields]
        also = [(batch.passed[batch.kept.index(values)], dict(zip(names, values, strict=False))) for values in new]
        return sorted([*batch.events, *also], key=itemgetter(0))

    def _is_known(self, values: tuple[Json, ...]) -> bool:
        """Whether an event that has these in the fields of the key, or nothing for one that lacks one of them, would not be the first."""
        if values not in self._passed:
            watch = self._keyed.get(tuple(map(value_key, values)))
            if watch is None and (values or not self._without_key):
                return False
            self._passed[values] = watch
        return True

    def _count_passed(self, batch: Batch, events: Sequence[tuple[int, Json]], end: int) -> None:
        """Count for their keys the events of a batch, before that place, that concern nothing and were not looked at."""
        looked_at = {place for place, _ in events}
        passed = zip(batch.passed, batch.kept, strict=True)
        for values, number in Counter(key for place, key in passed if place < end and place not in looked_at).items():
            if not self._is_known(values):
                continue
            watch = self._passed[values]
            if watch is None:
                self._without_key += number
            else:
                watch.events += number

    def _tell(self, change: VerdictChange) -> None:
        monitors = change.watch.monitors
        if change.detected:
            self.detected = change.number
        for listener in self.listeners:
            listener.change(change)
        if monitors.repeat and change.detected[:1] == [0]:
            monitors.found[0].explanation = change.explanations.get(0)
        monitors.begin_again()

    def _pass_over(self, batch: Batch, events: Sequence[tuple[int, Json]], last: int) -> None:
        """Count those of a batch that concern nothing and so are not among the events; `last` is the number of its last event."""
        passed = batch.total - len(events)
        if self.plan.monitors.counts_all:
            self._fill(last + 1)
        if self.totals.statistics is not None:
            self.totals.statistics.events += passed
        self.number = last
        if self.plan.key is None:
            self.watch.events += passed
        else:
            self._count_passed(batch, events, batch.total)

    def _fill(self, number: int) -> None:
        """Events before that number that were passed over, since they fit nothing: under `strict` they end a match, and a text says itself."""
        while self.watch.monitors.live and self.number + 1 < number:
            self.number, changed = self.watch.monitors.repeat_step(_NO_EVENT, self.number + 1, number - 1)
            if changed:
                self._tell(VerdictChange(self.watch, self.number, _NO_EVENT, changed))

    def _watch_of(self, key: Key, event: Json, number: int) -> MonitoredTrace | None:
        """The watch that an event is for, None for one that lacks the key; raises `TooLarge` beyond as many keys as are told apart."""
        plain: tuple[Json, ...] = ()
        if type(event) is dict and self._key_names:  # mostly; asked of every event
            plain = tuple([event.get(name) for name in self._key_names])
            if not _PLAIN_KEYS.issuperset(map(type, plain)):
                plain = ()
            elif (known := self._passed.get(plain)) is not None:
                return known
        found = key.of(event)
        if found is None or (isinstance(event, NonFiniteEvent) and not is_finite(found)):  # that equals no other value
            self._without_key += 1
            self._first_without_key = self._first_without_key or number
            return None
        name = tuple(map(value_key, found))  # 1 and 1.0 are one value, `true` is another
        watch = self._keyed.get(name)
        if watch is None:
            if len(self._keyed) >= self.plan.max_keys:
                what = " and ".join(field.text for field in key.fields)
                remedy = "raise it with --max-keys N, or name another field"
                raise TooLarge(f"different values of {what}", limit=self.plan.max_keys, remedy=remedy)
            watch = MonitoredTrace(self.trace, self.watch.monitors.fork(), found, self.buffer)
            self._keyed[name] = watch
            for listener in self.listeners:
                listener.begin(watch)
        if plain:
            self._passed[plain] = watch
        return watch

    @property
    def state(self) -> Any:
        """What `restore` needs to go on from here, in classes that hold data only."""
        watches = [(watch.key, watch.monitors.snapshot, watch.events) for watch in self.watches]
        without, totals = (self._without_key, self._first_without_key), (self.totals.statistics, self.totals.oversights)
        return watches, without, self.buffer.known, self.clock, self.ordering, totals

    def restore(self, state: Any, number: int) -> None:
        """Go on from a state after the event of that number."""
        watches, without, known, self.clock, self.ordering, (statistics, self.totals.oversights) = state
        self.totals.oversights.attach(self.plan.monitors.types)
        self.number = number
        self._without_key, self._first_without_key = without
        if statistics is not None:
            self.totals.statistics = statistics
            statistics.types = self.plan.monitors.types
        self.buffer.known.update(known)
        for key, snapshot, events in watches:
            monitors = self.plan.monitors.resumed(snapshot)
            watch = MonitoredTrace(self.trace, monitors, key, self.buffer, events)
            if key is None:
                self.watch = watch
            else:
                self._keyed[tuple(map(value_key, key))] = watch

    def end(self) -> None:
        """The trace ends, and was not malformed."""
        for watch in self.watches:
            for listener in self.listeners:
                listener.end(watch)
            if self.totals.hindsight is not None and watch.monitors.verdicts[0] is Verdict.FALSE:
                self.totals.hindsight.look(id(watch), self.prefix)

    def stop(self) -> None:
        """The trace cannot be read further; where it never began, nobody is told."""
        for watch in self.watches if self.begun else ():
            for listener in self.listeners:
                listener.stop(watch)

    @property
    def found(self) -> bool:
        """Whether something was detected."""
        return any(count.told for watch in self.watches for count in watch.monitors.found)

    @property
    def warnings(self) -> Iterator[str]:
        """What was odd about the events, each as a line."""
        counts = [count for watch in self.watches for count in watch.monitors.found if count.first_suppressed]
        if counts:
            first = min(count.first_suppressed or 0 for count in counts)
            suppressed = sum(count.suppressed for count in counts)
            yield f"{counted(suppressed, 'detection')} suppressed by the cooldown (first: event {first})"
        if self._without_key and self.plan.key is not None:
            lacking = f"{counted(self._without_key)} without the field {' or '.join(one.text for one in self.plan.key.fields)}"
            yield f"{lacking}, given to no monitor (first: event {self._first_without_key})"
        if self.clock is not None and self.clock.count:
            name = self.clock.field.text
            goes = f"the field {name} goes back at {counted(self.clock.count)} (first: event {self.clock.first})"
            yield f"{goes}; put them in order with --order-by {name}"
        if self.ordering is not None:
            name, ordering = self.ordering.field.text, self.ordering
            if ordering.late:
                more = f"too late for a window of {self.plan.window}: they stay where they stand"
                yield f"{counted(ordering.late)} by the field {name} {more} (first: event {ordering.first_late} as read)"
            if ordering.without:
                what = "a number or a time of ISO 8601"
                remedy = f"; `time {name} as FORMAT;` in the tree says how others are read"
                if ordering.time is not None:
                    what, remedy = f"a time as {ordering.time.format}", ""
                lacking = f"{counted(ordering.without)} without {what} in the field {name} stay behind the event before"
                yield f"{lacking} (first: event {ordering.first_without} as read){remedy}"
