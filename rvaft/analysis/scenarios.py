"""The scenarios of a tree without certain nodes and tree edges, as a space that is never enumerated.

Whether some scenario contains given nodes and edges is answered by walking from them to the root: the kept node that comes last in the
order of the tree (parents before children) needs one kept parent; an `or` that is asked for two different children ends the
attempt. For one node that is a path to the root, for two nodes a walk over pairs; in general the number of attempts may grow
exponentially, so each step is paid from a budget. Order among events is not looked at here.
"""

from collections.abc import Iterable, Mapping
from functools import cached_property
from heapq import heapify, heappop, heappush
from itertools import pairwise
from math import prod
from typing import Final, Literal, TypeAlias

import networkx as nx

from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.support.budget import Budget

# The strict precedence of a scenario as a graph of linear size (semantics, section 2).
#
# "All events of one part before all events of another" is quadratic when written pair by pair. Here each node has, beside
# its event, a point `start` before every event of its part (itself and its descendants) and a point `end` after every one,
# and each child of an ordered gate a point `done` after its part and those of the children before it. No edge leads from the start of
# a node to its end: a part without events orders nothing. So one event precedes another exactly when a path leads from
# the first to the second, and the precedence is cyclic exactly when the graph is.

Edge: TypeAlias = tuple[str, str]
"""A parent and a child that it keeps."""

Kept: TypeAlias = Mapping[str, tuple[str, ...]]
"""The kept nodes, each with the children it keeps, in the order of the tree."""

Point: TypeAlias = tuple[Literal["start", "event", "end", "done"], str, str]
"""What the point is, the node it belongs to, and for `done` the child (else the empty string)."""


def event(name: str) -> Point:
    """The point of a node's event."""
    return ("event", name, "")


def everything(tree: RVAFT) -> Kept:
    """All reachable nodes with all their children: its precedence contains that of every scenario."""
    return {node.name: node.children for node in tree.top_down()}


def precedence(tree: RVAFT, kept: Kept | None = None) -> nx.DiGraph:
    """The precedence among the events of the kept nodes; each edge has as `via` the tree edge that it needs, or None."""
    graph = nx.DiGraph()
    for name, children in (everything(tree) if kept is None else kept).items():
        node = tree.nodes[name]
        if node.has_event:
            graph.add_edge(("start", name, ""), event(name), via=None)
            graph.add_edge(event(name), ("end", name, ""), via=None)
        for child in children:
            graph.add_edge(("start", name, ""), ("start", child, ""), via=(name, child))
            graph.add_edge(("end", child, ""), ("end", name, ""), via=(name, child))
            if node.has_event and tree.causality is Causality.TOP_DOWN:
                graph.add_edge(event(name), ("start", child, ""), via=(name, child))
            elif node.has_event:
                graph.add_edge(("end", child, ""), event(name), via=(name, child))
        _sequence(graph, node, children)
    return graph


def _sequence(graph: nx.DiGraph, node: Node, children: tuple[str, ...]) -> None:
    if node.gate is None or not node.gate.ordered:
        return
    in_time = children if node.gate is Gate.SAND else tuple(reversed(children))
    for earlier, later in pairwise(in_time):
        done: Point = ("done", node.name, earlier)
        graph.add_edge(("end", earlier, ""), done, via=(node.name, earlier))
        graph.add_edge(done, ("start", later, ""), via=(node.name, later))
        graph.add_edge(done, ("done", node.name, later), via=(node.name, later))


def cycle(graph: nx.DiGraph) -> list[Point]:
    """The points of one cycle, in order, or none."""
    if nx.is_directed_acyclic_graph(graph):
        return []
    return [point for point, _ in nx.find_cycle(graph)]


def path(graph: nx.DiGraph, before: str, after: str) -> list[Point]:
    """The points of a path that makes the event of one node precede that of another, or none."""
    if event(before) not in graph or event(after) not in graph:
        return []
    try:
        points: list[Point] = nx.bidirectional_shortest_path(graph, event(before), event(after))
    except nx.NetworkXNoPath:
        return []
    return points


def edges_along(graph: nx.DiGraph, points: list[Point], *, closed: bool = False) -> list[Edge]:
    """The tree edges that a path (or, closed, a cycle) needs, each once; without one of them it is not there."""
    steps = list(pairwise([*points, points[0]] if closed else points))
    needed = (graph.edges[step]["via"] for step in steps)
    return list(dict.fromkeys(edge for edge in needed if edge is not None))


Demands: TypeAlias = dict[str, frozenset[str]]
"""Nodes that must be kept, each with the children that it must keep."""

_NONE: frozenset[str] = frozenset()


class Space:
    """The scenarios without the banned nodes and edges."""

    def __init__(
        self, tree: RVAFT, banned: frozenset[str] = frozenset(), without: frozenset[Edge] = frozenset()
    ) -> None:
        self.tree = tree
        self._rank = {name: index for index, name in enumerate(tree.order)}
        self._options: dict[str, tuple[str, ...]] = {}
        usable: set[str] = set()
        for node in tree.bottom_up():
            options = tuple(
                child for child in node.children if child in usable and not (without and (node.name, child) in without)
            )
            if node.name not in banned and len(options) >= _needed(node):
                usable.add(node.name)
                self._options[node.name] = options
        self._reached: dict[str, list[str]] = {tree.root: []} if tree.root in usable else {}
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
        """A scenario that contains these nodes and these tree edges, or None where there is none.

        Raises `Undecided` when the budget is spent.
        """
        demands = self._demands(nodes, edges)
        supported = None if demands is None else self._support(demands, budget)
        return None if supported is None else self._complete(supported)

    def possible(self, nodes: Iterable[str], budget: Budget, *, edges: Iterable[Edge] = ()) -> bool:
        """Whether some scenario contains these nodes and tree edges; raises `Undecided` when the budget is spent."""
        demands = self._demands(nodes, edges)
        return demands is not None and self._support(demands, budget) is not None

    def _demands(self, nodes: Iterable[str], edges: Iterable[Edge]) -> Demands | None:
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
            if self.tree.nodes[name].gate is Gate.OR and len(children) > 1:
                return None
        return demands

    def _support(self, demands: Demands, budget: Budget) -> Demands | None:
        """The demands, enlarged so that every demanded node but the root has a parent that keeps it."""
        attempts = [(demands, len(self._rank))]
        seen: set[frozenset[tuple[str, frozenset[str]]]] = set()
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
                    pending = (self.tree.order[-rank] for rank in agenda)
                    state = frozenset((waiting, current[waiting]) for waiting in pending)
                    if state in seen:
                        break
                    seen.add(state)
                    rank = -agenda[0]
                    attempts.extend((_demand(current, parent, name), rank) for parent in reversed(ways[1:]))
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
            demanded = demands.get(parent)
            if demanded is not None and (self.tree.nodes[parent].gate is not Gate.OR or name in demanded):
                return [parent]
            if not demanded or self.tree.nodes[parent].gate is not Gate.OR:
                ways.append(parent)
        return ways

    def _complete(self, demands: Demands) -> Kept:
        kept: dict[str, tuple[str, ...]] = {}
        todo = [self.tree.root]
        while todo:
            name = todo.pop()
            if name not in kept:
                kept[name] = self._choose(self.tree.nodes[name], demands.get(name, _NONE))
                todo.extend(reversed(kept[name]))
        return {name: kept[name] for name in self.tree.order if name in kept}

    def _choose(self, node: Node, demanded: frozenset[str]) -> tuple[str, ...]:
        options = self._options[node.name]
        if node.gate is Gate.OR:
            return tuple(demanded) or options[:1]
        if node.gate is Gate.VOT:
            others = [child for child in options if child not in demanded]
            chosen = demanded | set(others[: max(0, _needed(node) - len(demanded))])
            return tuple(child for child in options if child in chosen)
        return options


def _needed(node: Node) -> int:
    match node.gate:
        case Gate.OR:
            return 1
        case Gate.VOT:
            assert node.threshold is not None
            return node.threshold
        case _:
            return len(node.children)


def _demand(demands: Demands, parent: str, child: str) -> Demands:
    return {**demands, parent: demands.get(parent, _NONE) | {child}}


# Marks that no scenario can avoid, for all marks at once: one bit per mark, two passes over the tree.
#
# For a single mark let `avoid(v)` say that some way to resolve the choices below v bears no marked node. Since a choice
# belongs to a node and not to a path, `avoid` is found bottom-up even where nodes are shared, and some scenario
# contains v and no marked node exactly when v can avoid the mark and is the root or has a parent of which the same is true
# (take the choices along that path, and elsewhere those that avoid). The passes below compute the complement. Order among events is not looked at.


def inevitable(tree: RVAFT, marks: Mapping[str, int], full: int) -> dict[str, int]:
    """For each reachable node the marks borne in every scenario that contains it.

    `full` has the bits of all marks; a node marked `full` can be in no scenario, and a node that is in no scenario has
    `full` as its result.
    """
    below: dict[str, int] = {}
    for node in tree.bottom_up():
        below[node.name] = marks.get(node.name, 0) | _of_children(
            node.gate, node.threshold, [below[child] for child in node.children], full
        )
    result: dict[str, int] = {}
    for node in tree.top_down():
        above = full if tree.parents(node.name) else 0
        for parent in tree.parents(node.name):
            above &= result[parent]
        result[node.name] = below[node.name] | above
    return result


def _of_children(gate: Gate | None, threshold: int | None, children: list[int], full: int) -> int:
    match gate:
        case Gate.OR:
            common = full
            for bits in children:
                common &= bits
            return common
        case Gate.VOT:
            assert threshold is not None
            return at_least(len(children) - threshold + 1, children)
        case _:
            union = 0
            for bits in children:
                union |= bits
            return union


def at_least(count: int, sets: list[int]) -> int:
    """The bits that are set in at least `count` of the sets, by counting in binary, all bits side by side."""
    planes: list[int] = []
    for bits in sets:
        carry = bits
        for index, plane in enumerate(planes):
            planes[index], carry = plane ^ carry, plane & carry
        if carry:
            planes.append(carry)
    while len(planes) < count.bit_length():
        planes.append(0)
    everything = 0
    for bits in sets:
        everything |= bits
    greater, same = 0, everything
    for index in reversed(range(len(planes))):
        if count >> index & 1:
            same &= planes[index]
        else:
            greater |= same & planes[index]
            same &= ~planes[index]
    return greater | same


# How many scenarios a tree can have and how many events a detection takes, counted without trying them.

SCENARIOS: Final = 5_000
"""The most scenarios that the reference is made to try."""


def most_scenarios(tree: RVAFT) -> int:
    """A bound on the number of scenarios; the number itself where no node is shared and every scenario is feasible."""
    ways: dict[str, int] = {}
    for node in tree.bottom_up():
        ways[node.name] = _ways(node, [ways[child] for child in node.children])
    return ways[tree.root]


def _ways(node: Node, below: list[int]) -> int:
    match node.gate:
        case Gate.OR:
            return sum(below)
        case Gate.VOT:
            return _at_least(node.threshold or 0, below)
        case _:
            return prod(below)


def _at_least(threshold: int, below: list[int]) -> int:
    """The ways to keep at least so many children."""
    keeping = [1, *([0] * len(below))]
    for ways in below:
        keeping = [keeping[0], *(more + ways * fewer for fewer, more in pairwise(keeping))]
    return sum(keeping[threshold:])


def least_events(tree: RVAFT) -> int:
    """About how many events a detection takes at least; exact where no node is shared and every scenario is feasible."""
    least: dict[str, int] = {}
    for node in tree.bottom_up():
        below = sorted(least[child] for child in node.children)
        kept = {Gate.OR: 1, Gate.VOT: node.threshold or 0}.get(node.gate or Gate.AND, len(below))
        least[node.name] = sum(below[:kept]) + node.has_event
    return least[tree.root]
