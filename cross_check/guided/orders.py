"""Random orders of a scenario's occurrences that keep its precedence (semantics, section 2).

Written from the definition and not with `rvaft.precedence`, which a translation uses: an order that both forgot
would be missed on both sides. Every order that keeps the precedence can come out.
"""

from random import Random
from typing import Final

import networkx as nx

from cross_check.guided.scenarios import Kept
from rvaft.model import Causality, Gate
from rvaft.tree import RVAFT

_BEFORE, _EVENT, _AFTER, _GAP = range(4)
"""The points of a node: before all events of its part, its own event, after all of them, between two children of a sequence."""

Point = tuple[int, str, int]


class Cyclic(Exception):
    """Some event has to come before itself; `edges` are the tree edges (parent, child) of one cycle."""

    def __init__(self, edges: list[tuple[str, str]]) -> None:
        self.edges = edges
        super().__init__(edges)


def random_order(random: Random, tree: RVAFT, kept: Kept) -> list[str]:
    """The occurrences of a scenario, one after the other; raises `Cyclic` where no order keeps the precedence."""
    graph = _precedence(tree, kept)
    waits: dict[Point, int] = dict(graph.in_degree())
    ready: list[Point] = []
    silent = [point for point, count in waits.items() if count == 0]
    order: list[str] = []
    while silent or ready:
        # Only events wait in `ready`: points that are no event are passed at once, so any event that may be next can be.
        if silent:
            point = silent.pop()
        else:
            index = random.randrange(len(ready))
            ready[index], ready[-1] = ready[-1], ready[index]
            point = ready.pop()
            order.append(point[1])
        del waits[point]
        for later in graph.successors(point):
            waits[later] -= 1
            if waits[later] == 0:
                (ready if later[0] == _EVENT else silent).append(later)
    if waits:
        raise Cyclic(_tree_edges(kept, {name for (_, name, _), _ in nx.find_cycle(graph.subgraph(waits))}))
    return order


def _precedence(tree: RVAFT, kept: Kept) -> nx.DiGraph:
    """Points and what comes before what, linear in the scenario; from before a part to after it leads only an event."""
    graph: Final = nx.DiGraph()
    for name, children in kept.items():
        node = tree.nodes[name]
        before, own, after = (_BEFORE, name, 0), (_EVENT, name, 0), (_AFTER, name, 0)
        for child in children:
            graph.add_edge(before, (_BEFORE, child, 0))
            graph.add_edge((_AFTER, child, 0), after)
        if node.has_event:
            graph.add_edge(before, own)
            graph.add_edge(own, after)
            for child in children:
                if tree.causality is Causality.TOP_DOWN:
                    graph.add_edge(own, (_BEFORE, child, 0))
                else:
                    graph.add_edge((_AFTER, child, 0), own)
        if node.gate is Gate.SAND:
            _sequence(graph, name, children)
        elif node.gate is Gate.SAND_RL:
            _sequence(graph, name, children[::-1])
    return graph


def _sequence(graph: nx.DiGraph, name: str, children: tuple[str, ...]) -> None:
    """Each child's part before all later ones, also where a part between them has no event."""
    for number in range(len(children) - 1):
        gap = (_GAP, name, number)
        graph.add_edge((_AFTER, children[number], 0), gap)
        graph.add_edge(gap, (_BEFORE, children[number + 1], 0))
        graph.add_edge(gap, (_GAP, name, number + 1))


def _tree_edges(kept: Kept, names: set[str]) -> list[tuple[str, str]]:
    return [(name, child) for name, children in kept.items() if name in names for child in children if child in names]
