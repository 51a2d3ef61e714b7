"""How far one branch has come in one log: a monitor that looks at its partial matches (semantics, section 4)."""

from collections.abc import Collection, Hashable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from math import inf
from typing import Final, NamedTuple, Self

import networkx as nx

from rvaft.analysis.normal_form import Op, body, is_impossible
from rvaft.analysis.scenarios import Fewest, Kept, Point, event, fewest_events, precedence
from rvaft.engine import Engine
from rvaft.engine.compiled_tree import CompiledTree, Reading
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.contiguous import Following
from rvaft.engine.expectation import admitted, awaited
from rvaft.engine.scattered_linear import Earliest, EarliestRun
from rvaft.errors import TooLarge
from rvaft.model.tree import RVAFT, find_cycle, reachable
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Awaited
from rvaft.support.bits import bits

DEFAULT_LIMIT: Final = 20_000
"""How many ways to keep children of core gates are tried."""


class Lack(NamedTuple):
    """How many occurrences are lacking, and the nodes of the scenario that lacks so few."""

    lacking: int
    nodes: frozenset[str]


class LackingEvents:
    """The fewest events that a partial match of a branch still lacks, over all feasible scenarios that it is a part of.

    The tree is restricted to the branch, which leaves only KofN gates to choose: they keep K children or more. Where no node is shared,
    the cheapest children are the answer, gate by gate. The gates above shared nodes (the *core*) depend on each other: their choices
    are tried one by one, and each scenario is looked at as a whole.
    """

    def __init__(self, tree: RVAFT, *, limit: int = DEFAULT_LIMIT) -> None:
        self.tree = tree
        self.limit = limit
        self.occurrences = frozenset(tree.occurrences)
        self.chooses = any(body(node).op is Op.AT_LEAST for node in tree.top_down())
        """Whether there is a KofN gate; else the branch is one scenario."""
        compiled = CompiledTree(tree)
        self.core = frozenset(compiled.names[node] for node in compiled.core)
        self._never = frozenset(node.name for node in tree.top_down() if is_impossible(node))

    def fewest(self, taken: Mapping[str, int], dead: Collection[str] = (), *, exact: bool = True) -> Lack:
        """What is lacking when these occurrences are taken and the guards of the dead nodes do not hold.

        `taken` maps each occurrence to the position of its event. If `exact`, the scenario contains all that is taken; otherwise it
        may do without some of it. There has to be such a scenario. Raises `TooLarge`.
        """
        if not self.chooses:
            return Lack(len(self.occurrences) - len(taken), frozenset(self.tree.order))
        forced: set[str] = set()
        below = [node for node in self.tree.bottom_up() if node.name not in self.core]
        for node in below:
            if exact and (node.name in taken or not forced.isdisjoint(node.children)):
                forced.add(node.name)
        dead = self._never | frozenset(dead)
        parts = fewest_events(below, without=dead, taken=taken, forced=forced)
        best: Lack | None = None
        for kept in self._resolutions(parts, forced, dead):
            lack = Lack(len(self.occurrences & kept.keys() - taken.keys()), frozenset(kept))
            if best is None or lack.lacking < best.lacking:
                if exact and not taken.keys() <= kept.keys():
                    continue
                if not self.core or _keeps_order(self.tree, kept, taken):
                    best = lack
        assert best is not None, "a partial match is part of a feasible scenario"
        return best

    def _resolutions(
        self, parts: Mapping[str, Fewest], forced: Collection[str], dead: Collection[str]
    ) -> Iterator[Kept]:
        """Scenarios, each node with the children it keeps: every choice in the core, the cheapest below it."""
        agenda: list[tuple[dict[str, tuple[str, ...]], tuple[str, ...]]] = [({}, (self.tree.root,))]
        tried = 0
        while agenda:
            kept, reached = agenda.pop()
            waiting = next((name for name in reached if name in self.core and name not in kept), None)
            if waiting is not None:
                if waiting not in dead:
                    ways = self._ways(waiting, parts, forced)
                    agenda.extend(({**kept, waiting: children}, (*reached, *children)) for children in ways)
                continue
            tried += 1
            if tried > self.limit:
                gates = [name for name in self.tree.order if name in self.core and self._has_need(name)]
                what = f"ways to keep children of {', '.join(gates[:10])}, which share nodes"
                error = TooLarge(what, limit=self.limit)
                error.add_note("choose a branch without them with --branch N, or prune the tree")
                raise error
            if all(name in self.core or name in parts for name in reached):
                roots = [name for name in reached if name not in self.core]
                below = (name for root in roots for name in reachable(root, lambda name: parts[name].kept))
                yield kept | {name: parts[name].kept for name in below}

    def _ways(self, name: str, parts: Mapping[str, Fewest], forced: Collection[str]) -> Iterator[tuple[str, ...]]:
        """The children that a core gate may keep."""
        node = self.tree.nodes[name]
        if not self._has_need(name):
            yield node.children
            return
        able = [child for child in node.children if child in self.core or child in parts]
        must = {child for child in node.children if child in forced}
        for size in range(body(node).need, len(able) + 1):
            for chosen in combinations(able, size):
                if must <= set(chosen):
                    yield chosen

    def _has_need(self, name: str) -> bool:
        return body(self.tree.nodes[name]).op is Op.AT_LEAST


def _keeps_order(tree: RVAFT, kept: Kept, taken: Mapping[str, int]) -> bool:
    """Whether a scenario is feasible, and what is taken came in an order that it allows and before all that is lacking."""
    graph = precedence(tree, kept)
    if find_cycle(graph):
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


class BranchFollower(Engine):
    """The monitor of one branch, `tree` being that branch alone, that remembers the best of the partial matches it met.

    It is given only the events that may matter to it, with what the whole tree says of them, since there may be very many branches.
    Under `strict` and `projected` partial matches end, so they are looked at whenever they grow; under `scattered` none is lost
    but to a better one, and the end of the log is early enough. Raises `TooLarge`.
    """

    def __init__(self, tree: RVAFT, semantics: Semantics | str, *, limit: int) -> None:
        super().__init__(tree, semantics, limit=limit)
        self.shortest = LackingEvents(tree)
        self._size = 0
        self._lacking, self._last = self.shortest.fewest({}).lacking, 0
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
        names: set[str] = set()
        for witness in self._best:
            history = reversed(list(Configuration(0, 0, witness=witness).history()))
            match = strategy.matching.replayed((step.node, step.values, step.position) for step in history)
            assert match is not None, "a partial match can be made again"
            names.update(admitted(strategy.matching, match))
        return Reach(self._lacking, self._last, awaited(self.tree, names))

    def _reach_of_run(self, strategy: Earliest) -> Reach:
        """What has fired in the linear way; the best match may do without some of it, and is then played again alone."""
        names = strategy.compiled.names
        fired = {names[node]: position for node, (position, _) in strategy.run.fired.items()}
        lack = self.shortest.fewest(fired, exact=False)
        best, last = EarliestRun(strategy.compiled, strategy.starts), 0
        for node, (position, values) in strategy.run.fired.items():
            if names[node] in lack.nodes:
                best.fire([(node, values)], position)
                last = position
        return Reach(lack.lacking, last, awaited(self.tree, {names[node] for node in best.awaited()}))

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
        alike: dict[
            Hashable, tuple[int, Configuration]
        ] = {}  # of those that lack the same, one whose last event came first
        for match in partial:
            last = 0 if match.witness is None else match.witness.position
            place = match.taken, match.dead, match.inversions
            if place not in alike or last < alike[place][0]:
                alike[place] = last, match
        for last, match in alike.values():
            lacking = self._lack(match)
            if (lacking, last) < (self._lacking, self._last):
                self._lacking, self._last, self._best = lacking, last, []
            if (lacking, last) == (self._lacking, self._last) and match.witness not in self._best:
                self._best.append(match.witness)

    def _lack(self, partial: Configuration) -> int:
        if not self.shortest.chooses:
            return len(self.shortest.occurrences) - partial.taken.bit_count()
        names = self._strategy.compiled.names
        taken = {names[step.node]: step.position for step in partial.history()}
        return self.shortest.fewest(taken, [names[node] for node in bits(partial.dead)]).lacking
