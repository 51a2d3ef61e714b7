"""The strategy for `consecutive`, and for small trees under `strict` and `projected`.

An event that counts extends a partial match or ends it. The *frontier* is the tuple of the stages
of all partial matches; equal frontiers are one object. A frontier remembers which partial matches
the events of a class extend. If neither values nor guards decide this, it remembers the next
frontier as well, and an event costs one look-up and the new steps.
"""

from collections import deque
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Final, NamedTuple, Self

from rvaft.engine.compiled_tree import NOTHING, Admission, CompiledTree, EventClass, Reading, TreeLetters
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.partial_matches import Following, Matching
from rvaft.model.guards import Predicate
from rvaft.model.values import Json, equal, exact
from rvaft.model.verdict import Semantics, Verdict

SMALL: Final = 500
"""The maximum number of nodes of a small tree."""
MEMORY: Final = 500_000
"""The maximum size of the remembered stages and frontiers."""
_MANY: Final = 4
"""The maximum number of guards whose outcomes are enumerated."""
_PLAIN: Final = frozenset({str, int})
_UNMATCHED: Final[tuple[Mapping[str, Json], EventClass]] = ({}, EventClass())
_new: Final = tuple.__new__  # twice as fast as the constructors of the classes


class Follower(NamedTuple):
    """The remembered values of a partial match, and its last step."""

    binding: Mapping[str, Json]
    last: Witness | None


_NO_VALUES: Final[Mapping[str, Json]] = {}


class NodeMove(NamedTuple):
    """The event of a node after a stage: it must repeat the values of the `compared` variables.

    The outcomes of the guards decide the next stage.
    """

    node: int
    compared: tuple[str, ...]
    guards: Mapping[int, Predicate]
    targets: dict[tuple[bool, ...], "Progress | None"]


@dataclass(slots=True, eq=False)
class Progress:
    """What partial matches with the same progress have in common; `sample` has dummy values."""

    sample: Configuration
    is_match: bool
    names: tuple[str, ...]
    """The remembered variables."""
    moves: dict[int, NodeMove] = field(default_factory=dict)
    steps: dict[EventClass, Sequence[tuple[Admission, NodeMove]]] = field(default_factory=dict)


class FrontierPlan(NamedTuple):
    """The effect of the events of a class on a frontier.

    A step is the place of a partial match, the number of a letter, and a move. Unless `after` is
    known, the values of the event decide which steps are possible. A plan is `fresh` if all its steps
    begin a match.
    """

    letters: tuple[Admission, ...]
    steps: tuple[tuple[int, int, NodeMove], ...]
    after: "Frontier | None"
    fresh: bool


@dataclass(slots=True, eq=False)
class Frontier:
    """The stages of the partial matches, in order, with the places of those that are matches."""

    stages: tuple[Progress, ...]
    matches: tuple[int, ...]
    plans: dict[EventClass, FrontierPlan] = field(default_factory=dict)


class FrontierTable:
    """The stages and frontiers of a tree, made when first needed; copies of a strategy share them."""

    def __init__(self, matching: Matching, *, begins: bool) -> None:
        self._matching = matching
        self._begins = begins
        self._size = 0
        self.start: tuple[Progress, ...] = ()
        """The stage before any event, if a match may begin anywhere."""
        self._known: dict[Hashable, Progress] = {}
        self._frontiers: dict[tuple[Progress, ...], Frontier] = {}
        self._begin()

    def _begin(self) -> None:
        if self._begins:
            self.start = (self.of(self._matching.start()),)

    def of(self, configuration: Configuration) -> Progress:
        """Return the stage of a partial match."""
        place = configuration.taken, configuration.dead, configuration.closed, configuration.inversions
        found = self._known.get(place)
        if found is None:
            self._grow(1 + len(configuration.flags))
            sample = configuration.copy()
            sample.binding, sample.witness = dict.fromkeys(configuration.binding), None
            is_match, _ = self._matching.standing(sample)
            found = self._known[place] = Progress(sample, is_match, tuple(sample.binding))
        return found

    def frontier(self, stages: tuple[Progress, ...]) -> Frontier:
        """Return the frontier of partial matches with these stages."""
        found = self._frontiers.get(stages)
        if found is None:
            self._grow(len(stages))
            matches = tuple([place for place, stage in enumerate(stages) if stage.is_match])
            found = self._frontiers[stages] = Frontier(stages, matches)
        return found

    def plan(self, frontier: Frontier, event_class: EventClass) -> FrontierPlan:
        """Return the effect of the events of a class on a frontier."""
        steps = [
            (place, letter, move)
            for place, stage in enumerate(frontier.stages)
            for letter, move in self._possible(stage, event_class)
        ]
        after = None
        if not any(move.compared or move.guards or letter.reader.ways for _, letter, move in steps):
            first: dict[Progress | None, tuple[int, Admission, NodeMove]] = {}
            for step in steps:
                first.setdefault(step[2].targets[()], step)
            # two partial matches of one stage may remember different values
            if len(first) == len(steps) or not any(stage is not None and stage.names for stage in first):
                steps = list(first.values())
                after = self.frontier((*[stage for stage in first if stage is not None], *self.start))
        self._grow(1 + len(steps))
        letters = {letter.letter: letter for _, letter, _ in steps}
        numbers = {number: place for place, number in enumerate(letters)}
        numbered = tuple([(place, numbers[letter.letter], move) for place, letter, move in steps])
        fresh = bool(self.start) and all(place == len(frontier.stages) - 1 for place, _, _ in steps)
        found = frontier.plans[event_class] = FrontierPlan(tuple(letters.values()), numbered, after, fresh)
        return found

    def _possible(self, stage: Progress, event_class: EventClass) -> Sequence[tuple[Admission, NodeMove]]:
        """Return the moves by events of a class that are possible for some values."""
        known = stage.steps.get(event_class)
        if known is not None:
            return known
        found = list[tuple[Admission, NodeMove]]()
        for letter in event_class.serving:
            for node in letter.nodes:
                if not stage.sample.taken >> node & 1:
                    move = stage.moves.get(node) or self._move(stage, node)
                    ways = product((True, False), repeat=len(move.guards))
                    if len(move.guards) > _MANY or any(self.target(stage, move, way) for way in ways):
                        found.append((letter, move))
        stage.steps[event_class] = found
        return found

    def _move(self, stage: Progress, node: int) -> NodeMove:
        matching, sample = self._matching, stage.sample
        closing, narrowed = matching.decided(sample, node)
        guards = {guard: holds for guard in closing if (holds := matching.test(guard)) is not None}
        guards.update((guard, matching.early_test(guard)) for guard in narrowed)
        compared = tuple([name for name in matching.compiled.exported[node] if name in sample.binding])
        found = stage.moves[node] = NodeMove(node, compared, guards, {})
        return found

    def target(self, stage: Progress, move: NodeMove, outcomes: tuple[bool, ...]) -> Progress | None:
        """Return the stage after a move, or None."""
        if outcomes not in move.targets:
            self._grow(1)
            values = dict.fromkeys(self._matching.compiled.exported[move.node])
            judged = dict(zip(move.guards, outcomes, strict=True))
            after = self._matching.extended(stage.sample, move.node, values, 0, judged=judged)
            move.targets[outcomes] = None if after is None else self.of(after)
        return move.targets[outcomes]

    def _grow(self, size: int) -> None:
        self._size += size
        if self._size > MEMORY:  # the next moves lead to new stages only
            for stage in self._known.values():
                stage.moves.clear()
                stage.steps.clear()
            for frontier in self._frontiers.values():
                frontier.plans.clear()
            self._known.clear()
            self._frontiers.clear()
            self._size = 0
            self._begin()


class ContiguousMatches(Following):
    """All partial matches use the same events; under `consecutive`, the same since their first."""

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, semantics: Semantics, *, limit: int) -> None:
        super().__init__(compiled, letters, limit=limit, early=semantics is Semantics.CONSECUTIVE)
        self._projected = semantics is not Semantics.STRICT
        begins = semantics is Semantics.CONSECUTIVE
        self._stages = FrontierTable(self.matching, begins=begins)
        self._start = [Follower(_NO_VALUES, None)] if begins else []
        self._members: list[Follower] = []
        self._deferred = deque[tuple[FrontierPlan, Mapping[str, Json], int]](maxlen=max(1, sum(compiled.own)))
        """The last certain steps, which `_members` does not have yet; a match has at most so many."""
        self._begin()

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Replace the partial matches."""
        followed = list(configurations)
        self._deferred.clear()
        self._members = [Follower(one.binding, one.witness) for one in followed]
        self._frontier = self._stages.frontier(tuple([self._stages.of(one) for one in followed]))

    @property
    def partial(self) -> list[Configuration]:
        """The followed partial matches."""
        found = []
        for stage, (binding, last) in zip(self._frontier.stages, self._settled(), strict=True):
            sample = stage.sample
            progress = sample.inversions, sample.flags, sample.tallies
            found.append(Configuration(sample.dead, sample.closed, sample.taken, dict(binding), *progress, last))
        return found

    def _settled(self) -> list[Follower]:
        """Return the partial matches with all steps."""
        for plan, event, position in self._deferred:
            members, ways = self._members, [self.letters.values(letter, event) for letter in plan.letters]
            made = list[Follower]()
            for place, at, move in plan.steps:
                (binding, last), values = members[place if place < len(members) else -1], ways[at]
                names = () if (target := move.targets[()]) is None else target.names
                kept = {name: binding[name] if name in binding else values.get(name) for name in names}
                made.append(Follower(kept, _new(Witness, (last, move.node, position, values))))
            self._members = made + self._start
        self._deferred.clear()
        return self._members

    def fork(self) -> Self:
        """Return an independent copy."""
        self._settled()
        twin = object.__new__(type(self))  # faster than `copy`, since each detection forks
        vars(twin).update(vars(self), _deferred=self._deferred.copy())
        return twin

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the event with its class if it may extend a partial match."""
        if self._projected and not event_class.relevant:
            return NOTHING
        return _new(Reading, (event_class.relevant, (event, event_class) if event_class.serving else ()))

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        if self._projected and not reading.relevant:
            return Verdict.UNKNOWN if self._frontier.stages else Verdict.FALSE
        event, event_class = reading.hits or _UNMATCHED
        plan = self._frontier.plans.get(event_class) or self._stages.plan(self._frontier, event_class)
        _, steps, after, fresh = plan
        members: list[Follower] | None = None
        if after is None:
            after, members = self._extended(plan, reading, position)
        else:
            self.noted = bool(steps)
            self._bound(len(steps))
        if not after.stages:
            self.lost = self.partial
            self.follow([])
            return Verdict.FALSE
        if members is not None:
            self._members = members
        else:
            if fresh or len(self._deferred) == self._deferred.maxlen:
                self._members = self._start  # all others have ended
            if fresh:
                self._deferred.clear()
            self._deferred.append((plan, event, position))
        self._frontier = after
        if not after.matches:
            return Verdict.UNKNOWN
        followed = self.partial
        self.matches = [followed[place] for place in after.matches]
        self.follow([])
        return Verdict.TRUE

    def _extended(self, plan: FrontierPlan, reading: Reading, position: int) -> tuple[Frontier, list[Follower]]:
        """Return the partial matches after an event whose values decide."""
        stages, members, made = self._stages, self._settled(), dict[tuple[Any, ...], Follower]()
        event, event_class = reading.hits
        if event_class.timed:
            time = self.letters.time(event)
            ways = [self.letters.ways(letter, event, time) for letter in plan.letters]
        else:
            ways = [[letter.reader.values(event)] for letter in plan.letters]
        for place, at, move in plan.steps:
            node, compared, guards, targets = move
            binding, last = members[place]
            for values in ways[at]:
                for name in compared:
                    one, other = binding[name], values[name]
                    if not (one == other if type(one) is type(other) and type(one) in _PLAIN else equal(one, other)):
                        break
                else:
                    bound = {**values, **binding} if binding else values
                    if guards:
                        outcomes = tuple([holds(bound) for holds in guards.values()])
                        target = stages.target(self._frontier.stages[place], move, outcomes)
                    else:
                        target = targets[()]
                    if target is not None:
                        kept = {name: bound[name] for name in target.names}
                        own = (target, *[value if type(value) in _PLAIN else exact(value) for value in kept.values()])
                        if own not in made:
                            made[own] = _new(Follower, (kept, _new(Witness, (last, node, position, values))))
            self._bound(len(made))
        self.noted = bool(made)
        return stages.frontier((*[own[0] for own in made], *stages.start)), [*made.values(), *self._start]
