"""The strict precedence of the events of a scenario, and the order of ends.

A scenario has the closure, as bits for each event. Facts about many scenarios need a graph of linear
size, which also has their edges. A part has a vertex `start` before the events below it, and `end`
after them. A part in a sequence has a vertex `done` after its events and those of earlier parts. No
edge leads from `start` to `end`, because a part without events orders nothing. One event precedes
another if and only if there is a path.
"""

from collections.abc import Container, Iterable, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple, TypeAlias, assert_never

from rvaft.core import property as core
from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    Kept,
    One,
    Part,
    Times,
    Within,
    WithoutEvent,
    parts_below,
)
from rvaft.model.tree import reachable
from rvaft.support.bits import bits

Edge: TypeAlias = tuple[Part, Part]
"""An edge of the tree: a part, and a direct subpart of another node."""
Point: TypeAlias = tuple[Literal["start", "event", "end", "done"], Part, Part | None]
"""A vertex of the precedence graph: its kind, its part, and for `done` the subpart."""


def node_of(part: Part) -> str:
    """Return the name of the node that a part comes from; "" for a part made by a pass."""
    return "" if part.source is None else part.source.node


def is_edge(part: Part, inner: Part) -> bool:
    """Whether a direct subpart comes from another node."""
    return node_of(part) != node_of(inner)


def point_of(event: Part) -> Point:
    """Return the vertex of an event or a counted leaf."""
    return ("event", event, None)


class Precedence(dict[Point, dict[Point, Edge | None]]):
    """The direct successors of each vertex, each with the required tree edge, or None."""

    def add(self, one: Point, other: Point, via: Edge | None = None) -> None:
        """Add an edge of the graph."""
        self.setdefault(one, {})[other] = via
        self.setdefault(other, {})

    def copy(self) -> "Precedence":
        """Return an independent graph."""
        return Precedence({point: dict(later) for point, later in self.items()})

    @property
    def predecessors(self) -> dict[Point, list[Point]]:
        """The direct predecessors of each vertex."""
        found: dict[Point, list[Point]] = {point: [] for point in self}
        for point, later in self.items():
            for one in later:
                found[one].append(point)
        return found

    def restricted(self, points: Container[Point]) -> "Precedence":
        """Return the graph of some vertices."""
        inside = {point: later for point, later in self.items() if point in points}
        return Precedence({one: {b: via for b, via in later.items() if b in points} for one, later in inside.items()})


def precedence(kept: Kept, *, ends: bool = False) -> Precedence:
    """Return the precedence graph of kept parts.

    The order of an `EndInOrder` is omitted, or with `ends` treated as a sequence, which is stronger.
    """
    graph = Precedence()
    for part, inside in kept.items():
        start: Point = ("start", part, None)
        end: Point = ("end", part, None)
        if isinstance(part, Event | Times):
            graph.add(start, point_of(part))
            graph.add(point_of(part), end)
        for inner in inside:
            via = (part, inner) if is_edge(part, inner) else None
            graph.add(start, ("start", inner, None), via)
            graph.add(("end", inner, None), end, via)
        if isinstance(part, core.Sequence) or (ends and isinstance(part, EndInOrder)):
            for earlier, later in pairwise(inner for inner in part.parts if inner in inside):
                before, after = ((part, side) if is_edge(part, side) else None for side in (earlier, later))
                done: Point = ("done", part, earlier)
                graph.add(("end", earlier, None), done, before)
                graph.add(done, ("start", later, None), after)
                graph.add(done, ("done", part, later), after)
    return graph


def path(graph: Precedence, before: Part, after: Part) -> list[Point]:
    """Return a shortest path between two events, or an empty list."""
    start, end = point_of(before), point_of(after)
    earlier: dict[Point, Point | None] = {start: None} if start in graph else {}
    for point in (queue := list(earlier)):
        new = [later for later in graph[point] if later not in earlier]
        earlier.update(dict.fromkeys(new, point))
        queue += new
    points: list[Point] = []
    found: Point | None = end if end in earlier else None
    while found is not None:
        points.append(found)
        found = earlier[found]
    return points[::-1]


def edges_along(graph: Precedence, points: list[Point]) -> list[Edge]:
    """Return the tree edges that a path requires, each once."""
    needed = (graph[one][other] for one, other in pairwise(points))
    return list(dict.fromkeys(edge for edge in needed if edge is not None))


# The order of ends: a union of partial orders per scenario.
#
# Read backwards, each event of a part waits for *some* event of the next part. A vertex is free if
# its successors and one event of each awaited part are free. If vertices wait for each other, there
# is no order.


class Standstill(NamedTuple):
    """Why the events have no order: the scenario has all `edges` and none of `lacking`."""

    edges: Iterable[Edge] = ()
    lacking: Iterable[Edge] = ()


def standstill(kept: Kept, graph: Precedence) -> Standstill | None:
    """Return why no order satisfies the precedence `graph` and the order of ends, or None.

    `graph` may have additional edges.
    """
    bearing: set[Part] = set()
    above: dict[Part, list[Part]] = {}
    for part in reversed(list(kept)):
        if isinstance(part, Event | Times) or not bearing.isdisjoint(kept[part]):
            bearing.add(part)
        for inner in kept[part]:
            above.setdefault(inner, []).append(part)
    awaited: dict[Point, list[Point]] = {}  # the ends that wait for some event of a part, by the part's `start`
    for part, inside in kept.items():
        if isinstance(part, EndInOrder):
            for one, other in pairwise(inner for inner in inside if inner in bearing):
                awaited.setdefault(("start", other, None), []).append(("end", one, None))
    waiting, predecessors = {point: len(later) for point, later in graph.items()}, graph.predecessors
    for ends in awaited.values():
        for end in ends:
            waiting[end] += 1
    free = [point for point, count in waiting.items() if count == 0]
    begun: set[Part] = set()  # parts with a free event
    for point in free:
        ready = [*predecessors[point]]
        agenda = [point[1]] if point[0] == "event" else []
        while agenda:
            if (part := agenda.pop()) not in begun:
                begun.add(part)
                agenda += above.get(part, ())
                ready += awaited.get(("start", part, None), ())
        for earlier in ready:
            waiting[earlier] -= 1
            if waiting[earlier] == 0:
                free.append(earlier)
    stuck = {point for point, count in waiting.items() if count}
    if not any(kind == "event" for kind, _, _ in stuck):
        return None
    edges = [via for later in graph.restricted(stuck).values() for via in later.values() if via is not None]
    lacking: list[Edge] = []
    for (_, part, _), ends in awaited.items():
        if part not in begun and any(end in stuck for end in ends):
            inside = tuple(reachable(part, kept.__getitem__))
            edges += [(one, inner) for one in (*above[part], *inside) for inner in kept[one] if is_edge(one, inner)]
            votes = (vote for vote in inside if isinstance(vote, AtLeast))
            lacking += [(one, inner) for one in votes for inner in one.parts if inner not in kept[one]]
    return Standstill(dict.fromkeys(edges), dict.fromkeys(lacking))


def event_order(kept: Kept) -> tuple[tuple[Event, ...], tuple[int, ...]] | None:
    """Return the events of kept parts and, for each, the earlier events as bits; None if cyclic.

    The parts have no `Times` and `EndInOrder`.
    """
    events = tuple(part for part in kept if isinstance(part, Event))
    place = {event: number for number, event in enumerate(events)}
    inside: dict[Part, int] = {}
    before = [0] * len(events)
    for part in reversed(list(kept)):
        match part:
            case Event():
                inside[part] = 1 << place[part]
                continue
            case Times() | EndInOrder():
                raise AssertionError("a pass removes these before scenarios are enumerated")
            case core.Sequence():
                previous = 0  # with the parts before it, by transitivity
                for subpart in kept[part]:
                    for event in bits(inside[subpart]):
                        before[event] |= previous
                    previous = inside[subpart] or previous
            case Condition() | All() | One() | AtLeast() | Within() | WithoutEvent():
                pass
            case _:
                assert_never(part)
        found = 0
        for subpart in kept[part]:
            found |= inside[subpart]
        inside[part] = found
    closed = transitive(before)
    return None if closed is None else (events, closed)


def transitive(before: list[int]) -> tuple[int, ...] | None:
    """Return the transitive closure of the predecessors of each event, or None if cyclic."""
    waiting = [mask.bit_count() for mask in before]
    after: list[list[int]] = [[] for _ in before]
    for event, earlier in enumerate(before):
        for predecessor in bits(earlier):
            after[predecessor].append(event)
    ready = [event for event, count in enumerate(waiting) if not count]
    closed = list(before)
    for event in ready:
        for later in after[event]:
            closed[later] |= closed[event] | 1 << event
            waiting[later] -= 1
            if not waiting[later]:
                ready.append(later)
    return tuple(closed) if len(ready) == len(before) else None


class Ready:
    """Which of some events may come next; `before` has the predecessors of each, as bits.

    >>> Ready([0, 0b1, 0b1]).after(0b1)
    [1, 2]
    """

    def __init__(self, before: Sequence[int]) -> None:
        self._before = before
        self._events = [0] * (len(before) + 1)
        """For each number of earlier events, the events with at most so many predecessors."""
        for event, earlier in enumerate(before):
            self._events[earlier.bit_count()] |= 1 << event
        for count in range(1, len(self._events)):
            self._events[count] |= self._events[count - 1]

    def after(self, done: int) -> list[int]:
        """Return the events, in order, whose predecessors are done."""
        return [event for event in bits(self._events[done.bit_count()] & ~done) if not self._before[event] & ~done]


def direct(before: Sequence[int], event: int) -> list[int]:
    """Return the predecessors of an event without those of another predecessor."""
    found, left = list[int](), before[event]
    while left:  # find one that precedes none of the rest
        last = left.bit_length() - 1
        for one in bits(left):
            if before[one] >> last & 1:
                last = one
        found.append(last)
        left &= ~(before[last] | 1 << last)
    return sorted(found)


def later_events(root: Part) -> dict[Event, set[Event]]:
    """Return, for each event below a part without choices, the later events by its sequences."""
    inside: dict[Part, set[Event]] = {}
    after: dict[Event, set[Event]] = {}
    for part in parts_below(root):
        inside[part] = {part} if isinstance(part, Event) else set().union(*(inside[inner] for inner in part.parts))
        if isinstance(part, Event):
            after[part] = set()
        if isinstance(part, core.Sequence):
            for number, inner in enumerate(part.parts):
                for event in inside[inner]:
                    after[event].update(*(inside[other] for other in part.parts[number + 1 :]))
    for found in after.values():
        agenda = list(found)
        while agenda:
            new = after[agenda.pop()] - found
            found.update(new)
            agenda += new
    return after
