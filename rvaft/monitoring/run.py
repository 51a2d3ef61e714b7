"""One trace from its first event to its last: events go to the monitors, what they say goes to the listeners.

`Run` has the monitors and those who listen, and does not care how events reach it; `events` is the plain way, one by one. What
reads a file faster calls `Run.told` for the events that change a verdict and counts the others itself.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import BufferedIOBase, IOBase
from typing import Any, BinaryIO, Final, cast

from rvaft.analysis.pattern_index import Scope, TreeReads
from rvaft.engine.monitor import Engine
from rvaft.errors import RvaftError
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.event_buffer import Recall
from rvaft.monitoring.explanation_json import counted
from rvaft.monitoring.fast_reader import Batches
from rvaft.monitoring.monitor_set import MAX_KEYS, Bank, Keyed, Listener, Watch
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.reader import read
from rvaft.monitoring.stream import DEFAULT_WINDOW, Backwards, Field, Numbered, Ordering

TIME: Final = "time"
"""The field that is watched for going back, in the events that concern the tree."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is done with every trace: `bank` has read nothing; `reads` is what its monitors read of an event."""

    bank: Bank
    reads: Scope
    key: Field | None = None
    max_keys: int = MAX_KEYS
    order_by: str | None = None
    window: int = DEFAULT_WINDOW

    @property
    def plain(self) -> bool:
        """Whether every event goes to one bank, in the order in which it stands."""
        return self.key is None and self.order_by is None


class Run:
    """One trace; `statistics`, where they are wanted, count its events too, and `prefix` is what they put before a place in it."""

    def __init__(
        self,
        plan: Plan,
        trace: str,
        listeners: Sequence[Listener],
        *,
        recall: Recall,
        statistics: Statistics | None = None,
        prefix: str = "",
    ) -> None:
        self.plan = plan
        self.listeners = tuple(listeners)
        self.every = tuple(listener for listener in listeners if listener.every)
        self.statistics = statistics
        self.prefix = prefix
        self.ordering = None if plan.order_by is None else Ordering(plan.order_by, window=plan.window)
        self.clock = Backwards(TIME) if plan.order_by is None else None
        self.number = 0
        """That of the last event."""
        self.came = 0
        """How many events were read, where they are put in order before they are watched."""
        fresh = Watch(trace, plan.bank.fork(), recall=recall)
        self.keyed = None if plan.key is None else Keyed(plan.key, fresh, limit=plan.max_keys)
        self.watch = fresh
        """What is watched; with a key what is copied for each value of it."""

    def begin(self) -> None:
        """The trace begins, or goes on."""
        for watch in self.watches:
            self._begin(watch)

    def _begin(self, watch: Watch) -> None:
        for listener in self.listeners:
            listener.begin(watch)

    def step(self, number: int, event: Json) -> None:
        """Read one event; numbers rise."""
        if self.statistics is not None:
            self.statistics.add(event, number, self.prefix)
        self.watched(number, event)

    def watched(self, number: int, event: Json) -> None:
        """Give one event to the monitors; it was counted before."""
        self.number = number
        watch: Watch | None = self.watch
        if self.keyed is not None:
            watch, new = self.keyed.of(event, number)
            if watch is None:
                return
            if new:
                self._begin(watch)
        assert watch is not None
        watch.events += 1
        changed = watch.bank.step(event, number)
        if self.clock is not None and watch.bank.concerned:
            self.clock.see(number, event)
        if watch.bank.serves:
            watch.recall.remember(number, event)
        if changed:
            self.told(watch, number, event, changed)
        else:
            for listener in self.every:
                listener.event(watch, number, event, changed)

    def steps(self, events: Iterable[Numbered]) -> Iterator[None]:
        """Read events, and pause after each."""
        for number, event in events:
            self.step(number, event)
            yield

    def told(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Tell of an event that changed the verdicts of these columns."""
        for listener in self.listeners:
            listener.event(watch, number, event, changed)

    @property
    def state(self) -> Any:
        """What `restore` needs to go on from here, in classes that hold data only."""
        keyed = None if self.keyed is None else (self.keyed.without, self.keyed.first_without)
        watches = [(watch.key, watch.bank, watch.events) for watch in self.watches]
        recall = self.watch.recall.known
        return {"watches": watches, "keyed": keyed, "recall": recall, "clock": self.clock, "came": self.came}

    def restore(self, state: Any, ordering: Ordering | None, statistics: Statistics | None) -> None:
        """Go on from a state, with the events that were read and not yet watched and with the counts that belong to it."""
        self.clock, self.came, self.ordering = state["clock"], state["came"], ordering
        self.statistics = statistics or self.statistics
        self.watch.recall.known.update(state["recall"])
        for key, bank, events in state["watches"]:
            watch = Watch(self.watch.trace, bank, key, self.watch.recall, events)
            if self.keyed is None:
                self.watch = watch
            else:
                self.keyed.add(watch)
        if self.keyed is not None:
            self.keyed.without, self.keyed.first_without = state["keyed"]

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
    def watches(self) -> list[Watch]:
        """What was watched: the trace, or each key that came."""
        return [self.watch] if self.keyed is None else list(self.keyed)

    @property
    def found(self) -> bool:
        """Whether something was detected."""
        return any(verdict is Verdict.TRUE for watch in self.watches for verdict in watch.bank.verdicts)

    @property
    def warnings(self) -> list[str]:
        """What was odd about the events, each as a line."""
        said: list[str] = []
        if self.keyed is not None and self.keyed.without:
            lacking = f"{counted(self.keyed.without)} without the field {self.keyed.field.text}"
            said.append(f"{lacking}, given to no monitor (first: event {self.keyed.first_without})")
        if self.clock is not None and self.clock.count:
            goes = f"the field {TIME} goes back at {counted(self.clock.count)} (first: event {self.clock.first})"
            said.append(f"{goes}; put them in order with --order-by {TIME}")
        if self.ordering is not None:
            field, late = self.plan.order_by, self.ordering.late
            if late.count:
                more = f"too late for a window of {self.plan.window}: they stay where they stand"
                said.append(f"{counted(late.count)} by the field {field} {more} (first: event {late.first} as read)")
            if late.without:
                lacking = f"{counted(late.without)} without a number in the field {field}"
                said.append(f"{lacking} stay behind the event before (first: event {late.first_without} as read)")
        return said


def events(
    run: Run, source: BinaryIO | Iterable[Json], name: str, *, after: int = 0, line: int = 1
) -> Iterator[Numbered]:
    """The events of a stream, or events as they are, in the order and with the numbers in which they are watched.

    `after` is how many were watched before, and `line` the number of the line where a stream goes on. Raises what `rvaft.traces.read` raises.
    """
    found: Iterable[Json] = source
    if isinstance(source, IOBase):
        found = read(cast("BinaryIO", source), name=name, reads=run.plan.reads, line=line)
    return enumerate(found if run.ordering is None else _in_order(run, found, run.ordering), after + 1)


def _in_order(run: Run, events: Iterable[Json], ordering: Ordering) -> Iterator[Json]:
    """The events in order; where they break off, those that are held come before the error."""
    failure: Exception | None = None
    try:
        for event in events:
            run.came += 1
            given = ordering.add(run.came, event)
            if given is not None:
                yield given[1]
    except (RvaftError, OSError) as error:
        failure = error
    for _, event in ordering.rest():
        yield event
    if failure is not None:
        raise failure


# A log file read many lines at a time: events that fit no pattern are counted, and meet no monitor.
#
# What is told and counted is the same as by `rvaft.monitoring.run.events`; only events in between are not told of.

TOPIC: Final = "topic"
"""What is told of the events of a match, beside the time."""
_NO_EVENT: Final[dict[str, Json]] = {}
"""Stands for any event that fits no pattern: where there are such, no pattern is without a literal."""


def batches_for(run: Run) -> Batches | None:
    """What reads the file of a run quickly, or None where the run has to see every event as it stands."""
    reads = run.plan.reads
    engine = isinstance(run.watch.bank.monitors[0], Engine)
    if not (engine and run.plan.plain and isinstance(reads, TreeReads)) or run.every or run.statistics is None:
        return None
    return Batches.of(reads, (TIME, TOPIC))


def advance(run: Run, batches: Batches, stream: BufferedIOBase, name: str, statistics: Statistics) -> Iterator[None]:
    """Give a run all events of a stream, and pause after every batch; raises what `rvaft.traces.read` raises."""
    watch, bank, clock, prefix = run.watch, run.watch.bank, run.clock, run.prefix
    strict, projected = (bank.semantics is one for one in (Semantics.STRICT, Semantics.PROJECTED))
    for batch in batches.read(stream, name, statistics.wants):
        number = before = run.number
        try:
            for place, event in batch.events:
                number = before + place + 1
                if strict:
                    _fill(run, number)
                    run.number = number
                if not statistics.add(event, number, prefix) and projected:
                    continue
                # What `Run.watched` does, here for very many events.
                changed = bank.step(event, number)
                if clock is not None and bank.concerned:
                    clock.see(number, event)
                if bank.serves:
                    watch.recall.remember(number, event)
                if changed:
                    run.told(watch, number, event, changed)
        except RvaftError:
            run.number = number
            raise
        for values, count in batch.others:
            statistics.pass_over(values, count)
        if strict:
            _fill(run, before + batch.count + 1)
        run.number = watch.events = before + batch.count
        yield


def _fill(run: Run, number: int) -> None:
    """Under `strict` an event that fits nothing ends a match."""
    while run.watch.bank.live and run.number + 1 < number:
        run.watched(run.number + 1, _NO_EVENT)
