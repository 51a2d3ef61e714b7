"""How far one branch has come in one log: a monitor that looks at its partial matches (semantics, section 4)."""

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import inf
from typing import Final, NamedTuple, Self

import networkx as nx

from rvaft.analysis.branches import Branch
from rvaft.analysis.scenarios import Kept, Point, cycle, event, precedence
from rvaft.engine import Engine
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.contiguous import Following
from rvaft.engine.event_index import Reading
from rvaft.engine.scattered_linear import Earliest, Run
from rvaft.engine.shared_nodes import bits
from rvaft.errors import TooLarge
from rvaft.model.expressions import name_text, on_text
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Awaited

# The fewest events that a partial match of a branch still lacks, over all feasible scenarios that it is a part of.
#
# A branch leaves only KofN gates to choose, which keep K children or more. Where no node is shared, the cheapest children are the
# answer, gate by gate. The gates above shared nodes (the *core*) depend on each other: their choices are tried one by one,
# and each scenario is looked at as a whole.

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


@dataclass(frozen=True, slots=True)
class Reach:
    """The best that a log did: how many events were lacking, the number of the last event matched (0 for none), what came next."""

    lacking: int
    event: int
    awaited: tuple[Awaited, ...]


def alone(branch: Branch) -> RVAFT:
    """The tree of a branch and nothing else: what events are relevant has to be asked of the whole."""
    tree = branch.tree
    nodes = [replace(tree.nodes[name], children=branch.children(name)) for name in branch.nodes]
    events = dict.fromkeys(node.on.event for node in nodes if node.on is not None)
    return RVAFT(tree.root, nodes, (tree.events[event] for event in events), causality=tree.causality)


class Follower(Engine):
    """The monitor of one branch, `tree` being that branch `alone`, that remembers the best of the partial matches it met.

    It is given only the events that may matter to it, with what the whole tree says of them, since there may be very many branches. Under `strict` and `projected` partial matches end, so they are looked at whenever they grow; under `scattered` none is lost
    but to a better one, and the end of the log is early enough. Raises `TooLarge`.
    """

    def __init__(self, tree: RVAFT, semantics: Semantics | str, *, limit: int) -> None:
        super().__init__(tree, semantics, limit=limit)
        self.shortest = shortest = Shortest(tree)
        self._size = 0
        start = shortest.lacking({}, (), exact=True)
        assert start is not None, "the branch has a feasible scenario"
        self._lacking, self._last = start.lacking, 0
        self._best: list[Witness | None] = [None]

    def fork(self) -> Self:
        """An independent follower that has read the same events."""
        twin = super().fork()
        vars(twin)["_best"] = list(self._best)
        return twin

    def follow(self, number: int, event: Json, *, relevant: bool, fits: bool) -> Verdict:
        """Read the event of that number; those since the last one read change nothing.

        `relevant` is whether it is that to the whole tree, `fits` is False only where it is no event of this branch.
        """
        self.skip(number - 1 - self._read)
        verdict = self.take(Reading(relevant, self.read(event).hits if fits else ()))
        if verdict is Verdict.UNKNOWN and self.semantics is not Semantics.SCATTERED:
            self._look()
        return verdict

    def reach(self) -> Reach:
        """How far the branch came, asked once at the end of the log; after detection nothing is lacking."""
        if self.verdict is Verdict.TRUE:
            return Reach(0, self._position, ())
        strategy = self._strategy
        if isinstance(strategy, Earliest):
            return self._reach_of_run(strategy)
        if self.semantics is Semantics.SCATTERED:
            self._look()
        names = {name for witness in self._best for name in _open(strategy, witness)}
        return Reach(self._lacking, self._last, self._awaited(names))

    def _reach_of_run(self, strategy: Earliest) -> Reach:
        """What has fired in the linear way; the best match may do without some of it, and is then played again alone."""
        names = strategy.plan.names
        fired = {names[node]: position for node, (position, _) in strategy.run.fired.items()}
        lack = self.shortest.lacking(fired, (), exact=False)
        assert lack is not None, "the branch has a feasible scenario"
        alone, last = Run(strategy.plan, strategy.starts), 0
        for node, (position, values) in strategy.run.fired.items():
            if names[node] in lack.nodes:
                alone.fire([(node, values)], position)
                last = position
        return Reach(lack.lacking, last, self._awaited({names[node] for node in alone.awaited()}))

    def _look(self) -> None:
        """Compare the partial matches with the best so far."""
        strategy = self._strategy
        assert isinstance(strategy, Following), "the linear way has no partial matches"
        partial = strategy.partial
        if self.semantics is not Semantics.SCATTERED:
            size = partial[0].taken.bit_count()  # the same for all: each has used all events that count
            if size == self._size:
                return
            self._size = size
        for configuration in _alike(partial):
            lacking, last, witness = self._lack(configuration), _last(configuration), configuration.witness
            if (lacking, last) < (self._lacking, self._last):
                self._lacking, self._last, self._best = lacking, last, []
            if (lacking, last) == (self._lacking, self._last) and witness not in self._best:
                self._best.append(witness)

    def _lack(self, partial: Configuration) -> int:
        if not self.shortest.chooses:
            return len(self.shortest.occurrences) - partial.taken.bit_count()
        names = self._strategy.plan.names
        taken = {names[step.node]: step.position for step in partial.history()}
        lack = self.shortest.lacking(taken, [names[node] for node in bits(partial.dead)], exact=True)
        assert lack is not None, "a partial match is part of a scenario"
        return lack.lacking

    def _awaited(self, names: set[str]) -> tuple[Awaited, ...]:
        nodes = (self.tree.nodes[name] for name in self.tree.order if name in names)
        return tuple(Awaited(n.name, name_text(n.name) if n.on is None else on_text(n.on)) for n in nodes)


def _alike(partial: list[Configuration]) -> Iterable[Configuration]:
    """Of the partial matches that lack the same, one whose last event came first."""
    found: dict[Hashable, Configuration] = {}
    for configuration in partial:
        key = configuration.taken, configuration.dead, configuration.inversions
        known = found.setdefault(key, configuration)
        if _last(configuration) < _last(known):
            found[key] = configuration
    return found.values()


def _last(configuration: Configuration) -> int:
    """The position of the last event of a partial match."""
    return 0 if configuration.witness is None else configuration.witness.position


def _open(strategy: Following, witness: Witness | None) -> Iterator[str]:
    """The nodes whose event could come next in a partial match."""
    matching, names = strategy.matching, strategy.plan.names
    steps: list[Witness] = []
    while witness is not None:
        steps.append(witness)
        witness = witness.before
    configuration = matching.replayed((step.node, step.values, step.position) for step in reversed(steps))
    assert configuration is not None, "a partial match can be made again"
    return (names[n] for n, own in enumerate(strategy.plan.own) if own and matching.admits(configuration, n))
