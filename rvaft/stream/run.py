"""The run of one tree over one trace: the monitors of each key, the counts, and the listeners.

A batch in which nothing can change is only counted; otherwise the events are taken one by one.
"""

from bisect import bisect_right
from collections import Counter, OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from datetime import datetime
from heapq import heappop, heappush
from itertools import chain, count, repeat
from math import inf
from operator import itemgetter, length_hint, methodcaller
from typing import Any, Final, TypeAlias, cast

from rvaft.engine.compiled_tree import EventClass
from rvaft.engine.strategy import BatchEvent, Noted
from rvaft.errors import TooLarge
from rvaft.model.event_time import JUMPS, Jump
from rvaft.model.values import Json, JsonObject
from rvaft.model.values import key as value_key
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.readers.log import Batch
from rvaft.stream.bulk import EventGroup, Groups, changes_nothing, groups, needs_no_warning
from rvaft.stream.data_warnings import DataWarnings, checked
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import DistinctEvents, DistinctState, KeyedBatch, KeyedTraces
from rvaft.stream.lateness import WAITING, BatchLateness, KeyedTimes, lateness, numbered_jumps
from rvaft.stream.listeners import Audience, Listener
from rvaft.stream.order import Backwards, Ordering
from rvaft.stream.plan import TIME, MonitoringPlan, Totals
from rvaft.stream.statistics import EventKind, Statistics
from rvaft.stream.verdict_change import MonitoredTrace, TraceState, VerdictChange, time_told
from rvaft.support.wording import counted

FEW: Final = 32
"""Smaller blocks are not batches; also the maximum pause after failures."""
_OTHER_KEY: Final = "event of another key"
_NO_EVENT: Final[JsonObject] = {}
"""The stand-in for events that match no pattern."""
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
class TraceRun:
    """The run over one trace; `prefix` precedes event numbers in messages.

    A `pipeline` passes it the batches of the trace. `number` is the last event, `detected` the last
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
        self._tries = self._pause = 0
        self.times: BatchLateness | None = None
        """The times of the current batch, if one monitor reads all events and some may be late."""
        self._passed: list[tuple[BatchLateness, int, Sequence[int | None]]] = []
        """The last batches whose jumps are not noted: times, the event before them, and lines."""
        self._keyed_times = KeyedTimes()
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
        self._keyed_times.settle()
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
        self._keyed_times.settle()

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

    def pass_over(self, total: int, lines: Sequence[int | None] = ()) -> None:
        """Count events that do not concern the tree."""
        self.lines = self.number, lines
        self.number += total
        self.watch.events += total
        if self.totals.statistics is not None:
            self.totals.statistics.events += total

    def process(
        self,
        block: Batch,
        kinds: Mapping[int, EventKind] | None = None,
        found: Groups | None = None,
        *,
        turns: bool = False,
    ) -> Iterator[int]:
        """Process a block as a batch if only counts change, else event by event.

        `kinds` are the kinds of its events by their `id`, and `found` their groups, if they are known.
        With `turns`, the number of an event is yielded before its step, so that runs take turns.
        """
        before = self.number
        self.lines = before, block.lines
        events = block.events if self.keys is None or not block.passed else self._with_new_keys(block)
        monitors = self.plan.monitors
        self.times = self._lateness(block, events)
        together = self.assumes_in_bulk and not (self.audience.each or monitors.counts_all)
        try:
            steps = self._in_bulk(block, events, found, turns=turns) if together and events else None
            if steps is None:
                events = self._with_late(block, events)
                filled = self._filled(events, before) if monitors.counts_all else events
                yield from self._take(filled, before, kinds, turns=turns)
            else:
                yield from steps
                self.number = before + events[-1][0] + 1
            if self.times is not None:
                self._pass_times(self.times, before, block.total - 1)
        except TooLarge:
            if self.keys is None:
                self.watch.events = self.number
            else:
                self._count_passed(block, events, self.number - before - 1)
            raise
        if len(events) < block.total:
            self._pass_over(block, events, before + block.total)
        self.notify_unchanged(self.number)

    def _take(  # noqa: PLR0915
        self,
        events: Iterable[Placed],
        before: int,
        kinds: Mapping[int, EventKind] | None = None,
        *,
        turns: bool = False,
    ) -> Iterator[int]:
        """Step the monitors over events one by one; `before` is the event before place 0.

        `kinds` are known kinds by the `id` of an event. With `turns`, yield the number of an event before
        its step.
        """
        prefix, keys, fresh = self.prefix, self.keys, self.plan.monitors
        each, _, of_concern = self.audience
        skips = fresh.skips_irrelevant
        keyed_by = keys.names[0] if keys is not None and len(keys.names) == 1 else ""
        known = {} if keys is None else keys.known
        types, look_up = fresh.types, fresh.types.shapes.of
        may_be_late, counts_all = fresh.may_be_late, fresh.counts_all
        data_warnings, semantics_hint = self.totals.data_warnings, self.totals.semantics_hint
        statistics, clock, assumed = self.totals.statistics, self.clock, self.assumed
        sees_times = fresh.sees_times
        watch: MonitoredTrace | None = self.watch
        times, late = self.times, False
        served, concerned = list[Placed](), list[Placed]()
        try:
            for place, event in events:
                number = before + place + 1
                if turns:
                    yield number
                self.number = number
                if assumed is not None:
                    data_warnings.note_broken(assumed, event, f"{prefix}event {number}")
                if keys is not None:
                    if sees_times and self._deadlines:
                        self._remember(served)
                        served = []
                        self._pass_to_all(event)
                    value = event.get(keyed_by) if keyed_by else None
                    watch = known.get((value,)) if type(value) is str else None
                    watch = watch or keys.of(event, number)
                if may_be_late and watch is not None:
                    late = self._is_late(watch, place, event) if times is None else place in times.late
                event_kind = kinds.get(id(event), types.nothing) if kinds is not None else look_up(event).of(event)
                if late and watch is not None:
                    event_kind = types.late
                    self._note_late(watch, place, event)
                elif event_kind.checks.looked_at or type(event) is not dict:
                    data_warnings.see(event, number, prefix, event_kind)
                if statistics is not None:
                    if event_kind.noted is statistics and event_kind.relevant is not None:
                        statistics.events += 1
                        statistics.tally[event_kind.relevant] += 1
                    else:
                        statistics.add(event, number, prefix, event_kind)
                if watch is None:
                    continue
                watch.events += 1
                if semantics_hint is not None and event_kind.entries and not late:
                    semantics_hint.keep(id(watch), number, event)
                if event_kind.relevant or counts_all or (event_kind.serves and not skips):
                    monitors = watch.monitors
                    if times is not None:
                        monitors.reach(times.latest(place))
                    changed = monitors.step(event, number, event_kind.classes, late=late)
                    if sees_times and keys is not None:
                        self._note_deadline(watch)
                    if monitors.concerned:
                        concerned.append((number, event))
                    if monitors.serves:
                        served.append((number, event))
                    if changed:
                        self._remember(served)
                        served = []
                        self.notify(VerdictChange(watch, number, event, changed, self.line_of(number)))
                        continue
                    if of_concern and monitors.live and (monitors.concerned or (event_kind.relevant and not skips)):
                        for listener in of_concern:
                            listener.event(watch, number, event)
                for listener in each:
                    listener.event(watch, number, event)
        except TooLarge:
            self.notify_unchanged(self.number - 1)
            raise
        finally:
            self._remember(served)
            if clock is not None:
                clock.see_all(concerned)

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
        self._keyed_times.settle(watch)
        engine = watch.monitors.engines[0]
        late = engine.is_late(event, *self._numbered(place))
        self._keyed_times.greatest = max(self._keyed_times.greatest, engine.latest or -inf)
        return late

    def _numbered(self, place: int) -> tuple[int, int | None]:
        """Return the number of the event at a place, and its line if that differs."""
        before, lines = self.lines
        number = before + place + 1
        return number, None if not lines or lines[place] == number else lines[place]

    def _note_late(self, watch: MonitoredTrace, place: int, event: JsonObject) -> None:
        """Warn of a late event at this place."""
        if self._passed:
            self._note_jumps()
        (before, lines), engine = self.lines, watch.monitors.engines[0]
        latest, jumps = engine.latest, engine.jumps
        if self.times is not None:
            latest, placed = self.times.late[place]
            jumps = (*jumps, *numbered_jumps(placed, before, lines))[-JUMPS:]
        self.totals.data_warnings.note_late(event, before + place + 1, self.prefix, latest, jumps)

    def _remember(self, served: Sequence[tuple[Any, ...]]) -> None:
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
        self._keyed_times.settle()
        self._tell(self.watches, methodcaller("pass_time", time), time_told(time))
        known = (engine.latest for watch in self.watches for engine in watch.monitors.engines[:1])
        self._keyed_times.greatest = max([self._keyed_times.greatest, *(one for one in known if one is not None)])

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

    def _in_bulk(
        self, block: Batch, events: Sequence[Placed], found: Groups | None, *, turns: bool
    ) -> Iterator[int] | None:
        """Return the steps over events as a batch: none if no event can change the state.

        Return None if an event may cause a warning, or if a listener needs each. After a failure the next
        blocks are not tried; the pause doubles up to `FEW` blocks.
        """
        self._tries -= 1
        keyed_by = "" if self.keys is None or len(self.keys.names) != 1 else self.keys.names[0]
        if len(events) < FEW or self._tries > 0 or (self.keys is not None and not keyed_by):
            return None
        self._pause = self._tries = min(2 * self._pause + 1, FEW)
        bodies = [event for _, event in events]
        monitors, time = self.watch.monitors, self.plan.monitors.time
        if set(map(type, bodies)) != {dict}:
            return None
        keys = list(zip([event.get(keyed_by) for event in bodies], strict=True)) if keyed_by else []
        if keyed_by and {str} != set(map(type, chain.from_iterable(keys))):
            return None
        late: Collection[int] = () if self.times is None else self.times.late
        of_keys = None
        if self.keys is not None:
            before = self.lines[0]
            contiguous = len(events) == block.total
            numbers = (
                range(before + 1, before + 1 + block.total) if contiguous else [before + 1 + at for at, _ in events]
            )
            of_keys = KeyedBatch(self.keys.known, keys, numbers)
        if of_keys is not None and monitors.may_be_late and time is not None:
            late = self._timed(of_keys, time.of_all(time.written_in(bodies)))
        if late:
            found, bodies = None, [event for place, event in events if place not in late]
        if found is None:
            found = groups(self.plan.monitors.types, bodies)
        if found is None or (late and self.assumed is not None):
            return None
        concerned, stepped = list[EventGroup](), False
        timed = of_keys is not None and bool(of_keys.times) and None not in of_keys.times
        for event_kind, group in found:
            if not needs_no_warning(self.totals.data_warnings, group, event_kind, timed=timed):
                return None
            if self.assumed is not None and not self.assumed.is_kept(group):
                return None
            fits = changes_nothing(monitors, group, event_kind, keyed=bool(keyed_by))
            if fits is not False and (monitors.live or self.clock is not None):
                stepped = stepped or fits is None
                concerned.append(group)
        # an event that can extend no partial match may be relevant all the same: `_take` reports it
        relevant = not monitors.skips_irrelevant and any(kind.relevant for kind, _ in found)
        if (concerned or relevant) and self.audience.of_concern and monitors.live:
            return None
        self._pause = self._tries = 0
        batch = list[BatchEvent]()
        if stepped:
            projects = monitors.semantics.projects
            some = [(kind, group) for kind, group in found if kind.relevant or (kind.serves and not projects)]
            batch = self._batch(some, events, of_keys)
        elif self.clock is not None and concerned:
            self.clock.see_all(_numbered(concerned, events, self.lines[0]))
        if self.keys is None or of_keys is None:
            steps = self._steps(block, events, batch, turns=turns)
        else:
            steps = self._steps_of_keys(self.keys, events, of_keys, late, batch, turns=turns)
        return self._counted(steps, found, events, late)

    def _batch(self, some: Groups, events: Sequence[Placed], of_keys: KeyedBatch | None) -> list[BatchEvent]:
        """Return the events of some groups for the strategies, in order."""
        first, time, times = self.lines[0] + 1, self.plan.monitors.time, self.times
        if time is not None and of_keys is not None and of_keys.times:
            allowed, classes = time.late or 0, dict[int, Sequence[EventClass]]()
            for event_kind, group in some:
                classes.update(dict.fromkeys(map(id, group.events), event_kind.classes))
            of = classes.get
            return [
                (first + at, event, own, now, None if most is None else most - allowed)
                for (at, event), now, most in zip(events, of_keys.times, of_keys.latest, strict=True)
                if (own := of(id(event)))
            ]
        about = dict[int, tuple[Sequence[EventClass], int | None]]()
        for event_kind, group in some:
            known = repeat(None) if time is None else group.times(time)
            about.update(zip(map(id, group.events), zip(repeat(event_kind.classes), known, strict=False), strict=False))
        find = about.get
        if time is None or times is None:
            return [(first + at, event, *found, None) for at, event in events if (found := find(id(event)))]
        allowed, latest = time.late or 0, times.latest
        return [
            (first + at, event, *found, None if (most := latest(at, found[1])) is None else most - allowed)
            for at, event in events
            if (found := find(id(event)))
        ]

    def _steps(
        self, block: Batch, events: Sequence[Placed], batch: Sequence[BatchEvent], *, turns: bool
    ) -> Iterator[int]:
        """Step over a batch, which has no late events, and warn of those of the block."""
        before, monitors, end = self.lines[0], self.watch.monitors, -inf
        coming, noted, read = iter(batch), Noted([], []), 0
        changed: Sequence[int] = (0,) if batch else ()
        try:
            while changed:
                try:
                    changed = monitors.step_all(coming, noted)
                finally:
                    read = len(batch) - length_hint(coming)
                    self.number = batch[read - 1][0] if read else self.number
                if changed:
                    if turns:
                        yield self.number
                    self._remember(noted.served)
                    noted, one = Noted(noted.concerned, []), batch[read - 1]
                    if self.times is not None:
                        monitors.reach(self.times.latest(self.number - before - 1, one[3]))
                    self.notify(VerdictChange(self.watch, self.number, one[1], changed, self.line_of(self.number)))
            end = inf
        except TooLarge:
            if turns:
                yield self.number
            self.notify_unchanged(self.number - 1)
            raise
        finally:
            self._remember(noted.served)
            if self.clock is not None:
                self.clock.see_all([one[:2] for one in noted.concerned])
            late = () if self.times is None else [*self.times.late]
            known = dict(events) if late else {}
            for place in late:
                if before + place < max(end, self.number):
                    event = known[place] if place in known or block.times is None else block.times.event(place)
                    self._note_late(self.watch, place, event)

    def _timed(self, batch: KeyedBatch, times: Sequence[int | None]) -> set[int]:
        """Add these times of its events to a batch, and return the places of those that are late."""
        batch.times = batch.latest = times
        if self._keyed_times.rises(times):
            self._keyed_times.greatest = cast("int", times[-1])
            return set()
        assert self.keys is not None, "only keys have times of their own"
        time, known, latest_at, late = (
            self.plan.monitors.time,
            dict[KeyValues, int | None](),
            list[int | None](),
            set[int](),
        )
        allowed = 0 if time is None else time.late or 0
        for place, (key, now) in enumerate(zip(batch.keys, times, strict=True)):
            if key not in known:
                watch = self.keys.known.get(key) or self.keys.find(key)
                known[key] = None if watch is None else self._keyed_times.latest(watch)
            latest = known[key]
            if now is not None:
                if latest is None or now > latest:
                    known[key] = latest = now
                elif latest - now > allowed:
                    late.add(place)
            latest_at.append(latest)
        batch.latest = latest_at
        self._keyed_times.greatest = max([self._keyed_times.greatest, *(one for one in times if one is not None)])
        return late

    def _pass(self, batch: KeyedBatch, end: int) -> None:
        """Count the events of a batch before an index for their keys, and note their times."""
        start, traces = batch.done, batch.pass_to(end)
        numbers = batch.numbers[start:end]
        if batch.latest and traces:
            self._keyed_times.add(traces, numbers, batch.latest[start:end], self.lines)
        else:
            for trace, number, time in zip(traces, numbers, batch.times[start:end], strict=False):
                trace.monitors.engines[0].pass_event(time, *self._numbered(number - self.lines[0] - 1))

    def _steps_of_keys(
        self,
        keys: KeyedTraces,
        events: Sequence[Placed],
        of_keys: KeyedBatch,
        late: Collection[int],
        batch: Sequence[BatchEvent],
        *,
        turns: bool,
    ) -> Iterator[int]:
        """Step over a batch, which has no late events, with the monitors of keys.

        Besides these events, only the late ones and the first of each key are looked at one by one.
        """
        (name,), known, numbers, noted = keys.names, keys.known, of_keys.numbers, Noted([], [])
        stops = of_keys.stops(late)
        try:
            for one in chain(batch, (None,)):
                while stops and (one is None or numbers[stops[0]] <= one[0]):
                    at = stops.popleft()
                    place, event = events[at]
                    self._pass(of_keys, at)
                    if of_keys.keys[at] not in known:
                        self.number, forgotten = numbers[at], keys.forgotten
                        if turns:
                            yield self.number
                        keys.of(event, self.number)
                        if keys.forgotten > forgotten:
                            of_keys.latest = ()
                            stops = of_keys.stops(late, at + 1)
                    if place in late:
                        self._pass(of_keys, at + 1)
                        watch = known[of_keys.keys[at]]
                        assert watch is not None, "each event has a key"
                        self._keyed_times.settle(watch)
                        self._note_late(watch, place, event)
                if one is None:
                    break
                self.number = number = one[0]
                watch = known[one[1][name],]
                assert watch is not None, "each event has a key"
                try:
                    changed = watch.monitors.step_one(one, noted)
                except TooLarge:
                    self._pass(of_keys, bisect_right(numbers, number))
                    raise
                if changed:
                    self._pass(of_keys, bisect_right(numbers, number))
                    if turns:
                        yield number
                    self._remember(noted.served)
                    noted = Noted(noted.concerned, [])
                    self.notify(VerdictChange(watch, number, one[1], changed, self.line_of(number)))
            self._pass(of_keys, len(events))
        except TooLarge:
            if turns:
                yield self.number
            self.notify_unchanged(self.number - 1)
            raise
        finally:
            self._remember(noted.served)
            if self.clock is not None:
                self.clock.see_all([one[:2] for one in noted.concerned])

    def _counted(
        self, steps: Iterator[int], found: Groups, events: Sequence[Placed], late: Collection[int]
    ) -> Iterator[int]:
        """Yield the steps over events, and count those that came; those at some places are late."""
        before, failed = self.lines[0], True
        try:
            yield from steps
            failed = False
        finally:
            if failed:
                events = [one for one in events if before + one[0] < self.number and self._watch_of(one[1])]
            if failed or late:
                types = self.plan.monitors.types
                behind = [event for place, event in events if place in late]
                events = [one for one in events if one[0] not in late]
                found = [*(groups(types, [event for _, event in events]) or ()), (types.late, EventGroup(behind))]
            self._count(found, events, before)

    def _count(self, found: Groups, events: Sequence[Placed], before: int) -> None:
        """Count events that cause no warning."""
        statistics, hint = self.totals.statistics, self.totals.semantics_hint
        if statistics is not None:
            others = list[EventGroup]()
            for event_kind, group in found:
                if not (event_kind.entries or statistics.are_impossible(group.events)):
                    others.append(group)
                    continue
                statistics.events += len(group.events)
                statistics.seen |= event_kind.types
                if event_kind.entries and event_kind.relevant is not None:
                    statistics.tally[event_kind.relevant] += len(group.events)
            for number, event in _numbered(others, events, before) if others else ():
                statistics.add(event, number, self.prefix)
        if self.keys is None:
            self.watch.events += sum(len(group.events) for _, group in found)
        if hint is None:
            return
        watches = {id(self.watch)} if self.keys is None else {id(self._watch_of(event)) for _, event in events}
        if not all(map(hint.is_full, watches)):
            read = [group for kind, group in found if kind.entries and kind is not self.plan.monitors.types.late]
            for number, event in _numbered(read, events, before):
                hint.keep(id(self._watch_of(event)), number, event)

    def _watch_of(self, event: JsonObject) -> MonitoredTrace | None:
        """Return the monitored trace of an event, or None for a new key."""
        keys = self.keys
        return self.watch if keys is None else keys.known.get((event[keys.names[0]],))

    def _with_new_keys(self, block: Batch) -> Sequence[Placed]:
        """Return the events, with a stand-in for the first of each new key."""
        keys = self.keys
        assert keys is not None, "only events with keys are kept by them"
        new = [values for values in dict.fromkeys(block.kept) if not self._is_known(values)]
        if not new:
            return block.events
        names = [field.text for field in keys.key.fields]
        also = [(block.passed[block.kept.index(values)], dict(zip(names, values, strict=False))) for values in new]
        return sorted([*block.events, *also], key=itemgetter(0))

    def _is_known(self, values: KeyValues) -> bool:
        """Whether this key, or for () its absence, is known."""
        keys = self.keys
        assert keys is not None, "only events with keys are kept by them"
        if values not in keys.known:
            watch = keys.find(values)
            if watch is None and (values or not keys.lacking):
                return False
            keys.known[values] = watch
        return True

    def _count_passed(self, block: Batch, events: Sequence[Placed], end: int) -> None:
        """Count the skipped events before place `end` for their keys."""
        keys = self.keys
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

    def _pass_over(self, block: Batch, events: Sequence[Placed], last: int) -> None:
        """Count the skipped events of a block."""
        passed = block.total - len(events)
        if self.plan.monitors.counts_all:
            self._fill(last + 1)
        if self.totals.statistics is not None:
            self.totals.statistics.events += passed
        self.number = last
        if self.keys is None:
            self.watch.events += passed
        else:
            self._count_passed(block, events, block.total)

    def _filled(self, events: Iterable[Placed], before: int) -> Iterator[Placed]:
        """Yield events, after stepping over irrelevant ones."""
        for place, event in events:
            self._fill(before + place + 1)
            yield place, event

    def _fill(self, number: int) -> None:
        """Step monitors over irrelevant events, which `strict` and backends count."""
        monitors = self.watch.monitors
        kind = self.plan.monitors.types.of(_NO_EVENT)
        while monitors.live and self.number + 1 < number:
            self.number += 1
            if changed := monitors.step(_NO_EVENT, self.number, kind.classes):
                self.notify(VerdictChange(self.watch, self.number, _NO_EVENT, changed, self.line_of(self.number)))

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
                self._keyed_times.greatest = max(self._keyed_times.greatest, latest)
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


def _numbered(some: Iterable[EventGroup], events: Iterable[Placed], before: int) -> list[Placed]:
    wanted = {id(event) for one in some for event in one.events}
    return [(before + place + 1, event) for place, event in events if id(event) in wanted]
