"""One trace from its first event to its last: batches of events go to the monitors, what these say goes to the listeners."""

import re
from collections import OrderedDict
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from io import BufferedIOBase, IOBase
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, cast

from rvaft.analysis.pattern_index import Scope, TreeReads
from rvaft.errors import RvaftError, TooLarge
from rvaft.model.nodes import Kind
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.explanation_json import PLACES, counted, matched_events, unlike
from rvaft.monitoring.fast_reader import FastReader, blocks
from rvaft.monitoring.monitor_set import MonitorSet
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.reader import BLANK, decode, read
from rvaft.monitoring.stream import DEFAULT_WINDOW, END, Backwards, Batch, Key, Ordering
from rvaft.monitors import Explanation
from rvaft.support.files import opened

TIME: Final = "time"
"""The field that is watched for going back, in the events that concern the tree."""
MAX_KEYS: Final = 100_000
"""How many values of a key are told apart."""
BOUND: Final = 10_000
"""How many events are remembered for explanations."""
_UNSURE: Final = re.compile(rb"\n[ \t\r\n]")
"""What may be a blank line, which counts as no event."""
_NO_EVENT: Final[dict[str, Json]] = {}
"""Stands for any event that fits no pattern: where there are such, no pattern is without a literal."""


class EventBuffer:
    """The events of one trace, by their numbers, that explanations may name.

    Those that may become part of a match are remembered, up to `bound`; beyond it the oldest are forgotten. In a regular file, `path`, whose
    events are numbered as they stand, they are then looked up; in a stream they are gone. `reads` is what was read of them.
    """

    def __init__(self, path: Path | None = None, *, reads: Scope | None = None, bound: int = BOUND) -> None:
        self.path = path
        self.reads = reads
        self.bound = bound
        self.known: OrderedDict[int, Json] = OrderedDict()  # a dict looks for its first key among all that were removed
        """Those that are remembered."""

    def remember(self, number: int, event: Json) -> None:
        """An event that may become part of a match."""
        if len(self.known) >= self.bound:
            self.known.popitem(last=False)
        self.known[number] = event

    def events(self, numbers: Collection[int]) -> Mapping[int, Json]:
        """The events with these numbers, as far as they are known; what has changed in the file since it was read is left out."""
        known = {number: self.known[number] for number in numbers if number in self.known}
        missing = {number for number in numbers if number not in known}
        if missing and self.path is not None:
            with suppress(OSError, RvaftError, ValueError), opened(self.path) as stream:
                for number, line in _lines(cast("BufferedIOBase", stream), str(self.path), missing):
                    known[number] = decode(line, reads=self.reads)
                    if len(known) == len(numbers):
                        break
        return known


def _lines(stream: BufferedIOBase, file: str, numbers: set[int]) -> Iterator[tuple[int, bytes]]:
    """The lines of the events that have these numbers. Blocks without any are counted and not split."""
    number = 0
    for block in blocks(stream, file):
        text = block.text
        if text[:1] not in BLANK and not _UNSURE.search(text):
            count = text.count(b"\n") + (not text.endswith(b"\n"))
            if numbers.isdisjoint(range(number + 1, number + count + 1)):
                number += count
                continue
        for line in block.lines:
            if line.strip(BLANK):
                number += 1
                if number in numbers:
                    yield number, line


@dataclass(slots=True)
class MonitoredTrace:
    """The monitors of one trace, or of one value of a key in it."""

    trace: str
    monitors: MonitorSet
    key: tuple[Json, ...] | None = None
    buffer: EventBuffer = field(default_factory=EventBuffer)
    events: int = 0
    """How many events it was given."""


class Detection(NamedTuple):
    """One match that was found, the events in it that are known, and the kinds whose monitors it detected."""

    explanation: Explanation | None
    events: Mapping[int, Json]
    kinds: frozenset[Kind] = frozenset()


class VerdictChange:
    """What one event changed: the columns whose verdict is another, and how that came about."""

    def __init__(self, watch: MonitoredTrace, number: int, event: Json, columns: Sequence[int]) -> None:
        self.watch = watch
        self.number = number
        self.event = event
        self.columns = columns
        self.verdicts = watch.monitors.verdicts
        self.detected = [column for column in columns if self.verdicts[column] is Verdict.TRUE]
        """The columns that detect."""

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
    def detections(self) -> Sequence[Detection]:
        """What was detected, each match once: by the monitors of branches or kinds where these are monitored, else by that of the tree."""
        parts = [column for column in self.detected if column] or self.detected
        if parts and not self.explanations:
            return [Detection(None, {})]  # a backend does not explain
        found = []
        for columns, explanation in unlike({column: self.explanations.get(column) for column in parts}):
            wholes = [self.watch.monitors.columns[column].part.part_of for column in columns]
            kinds = frozenset(whole.kind for whole in wholes if whole is not None and whole.kind is not None)
            found.append(Detection(explanation, self.events, kinds))
        return found


class Listener:
    """Told of what happens in a run; does nothing with it.

    With `every` it is told of every event, else only of those that change a verdict; with `whole` it has to see all of an event.
    Otherwise events may be read quickly.
    """

    every = False
    whole = False
    told_before = 0
    """The number of the last event of which an earlier run told what it detected."""

    def begin(self, watch: MonitoredTrace) -> None:
        """A trace begins, or the first event of a key came."""

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """The event of that number was read and changed no verdict; only with `every`."""

    def change(self, change: VerdictChange) -> None:
        """An event changed verdicts."""

    def end(self, watch: MonitoredTrace) -> None:
        """The trace ends, and was not malformed."""

    def stop(self, watch: MonitoredTrace) -> None:
        """The trace was malformed, or could not be read further: no event and no end comes any more."""


@dataclass(frozen=True)
class MonitoringPlan:
    """What is done with every trace: `monitors` have read nothing; `reads` is what is read of an event; `told` are fields that are told."""

    monitors: MonitorSet
    reads: Scope
    key: Key | None = None
    max_keys: int = MAX_KEYS
    order_by: str | None = None
    window: int = DEFAULT_WINDOW
    told: tuple[str, ...] = PLACES

    @property
    def plain(self) -> bool:
        """Whether every event goes to the same monitors, in the order in which it stands."""
        return self.key is None and self.order_by is None

    @cached_property
    def fast_reader(self) -> FastReader | None:
        """What reads files quickly, or None where every event has to be seen as it stands."""
        if not self.plain or not self.monitors.engines or not isinstance(self.reads, TreeReads):
            return None
        return FastReader.of(self.reads, dict.fromkeys((TIME, *self.told)), self.monitors.types.possible)


class TraceRun:
    """One trace; `statistics`, where they are wanted, count its events too, and `prefix` is what they put before a place in it.

    `read` takes the events, from wherever they come, and `begin` and `end` (or `stop`) go before and after it.
    """

    def __init__(
        self,
        plan: MonitoringPlan,
        trace: str,
        listeners: Sequence[Listener],
        *,
        buffer: EventBuffer,
        statistics: Statistics | None = None,
        prefix: str = "",
    ) -> None:
        self.plan = plan
        self.listeners = tuple(listeners)
        self.statistics = statistics
        self.prefix = prefix
        self.ordering = None if plan.order_by is None else Ordering(plan.order_by, window=plan.window)
        self.clock = Backwards(TIME) if plan.order_by is None else None
        self.number = 0
        """That of the last event."""
        self.detected = 0
        """That of the last event that detected something."""
        self.watch = MonitoredTrace(trace, plan.monitors.fork(), buffer=buffer)
        """What is watched; with a key what is copied for each value of it."""
        self.ended = False
        """Whether nothing more is read, and only events that were held back come."""
        self.without_key = self.first_without_key = 0
        """How many events do not have the key, and the number of the first."""
        self._keyed: dict[Hashable, MonitoredTrace] = {}
        self._every = tuple(listener for listener in listeners if listener.every)
        semantics = plan.monitors.semantics
        self._strict = semantics is Semantics.STRICT
        self._skips = semantics is Semantics.PROJECTED and bool(plan.monitors.engines)
        """Whether the monitors need not see events that are not relevant."""

    @property
    def watches(self) -> list[MonitoredTrace]:
        """What was watched: the trace, or each key that came, in the order in which they came."""
        return [self.watch] if self.plan.key is None else list(self._keyed.values())

    def begin(self) -> None:
        """The trace begins, or goes on."""
        for watch in self.watches:
            for listener in self.listeners:
                listener.begin(watch)

    def read(
        self, source: BinaryIO | Iterable[Json], name: str, *, line: int = 1, by_blocks: bool = False
    ) -> Iterator[bool]:
        """Read all events of a stream, or events as they are, and pause after each batch of them.

        Gives False once where the trace has ended; events that were held back come after that. `line` is the number of the line where a
        stream goes on; `by_blocks` says that it need not be read as it comes. Raises what `rvaft.monitoring.reader.read` raises.
        """
        listening = bool(self._every)
        for batch in self._batches(source, name, line, by_blocks=by_blocks):
            before = self.number
            statistics, key, clock, watch = self.statistics, self.plan.key, self.clock, self.watch
            look_up, strict, skips, prefix = self.plan.monitors.types.of, self._strict, self._skips, self.prefix
            # From here on every call counts: this is done for each event of a log.
            for place, event in batch.events:
                number = before + place + 1
                if strict:
                    self._fill(number)
                self.number = number
                sight = look_up(event)
                relevant = True
                if statistics is not None:
                    if sight.plain and sight.noted is statistics:
                        statistics.events += 1
                        statistics.tally[sight.constant] += 1  # type: ignore[index] # plain says so
                    else:
                        relevant = statistics.add(event, number, prefix, sight)
                if key is not None:
                    found = self._watch_of(key, event, number)
                    if found is None:
                        continue
                    watch = found
                watch.events += 1
                if relevant or not skips:
                    monitors = watch.monitors
                    changed = monitors.step(event, number, sight)
                    if clock is not None and monitors.concerned:
                        clock.see(number, event)
                    if monitors.serves:
                        watch.buffer.remember(number, event)
                    if changed:
                        self._tell(VerdictChange(watch, number, event, changed))
                        continue
                if listening:
                    for listener in self._every:
                        listener.event(watch, number, event)
            passed = batch.count - len(batch.events)
            if passed:
                if strict:
                    self._fill(before + batch.count + 1)
                if statistics is not None:
                    statistics.events += passed
                self.number = before + batch.count
                self.watch.events += passed
            yield batch is not END

    def _batches(self, source: BinaryIO | Iterable[Json], name: str, line: int, *, by_blocks: bool) -> Iterator[Batch]:
        found: Iterable[Any] = source
        if isinstance(source, IOBase):
            seen = any(listener.every or listener.whole for listener in self.listeners)
            if by_blocks and not seen and self.plan.fast_reader is not None:
                yield from self.plan.fast_reader.read(cast("BufferedIOBase", source), name)
                yield END
                return
            found = read(cast("BinaryIO", source), name=name, reads=self.plan.reads, line=line)
        if self.ordering is None:
            for event in found:
                yield Batch(1, ((0, event),))
            yield END
            return
        failure: Exception | None = None
        try:
            for event in found:
                given = self.ordering.add(event)
                if given is not None:
                    yield Batch(1, ((0, given),))
        except (RvaftError, OSError) as error:
            failure = error  # the events that are held come before it
        if failure is None:
            yield END
        self.ended = True
        for event in self.ordering.rest():
            yield Batch(1, ((0, event),))
        if failure is not None:
            raise failure

    def _tell(self, change: VerdictChange) -> None:
        if change.detected:
            self.detected = change.number
        for listener in self.listeners:
            listener.change(change)

    def _fill(self, number: int) -> None:
        """Under `strict` an event before that number that was passed over, since it fits nothing, ends a match."""
        while self.watch.monitors.live and self.number + 1 < number:
            self.number += 1
            changed = self.watch.monitors.step(_NO_EVENT, self.number)
            if changed:
                self._tell(VerdictChange(self.watch, self.number, _NO_EVENT, changed))

    def _watch_of(self, key: Key, event: Json, number: int) -> MonitoredTrace | None:
        """The watch that an event is for, None for one that lacks the key; raises `TooLarge` beyond as many keys as are told apart."""
        found = key.of(event)
        if found is None:
            self.without_key += 1
            self.first_without_key = self.first_without_key or number
            return None
        name = key.name(found)
        watch = self._keyed.get(name)
        if watch is None:
            if len(self._keyed) >= self.plan.max_keys:
                what = " and ".join(field.text for field in key.fields)
                error = TooLarge(f"different values of {what}", limit=self.plan.max_keys)
                error.add_note("raise it with --max-keys N, or name another field")
                raise error
            watch = MonitoredTrace(self.watch.trace, self.watch.monitors.fork(), found, self.watch.buffer)
            self._keyed[name] = watch
            for listener in self.listeners:
                listener.begin(watch)
        return watch

    @property
    def state(self) -> Any:
        """What `restore` needs to go on from here, in classes that hold data only."""
        watches = [(watch.key, watch.monitors.snapshot, watch.events) for watch in self.watches]
        without = self.without_key, self.first_without_key
        return watches, without, self.watch.buffer.known, self.clock, self.ordering, self.statistics

    def restore(self, state: Any, number: int) -> None:
        """Go on from a state after the event of that number."""
        watches, without, known, self.clock, self.ordering, statistics = state
        self.number = number
        self.without_key, self.first_without_key = without
        if statistics is not None:
            self.statistics = statistics
            statistics.types = self.plan.monitors.types
        self.watch.buffer.known.update(known)
        for key, snapshot, events in watches:
            watch = MonitoredTrace(
                self.watch.trace, self.plan.monitors.resumed(snapshot), key, self.watch.buffer, events
            )
            if self.plan.key is None:
                self.watch = watch
            else:
                self._keyed[self.plan.key.name(key)] = watch

    def end(self) -> None:
        """The trace ends, and was not malformed."""
        for watch in self.watches:
            for listener in self.listeners:
                listener.end(watch)

    def stop(self) -> None:
        """The trace cannot be read further."""
        for watch in self.watches:
            for listener in self.listeners:
                listener.stop(watch)

    @property
    def found(self) -> bool:
        """Whether something was detected."""
        return any(verdict is Verdict.TRUE for watch in self.watches for verdict in watch.monitors.verdicts)

    @property
    def warnings(self) -> Iterator[str]:
        """What was odd about the events, each as a line."""
        if self.without_key:
            lacking = f"{counted(self.without_key)} without the field {self.plan.key}"
            yield f"{lacking}, given to no monitor (first: event {self.first_without_key})"
        if self.clock is not None and self.clock.count:
            goes = f"the field {TIME} goes back at {counted(self.clock.count)} (first: event {self.clock.first})"
            yield f"{goes}; put them in order with --order-by {TIME}"
        if self.ordering is not None:
            name, ordering = self.plan.order_by, self.ordering
            if ordering.late:
                more = f"too late for a window of {self.plan.window}: they stay where they stand"
                yield f"{counted(ordering.late)} by the field {name} {more} (first: event {ordering.first_late} as read)"
            if ordering.without:
                lacking = f"{counted(ordering.without)} without a number in the field {name}"
                yield f"{lacking} stay behind the event before (first: event {ordering.first_without} as read)"
