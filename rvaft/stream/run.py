"""The run over one trace: events in time order, the monitors of each key, and the listeners."""

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from io import IOBase
from typing import BinaryIO, Final, TypeAlias, cast

from rvaft.engine.monitor import Engine
from rvaft.errors import RvaftError, TooLarge
from rvaft.model.values import Json, JsonObject
from rvaft.model.values import key as value_key
from rvaft.model.verdict import Verdict
from rvaft.readers.json_lines import numbered
from rvaft.readers.log import ALL, Log
from rvaft.stream.data_warnings import DataWarnings, checked
from rvaft.stream.detection import counted
from rvaft.stream.follow import FollowedFile
from rvaft.stream.keys import DistinctEvents, DistinctState, KeyedTraces
from rvaft.stream.listeners import Audience, EventBuffer, Listener, MonitoredTrace, TraceState, VerdictChange
from rvaft.stream.order import Backwards, Ordering
from rvaft.stream.plan import TIME, MonitoringPlan, Totals
from rvaft.stream.statistics import EventKind, Statistics

WHOLE: Final = 1_000_000
"""Maximum number of events of a log that backends read as a whole."""
Source: TypeAlias = BinaryIO | Log | Iterable[Json]
Lined: TypeAlias = tuple[int | None, JsonObject]
"""An event after its line."""
StateBeside: TypeAlias = tuple[
    tuple[int, int],
    tuple[OrderedDict[int, JsonObject], dict[int, int | None]],
    Backwards | None,
    Ordering[Lined] | None,
    tuple[Statistics | None, DataWarnings],
    DistinctState | None,
]
"""Events without a key, buffer with lines, clock, order, totals, ids."""
RunState: TypeAlias = tuple[list[TraceState], StateBeside]


@dataclass(eq=False)
class TraceRun:
    """The run over one trace; `prefix` precedes event numbers in messages.

    Call `begin`, `read`, and `end` or `stop`. `number` is the last event, `detected` the last one
    with a detection. Once the trace has `ended`, only held-back events come.
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
        self.ordering: Ordering[Lined] | None = None
        if by is not None:
            self.ordering = Ordering(by, window=self.plan.window, time=monitors.time)
        name = TIME if monitors.time is None else ".".join(monitors.time.field)
        self.distinct: DistinctEvents | None = None
        if self.plan.distinct is not None:
            ids, most, warn = self.plan.distinct, self.plan.max_distinct, self.totals.data_warnings.warn
            self.distinct = DistinctEvents(ids, self.plan.key, most, warn)
        self.clock = None if by is not None or monitors.may_be_late else Backwards(name, monitors.time)
        self.assumed = checked(monitors.types.tree, order=not monitors.engines)
        self.number = self.detected = 0
        self.lines: tuple[int, Sequence[int | None]] = 0, ()
        """A number, and the lines of the events after it."""
        self.begun = self.ended = False
        self._coming: dict[Hashable, list[Json]] = {}
        """The events of each key, of a log that backends read as a whole."""
        self.watch = MonitoredTrace(self.trace, monitors.fork(), buffer=self.buffer)
        """The monitored trace; with a key, the template for each value."""
        key, most = self.plan.key, self.plan.max_keys
        self.keys = None if key is None else KeyedTraces(key, most, self._of_key, self._begin_trace)
        self.prepare()

    def _of_key(self, values: tuple[Json, ...]) -> MonitoredTrace:
        watch = MonitoredTrace(self.trace, self.watch.monitors.fork(), values, self.buffer)
        if self._coming:
            watch.monitors.expect(self._coming[tuple(map(value_key, values))])
        return watch

    def _begin_trace(self, watch: MonitoredTrace) -> None:
        for listener in self.listeners:
            listener.begin(watch)

    def prepare(self) -> None:
        """Prepare to read events from the current position."""
        self.audience = Audience.of(self.listeners, one_by_one=self.one_by_one)
        self._notified, self._verdicts = self.number, self.watch.monitors.verdicts

    @property
    def one_by_one(self) -> bool:
        """Whether listeners receive events one at a time."""
        return self.keys is not None or self.plan.monitors.counts_all

    @property
    def watches(self) -> list[MonitoredTrace]:
        """The monitored trace, or that of each key in order of first occurrence."""
        return [self.watch] if self.keys is None else self.keys.traces

    def line_of(self, number: int) -> int | None:
        """Return the line of a current event in the input; None if it has no lines."""
        before, lines = self.lines
        return lines[number - before - 1] if before < number <= before + len(lines) else None

    def begin(self) -> None:
        """Notify listeners that the trace begins or continues."""
        self.begun = True
        for watch in self.watches:
            self._begin_trace(watch)

    def read(self, source: Source, name: str, *, line: int = 1, whole: bool = False) -> Iterator[bool]:
        """Read all events of a source, and pause after each.

        Yields False once the trace has ended; held-back events follow. `line` is the number of the
        first line of a stream. A `whole` log is held in memory, and its events are announced to the
        monitors. Raises what `rvaft.readers.json_lines.read` raises, and `TooLarge`.
        """
        self.prepare()
        turns = self._in_turn(self._lined(source, name, line))
        for lined in self._announced(turns) if whole else turns:
            if lined is not None:
                self.lines = self.number, lined[:1]
                self.take(((0, lined[1]),), self.number)
                self.notify_unchanged(self.number)
            yield lined is not None

    def _announced(self, turns: Iterator[Lined | None]) -> Iterator[Lined | None]:
        """Yield the same, after announcing all events to the monitors; an error comes last."""
        held: list[Lined | None] = []
        failure: Exception | None = None
        try:
            for turn in turns:
                held.append(turn)
                if len(held) > WHOLE:
                    raise TooLarge("events for monitors of backends", limit=WHOLE, remedy="omit --backend")
        except (RvaftError, OSError) as error:
            failure = error
        events = [turn[1] for turn in held if turn is not None]
        if self.keys is None:
            self.watch.monitors.expect(events)
        key = self.plan.key
        for event in () if key is None else events:
            if key is not None and (values := key.of(event)) is not None:
                self._coming.setdefault(tuple(map(value_key, values)), []).append(event)
        yield from held
        if failure is not None:
            raise failure

    def _lined(self, source: Source, name: str, line: int) -> Iterator[Lined]:
        stream, plan = source, self.plan
        found: Iterator[tuple[int | None, Json]]
        if isinstance(source, Log):
            source.interest, stream = ALL, cast("Source", source.source)
            found = ((source.line_read, event) for event in source.events())
        elif isinstance(source, IOBase):
            found = numbered(cast("BinaryIO", source), name, plan.reads, line, strict=plan.strict_json)
        else:
            found = ((None, event) for event in cast("Iterable[Json]", source))
        for number, event in found:
            # a followed file may be replaced by another
            line_read = stream.given if isinstance(stream, FollowedFile) else number
            if self.distinct is None or self.distinct.is_new(event, line_read):
                yield line_read, cast("JsonObject", event)

    def _in_turn(self, events: Iterable[Lined]) -> Iterator[Lined | None]:
        """Yield events in time order, then None; an error comes last."""
        ordering, failure = self.ordering, None
        try:
            for event in events:
                turn = event if ordering is None else ordering.put(ordering.place(event[1]), event)
                if turn is not None:
                    yield turn
        except (RvaftError, OSError) as error:
            failure = error
        else:
            yield None
        self.ended = True
        if ordering is not None:
            yield from ordering.rest()
        if failure is not None:
            raise failure

    def take(  # noqa: PLR0915
        self, events: Iterable[tuple[int, JsonObject]], before: int, kinds: Mapping[int, EventKind] | None = None
    ) -> None:
        """Step the monitors over events, in one loop for speed; `before` is the event before place
        0.

        With `kinds`, by the `id` of an event, the caller checks and counts events.
        """
        prefix, keys, fresh = self.prefix, self.keys, self.plan.monitors
        each, _, of_concern = self.audience
        skips = fresh.semantics.projects and bool(fresh.engines)  # irrelevant events change nothing
        keyed_by = keys.names[0] if keys is not None and len(keys.names) == 1 else ""
        known = {} if keys is None else keys.known
        types, look_up = fresh.types, fresh.types.shapes.of
        may_be_late, counts_all = fresh.may_be_late, fresh.counts_all
        data_warnings, semantics_hint = self.totals.data_warnings, self.totals.semantics_hint
        statistics, clock, assumed = self.totals.statistics, self.clock, self.assumed
        watch: MonitoredTrace | None = self.watch
        late: bool | None = None
        served, concerned = list[tuple[int, JsonObject]](), list[tuple[int, JsonObject]]()
        try:
            for place, event in events:
                number = before + place + 1
                self.number = number
                if assumed is not None:
                    data_warnings.note_broken(assumed, event, f"{prefix}event {number}")
                if keys is not None:
                    value = event.get(keyed_by) if keyed_by else None
                    watch = known.get((value,)) if type(value) is str else None
                    watch = watch or keys.of(event, number)
                if kinds is None:
                    late = may_be_late and watch is not None and self._is_late(watch.monitors.engines[0], event)
                    event_kind = types.late if late else look_up(event).of(event)
                    if watch is not None and late:
                        engine = watch.monitors.engines[0]
                        data_warnings.note_late(event, number, prefix, engine.latest, engine.jumps)
                    elif event_kind.checks.looked_at or type(event) is not dict:
                        data_warnings.see(event, number, prefix, event_kind)
                    if statistics is not None:
                        if event_kind.noted is statistics and event_kind.relevant is not None:
                            statistics.events += 1
                            statistics.tally[event_kind.relevant] += 1
                        elif late:
                            statistics.events += 1
                        else:
                            statistics.add(event, number, prefix, event_kind)
                    if watch is not None:
                        watch.events += 1
                        if semantics_hint is not None and event_kind.entries:
                            semantics_hint.keep(id(watch), number, event)
                else:
                    event_kind = kinds[id(event)]
                if watch is None:
                    continue
                if event_kind.relevant or counts_all or (event_kind.serves and not skips):
                    monitors = watch.monitors
                    changed = monitors.step(event, number, event_kind, late=late)
                    if monitors.concerned:
                        concerned.append((number, event))
                    if monitors.serves:
                        served.append((number, event))
                    if changed:
                        self._remember(served)
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

    def _is_late(self, engine: Engine, event: JsonObject) -> bool:
        """Whether the current event is late; a jump of its time is noted with its line."""
        late, number = engine.is_late(event, self.number), self.number
        if engine.jumps and engine.jumps[-1].number == number and (line := self.line_of(number)) not in (None, number):
            engine.jumps = (*engine.jumps[:-1], engine.jumps[-1]._replace(line=line))
        return late

    def _remember(self, served: list[tuple[int, JsonObject]]) -> None:
        """Keep events that an explanation may name."""
        before, lines = self.lines
        self.buffer.remember_all(served, [lines[number - before - 1] for number, _ in served] if lines else ())
        served.clear()

    def notify_unchanged(self, last: int) -> None:
        """Notify listeners of events without a change, up to this number."""
        if self._notified < last:
            for listener in self.audience.in_rows:
                listener.events(self.watch, self._notified + 1, last, self._verdicts)
            self._notified = last

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
        return [watch.state for watch in self.watches], self.state_beside

    @property
    def state_beside(self) -> StateBeside:
        """The state besides that of the monitored traces."""
        lacking = (0, 0) if self.keys is None else (self.keys.lacking, self.keys.first_lacking)
        totals = (self.totals.statistics, self.totals.data_warnings)
        ids = None if self.distinct is None else self.distinct.state
        return lacking, (self.buffer.known, self.buffer.lines), self.clock, self.ordering, totals, ids

    def restore(self, state: RunState, number: int) -> None:
        """Continue from a state after the event of that number."""
        watches, beside = state
        warn = self.totals.data_warnings.warn
        lacking, (known, lines), self.clock, self.ordering, totals, ids = beside
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
                self.keys.restore(watch, key)
        if self.keys is not None:
            self.keys.lacking, self.keys.first_lacking = lacking

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
