"""How far one branch has come in one log: a monitor that looks at its partial matches (semantics, section 4)."""

from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Self

from rvaft.branches import Branch
from rvaft.coverage.shortest import Shortest
from rvaft.engine import Engine
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.earliest import Earliest, Run
from rvaft.engine.following import Following
from rvaft.engine.letters import Reading
from rvaft.engine.order import bits
from rvaft.language import name_text, on_text
from rvaft.monitors import Awaited
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict


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
