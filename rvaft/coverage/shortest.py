"""The fewest events that a partial match of a branch still lacks, over all feasible scenarios that it is a part of.

A branch leaves only KofN gates to choose, which keep K children or more. Where no node is shared, the cheapest children are the
answer, gate by gate. The gates above shared nodes (the *core*) depend on each other: their choices are tried one by one,
and each scenario is looked at as a whole.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property
from itertools import combinations
from math import inf
from typing import Final, NamedTuple

import networkx as nx

from rvaft.errors import TooLarge
from rvaft.guards import holds
from rvaft.guards import variables as guard_variables
from rvaft.model import Gate
from rvaft.precedence import Kept, Point, cycle, event, precedence
from rvaft.tree import RVAFT, reachable

DEFAULT_LIMIT: Final = 20_000
"""How many ways to keep children of core gates are tried."""


class Lack(NamedTuple):
    """How many occurrences are lacking, and the nodes of the scenario that lacks so few."""

    lacking: int
    nodes: frozenset[str]


class Shortest:
    """The scenarios of one branch; the tree is restricted to it, so that every `or` has one child."""

    def __init__(self, tree: RVAFT, *, limit: int = DEFAULT_LIMIT) -> None:
        self.tree = tree
        self.limit = limit
        self.occurrences = frozenset(tree.occurrences)
        self.core = self._core()
        self.chooses = any(node.gate is Gate.VOT for node in tree.top_down())
        """Whether there is a KofN gate; else the branch is one scenario."""

    def _core(self) -> frozenset[str]:
        found, agenda = set[str](), sorted(self.tree.shared)
        while agenda:
            name = agenda.pop()
            if name not in found:
                found.add(name)
                agenda += self.tree.parents(name)
        return frozenset(found)

    @cached_property
    def never(self) -> frozenset[str]:
        """The nodes with a guard without variables that does not hold."""
        guards = ((node.name, node.when) for node in self.tree.top_down())
        return frozenset(n for n, g in guards if g is not None and not guard_variables(g) and not holds(g, {}))

    def lacking(self, taken: Mapping[str, int], dead: Collection[str], *, exact: bool) -> Lack | None:
        """What is lacking when these occurrences are taken and the guards of the dead nodes do not hold; None for no scenario.

        `taken` maps each occurrence to the position of its event. If `exact`, the scenario contains all that is taken; otherwise it
        may do without some of it. Raises `TooLarge`.
        """
        if not self.chooses:
            return Lack(len(self.occurrences) - len(taken), frozenset(self.tree.order))
        parts = _Parts(self.tree, taken, frozenset(dead) | self.never, self.core, exact=exact)
        best: Lack | None = None
        for kept in self._resolutions(parts):
            nodes = frozenset(kept)
            lacking = len(self.occurrences & nodes - taken.keys())
            if (best is None or lacking < best.lacking) and self._fits(kept, taken, exact=exact):
                best = Lack(lacking, nodes)
        return best

    def _fits(self, kept: Kept, taken: Mapping[str, int], *, exact: bool) -> bool:
        """Whether a scenario is feasible and what is taken is a partial match of it."""
        if exact and not taken.keys() <= kept.keys():
            return False
        return not self.core or _keeps_order(self.tree, kept, taken)

    def _resolutions(self, parts: "_Parts") -> Iterator[Kept]:
        """Scenarios, each node with the children it keeps: every choice in the core, the cheapest below it."""
        agenda: list[tuple[dict[str, tuple[str, ...]], tuple[str, ...]]] = [({}, (self.tree.root,))]
        tried = 0
        while agenda:
            kept, reached = agenda.pop()
            waiting = next((name for name in reached if name in self.core and name not in kept), None)
            if waiting is not None:
                if waiting not in parts.dead:
                    choices = self._choices(waiting, parts)
                    agenda += [({**kept, waiting: children}, (*reached, *children)) for children in choices]
                continue
            tried += 1
            if tried > self.limit:
                gates = [name for name in self.tree.order if name in self.core and self._votes(name)]
                what = f"ways to keep children of {', '.join(gates[:10])}, which share nodes"
                error = TooLarge(what, limit=self.limit)
                error.add_note("choose a branch without them with --branch N, or prune the tree")
                raise error
            if all(name in self.core or name in parts.cost for name in reached):
                below = parts.kept(name for name in reached if name not in self.core)
                yield {**kept, **below}

    def _choices(self, name: str, parts: "_Parts") -> Iterator[tuple[str, ...]]:
        """The children that a core gate may keep."""
        node = self.tree.nodes[name]
        if not self._votes(name):
            yield node.children
            return
        able = [child for child in node.children if child in self.core or child in parts.cost]
        forced = {child for child in node.children if child in parts.forced}
        for size in range(node.threshold or 0, len(able) + 1):
            for chosen in combinations(able, size):
                if forced <= set(chosen):
                    yield chosen

    def _votes(self, name: str) -> bool:
        return self.tree.nodes[name].gate is Gate.VOT


class _Parts:
    """The nodes outside the core: what each lacks at the least (absent where it is in no scenario), with which children."""

    def __init__(
        self, tree: RVAFT, taken: Collection[str], dead: frozenset[str], core: frozenset[str], *, exact: bool
    ) -> None:
        self.tree = tree
        self.dead = dead
        self.cost: dict[str, int] = {}
        self.forced: set[str] = set()
        """Nodes that a scenario with their parent has to keep."""
        self._children: dict[str, tuple[str, ...]] = {}
        for node in tree.bottom_up():
            name = node.name
            if name in core:
                continue
            if exact and (name in taken or any(child in self.forced for child in node.children)):
                self.forced.add(name)
            kept = self._cheapest(name)
            if kept is not None and name not in dead:
                own = node.has_event and name not in taken
                self._children[name] = kept
                self.cost[name] = own + sum(self.cost[child] for child in kept)

    def _cheapest(self, name: str) -> tuple[str, ...] | None:
        node = self.tree.nodes[name]
        able = [child for child in node.children if child in self.cost]
        if node.gate is not Gate.VOT:
            return node.children if len(able) == len(node.children) else None
        forced = [child for child in node.children if child in self.forced]
        if any(child not in self.cost for child in forced) or len(able) < (node.threshold or 0):
            return None
        rest = sorted((child for child in able if child not in self.forced), key=self.cost.__getitem__)
        chosen = {*forced, *rest[: max((node.threshold or 0) - len(forced), 0)]}
        return tuple(child for child in node.children if child in chosen)

    def kept(self, roots: Iterable[str]) -> Mapping[str, tuple[str, ...]]:
        """The nodes from these down, each with the children it keeps."""
        names = dict.fromkeys(name for root in roots for name in reachable(root, self._children.__getitem__))
        return {name: self._children[name] for name in names}


def _keeps_order(tree: RVAFT, kept: Kept, taken: Mapping[str, int]) -> bool:
    """Whether a scenario is feasible, and what is taken came in an order that it allows and before all that is lacking."""
    graph = precedence(tree, kept)
    if cycle(graph):
        return False
    position = {event(name): taken.get(name, inf) for name in kept if tree.nodes[name].has_event}
    latest: dict[Point, float] = {}
    for point in nx.topological_sort(graph):
        before = max((latest[earlier] for earlier in graph.predecessors(point)), default=0)
        own = position.get(point, before)
        if own <= before and point in position and own != inf:
            return False
        latest[point] = max(before, own)
    return True
