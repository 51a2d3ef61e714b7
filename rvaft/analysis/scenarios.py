"""The scenarios of a tree, as a space that is never enumerated: which there are, what all of them have, how large they are.

A scenario makes the choices of a tree: one child at each `or`, K children or more at each `KofN`. It is feasible where no guard
without variables is false and no event has to come before itself (semantics, section 2).
"""

from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Set
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from heapq import heapify, heappop, heappush
from itertools import chain, combinations, pairwise
from math import prod
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias, TypeVar, assert_never

from rvaft.analysis.normal_form import Op, body, is_impossible
from rvaft.errors import TooLarge
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT, find_cycle, reachable
from rvaft.support.bits import bits, in_at_least, union
from rvaft.support.budget import DEFAULT_LIMIT, Budget

if TYPE_CHECKING:
    import networkx as nx

# The strict precedence of a scenario as a graph of linear size (semantics, section 2).
#
# "All events of one part before all events of another" is quadratic when written pair by pair. Here each node has, beside
# its event, a point `start` before every event of its part (itself and its descendants) and a point `end` after every one,
# and each child of an ordered gate a point `done` after its part and those of the children before it. No edge leads from the start of
# a node to its end: a part without events orders nothing. So one event precedes another exactly when a path leads from
# the first to the second, and the precedence is cyclic exactly when the graph is.

T = TypeVar("T")

Edge: TypeAlias = tuple[str, str]
"""A parent and a child that it keeps."""

Kept: TypeAlias = Mapping[str, tuple[str, ...]]
"""The kept nodes, each with the children it keeps, in the order of the tree."""

Point: TypeAlias = tuple[Literal["start", "event", "end", "done"], str, str]
"""What the point is, the node it belongs to, and for `done` the child (else the empty string)."""


def event(name: str) -> Point:
    """The point of a node's event."""
    return ("event", name, "")


def precedence(tree: RVAFT, kept: Kept, *, ends: bool = False) -> "nx.DiGraph":
    """The precedence among the events of the kept nodes; each edge has as `via` the tree edge that it needs, or None.

    Of the order of ends under `pand` nothing is in it, or, with `ends`, more than is asked: the parts in sequence.
    """
    import networkx as nx  # noqa: PLC0415 -- slow to import, and seldom needed

    graph = nx.DiGraph()
    for name, children in kept.items():
        node, below, own = tree.nodes[name], body(tree.nodes[name]), event(name)
        start, end = (("start", name, ""), ("end", name, ""))
        if node.has_event:
            graph.add_edge(start, own, via=None)
            graph.add_edge(own, end, via=None)
        for child in children:
            via = (name, child)
            graph.add_edge(start, ("start", child, ""), via=via)
            graph.add_edge(("end", child, ""), end, via=via)
            if node.has_event and tree.causality is Causality.TOP_DOWN:
                graph.add_edge(own, ("start", child, ""), via=via)
            elif node.has_event:
                graph.add_edge(("end", child, ""), own, via=via)
        in_sequence = below.op is Op.SEQUENCE or (ends and node.gate is Gate.PAND)
        in_time = [child for child in below.children if child in children] if in_sequence else []
        for earlier, later in pairwise(in_time):
            done: Point = ("done", name, earlier)
            graph.add_edge(("end", earlier, ""), done, via=(name, earlier))
            graph.add_edge(done, ("start", later, ""), via=(name, later))
            graph.add_edge(done, ("done", name, later), via=(name, later))
    return graph


def path(graph: "nx.DiGraph", before: str, after: str) -> list[Point]:
    """The points of a shortest path that makes the event of one node precede that of another, or none."""
    import networkx as nx  # noqa: PLC0415 -- slow to import, and seldom needed

    points: list[Point] = []
    with suppress(nx.NetworkXNoPath, nx.NodeNotFound):
        points += nx.shortest_path(graph, event(before), event(after))
    return points


def edges_along(graph: "nx.DiGraph", points: list[Point]) -> list[Edge]:
    """The tree edges that a path needs, each once; without one of them it is not there."""
    needed = (graph.edges[step]["via"] for step in pairwise(points))
    return list(dict.fromkeys(edge for edge in needed if edge is not None))


# The order of ends under `pand`, of which each scenario has a union of partial orders.
#
# That a part ends before the next one does says, read backwards: each event of the part waits for *some* event of the next. So one looks
# for an order from its end: a point is free as soon as all that follows it is, and where it waits for some event, one of these.
# Where points are left that wait for each other, there is no order.


def in_sequence(tree: RVAFT) -> RVAFT:
    """The tree with `sand` for each `pand` between whose children no scenario has more than one event each: that is the same.

    >>> from rvaft import loads
    >>> in_sequence(loads("top pand a b;")).nodes["top"].gate
    <Gate.SAND: 'sand'>
    """
    if not any(node.gate is Gate.PAND for node in tree.top_down()):
        return tree
    most = most_events(tree)
    nodes = dict(tree.nodes)
    for node in tree.top_down():
        if node.gate is Gate.PAND and all(most[child] < 2 for child in node.children):
            nodes[node.name] = replace(node, gate=Gate.SAND)
    return tree.changed(nodes=nodes.values())


def most_events(tree: RVAFT, own: Callable[[Node], int] = lambda node: node.times * node.has_event) -> dict[str, int]:
    """How many events, or of what is `own` of a node, its part has in no scenario more than; two stand for many.

    >>> from rvaft import loads
    >>> most_events(loads("top or a b; b and c d;"))["top"]
    2
    """
    most: dict[str, int] = {}
    for node in tree.bottom_up():
        below = [most[child] for child in node.children]
        inside = max(below) if body(node).op is Op.ONE else sum(below)
        most[node.name] = min(2, inside + own(node))
    return most


class Standstill(NamedTuple):
    """Why the events of a scenario have no order: it needs all `edges`, and none of `lacking`, to be so."""

    edges: Iterable[Edge] = ()
    lacking: Iterable[Edge] = ()


def standstill(tree: RVAFT, kept: Kept, graph: "nx.DiGraph") -> Standstill | None:
    """Why no order of the events keeps this precedence, that of the kept nodes and perhaps more, and the ends of each `pand`; or None."""
    bearing: set[str] = set()
    above: dict[str, list[str]] = {}
    for name in [name for name in reversed(tree.order) if name in kept]:
        if tree.nodes[name].has_event or not bearing.isdisjoint(kept[name]):
            bearing.add(name)
        for child in kept[name]:
            above.setdefault(child, []).append(name)
    awaited: dict[Point, list[Point]] = {}  # the ends that wait for some event of a part, which is named by its `start`
    for name, children in kept.items():
        if tree.nodes[name].gate is Gate.PAND:
            for one, other in pairwise(child for child in children if child in bearing):
                awaited.setdefault(("start", other, ""), []).append(("end", one, ""))
    waiting = {point: graph.out_degree(point) for point in graph}
    for ends in awaited.values():
        for end in ends:
            waiting[end] += 1
    free = [point for point, count in waiting.items() if count == 0]
    begun: set[str] = set()  # nodes of whose part some event is free
    for point in free:
        ready = [*graph.predecessors(point)]
        parts = [point[1]] if point[0] == "event" else []
        while parts:
            if (part := parts.pop()) not in begun:
                begun.add(part)
                parts += above.get(part, ())
                ready += awaited.get(("start", part, ""), ())
        for earlier in ready:
            waiting[earlier] -= 1
            if waiting[earlier] == 0:
                free.append(earlier)
    stuck = {point for point, count in waiting.items() if count}
    if not any(kind == "event" for kind, _, _ in stuck):
        return None
    edges = [via for one, other, via in graph.edges(data="via") if via is not None and one in stuck and other in stuck]
    lacking: list[Edge] = []
    for (_, part, _), ends in awaited.items():
        if part not in begun and any(end in stuck for end in ends):
            inside = [*reachable(part, kept.__getitem__)]
            edges += [(name, child) for name in (*above[part], *inside) for child in kept[name]]
            votes = [name for name in inside if body(tree.nodes[name]).op is Op.AT_LEAST]
            lacking += [(name, c) for name in votes for c in tree.nodes[name].children if c not in kept[name]]
    return Standstill(dict.fromkeys(edges), dict.fromkeys(lacking))


# What is in some scenario, in every one.

Demands: TypeAlias = dict[str, frozenset[str]]
"""Nodes that must be kept, each with the children that it must keep."""

_NONE: frozenset[str] = frozenset()


class Resolutions:
    """The ways to make the choices of a tree without certain nodes and tree edges. Order among events is not looked at.

    Whether some way keeps given nodes and edges is answered by walking from them to the root: the kept node that comes last in the
    order of the tree (parents before children) needs one kept parent; an `or` that is asked for two different children ends the
    attempt. For one node that is a path to the root, for two nodes a walk over pairs; in general the number of attempts may grow
    exponentially, so each step is paid from a budget.
    """

    def __init__(self, tree: RVAFT, banned: Container[str] = (), without: Container[Edge] = ()) -> None:
        self.tree = tree
        self._rank = {name: index for index, name in enumerate(tree.order)}
        self._options: dict[str, tuple[str, ...]] = {}
        for node in tree.bottom_up():
            options = tuple(c for c in node.children if c in self._options and (node.name, c) not in without)
            if node.name not in banned and len(options) >= body(node).need:
                self._options[node.name] = options
        self._reached: dict[str, list[str]] = {tree.root: []} if tree.root in self._options else {}
        for node in tree.top_down():
            if node.name in self._reached:
                for child in self._options[node.name]:
                    self._reached.setdefault(child, []).append(node.name)

    def __bool__(self) -> bool:
        return bool(self._reached)

    def __contains__(self, name: str) -> bool:
        return name in self._reached

    @cached_property
    def union(self) -> dict[str, tuple[str, ...]]:
        """Each node that is in some scenario, with the children that it keeps in some scenario."""
        return {name: self._options[name] for name in self.tree.order if name in self._reached}

    def scenario(self, nodes: Iterable[str], edges: Iterable[Edge], budget: Budget) -> Kept | None:
        """A scenario that contains these nodes and tree edges, or None; raises `Undecided` when the budget is spent."""
        demands = self._support(nodes, edges, budget)
        if demands is None:
            return None
        kept: dict[str, tuple[str, ...]] = {}
        todo = [self.tree.root]
        while todo:
            name = todo.pop()
            if name in kept:
                continue
            below, demanded, chosen = body(self.tree.nodes[name]), demands.get(name, _NONE), self._options[name]
            if below.chooses:
                others = [child for child in chosen if child not in demanded]
                wanted = {*demanded, *others[: max(0, below.need - len(demanded))]}
                chosen = tuple(child for child in chosen if child in wanted)
            kept[name] = chosen
            todo.extend(reversed(chosen))
        return {name: kept[name] for name in self.tree.order if name in kept}

    def possible(self, nodes: Iterable[str], budget: Budget, *, edges: Iterable[Edge] = ()) -> bool:
        """Whether some scenario contains these nodes and tree edges; raises `Undecided` when the budget is spent."""
        return self._support(nodes, edges, budget) is not None

    def _support(self, nodes: Iterable[str], edges: Iterable[Edge], budget: Budget) -> Demands | None:
        """What must be kept for these nodes and edges, enlarged so that each node but the root has a parent that keeps it."""
        demands: Demands = {}
        if not self:
            return None
        for name in (self.tree.root, *nodes):
            demands.setdefault(name, _NONE)
        for parent, child in edges:
            demands[parent] = demands.get(parent, _NONE) | {child}
            demands.setdefault(child, _NONE)
        for name, children in demands.items():
            if name not in self or not children <= set(self._options[name]):
                return None
            if len(children) > 1 and body(self.tree.nodes[name]).op is Op.ONE:
                return None
        attempts = [(demands, len(self._rank))]
        seen: set[frozenset[tuple[int, frozenset[str]]]] = set()
        while attempts:
            current, below = attempts.pop()
            # A heap of negated ranks: the node that comes last is served first, so that all its demands are known.
            agenda = [-self._rank[name] for name in current if self._rank[name] < below]
            heapify(agenda)
            while agenda[0] != 0:
                budget.spend(1)
                name = self.tree.order[-agenda[0]]
                ways = self._ways(current, name)
                if len(ways) > 1:
                    budget.spend(len(current) * len(ways))
                    state = frozenset((-rank, current[self.tree.order[-rank]]) for rank in agenda)
                    if state in seen:
                        break
                    seen.add(state)
                    others = ({**current, way: current.get(way, _NONE) | {name}} for way in ways[:0:-1])
                    attempts += [(other, self._rank[name]) for other in others]
                if not ways:
                    break
                heappop(agenda)
                if ways[0] not in current:
                    heappush(agenda, -self._rank[ways[0]])
                current[ways[0]] = current.get(ways[0], _NONE) | {name}
            else:
                return current
        return None

    def _ways(self, demands: Demands, name: str) -> list[str]:
        """The parents that may keep the node; only one where a parent that is kept anyway can keep it too."""
        ways: list[str] = []
        for parent in self._reached[name]:
            demanded, takes_one = demands.get(parent), body(self.tree.nodes[parent]).op is Op.ONE
            if demanded is not None and (name in demanded or not takes_one):
                return [parent]
            if not demanded or not takes_one:
                ways.append(parent)
        return ways


_RESOLUTIONS, _PRECEDENCE = 4, 15
"""What resolutions and a precedence cost per node, in steps."""


class ScenarioSpace:
    """The feasible scenarios of a tree; `limit` is what each question that is hard in general may cost.

    A scenario whose precedence is cyclic shows a cycle, a cycle needs some tree edges, and every feasible scenario lacks one
    of them: so the search bans tree edges until nothing is cyclic. Where the ends of a `pand` have no order, it may help as well to keep more.

    >>> from rvaft import loads
    >>> ScenarioSpace(loads("top or a b; a when 2 < 1; b;")).feasible(Budget())
    {'top': ('b',), 'b': ()}
    """

    def __init__(self, tree: RVAFT, limit: int = DEFAULT_LIMIT) -> None:
        self.tree = in_sequence(tree)
        self.limit = limit

    def budget(self) -> Budget:
        """A fresh budget."""
        return Budget(self.limit)

    @cached_property
    def dead(self) -> frozenset[str]:
        """The nodes whose guard has no variables and does not hold: no feasible scenario contains them."""
        return frozenset(node.name for node in self.tree.top_down() if is_impossible(node))

    @cached_property
    def resolutions(self) -> Resolutions:
        """The ways to make the choices without dead nodes; those with a cyclic precedence are among them."""
        return Resolutions(self.tree, self.dead)

    @cached_property
    def ends(self) -> bool:
        """Whether a `pand` orders the ends of its parts, and no more."""
        return any(node.gate is Gate.PAND for node in self.tree.top_down())

    @cached_property
    def order(self) -> "nx.DiGraph":
        """The precedence over all nodes that are not dead, parts under `pand` in sequence; it contains that of every scenario."""
        return precedence(self.tree, self.resolutions.union, ends=True)

    @cached_property
    def acyclic(self) -> bool:
        """Whether surely no precedence is cyclic; only a shared node can be in a sequence twice."""
        ordered = any(body(node).op is Op.SEQUENCE for node in self.tree.top_down())
        return not (self.tree.shared and (ordered or self.ends)) or not find_cycle(self.order)

    @cached_property
    def is_empty(self) -> bool:
        """Whether there is no feasible scenario; raises `Undecided` beyond the limit."""
        return bool(self.dead or not self.acyclic) and self.feasible(self.budget()) is None

    def feasible(
        self,
        budget: Budget,
        nodes: Iterable[str] = (),
        *,
        edges: Iterable[Edge] = (),
        without: frozenset[str] = frozenset(),
        apart: tuple[str, str] | None = None,
        silent: str | None = None,
    ) -> Kept | None:
        """A feasible scenario with some nodes and tree edges and without other nodes, or None where there is none.

        With `apart`, one that contains both and orders neither before the other; with `silent`, one that contains that node and no event of
        its part. Raises `Undecided` beyond the budget.
        """
        wanted, needed = [*nodes, *(apart or ()), *([] if silent is None else [silent])], [*edges]

        def attempt(bans: frozenset[Edge], more: frozenset[Edge]) -> Kept | Standstill:
            if bans or without:
                budget.spend(_RESOLUTIONS * len(self.tree.order))
            space = Resolutions(self.tree, self.dead | without, bans) if bans or without else self.resolutions
            kept = space.scenario(wanted, [*needed, *more], budget)
            if kept is None:
                return Standstill()
            if silent is not None and (way := _to_event(self.tree, kept, silent)):
                return Standstill(way)
            if self.acyclic and apart is None:
                return kept
            budget.spend(_PRECEDENCE * len(kept))
            return self._disorder(kept, apart) or kept

        return _first_without(attempt)

    def _disorder(self, kept: Kept, apart: tuple[str, str] | None) -> Standstill | None:
        """Why the events of a scenario have no order, or two of them only one."""
        graph = precedence(self.tree, kept)
        points = [] if self.acyclic else find_cycle(graph)
        points += points[:1]
        if not points and apart is not None:
            points = path(graph, *apart) or path(graph, *apart[::-1])
        if (edges := edges_along(graph, points)) or not self.ends:
            return Standstill(edges) if edges else None
        if apart is None:
            return standstill(self.tree, kept, graph)
        # Of a leaf that counts the first event comes right after its `start`.
        firsts = [event(name) if self.tree.nodes[name].times == 1 else ("start", name, "") for name in apart]
        for one, other in pairwise([*firsts, firsts[0]]):
            further = graph.copy()
            further.add_edge(one, other, via=None)
            if why := standstill(self.tree, kept, further):
                return why
        return None

    def endless(self, budget: Budget) -> tuple[Kept, str] | None:
        """A scenario without dead nodes whose precedence is not cyclic, and a `pand` of it whose parts cannot end in its order."""
        if not self.ends or self.acyclic:
            return None
        for kept in resolutions(self.tree, limit=self.limit):
            budget.spend((_RESOLUTIONS + _PRECEDENCE) * len(self.tree.order))
            graph = precedence(self.tree, kept)
            why = None if find_cycle(graph) else standstill(self.tree, kept, graph)
            if why is not None:
                return kept, next(name for name, _ in why.edges if self.tree.nodes[name].gate is Gate.PAND)
        return None

    def cyclic(self, budget: Budget, knot: Set[Point]) -> tuple[Kept, tuple[str, ...]] | None:
        """A scenario without dead nodes whose precedence has a cycle among these points, and the nodes of the cycle."""

        def attempt(bans: frozenset[Edge], _: object) -> tuple[Kept, tuple[str, ...]] | Standstill:
            budget.spend((_RESOLUTIONS + _PRECEDENCE) * len(self.tree.order))
            space = Resolutions(self.tree, self.dead, bans)
            graph = precedence(self.tree, space.union)
            points = find_cycle({p: [later for later in graph[p] if later in knot] for p in graph if p in knot})
            edges = edges_along(graph, points + points[:1])
            kept = space.scenario((), edges, budget) if points else None
            if kept is None:
                return Standstill(edges)
            return kept, tuple(dict.fromkeys(name for kind, name, _ in points if kind == "event"))

        return _first_without(attempt)


def _to_event(tree: RVAFT, kept: Kept, name: str) -> list[Edge]:
    """The tree edges of a way from a kept node to an event of its part, or none."""
    way: dict[str, list[Edge]] = {name: []}
    for one in (queue := [name]):
        for child in kept[one]:
            if child not in way:
                way[child] = [*way[one], (one, child)]
                queue.append(child)
                if tree.nodes[child].has_event:
                    return way[child]
    return []


def _first_without(attempt: Callable[[frozenset[Edge], frozenset[Edge]], T | Standstill]) -> T | None:
    """What an attempt with some tree edges banned and others kept finds, first with none; a failed one says which of these are one more."""
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


def inevitable(tree: RVAFT, marks: Mapping[str, int], full: int) -> dict[str, int]:
    """For each reachable node the marks borne in every scenario that contains it, for all marks (bits) at once.

    `full` has the bits of all marks; a node marked `full` can be in no scenario, and a node that is in no scenario has
    `full` as its result. Order among events is not looked at.

    For a single mark let `avoid(v)` say that some way to resolve the choices below v bears no marked node. Since a choice
    belongs to a node and not to a path, `avoid` is found bottom-up even where nodes are shared, and some scenario
    contains v and no marked node exactly when v can avoid the mark and is the root or has a parent of which the same is true
    (take the choices along that path, and elsewhere those that avoid). The two passes compute the complement.
    """
    below: dict[str, int] = {}
    for node in tree.bottom_up():
        missable = len(node.children) - body(node).need + 1
        children = in_at_least(missable, [below[child] for child in node.children])
        below[node.name] = marks.get(node.name, 0) | children
    result: dict[str, int] = {}
    for node in tree.top_down():
        above = full if tree.parents(node.name) else 0
        for parent in tree.parents(node.name):
            above &= result[parent]
        result[node.name] = below[node.name] | above
    return result


_AT_ONCE: Final = 4096
"""So many marks are looked at together: each node has a bit for each."""


def borne_surely(
    tree: RVAFT, dead: Iterable[str], asked: Collection[tuple[str, str]], bearers: Mapping[str, Iterable[str]]
) -> set[tuple[str, str]]:
    """Of these pairs of a node and a mark those where every scenario with the node has a bearer of the mark, if there is one at all."""
    wanted, found = list(dict.fromkeys(mark for _, mark in asked)), set[tuple[str, str]]()
    for start in range(0, len(wanted), _AT_ONCE):
        bit = {mark: 1 << index for index, mark in enumerate(wanted[start : start + _AT_ONCE])}
        # A scenario that bears everything and one that is no scenario must not look alike: one bit more for the latter.
        everything = (1 << len(bit) + 1) - 1
        marks = dict.fromkeys(dead, everything)
        for mark, own in bit.items():
            for bearer in bearers.get(mark, ()):
                marks[bearer] = marks.get(bearer, 0) | own
        borne = inevitable(tree, marks, everything)
        found.update((name, mark) for name, mark in asked if borne[name] & bit.get(mark, 0))
    return found


# How many scenarios there are, and how large they are.

SCENARIOS: Final = 5_000
"""The most scenarios that the reference is made to try."""


def most_scenarios(tree: RVAFT) -> int:
    """A bound on the number of scenarios; the number itself where no node is shared and every scenario is feasible."""
    ways: dict[str, int] = {}
    for node in tree.bottom_up():
        below, op = [ways[child] for child in node.children], body(node).op
        match op:
            case Op.ONE:
                ways[node.name] = sum(below)
            case Op.AT_LEAST:
                keeping = [1, *([0] * len(below))]  # the ways to keep so many children
                for of_child in below:
                    keeping = [keeping[0], *(more + of_child * fewer for fewer, more in pairwise(keeping))]
                ways[node.name] = sum(keeping[body(node).need :])
            case Op.ALL | Op.SEQUENCE:
                ways[node.name] = prod(below)
            case Op.EVENT | Op.CONDITION:
                raise AssertionError("the body of a node is made of its children")
            case _:
                assert_never(op)
    return ways[tree.root]


class Fewest(NamedTuple):
    """How many events at the least, and the children that are kept for it."""

    events: int
    kept: tuple[str, ...]


def fewest_events(
    nodes: Iterable[Node],
    *,
    without: Container[str] = frozenset(),
    without_edges: Container[Edge] = frozenset(),
    taken: Container[str] = frozenset(),
    forced: Container[str] = frozenset(),
) -> dict[str, Fewest]:
    """For each of these nodes (children first) with a way to be kept, the fewest events of its part, a shared part counted anew.

    Not counted are the events that are `taken`; `forced` children are kept wherever their parent is.

    >>> from rvaft import loads
    >>> fewest_events(loads("top 2of3 a b c;").bottom_up(), without={"b"})["top"]
    Fewest(events=2, kept=('a', 'c'))
    """
    found: dict[str, Fewest] = {}
    for node in nodes:
        below = body(node)
        able = [child for child in node.children if child in found and (node.name, child) not in without_edges]
        must = [child for child in node.children if child in forced]
        if node.name in without or len(able) < below.need or not set(must) <= set(able):
            continue
        rest = sorted((child for child in able if child not in forced), key=lambda child: found[child].events)
        chosen = {*must, *rest[: max(below.need - len(must), 0)]}
        kept = tuple(child for child in node.children if child in chosen)
        own = node.times if node.has_event and node.name not in taken else 0
        found[node.name] = Fewest(own + sum(found[child].events for child in kept), kept)
    return found


# Scenarios one by one, and at random.


def resolutions(tree: RVAFT, *, minimal: bool = False, limit: int) -> Iterator[Kept]:
    """The ways to make the choices that a scenario reaches without a dead node, in a stable order; `minimal` keeps just K of N.

    Raises `TooLarge` beyond `limit`.
    """
    order = tree.order
    position = {name: index for index, name in enumerate(order)}
    alive = Resolutions(tree, {node.name for node in tree.top_down() if is_impossible(node)}).union
    surely: dict[str, int] = {}  # of each node those kept whenever it is: those below it up to the next choices
    for node in tree.bottom_up():
        below = () if body(node).chooses else node.children
        surely[node.name] = 1 << position[node.name] | union(surely[child] for child in below)
    gates = [name for name in order if body(tree.nodes[name]).chooses]

    def further(reached: int, chosen: Kept, gate: str) -> Iterator[tuple[int, Kept]]:
        below, options = body(tree.nodes[gate]), alive.get(gate, ())
        most = below.need if minimal or below.op is Op.ONE else len(options)
        ways = chain.from_iterable(combinations(options, size) for size in range(below.need, most + 1))
        return ((reached | union(surely[c] for c in children), {**chosen, gate: children}) for children in ways)

    # One level per gate: what is reached with each of its choices, and all the choices so far.
    levels: list[Iterator[tuple[int, Kept]]] = [iter([(surely[tree.root], {})] if tree.root in alive else [])]
    count = 0
    while levels:
        reached, chosen = next(levels[-1], (0, {}))
        if not reached:
            levels.pop()
        elif len(levels) > len(gates):
            count += 1
            if count > limit:
                raise TooLarge("scenarios of the tree", limit=limit)
            yield {order[i]: chosen.get(order[i], tree.nodes[order[i]].children) for i in bits(reached)}
        elif reached >> position[gate := gates[len(levels) - 1]] & 1:
            levels.append(further(reached, chosen, gate))
        else:
            levels.append(iter([(reached, chosen)]))
