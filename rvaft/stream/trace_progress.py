"""The progress over one trace: the monitors of each key, the counts, late events, and the listeners."""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from datetime import datetime
from heapq import heappop, heappush
from itertools import count
from math import inf
from operator import itemgetter, methodcaller
from typing import Any, Final, TypeAlias, cast

from rvaft.model.event_time import JUMPS, Jump
from rvaft.model.values import Json, JsonObject
from rvaft.model.values import key as value_key
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.readers.log import Batch
from rvaft.stream.data_warnings import DataWarnings, checked
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import DistinctEvents, DistinctState, KeyedTraces
from rvaft.stream.lateness import WAITING, BatchLateness, KeyedTimes, lateness, numbered_jumps
from rvaft.stream.listeners import Audience, Listener
from rvaft.stream.order import Backwards, Ordering
from rvaft.stream.plan import TIME, MonitoringPlan, Totals
from rvaft.stream.statistics import Statistics
from rvaft.stream.verdict_change import MonitoredTrace, TraceState, VerdictChange, time_told
from rvaft.support.wording import counted

_OTHER_KEY: Final = "event of another key"
KeyValues: TypeAlias = tuple[Json, ...]
"""An irrelevant event: its values in the key fields, or () if it lacks one."""
Turn: TypeAlias = tuple[int | None, JsonObject | KeyValues]
"""An event, or what stands for an irrelevant one, after its line."""
Placed: TypeAlias = tuple[int, JsonObject]
"""An event after its place in a block, from 0."""
StateBeside: TypeAlias = tuple[
    tuple[int, ...],
    tuple[OrderedDict[int, JsonObject], dict[int, int | None]],
    Backwards | None,
    Ordering[Turn] | None,
    tuple[Statistics | None, DataWarnings],
    DistinctState | None,
]
"""Events without a key, buffer with lines, clock, order, totals, ids."""
RunState: TypeAlias = tuple[list[TraceState], StateBeside]


@dataclass(eq=False)
class TraceProgress:
    """The monitors and the counts over one trace, and what listeners are told.

    `prefix` precedes event numbers in messages. `number` is the last event, `detected` the last
    one with a detection. Once the trace has `ended`, only held-back events come.
    """

    plan: MonitoringPlan
    trace: str
    listeners: Sequence[Listener]
    totals: Totals
    _: KW_ONLY
    buffer: EventBuffer
    prefix: str = ""

    def __post_init__(self) -> None:
        if self.totals.semantics_hint is not None:
            self.totals.semantics_hint.forget()
        monitors, by = self.plan.monitors, self.plan.order_by
        self.ordering: Ordering[Turn] | None = None
        if by is not None:
            self.ordering = Ordering(by, window=self.plan.window, time=monitors.time)
        name = TIME if monitors.time is None else ".".join(monitors.time.field)
        self.distinct: DistinctEvents | None = None
        if self.plan.distinct is not None:
            ids, most, warn = self.plan.distinct, self.plan.max_distinct, self.totals.data_warnings.warn
            self.distinct = DistinctEvents(ids, self.plan.key, most, warn)
        self.clock = None if by is not None or monitors.may_be_late else Backwards(name, monitors.time)
        self.assumed = checked(monitors.types.tree, order=not monitors.engines)
        self.assumes_in_bulk = self.assumed is None or self.plan.has_checked_events(self.assumed)
        """Whether the assumptions, if any, can be checked for many events at once."""
        self.number = self.detected = 0
        self.lines: tuple[int, Sequence[int | None]] = 0, ()
        """A number, and the lines of the events after it."""
        self.begun = self.ended = False
        self.leads = True
        """Whether the ids of events are kept with the state of this run, of several over one trace."""
        self.times: BatchLateness | None = None
        """The times of the current batch, if one monitor reads all events and some may be late."""
        self._passed: list[tuple[BatchLateness, int, Sequence[int | None]]] = []
        """The last batches whose jumps are not noted: times, the event before them, and lines."""
        self.keyed_times = KeyedTimes()
        self._coming: dict[tuple[Json, ...], list[Json]] = {}
        """The events of each key, of a log that backends read as a whole."""
        self._deadlines: list[tuple[float, int, MonitoredTrace]] = []
        """A heap of the deadlines of keys in order of arrival, with others that are no longer waited for."""
        self._arrivals = count()
        self._waiting: dict[MonitoredTrace, float] = {}
        """The deadlines that are waited for."""
        self.watch = MonitoredTrace(self.trace, monitors.fork(), buffer=self.buffer)
        """The monitored trace; with a key, the template for each value."""
        key, most = self.plan.key, self.plan.max_keys
        self.keys = None if key is None else KeyedTraces(key, most, self._of_key, self._begin_trace, self._forgets_keys)
        self.prepare()

    def _of_key(self, values: tuple[Json, ...]) -> MonitoredTrace:
        watch = MonitoredTrace(self.trace, self.watch.monitors.fork(), values, self.buffer)
        if self._coming:
            watch.monitors.expect(self._coming[tuple(map(value_key, values))])
        return watch

    def _forgets_keys(self) -> bool:
        self.keyed_times.settle()
        return self.may_forget_keys

    @property
    def may_forget_keys(self) -> bool:
        """Whether no listener needs each key."""
        return not any(listener.each_key for listener in self.listeners)

    def _begin_trace(self, watch: MonitoredTrace) -> None:
        for listener in self.listeners:
            listener.begin(watch)

    def prepare(self, *, one_by_one: bool | None = None) -> None:
        """Prepare to read events from the current position; `one_by_one` is by default that of the plan."""
        one_by_one = self.one_by_one if one_by_one is None else one_by_one
        self.audience = Audience.of(self.listeners, one_by_one=one_by_one)
        self._notified, self._verdicts = self.number, self.watch.monitors.verdicts

    @property
    def one_by_one(self) -> bool:
        """Whether listeners receive events one at a time."""
        return self.keys is not None or self.plan.monitors.counts_all

    @property
    def needs_each(self) -> bool:
        """Whether irrelevant events must be passed one at a time, not only their number."""
        monitors = self.plan.monitors
        all_read = self.keys is not None or not self.assumes_in_bulk or bool(self.audience.each)
        return all_read or monitors.counts_all

    @property
    def watches(self) -> list[MonitoredTrace]:
        """The monitored trace, or that of each key in order of first occurrence; see `settle`."""
        return [self.watch] if self.keys is None else self.keys.traces

    def settle(self) -> None:
        """Tell the monitors of the times of events that they did not read, before their states are kept."""
        if self._passed:
            self._note_jumps()
        self.keyed_times.settle()

    def line_of(self, number: int) -> int | None:
        """Return the line of a current event in the input; None if it has no lines."""
        before, lines = self.lines
        return lines[number - before - 1] if before < number <= before + len(lines) else None

    def begin(self) -> None:
        """Notify listeners that the trace begins or continues."""
        self.begun = True
        for watch in self.watches:
            self._begin_trace(watch)

    def expect(self, events: Sequence[JsonObject]) -> None:
        """Announce all events to the monitors."""
        if self.keys is None:
            self.watch.monitors.expect(events)
        key = self.plan.key
        for event in () if key is None else events:
            if key is not None and (values := key.of(event)) is not None:
                self._coming.setdefault(tuple(map(value_key, values)), []).append(event)

    def _lateness(self, block: Batch, events: Sequence[Placed]) -> BatchLateness | None:
        """Return the times of a batch, or None if no event may be late, or each key has a latest time."""
        time, monitors = self.plan.monitors.time, self.watch.monitors
        if not monitors.may_be_late or self.keys is not None or time is None:
            return None
        latest = monitors.engines[0].latest
        if block.times is None:
            assert len(events) == block.total, "all events are read, since their times count"
            return lateness(time, time.written_in([event for _, event in events]), latest)
        known = cast("dict[object, BatchLateness]", block.times.known)
        if (time, latest) not in known:
            known[time, latest] = lateness(time, block.times.values, latest, block.times.exact)
        return known[time, latest]

    def _with_late(self, block: Batch, events: Sequence[Placed]) -> Sequence[Placed]:
        """Return the events with the late ones among the irrelevant events."""
        if block.times is None or self.times is None or not self.times.late:
            return events
        also = self.times.late.keys() - {place for place, _ in events}
        return sorted([*events, *((place, block.times.event(place)) for place in also)], key=itemgetter(0))

    def _pass_times(self, times: BatchLateness, before: int, last: int) -> None:
        """Note the maximum time after a batch; its jumps are found when they are needed."""
        self._passed.append((times, before, self.lines[1]))
        if len(self._passed) > WAITING:
            self._note_jumps()
        self.watch.monitors.reach(times.latest(last))

    def _note_jumps(self) -> None:
        """Note the last jumps of the maximum time in the batches that have passed."""
        found = list[Jump]()
        for times, before, lines in reversed(self._passed):
            found = [*numbered_jumps(times.jumps, before, lines), *found]
            if len(found) >= JUMPS:
                break
        engine = self.watch.monitors.engines[0]
        engine.jumps = (*engine.jumps, *found)[-JUMPS:]
        self._passed.clear()

    def _is_late(self, watch: MonitoredTrace, place: int, event: JsonObject) -> bool:
        """Whether an event of a key is late."""
        self.keyed_times.settle(watch)
        engine = watch.monitors.engines[0]
        late = engine.is_late(event, *self.numbered(place))
        self.keyed_times.greatest = max(self.keyed_times.greatest, engine.latest or -inf)
        return late

    def numbered(self, place: int) -> tuple[int, int | None]:
        """Return the number of the event at a place, and its line if that differs."""
        before, lines = self.lines
        number = before + place + 1
        return number, None if not lines or lines[place] == number else lines[place]

    def note_late(self, watch: MonitoredTrace, place: int, event: JsonObject) -> None:
        """Warn of a late event at this place."""
        if self._passed:
            self._note_jumps()
        (before, lines), engine = self.lines, watch.monitors.engines[0]
        latest, jumps = engine.latest, engine.jumps
        if self.times is not None:
            latest, placed = self.times.late[place]
            jumps = (*jumps, *numbered_jumps(placed, before, lines))[-JUMPS:]
        self.totals.data_warnings.note_late(event, before + place + 1, self.prefix, latest, jumps)

    def remember(self, served: Sequence[tuple[Any, ...]]) -> None:
        """Keep events that an explanation may name, each after its number."""
        if served:
            self.buffer.remember_all(served, *self.lines)

    def notify_unchanged(self, last: int) -> None:
        """Notify listeners of events without a change, up to this number."""
        if self._notified < last:
            for listener in self.audience.in_rows:
                listener.events(self.watch, self._notified + 1, last, self._verdicts)
            self._notified = last

    def pass_time(self, time: Json | datetime) -> None:
        """Tell all monitors that a time has come, which changes verdicts without an event."""
        self.keyed_times.settle()
        self._tell(self.watches, methodcaller("pass_time", time), time_told(time))
        known = (engine.latest for watch in self.watches for engine in watch.monitors.engines[:1])
        self.keyed_times.greatest = max([self.keyed_times.greatest, *(one for one in known if one is not None)])

    def decide(self, time: int) -> None:
        """Tell all monitors a time in nanoseconds, of an event of another key, which makes no event late."""
        self._tell(self.watches, methodcaller("decide", time), _OTHER_KEY)

    def finish(self) -> None:
        """Tell all monitors that the trace is complete."""
        self._tell(self.watches, methodcaller("finish"), "end of the log")

    def _note_deadline(self, watch: MonitoredTrace) -> None:
        """Remember the deadline of a key, which events of other keys may pass."""
        deadline = watch.monitors.deadline
        if deadline < inf and self._waiting.get(watch) != deadline:
            self._waiting[watch] = deadline
            heappush(self._deadlines, (deadline, next(self._arrivals), watch))

    def _pass_to_all(self, event: JsonObject) -> None:
        """Decide the deadlines of all keys that the time of an event has passed."""
        time = None if self.plan.monitors.time is None else self.plan.monitors.time.read(event)
        while time is not None and self._deadlines and self._deadlines[0][0] < time:
            deadline, _, watch = heappop(self._deadlines)
            if self._waiting.get(watch) == deadline:
                del self._waiting[watch]
                self._tell([watch], methodcaller("decide", time), _OTHER_KEY)
                self._note_deadline(watch)

    def _tell(self, watches: Iterable[MonitoredTrace], tell: Callable[[Monitor], Verdict], passed: str) -> None:
        for watch in watches:
            watch.told += 1
            changed = watch.monitors.told(tell, self.number)
            if changed:
                self.notify(VerdictChange(watch, self.number, {}, changed, passed=passed))

    def notify(self, change: VerdictChange) -> None:
        """Notify listeners of a change, after the events before it."""
        self.notify_unchanged(change.number - 1)
        monitors = change.watch.monitors
        if change.detected:
            self.detected = change.number
        for listener in self.listeners:
            listener.change(change)
        if monitors.repeat and change.detected[:1] == [0]:
            monitors.found[0].explanation = change.explanations.get(0)
        monitors.begin_again()
        if self.audience.in_rows:
            self._notified, self._verdicts = change.number, monitors.verdicts

    @property
    def state(self) -> RunState:
        """The state for `restore`."""
        self.settle()
        return [watch.state for watch in self.watches], self.state_beside

    @property
    def state_beside(self) -> StateBeside:
        """The state besides that of the monitored traces."""
        keyed = () if self.keys is None else self.keys.state
        totals = (self.totals.statistics, self.totals.data_warnings)
        ids = self.distinct.state if self.distinct is not None and self.leads else None
        return keyed, (self.buffer.known, self.buffer.lines), self.clock, self.ordering, totals, ids

    def restore(self, state: RunState, number: int) -> None:
        """Continue from a state after the event of that number."""
        watches, beside = state
        warn = self.totals.data_warnings.warn
        keyed, (known, lines), self.clock, self.ordering, totals, ids = beside
        statistics, self.totals.data_warnings = totals
        if self.distinct is not None and ids is not None:
            self.distinct.restore(ids)
        self.totals.data_warnings.attach(self.plan.monitors.types, warn)
        self.number = number
        if statistics is not None:
            self.totals.statistics = statistics
            statistics.attach(self.plan.monitors.types)
        self.buffer.known.update(known)
        self.buffer.lines.update(lines)
        for key, snapshot, events in watches:
            monitors = self.plan.monitors.resumed(snapshot)
            watch = MonitoredTrace(self.trace, monitors, key, self.buffer, events)
            if key is None or self.keys is None:
                self.watch = watch
            else:
                latest = max((engine.latest or -inf for engine in monitors.engines), default=-inf)
                self.keyed_times.greatest = max(self.keyed_times.greatest, latest)
                self.keys.restore(watch, key)
        if self.keys is not None:
            self.keys.resume(keyed)
            for watch in self.keys.traces if self.plan.monitors.sees_times else ():
                self._note_deadline(watch)

    def end(self) -> None:
        """Notify listeners of a regular end."""
        for watch in self.watches:
            for listener in self.listeners:
                listener.end(watch)
            if self.totals.semantics_hint is not None and watch.monitors.verdicts[0] is Verdict.FALSE:
                self.totals.semantics_hint.look(id(watch), self.prefix)

    def stop(self) -> None:
        """Notify listeners that the trace cannot be read further."""
        for watch in self.watches if self.begun else ():
            for listener in self.listeners:
                listener.stop(watch)

    @property
    def found(self) -> bool:
        """Whether something was detected."""
        return any(count.notified for watch in self.watches for count in watch.monitors.found)

    @property
    def warnings(self) -> Iterator[str]:
        """The warnings about the events, one line each."""
        counts = [count for watch in self.watches for count in watch.monitors.found if count.first_suppressed]
        if counts:
            first = min(count.first_suppressed or 0 for count in counts)
            suppressed = sum(count.suppressed for count in counts)
            yield f"{counted(suppressed, 'detection')} suppressed by the cooldown (first: event {first})"
        for part in (self.keys, self.clock, self.ordering, self.distinct):
            if part is not None:
                yield from part.warnings
