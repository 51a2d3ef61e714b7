"""The scenarios of a tree without certain nodes and tree edges, as a space that is never enumerated.

Whether some scenario contains given nodes and edges is answered by walking from them to the root: the kept node that comes last in the
order of the tree (parents before children) needs one kept parent; an `or` that is asked for two different children ends the
attempt. For one node that is a path to the root, for two nodes a walk over pairs; in general the number of attempts may grow
exponentially, so each step is paid from a budget. Order among events is not looked at here.
"""

from collections.abc import Iterable
from functools import cached_property
from heapq import heapify, heappop, heappush
from typing import TypeAlias

from rvaft.model import Gate, Node
from rvaft.precedence import Edge, Kept
from rvaft.rules.rule import Budget
from rvaft.tree import RVAFT

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
