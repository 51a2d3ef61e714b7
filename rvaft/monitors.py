"""The interface of monitors, and monitors that are independent of a backend."""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final, NamedTuple, Self, TypeAlias, TypeVar, cast

from rvaft.errors import RvaftError, TooLarge, TraceError
from rvaft.model.event_time import duration_text
from rvaft.model.nodes import Kind, Side
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, as_json
from rvaft.model.verdict import Verdict
from rvaft.support.plugins import display


class MatchedEvent(NamedTuple):
    """One event of a match: its node, its occurrence of the node, and its number in the trace, from
    1.
    """

    node: str
    occurrence: int
    event: int


class Absence(NamedTuple):
    """An event that did not come, by the `without` of a node.

    It did not come between two events, by their numbers: `after` is None for the beginning of the
    trace. Of `for D after`, `before` is the event with which D has passed, None if no event told so.
    `duration` is D in nanoseconds.

    >>> import rvaft
    >>> text = "event e(k) = { k: k }; top sand a b without e(3); a on e(1); b on e(2);"
    >>> watching = rvaft.monitor(rvaft.loads(text), semantics="scattered")
    >>> [*watching.run([{"k": 1}, {"k": 2}])][-1].symbol, watching.explanation.absences[0].text
    ('⊤', 'no e(3) between events 1 and 2')
    """

    node: str
    event: str
    side: Side
    duration: int | None
    after: int | None
    before: int | None

    @property
    def text(self) -> str:
        """The absence in words."""
        length = "" if self.duration is None else f" for {duration_text(self.duration)}"
        match self.side:
            case Side.DURING:
                return f"no {self.event} between events {self.after} and {self.before}"
            case Side.AFTER:
                told = "" if self.before is None else f", as event {self.before} shows"
                return f"no {self.event}{length} after event {self.after}{told}"
            case Side.BEFORE:
                return f"no {self.event}{length} before event {self.before}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """One match (semantics, section 4), in the branch with the lowest number.

    `matched` are its events in order. `branch` is None if the tree has too many branches to count.
    `scenario` maps each node of the scenario to the children that it keeps (empty if unknown).
    `absences` are the events that had to be absent.

    >>> import rvaft
    >>> watching = rvaft.monitor(rvaft.loads("top sand a b;"))
    >>> [*watching.run([{"event": "a"}, {"event": "b"}])][-1].symbol, watching.explanation.matched[1]
    ('⊤', MatchedEvent(node='b', occurrence=1, event=2))
    """

    branch: int | None
    kinds: frozenset[Kind]
    matched: tuple[MatchedEvent, ...]
    variables: Mapping[str, Json]
    scenario: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    absences: tuple[Absence, ...] = ()

    @property
    def events(self) -> dict[str, list[int]]:
        """The numbers of the events of each node.

        >>> import rvaft
        >>> watching = rvaft.monitor(rvaft.loads("top sand a b; a times 2;"))
        >>> [*watching.run([{"event": name} for name in "aab"])][-1].symbol, watching.explanation.events
        ('⊤', {'a': [1, 2], 'b': [3]})
        """
        found: dict[str, list[int]] = {}
        for match in self.matched:
            found.setdefault(match.node, []).append(match.event)
        return found

    def _repr_html_(self) -> str:
        return cast("str", display("explanation")(self))

    def bound(self, tree: RVAFT) -> dict[str, Json]:
        """Return the variables with their values, in the order of a tree.

        >>> import rvaft
        >>> watching = rvaft.monitor(tree := rvaft.loads("event e(v) = { e: v }; top and a b; a on e(X); b on e(Y);"))
        >>> [*watching.run([{"e": 2}, {"e": 1}])][-1].symbol, watching.explanation.bound(tree)
        ('⊤', {'X': 2, 'Y': 1})
        """
        return {name: self.variables[name] for name in tree.variables if name in self.variables}


@dataclass(frozen=True, slots=True)
class Awaited:
    """A node that waits for its event, with the event as text: `inspect(Waypoint)`.

    >>> import rvaft
    >>> rvaft.monitor(rvaft.loads("top sand a b;")).pending()[0].awaited
    (Awaited(node='a', event='a'),)
    """

    node: str
    event: str


@dataclass(frozen=True, slots=True)
class AwaitedAbsence:
    """A node that waits until a time for an event not to come; `until` is in nanoseconds.

    >>> import rvaft
    >>> text = "time t as s; event e(k) = { k: k }; top on e(1) without e(2) for 5 s after;"
    >>> watching = rvaft.monitor(rvaft.loads(text), semantics="scattered")
    >>> watching.step({"k": 1, "t": 10}).symbol, watching.pending()[-1].absent
    ('?', (AwaitedAbsence(node='top', event='e(2)', until=15000000000),))
    """

    node: str
    event: str
    until: int


@dataclass(frozen=True, slots=True)
class Pending:
    """The nodes whose events may come next in a live branch, and those whose events must not come.

    `variables` are the values bound so far on which later events depend; each binding has a record.
    `branch` is None for all branches together, if they are too many.

    >>> import rvaft
    >>> [record.branch for record in rvaft.monitor(rvaft.loads("top or a b;")).pending()]
    [1, 2]
    """

    branch: int | None
    awaited: tuple[Awaited, ...]
    variables: Mapping[str, Json]
    absent: tuple[AwaitedAbsence, ...] = ()


@dataclass(frozen=True, slots=True)
class Ended:
    """The event, from 1, after which no detection is possible, and what was pending before.

    >>> import rvaft
    >>> watching = rvaft.monitor(rvaft.loads("top sand a b;"))
    >>> watching.step({"event": "b"}).symbol, watching.ended.event
    ('⊥', 1)
    """

    event: int
    pending: tuple[Pending, ...]


AHEAD: Final = 256
"""Minimum number of announced events that a `DetectionMonitor` evaluates at once."""
LIVE: Final = 5_000
"""Maximum number of events that a `DetectionMonitor` evaluates after each event."""
DEFAULT_BRANCHES: Final = 100
DEFAULT_LIMIT: Final = 100_000
"""The maximum number of partial matches of a monitor."""
"""The maximum number of branches that `Monitor.pending` lists separately."""


LeftOpen: TypeAlias = Callable[[Sequence[Json]], str]
"""Returns why a language leaves a trace undefined (such as unordered events), or ""."""


T = TypeVar("T")


def twin(one: T) -> T:
    """Return an object with the same attributes, as for a copy of one of many monitors.

    Attributes that are set one by one share their names with those of other instances: such a copy takes a
    third of the memory of one by `copy.copy`, and less time.
    """
    made = object.__new__(type(one))
    for name, value in vars(one).items():
        setattr(made, name, value)
    return made


class Monitor(ABC):
    """Reads events one by one. After a final verdict it ignores further events.

    >>> import rvaft
    >>> watching = rvaft.monitor(rvaft.loads("top and a b;"))
    >>> watching.step({"event": "b"}).symbol, watching.step({"event": "a"}).symbol, watching.verdict.final
    ('?', '⊤', True)
    """

    left_open: LeftOpen | None = None
    """Why a new monitor has no verdict for a trace; None if it has one for every trace."""

    def __init__(self) -> None:
        self._verdict = Verdict.UNKNOWN
        self._read = 0

    @property
    def verdict(self) -> Verdict:
        """The current verdict; unknown before any event."""
        return self._verdict

    def step(self, event: Json) -> Verdict:
        """Read an event and return the verdict after it.

        Values of NumPy, pandas and the standard library are read as those of JSON. Raises `TraceError` for
        another object than a mapping, and `WrongType` for a value that has no form in JSON.
        """
        if not isinstance(event, Mapping):
            message = f"an event is a JSON object (a dict), not {type(event).__name__}: decode the line first"
            raise TraceError(message, line=self._read + 1)
        self._read += 1
        if not self._verdict.final:
            self._verdict = self._advance(as_json(event))
        return self._verdict

    def run(self, events: Iterable[Json]) -> Iterator[Verdict]:
        """Yield the verdict after each event; events are read only while iterating.

        >>> import rvaft
        >>> watching = rvaft.monitor(rvaft.loads("top sand a b;"))
        >>> [verdict.symbol for verdict in watching.run([{"event": "a"}, {"event": "b"}])]
        ['?', '⊤']
        """
        return (self.step(event) for event in events)

    def expect(self, events: Sequence[Json]) -> None:  # noqa: B027
        """Announce the next events of a finished log, for monitors that read it faster as a whole."""

    def restarted(self, fresh: Self) -> Self:
        """Return the monitor that goes on after this one has detected; `fresh` is in the first state."""
        twin = fresh.fork()
        twin.go_on_after(self)
        return twin

    def pass_time(self, time: Json | datetime) -> Verdict:  # noqa: ARG002 (a subclass uses it)
        """Return the verdict after a time has come, without an event.

        `time` is what the time field of an event would have, or a `datetime`. It decides deadlines (`for
        D after`), and later events may be late by it. Monitors of backends do not look at it.
        """
        return self.verdict

    def decide(self, time: int) -> Verdict:  # noqa: ARG002 (a subclass uses it)
        """As `pass_time`, for a time in nanoseconds that makes no later event late."""
        return self.verdict

    def finish(self) -> Verdict:
        """Return the verdict after the end of the trace, which decides every `for D after`.

        Monitors of backends do not look at it.
        """
        return self.verdict

    def fork(self) -> Self:
        """Return an independent monitor in the same state.

        A subclass that changes attributes in place copies them here.
        """
        return twin(self)

    def go_on_after(self, earlier: Self) -> None:
        """Continue, as a new monitor, after the events that an equal monitor has read.

        Keeps event numbers, and the state that affects any match, such as the latest time.
        """
        self._read = earlier._read

    @property
    def detections(self) -> int:
        """The number of detections so far: at most one, except for a `Repetition`."""
        return int(self.verdict is Verdict.TRUE)

    @abstractmethod
    def _advance(self, event: Json) -> Verdict:
        """Read one event; called only while the verdict is unknown."""

    @property
    @abstractmethod
    def state(self) -> Hashable:
        """Equal states of monitors of one specification have equal futures."""

    @property
    def explanation(self) -> Explanation | None:
        """After ⊤, one match; None if the monitor cannot explain."""
        return None

    def pending(self, *, limit: int = DEFAULT_BRANCHES) -> tuple[Pending, ...]:  # noqa: ARG002 (a subclass uses it)
        """Return what each live branch waits for; () after a final verdict or if unknown.

        Beyond `limit` branches, records are for all branches.
        """
        return ()

    @property
    def ended(self) -> Ended | None:
        """After ⊥, the event that caused it; None if unknown."""
        return None


FirstDetections: TypeAlias = Callable[[Sequence[Sequence[Json]]], Sequence[int | None]]
"""Returns for each whole trace the number, from 1, of the first detecting event, if any."""


class DetectionMonitor(Monitor):
    """Applies a function of whole traces; never returns ⊥.

    `first_detections` raises an error for a trace that the language leaves undefined (`left_open`);
    comparisons skip it. The function is called for a few prefixes of the events that `expect`
    announces, each about twice as long as the one before, and else for all events after each event,
    up to `LIVE` (`TooLarge`).

    >>> two = DetectionMonitor(lambda traces: [2 if len(trace) > 1 else None for trace in traces])
    >>> [verdict.symbol for verdict in two.run([{}, {}, {}])], two.first_detections([[], [{}, {}]])
    (['?', '⊤', '⊤'], [None, 2])
    """

    def __init__(self, first_detections: FirstDetections, left_open: LeftOpen = lambda _: "") -> None:
        super().__init__()
        self.first_detections = first_detections
        self.left_open: LeftOpen = left_open
        self._events: tuple[Json, ...] = ()
        self._coming: Sequence[Json] = ()
        self._own = self._horizon = 0
        """The numbers of announced events that were read, and that were evaluated."""
        self._due: int | None = None

    def expect(self, events: Sequence[Json]) -> None:
        """Announce the next events."""
        self._coming = [*self._events, *self._coming[: self._own], *events]
        self._own, self._events = len(self._coming) - len(events), ()

    def run(self, events: Iterable[Json]) -> Iterator[Verdict]:
        """Yield the verdict after each event."""
        if isinstance(events, list | tuple) and all(isinstance(event, Mapping) for event in events):
            self.expect(events)
        return super().run(events)

    def go_on_after(self, earlier: Self) -> None:
        """Continue after the events that an equal monitor has read."""
        super().go_on_after(earlier)
        self._coming = earlier._coming[earlier._own :]

    def _advance(self, event: Json) -> Verdict:
        if self._own < len(self._coming):
            self._own += 1
            if self._own > self._horizon:
                self._look_ahead()
            found = self._due is not None and self._due <= self._own
            return Verdict.TRUE if found else Verdict.UNKNOWN
        self._events = (*self._coming, *self._events, event)
        self._coming, self._own = (), 0
        if len(self._events) > LIVE:
            what = "events, which are all evaluated after each event"
            raise TooLarge(what, limit=LIVE, remedy="give the log as a file, or use the engine")
        (first,) = self.first_detections([self._events])
        return Verdict.UNKNOWN if first is None else Verdict.TRUE

    def _look_ahead(self) -> None:
        """Evaluate the longest prefix without an error, up to twice the events so far."""
        good, bad = self._own - 1, min(max(2 * self._own, AHEAD), len(self._coming)) + 1
        end = bad - 1
        while good < end:
            try:
                (self._due,) = self.first_detections([self._coming[:end]])
                good = end
            except RvaftError:
                if end == self._own:
                    raise
                bad = end
            end = (good + bad) // 2 if good < bad - 1 else good
        self._horizon = good

    @property
    def state(self) -> Hashable:
        """The verdict and, before a detection, all events so far."""
        events = (*self._coming[: self._own], *self._events)
        return self.verdict, None if self.verdict.final else json.dumps(events)


class Repetition(Monitor):
    """A monitor that restarts with the event after each detection; no event is used twice.

    The verdict is ⊤ at each detecting event, else that since the last detection; ⊥ is final.
    Explanations count events in the whole trace. `monitor` must be new.

    >>> import rvaft
    >>> watching = Repetition(rvaft.monitor(rvaft.loads("top sand a b;"), semantics="scattered"))
    >>> "".join(verdict.symbol for verdict in watching.run({"event": name} for name in "abbab"))
    '?⊤??⊤'
    >>> watching.detections, watching.explanation.events
    (2, {'a': [4], 'b': [5]})
    """

    def __init__(self, monitor: Monitor) -> None:
        super().__init__()
        self._fresh = monitor
        self._before = 0
        self.current = monitor.fork()

    def begin_again(self) -> None:
        """Restart, if the last event was a detection."""
        current = self._next()
        if current is not self.current:
            self._before += 1
            self.current = current

    def _next(self) -> Monitor:
        if self.verdict is not Verdict.TRUE:
            return self.current
        return self.current.restarted(self._fresh)

    @property
    def verdict(self) -> Verdict:
        """The current verdict."""
        return self.current.verdict

    @property
    def detections(self) -> int:
        """The number of detections so far."""
        return self._before + self.current.detections

    def expect(self, events: Sequence[Json]) -> None:
        """Announce the next events."""
        self.current.expect(events)

    def step(self, event: Json) -> Verdict:
        """Read one event and return the verdict after it."""
        current = self.current
        if current.verdict is Verdict.TRUE:
            self.begin_again()
            current = self.current
        return current.step(event)

    def pass_time(self, time: Json | datetime) -> Verdict:
        """Return the verdict after a time has come."""
        self.begin_again()
        return self.current.pass_time(time)

    def decide(self, time: int) -> Verdict:
        """Return the verdict after a time in nanoseconds."""
        self.begin_again()
        return self.current.decide(time)

    def finish(self) -> Verdict:
        """Return the verdict after the end of the trace."""
        self.begin_again()
        return self.current.finish()

    def fork(self) -> Self:
        """Return an independent monitor in the same state."""
        made = super().fork()
        made.current = self.current.fork()
        return made

    def _advance(self, event: Json) -> Verdict:
        return self.current.step(event)

    @property
    def state(self) -> Hashable:
        """Equal states of repetitions of one monitor have equal futures."""
        return self.verdict, self._next().state

    @property
    def explanation(self) -> Explanation | None:
        """After a detecting event, one match."""
        return self.current.explanation

    def pending(self, *, limit: int = DEFAULT_BRANCHES) -> tuple[Pending, ...]:
        """Return what each live branch waits for."""
        return self._next().pending(limit=limit)

    @property
    def ended(self) -> Ended | None:
        """After ⊥, the event that caused it."""
        return self.current.ended
