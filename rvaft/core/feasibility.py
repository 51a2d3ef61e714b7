"""Questions about the feasible scenarios of a property, answered without enumeration."""

from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence, Set
from functools import cached_property
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import Final, TypeAlias, TypeVar

from rvaft.core import property as core
from rvaft.core.build import build
from rvaft.core.precedence import (
    Edge,
    Point,
    Precedence,
    Standstill,
    edges_along,
    is_edge,
    node_of,
    path,
    point_of,
    precedence,
    standstill,
)
from rvaft.core.property import (
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    Kept,
    One,
    Part,
    Source,
    Times,
    fewest,
)
from rvaft.core.scenarios import is_constant, resolutions
from rvaft.core.time_order import with_single_ends
from rvaft.model.guards import holds
from rvaft.model.tree import RVAFT, find_cycle
from rvaft.support.bits import in_at_least
from rvaft.support.budget import DEFAULT_LIMIT, Budget

T = TypeVar("T")


Demands: TypeAlias = dict[Part, frozenset[Part]]
"""The required parts, each with its required direct subparts."""
_NONE: frozenset[Part] = frozenset()


class Resolutions:
    """The ways to make the choices of a property without some parts and edges, in any event order.

    A query walks from the given parts to the root: the deepest part needs a kept parent, and a
    `One` with two demanded children fails. Each step costs budget: attempts may be exponentially
    many.

    `everything` maps all parts, outer parts first, to their subparts in search order.
    """

    def __init__(self, everything: Kept, banned: Container[Part] = (), without: Container[Edge] = frozenset()) -> None:
        self._order = tuple(everything)
        self._root = self._order[0]
        self._rank = {part: index for index, part in enumerate(self._order)}
        self._options: dict[Part, tuple[Part, ...]] = {}
        for part in reversed(self._order):
            inside = tuple(
                inner for inner in everything[part] if inner in self._options and (part, inner) not in without
            )
            if part not in banned and len(inside) >= fewest(part):
                self._options[part] = inside
        self._reached: dict[Part, list[Part]] = {self._root: []} if self._root in self._options else {}
        for part in self._order:
            if part in self._reached:
                for inner in self._options[part]:
                    self._reached.setdefault(inner, []).append(part)

    def __bool__(self) -> bool:
        return bool(self._reached)

    def __contains__(self, part: Part) -> bool:
        return part in self._reached

    @cached_property
    def union(self) -> Kept:
        """Each part of some scenario, with the direct subparts that some scenario keeps."""
        return {part: self._options[part] for part in self._order if part in self._reached}

    def scenario(self, parts: Iterable[Part], edges: Iterable[Edge], budget: Budget) -> Kept | None:
        """Return a scenario with these parts and tree edges, or None; raises `Undecided`."""
        demands = self._support(parts, edges, budget)
        if demands is None:
            return None
        kept: dict[Part, tuple[Part, ...]] = {}
        todo = [self._root]
        while todo:
            part = todo.pop()
            if part in kept:
                continue
            demanded, chosen = demands.get(part, _NONE), self._options[part]
            if isinstance(part, One | AtLeast):
                others = [inner for inner in chosen if inner not in demanded]
                wanted = {*demanded, *others[: max(0, fewest(part) - len(demanded))]}
                chosen = tuple(inner for inner in chosen if inner in wanted)
            kept[part] = chosen
            todo.extend(reversed(chosen))
        return {part: kept[part] for part in self._order if part in kept}

    def possible(self, parts: Iterable[Part], budget: Budget, *, edges: Iterable[Edge] = ()) -> bool:
        """Whether `scenario` finds one."""
        return self._support(parts, edges, budget) is not None

    def _support(self, parts: Iterable[Part], edges: Iterable[Edge], budget: Budget) -> Demands | None:
        demands: Demands = {}
        if not self:
            return None
        for part in (self._root, *parts):
            demands.setdefault(part, _NONE)
        for part, inner in edges:
            demands[part] = demands.get(part, _NONE) | {inner}
            demands.setdefault(inner, _NONE)
        for part, inside in demands.items():
            if part not in self or not inside <= set(self._options[part]):
                return None
            if len(inside) > 1 and isinstance(part, One):
                return None
        attempts = [(demands, len(self._rank))]
        seen: set[frozenset[tuple[int, frozenset[Part]]]] = set()
        while attempts:
            current, below = attempts.pop()
            # A heap of negated ranks: the deepest part comes first, when all its demands are known.
            agenda = [-self._rank[part] for part in current if self._rank[part] < below]
            heapify(agenda)
            while agenda[0] != 0:
                part = self._order[-agenda[0]]
                ways = self._ways(current, part)
                budget.spend(1 if not ways or is_edge(ways[0], part) else 0)
                if len(ways) > 1:
                    budget.spend(len(current) * len(ways))
                    state = frozenset((-rank, current[self._order[-rank]]) for rank in agenda)
                    if state in seen:
                        break
                    seen.add(state)
                    others = ({**current, way: current.get(way, _NONE) | {part}} for way in ways[:0:-1])
                    attempts += [(other, self._rank[part]) for other in others]
                if not ways:
                    break
                heappop(agenda)
                if ways[0] not in current:
                    heappush(agenda, -self._rank[ways[0]])
                current[ways[0]] = current.get(ways[0], _NONE) | {part}
            else:
                return current
        return None

    def _ways(self, demands: Demands, part: Part) -> list[Part]:
        ways: list[Part] = []
        for around in self._reached[part]:
            demanded, takes_one = demands.get(around), isinstance(around, One)
            if demanded is not None and (part in demanded or not takes_one):
                return [around]
            if not demanded or not takes_one:
                ways.append(around)
        return ways


_RESOLUTIONS, _PRECEDENCE = 4, 15
"""The cost of resolutions and of a precedence graph, in budget steps per node."""


class ScenarioSpace:
    """The feasible scenarios of a tree; each hard question may cost `limit` steps.

    Every feasible scenario lacks a tree edge of each cycle, so the search bans tree edges until no
    cycle is left. If parts cannot end in order, it also requires more parts.

    >>> from rvaft import loads
    >>> [node_of(part) for part in ScenarioSpace(loads("top or a b; a when 2 < 1; b;")).feasible(Budget())]
    ['top', 'b']
    """

    def __init__(self, tree: RVAFT, limit: int = DEFAULT_LIMIT) -> None:
        self.tree = tree
        self.limit = limit
        self.prop = with_single_ends(build(tree))
        rank = tree.rank
        outer_first = self.prop.parts[::-1]
        self.order = tuple(sorted(outer_first, key=lambda part: rank[node_of(part)]))
        """All parts, outer parts first, in the order of the nodes of the tree."""
        self.whole: Mapping[str, Part] = {name: self.prop.wholes[Source(name)] for name in tree.order}
        """The whole part of each reachable node."""
        self.leaf: Mapping[str, Event | Times] = {
            node_of(part): part for part in self.order if isinstance(part, Event | Times)
        }
        """The event part of each reachable node with a runtime event."""
        self.gate: Mapping[str, Part] = {
            node_of(part): part for part in self.order if any(is_edge(part, inner) for inner in part.parts)
        }
        """The gate's part of each reachable node with children."""
        written = {
            gate: tuple(self.whole[child] for child in tree.nodes[name].children) for name, gate in self.gate.items()
        }
        self.everything: Kept = {part: written.get(part, part.parts) for part in self.order}
        """All parts with their direct subparts, in the order of the tree."""

    def budget(self) -> Budget:
        """Return a new budget."""
        return Budget(self.limit)

    @cached_property
    def never(self) -> frozenset[Part]:
        """The false constant conditions, which no feasible scenario has."""
        conditions = (part for part in self.order if isinstance(part, Condition))
        return frozenset(part for part in conditions if is_constant(part) and not holds(part.guard, {}))

    @cached_property
    def dead(self) -> frozenset[str]:
        """The nodes of the false constant conditions."""
        return frozenset(map(node_of, self.never))

    @cached_property
    def resolutions(self) -> Resolutions:
        """The ways to make the choices without dead nodes, including cyclic ones."""
        return Resolutions(self.everything, self.never)

    @cached_property
    def ends(self) -> bool:
        """Whether some order of ends is not a sequence of events."""
        return any(isinstance(part, EndInOrder) for part in self.order)

    @cached_property
    def widest(self) -> Precedence:
        """A superset of every scenario's precedence: all possible parts, with ends as sequences."""
        return precedence(self.resolutions.union, ends=True)

    @cached_property
    def acyclic(self) -> bool:
        """Whether surely no precedence is cyclic; only a shared part can be in a sequence twice."""
        ordered = any(isinstance(part, core.Sequence | EndInOrder) for part in self.gate.values())
        return not (self.prop.shared and ordered) or not find_cycle(self.widest)

    @cached_property
    def is_empty(self) -> bool:
        """Whether there is no feasible scenario; raises `Undecided`."""
        return bool(self.dead or not self.acyclic) and self.feasible(self.budget()) is None

    def feasible(
        self,
        budget: Budget,
        nodes: Iterable[str] = (),
        *,
        edges: Iterable[Edge] = (),
        without: Collection[str] = (),
        apart: tuple[str, str] | None = None,
        silent: str | None = None,
    ) -> Kept | None:
        """Return a feasible scenario with `nodes` and `edges` and without the nodes `without`, or
        None.

        With `apart`, it has the events of both nodes, unordered. With `silent`, it has that node
        but no event of its part. Raises `Undecided`.
        """
        parts = [self.whole[name] for name in (*nodes, *(apart or ()), *([] if silent is None else [silent]))]
        needed = [*edges]
        banned = self.never | {self.whole[name] for name in without if name in self.whole}
        events = None if apart is None else (self.leaf[apart[0]], self.leaf[apart[1]])

        def attempt(bans: frozenset[Edge], more: frozenset[Edge]) -> Kept | Standstill:
            if bans or without:
                budget.spend(_RESOLUTIONS * len(self.tree.order))
            space = Resolutions(self.everything, banned, bans) if bans or without else self.resolutions
            kept = space.scenario(parts, [*needed, *more], budget)
            if kept is None:
                return Standstill()
            if silent is not None and (way := _to_event(kept, self.whole[silent])):
                return Standstill(way)
            if self.acyclic and events is None:
                return kept
            budget.spend(_PRECEDENCE * sum(part in kept for part in self.whole.values()))
            return self._disorder(kept, events) or kept

        return _first_without(attempt)

    def _disorder(self, kept: Kept, apart: tuple[Event | Times, Event | Times] | None) -> Standstill | None:
        graph = precedence(kept)
        points = [] if self.acyclic else find_cycle(graph)
        points += points[:1]
        if not points and apart is not None:
            points = path(graph, *apart) or path(graph, *apart[::-1])
        if (edges := edges_along(graph, points)) or not self.ends:
            return Standstill(edges) if edges else None
        if apart is None:
            return standstill(kept, graph)
        # The first event of a counted leaf directly follows the leaf's `start`.
        firsts = [point_of(leaf) if isinstance(leaf, Event) else ("start", leaf, None) for leaf in apart]
        for one, other in pairwise([*firsts, firsts[0]]):
            further = graph.copy()
            further.add(one, other)
            if why := standstill(kept, further):
                return why
        return None

    def endless(self, budget: Budget) -> tuple[Kept, str] | None:
        """Return an acyclic scenario and a node whose parts cannot end in order, or None."""
        if not self.ends or self.acyclic:
            return None
        for kept in resolutions(self.prop, limit=self.limit):
            budget.spend((_RESOLUTIONS + _PRECEDENCE) * len(self.tree.order))
            graph = precedence(kept)
            why = None if find_cycle(graph) else standstill(kept, graph)
            if why is not None:
                return kept, next(node_of(part) for part, _ in why.edges if isinstance(part, EndInOrder))
        return None

    def cyclic(self, budget: Budget, knot: Set[Point]) -> tuple[Kept, tuple[str, ...]] | None:
        """Return a scenario without dead nodes and with a cycle through `knot`, and the cycle, or
        None.
        """

        def attempt(bans: frozenset[Edge], _: object) -> tuple[Kept, tuple[str, ...]] | Standstill:
            budget.spend((_RESOLUTIONS + _PRECEDENCE) * len(self.tree.order))
            space = Resolutions(self.everything, self.never, bans)
            graph = precedence(space.union)
            points = find_cycle({p: [later for later in graph[p] if later in knot] for p in graph if p in knot})
            edges = edges_along(graph, points + points[:1])
            kept = space.scenario((), edges, budget) if points else None
            if kept is None:
                return Standstill(edges)
            return kept, tuple(dict.fromkeys(node_of(part) for kind, part, _ in points if kind == "event"))

        return _first_without(attempt)


def _to_event(kept: Kept, start: Part) -> list[Edge]:
    way: dict[Part, list[Edge]] = {start: []}
    for part in (queue := [start]):
        for inner in kept[part]:
            if inner not in way:
                way[inner] = [*way[part], (part, inner)] if is_edge(part, inner) else way[part]
                queue.append(inner)
                if isinstance(inner, Event | Times):
                    return way[inner]
    return []


def _first_without(attempt: Callable[[frozenset[Edge], frozenset[Edge]], T | Standstill]) -> T | None:
    """Return the first result; a failed attempt bans one more of its `edges` or requires one
    `lacking`.
    """
    todo: list[tuple[frozenset[Edge], frozenset[Edge]]] = [(frozenset(), frozenset())]
    seen = set(todo)
    while todo:
        bans, more = todo.pop()
        found = attempt(bans, more)
        if not isinstance(found, Standstill):
            return found
        new = [(bans | {edge}, more) for edge in found.edges if edge not in more]
        new += [(bans, more | {edge}) for edge in found.lacking if edge not in bans]
        new = [state for state in dict.fromkeys(new) if state not in seen]
        seen.update(new)
        todo.extend(reversed(new))
    return None


def inevitable(order: Sequence[Part], marks: Mapping[Part, int], full: int) -> dict[Part, int]:
    """Return, for each part, the marks (bits) of every scenario with the part.

    `order` lists the parts, outer parts first. `full` has all bits: the mark and the result of a
    part in no scenario. Event order is ignored.

    For one mark, let `avoid(v)` mean that some way to make the choices below v has no marked part.
    It is computed bottom-up even with shared parts, because choices belong to parts. Some scenario
    has v and no marked part if and only if v can avoid the mark and is the root or has such a
    parent. The two loops compute the complement.
    """
    below: dict[Part, int] = {}
    for part in reversed(order):
        missable = len(part.parts) - fewest(part) + 1
        below[part] = marks.get(part, 0) | in_at_least(missable, [below[inner] for inner in part.parts])
    above = {order[0]: 0}
    result: dict[Part, int] = {}
    for part in order:
        result[part] = below[part] | above[part]
        for inner in part.parts:
            above[inner] = above.get(inner, full) & result[part]
    return result


_AT_ONCE: Final = 4096
"""The number of marks processed together; each part has a bit per mark."""


def borne_surely(
    space: ScenarioSpace, pairs: Collection[tuple[str, str]], bearers: Mapping[str, Iterable[Part]]
) -> set[tuple[str, str]]:
    """Return the pairs of a node and a mark such that every scenario with the node has a marked
    part.

    `bearers` are the parts with a mark. A node in no scenario has no pair.
    """
    names, found = list(dict.fromkeys(mark for _, mark in pairs)), set[tuple[str, str]]()
    for start in range(0, len(names), _AT_ONCE):
        bit = {mark: 1 << index for index, mark in enumerate(names[start : start + _AT_ONCE])}
        # One more bit distinguishes a scenario with all marks from no scenario.
        everything = (1 << len(bit) + 1) - 1
        marks = dict.fromkeys(space.never, everything)
        for mark, own in bit.items():
            for bearer in bearers.get(mark, ()):
                marks[bearer] = marks.get(bearer, 0) | own
        borne = inevitable(space.order, marks, everything)
        found.update((name, mark) for name, mark in pairs if borne[space.whole[name]] & bit.get(mark, 0))
    return found
