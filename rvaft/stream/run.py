"""One trace from its first event to its last: events are put in order and told apart by a key, the monitors read them, listeners are notified."""

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from io import BufferedIOBase, IOBase
from operator import itemgetter
from typing import Any, BinaryIO, Final, cast

import msgspec

from rvaft.errors import RvaftError, TooLarge
from rvaft.model.guards import Alike
from rvaft.model.values import Json, is_finite
from rvaft.model.values import key as value_key
from rvaft.model.verdict import Semantics, Verdict
from rvaft.readers.json_blocks import Batch
from rvaft.readers.json_lines import LinesRead, NonFiniteEvent, read
from rvaft.readers.log import ALL, Log
from rvaft.readers.parallel_blocks import read_in_processes
from rvaft.stream.detection import counted
from rvaft.stream.keys import Key
from rvaft.stream.listeners import EventBuffer, Listener, MonitoredTrace, VerdictChange
from rvaft.stream.order import Backwards, Ordering
from rvaft.stream.plan import TIME, MonitoringPlan, Totals
from rvaft.stream.statistics import Sight

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
        if self.totals.semantics_hint is not None:
            self.totals.semantics_hint.forget()
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
        data_warnings, semantics_hint = self.totals.data_warnings, self.totals.semantics_hint
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
                        data_warnings.note_late(event, number, prefix, watch.monitors.engines[0].latest)
                    elif sight.looked_at or type(event) is not dict:
                        data_warnings.see(event, number, prefix, sight)
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
                    if semantics_hint is not None and not late and (sight.entries or sight.decided.open):
                        semantics_hint.keep(id(watch), number, event)
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
            parts = sight.parted(group) if totals.data_warnings.are_good(group, sight) else None
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
        if totals.semantics_hint is not None and not all(
            totals.semantics_hint.is_full(id(watch)) for watch, _ in watches
        ):
            for number, event in numbered(entries):
                own = self._passed[event[keyed_by],] if keyed_by else self.watch
                totals.semantics_hint.keep(id(own), number, event)
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
            if quickly and plan.block_reader is not None:
                how: dict[str, Any] = {"reached": source.reach} if isinstance(source, LinesRead) else {}
                given, found = cast("BufferedIOBase", source), ()
                if jobs > 1:
                    quick = read_in_processes(plan.block_reader, given, name, jobs=jobs, line=line, **how)
                else:
                    quick = plan.block_reader.read(given, name, line=line, live=live, **how)
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
        without, totals = (
            (self._without_key, self._first_without_key),
            (self.totals.statistics, self.totals.data_warnings),
        )
        return watches, without, self.buffer.known, self.clock, self.ordering, totals

    def restore(self, state: Any, number: int) -> None:
        """Go on from a state after the event of that number."""
        watches, without, known, self.clock, self.ordering, (statistics, self.totals.data_warnings) = state
        self.totals.data_warnings.attach(self.plan.monitors.types)
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
            if self.totals.semantics_hint is not None and watch.monitors.verdicts[0] is Verdict.FALSE:
                self.totals.semantics_hint.look(id(watch), self.prefix)

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
