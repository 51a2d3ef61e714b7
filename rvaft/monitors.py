"""What every monitor can do, whichever way it was made."""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self, TypeAlias

from rvaft.errors import TraceError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict


class MatchedEvent(NamedTuple):
    """One event of a match.

    The node that it shows, which event of the node it is, and its number in the trace, both from 1.
    """

    node: str
    occurrence: int
    event: int


@dataclass(frozen=True, slots=True)
class Explanation:
    """One match (semantics, section 4): the branch with the lowest number that has one, and how it matched.

    `matched` are the events of the match, in their order; `branch` is None where a tree has too
    many branches to count. `scenario` maps each node of the scenario to the children that it keeps,
    those of a KofN being K or more; it is empty where the monitor does not know.

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

    @property
    def events(self) -> dict[str, list[int]]:
        """The numbers of the events of each node, several where a leaf counts them.

        >>> import rvaft
        >>> watching = rvaft.monitor(rvaft.loads("top sand a b; a times 2;"))
        >>> [*watching.run([{"event": name} for name in "aab"])][-1].symbol, watching.explanation.events
        ('⊤', {'a': [1, 2], 'b': [3]})
        """
        found: dict[str, list[int]] = {}
        for one in self.matched:
            found.setdefault(one.node, []).append(one.event)
        return found

    def bound(self, tree: RVAFT) -> dict[str, Json]:
        """The variables with their values, in the order of a tree.

        >>> import rvaft
        >>> watching = rvaft.monitor(tree := rvaft.loads("event e(v) = { e: v }; top and a b; a on e(X); b on e(Y);"))
        >>> [*watching.run([{"e": 2}, {"e": 1}])][-1].symbol, watching.explanation.bound(tree)
        ('⊤', {'X': 2, 'Y': 1})
        """
        return {name: self.variables[name] for name in tree.variables if name in self.variables}


@dataclass(frozen=True, slots=True)
class Awaited:
    """A node that waits for its event; `event` is that as text.

    `inspect(Waypoint)`, or the node's name for the default event.

    >>> import rvaft
    >>> rvaft.monitor(rvaft.loads("top sand a b;")).pending()[0].awaited
    (Awaited(node='a', event='a'),)
    """

    node: str
    event: str


@dataclass(frozen=True, slots=True)
class Pending:
    """What a live branch waits for: any of these nodes' events may come next.

    `variables` holds the values that the events so far gave to variables that something to come
    depends on; a branch has one record for each way to bind them. `branch` is None where a tree has
    too many branches to count, for all of them together.

    >>> import rvaft
    >>> [record.branch for record in rvaft.monitor(rvaft.loads("top or a b;")).pending()]
    [1, 2]
    """

    branch: int | None
    awaited: tuple[Awaited, ...]
    variables: Mapping[str, Json]


@dataclass(frozen=True, slots=True)
class Ended:
    """How the last hope of a detection ended: the number of the event, from 1, and what was waited for just before it.

    >>> import rvaft
    >>> watching = rvaft.monitor(rvaft.loads("top sand a b;"))
    >>> watching.step({"event": "b"}).symbol, watching.ended.event
    ('⊥', 1)
    """

    event: int
    pending: tuple[Pending, ...]


DEFAULT_BRANCHES: Final = 100
"""How many branches are told apart in what is waited for."""


class Monitor(ABC):
    """Reads events one by one. After a final verdict it keeps returning it and looks at nothing.

    >>> import rvaft
    >>> watching = rvaft.monitor(rvaft.loads("top and a b;"))
    >>> watching.step({"event": "b"}).symbol, watching.step({"event": "a"}).symbol, watching.verdict.final
    ('?', '⊤', True)
    """

    def __init__(self) -> None:
        self._verdict = Verdict.UNKNOWN
        self._read = 0

    @property
    def verdict(self) -> Verdict:
        """The verdict so far; unknown before any event."""
        return self._verdict

    def step(self, event: Json) -> Verdict:
        """Read one event and return the verdict after it; raises `TraceError` for what is no JSON object."""
        if not isinstance(event, Mapping):
            message = f"an event is a JSON object (a dict), not {type(event).__name__}: decode the line first"
            raise TraceError(message, line=self._read + 1)
        self._read += 1
        if not self._verdict.final:
            self._verdict = self._advance(event)
        return self._verdict

    def run(self, events: Iterable[Json]) -> Iterator[Verdict]:
        """The verdict after each event in turn. Events are read as verdicts are asked for.

        Without a loop over it nothing happens.

        >>> import rvaft
        >>> watching = rvaft.monitor(rvaft.loads("top sand a b;"))
        >>> [verdict.symbol for verdict in watching.run([{"event": "a"}, {"event": "b"}])]
        ['?', '⊤']
        """
        return (self.step(event) for event in events)

    def fork(self) -> Self:
        """An independent monitor that has read the same events.

        A subclass that changes its parts in place, instead of replacing them, copies those here.
        """
        twin = object.__new__(type(self))  # as `copy` would, and faster: the product forks at every step
        vars(twin).update(vars(self))
        return twin

    def go_on_after(self, earlier: Self) -> None:
        """Go on in the trace after the events that another monitor of the same has read; this one has read none.

        Events keep their numbers, and what of the trace before them matters to any match, as its
        greatest time, is known.
        """
        self._read = earlier._read

    @property
    def detections(self) -> int:
        """How many times the events so far were a detection: one at most, but of a `Repetition`."""
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
        """After ⊤, one match, where the monitor knows the tree; else None."""
        return None

    def pending(self, *, limit: int = DEFAULT_BRANCHES) -> tuple[Pending, ...]:  # noqa: ARG002 (a subclass uses it)
        """Before a final verdict, what each live branch waits for, where the monitor knows the tree; else nothing.

        Beyond `limit` branches all are taken together.
        """
        return ()

    @property
    def ended(self) -> Ended | None:
        """After ⊥, the event that ended the last hope, where the monitor knows the tree; else None."""
        return None


FirstDetections: TypeAlias = Callable[[Sequence[Sequence[Json]]], Sequence[int | None]]
"""What a program says that looks at whole traces: for each, the number of the event, from 1, with
which it first is a detection, if it is one.
"""


LeftOpen: TypeAlias = Callable[[Sequence[Json]], str]
"""Why a language says nothing of a trace (its events have no order there, say), in a few words; empty where it does."""


class DetectionMonitor(Monitor):
    """Asks a program that looks at whole traces, after each event, whether the events so far are a detection.

    It never says ⊥.

    What a language has `left_open` raises `TraceError`, and no comparison asks for it. Every event
    costs as much as all before it: ask `first_detections` itself where a trace is known to its end.

    >>> two = DetectionMonitor(lambda traces: [2 if len(trace) > 1 else None for trace in traces])
    >>> [verdict.symbol for verdict in two.run([{}, {}, {}])], two.first_detections([[], [{}, {}]])
    (['?', '⊤', '⊤'], [None, 2])
    """

    def __init__(self, first_detections: FirstDetections, left_open: LeftOpen = lambda _: "") -> None:
        super().__init__()
        self.first_detections = first_detections
        self.left_open = left_open
        self._events: tuple[Json, ...] = ()

    def _advance(self, event: Json) -> Verdict:
        self._events += (event,)
        (found,) = self.first_detections([self._events])
        return Verdict.UNKNOWN if found is None else Verdict.TRUE

    @property
    def state(self) -> Hashable:
        """The verdict and, before a detection, all events so far."""
        return self.verdict, None if self.verdict.final else json.dumps(self._events)


class Repetition(Monitor):
    """A monitor that begins afresh with the event after each detection; what was used is not used again.

    The verdict is true at each event that detects; after others it is that of the events since, and
    false stays. Explanations name events by their numbers in the whole trace. `monitor` has read
    nothing.

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
        """The monitor that reads the events since the last detection."""

    def begin_again(self) -> None:
        """Begin afresh, if the last event was a detection."""
        if self.verdict is Verdict.TRUE:
            self._before += 1
            self.current = self._next()

    def _next(self) -> Monitor:
        """What reads the next event."""
        if self.verdict is not Verdict.TRUE:
            return self.current
        fresh = self._fresh.fork()
        fresh.go_on_after(self.current)
        return fresh

    @property
    def verdict(self) -> Verdict:
        """The verdict so far."""
        return self.current.verdict

    @property
    def detections(self) -> int:
        """How many detections there were."""
        return self._before + self.current.detections

    def step(self, event: Json) -> Verdict:
        """Read one event and return the verdict after it; raises what the monitor raises."""
        self.begin_again()
        return self.current.step(event)

    def fork(self) -> Self:
        """An independent monitor that has read the same events."""
        twin = super().fork()
        twin.current = self.current.fork()
        return twin

    def _advance(self, event: Json) -> Verdict:
        return self.current.step(event)

    @property
    def state(self) -> Hashable:
        """Equal states of repetitions of one monitor have equal futures."""
        return self.verdict, self._next().state

    @property
    def explanation(self) -> Explanation | None:
        """At an event that detects, one match."""
        return self.current.explanation

    def pending(self, *, limit: int = DEFAULT_BRANCHES) -> tuple[Pending, ...]:
        """What each live branch waits for."""
        return self._next().pending(limit=limit)

    @property
    def ended(self) -> Ended | None:
        """After ⊥, how the last hope ended."""
        return self.current.ended
