"""What the rules about scenarios ask: the tree with what is known of its scenarios, found when first needed.

Bans of nodes and tree edges are what the search for a feasible scenario works with: a scenario whose precedence is cyclic
shows a cycle, a cycle needs some tree edges, and every feasible scenario lacks one of them.
"""

from collections.abc import Callable, Iterable
from functools import cached_property

import networkx as nx

from rvaft.analysis.scenarios import Edge, Kept, Space, cycle, edges_along, path, precedence
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.tree import RVAFT
from rvaft.support.budget import DEFAULT_LIMIT, Budget

_SPACE, _GRAPH = 4, 15
"""What a space and a precedence cost per node, in steps."""


class Context:
    """A tree and the answers about its scenarios; `limit` is what each rule may spend."""

    def __init__(self, tree: RVAFT, limit: int = DEFAULT_LIMIT) -> None:
        self.tree = tree
        self.limit = limit

    def budget(self) -> Budget:
        """A fresh budget."""
        return Budget(self.limit)

    @cached_property
    def dead(self) -> frozenset[str]:
        """The reachable nodes whose guard has no variables and does not hold: no feasible scenario contains them."""
        guards = ((node.name, node.when) for node in self.tree.top_down() if node.when is not None)
        return frozenset(name for name, when in guards if not guard_variables(when) and not holds(when, {}))

    @cached_property
    def space(self) -> Space:
        """The scenarios without dead nodes; those with a cyclic precedence are among them."""
        return Space(self.tree, self.dead)

    @cached_property
    def order(self) -> nx.DiGraph:
        """The precedence over all nodes of the space; it contains that of every scenario."""
        return precedence(self.tree, self.space.union)

    @cached_property
    def acyclic(self) -> bool:
        """Whether surely no scenario of the space has a cyclic precedence; only a shared node can be in a sequence twice."""
        if not self.tree.shared or not any(
            node.gate is not None and node.gate.ordered for node in self.tree.top_down()
        ):
            return True
        return bool(nx.is_directed_acyclic_graph(self.order))

    @cached_property
    def feasible_exists(self) -> bool:
        """Whether there is a feasible scenario; raises `Undecided` beyond the limit."""
        return self.feasible(self.budget()) is not None

    def feasible(
        self,
        budget: Budget,
        nodes: Iterable[str] = (),
        *,
        without: frozenset[str] = frozenset(),
        apart: tuple[str, str] | None = None,
    ) -> Kept | None:
        """A feasible scenario with some nodes and without others, or None where there is none.

        With `apart`, one that contains both and orders neither before the other. Raises `Undecided` beyond the budget.
        """

        def objection(kept: Kept) -> list[Edge]:
            if self.acyclic and apart is None:
                return []
            budget.spend(_GRAPH * len(kept))
            graph = precedence(self.tree, kept)
            points = [] if self.acyclic else cycle(graph)
            if points:
                return edges_along(graph, points, closed=True)
            if apart is None:
                return []
            one, other = apart
            return edges_along(graph, path(graph, one, other) or path(graph, other, one))

        return self._search(budget, [*nodes, *(apart or ())], self.dead | without, objection)

    def _search(
        self, budget: Budget, nodes: list[str], banned: frozenset[str], objection: Callable[[Kept], list[Edge]]
    ) -> Kept | None:
        """A scenario without objection; an objection names tree edges that are not all in a scenario without it."""
        todo: list[frozenset[Edge]] = [frozenset()]
        seen = set(todo)
        while todo:
            bans = todo.pop()
            if not bans and banned == self.dead:
                space = self.space
            else:
                budget.spend(_SPACE * len(self.tree.order))
                space = Space(self.tree, banned, bans)
            kept = space.scenario(nodes, (), budget)
            if kept is None:
                continue
            objections = objection(kept)
            if not objections:
                return kept
            for edge in reversed(objections):
                more = bans | {edge}
                if more not in seen:
                    seen.add(more)
                    todo.append(more)
        return None

    def cyclic(self, budget: Budget, component: frozenset[object]) -> tuple[Kept, list[str]] | None:
        """A scenario without dead nodes whose precedence has a cycle among these points, and the nodes of the cycle."""
        todo: list[frozenset[Edge]] = [frozenset()]
        seen = set(todo)
        while todo:
            bans = todo.pop()
            budget.spend((_SPACE + _GRAPH) * len(self.tree.order))
            space = Space(self.tree, self.dead, bans)
            graph = precedence(self.tree, space.union).subgraph(component)
            points = cycle(graph)
            if not points:
                continue
            edges = edges_along(graph, points, closed=True)
            kept = space.scenario((), edges, budget)
            if kept is not None:
                return kept, [name for kind, name, _ in points if kind == "event"]
            for edge in reversed(edges):
                more = bans | {edge}
                if more not in seen:
                    seen.add(more)
                    todo.append(more)
        return None
