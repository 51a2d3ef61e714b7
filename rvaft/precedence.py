"""The strict precedence of a scenario as a graph of linear size (semantics, section 2).

"All events of one part before all events of another" is quadratic when written pair by pair. Here each node has, beside
its event, a point `start` before every event of its part (itself and its descendants) and a point `end` after every one,
and each child of an ordered gate a point `done` after its part and those of the children before it. No edge leads from the start of
a node to its end: a part without events orders nothing. So one event precedes another exactly when a path leads from
the first to the second, and the precedence is cyclic exactly when the graph is.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Literal, TypeAlias

import networkx as nx

from rvaft.model import Causality, Gate, Node
from rvaft.tree import RVAFT

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
