"""The strategies for `consecutive`, `strict` and `projected`; that of large trees has no frontier.

An event that counts extends a partial match or ends it. The *frontier* is the tuple of the stages
of all partial matches; equal frontiers are one object. A frontier remembers which partial matches
the events of a class extend. If no remembered value decides this, it remembers the next frontier as
well, and an event costs one look-up and the new steps.
"""

from collections import deque
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, Self

from rvaft.engine.all_matches import Following
from rvaft.engine.compiled_tree import NOTHING, Admission, CompiledTree, EventClass, Reading, TreeLetters
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.partial_matches import Matching
from rvaft.engine.stages import Stage, StageMove, Stages, agree
from rvaft.model.values import OWN_TYPES, Json, exact
from rvaft.model.verdict import Semantics, Verdict

SMALL: Final = 500
"""The maximum number of nodes of a small tree. With 1,000 leaves, the stages take 2 to 3 times as long as
`LargeContiguousMatches` for the first events, and up to 6 times for later ones."""
_UNMATCHED: Final[tuple[Mapping[str, Json], EventClass]] = ({}, EventClass())
_new: Final = tuple.__new__  # twice as fast as the constructors of the classes


class Follower(NamedTuple):
    """The remembered values of a partial match, and its last step."""

    binding: Mapping[str, Json]
    last: Witness | None


_NO_VALUES: Final[Mapping[str, Json]] = {}


class FrontierStep(NamedTuple):
    """A possible move by a letter, with the place of the partial match.

    `target` is the next stage if no guard decides it.
    """

    place: int
    letter: Admission
    move: StageMove
    target: Stage | None


class FrontierPlan(NamedTuple):
    """The effect of the events of a class on a frontier.

    Unless `after` is known, the values of the event decide which steps are possible. A plan is
    `fresh` if all its steps begin a match.
    """

    steps: tuple[FrontierStep, ...]
    after: "Frontier | None"
    fresh: bool


@dataclass(slots=True, eq=False)
class Frontier:
    """The stages of the partial matches, in order, with the places of those that are matches."""

    stages: tuple[Stage, ...]
    matches: tuple[int, ...]
    plans: dict[EventClass, FrontierPlan] = field(default_factory=dict)


class FrontierTable(Stages):
    """The stages and frontiers of a tree, made when first needed; copies of a strategy share them."""

    def __init__(self, matching: Matching, *, begins: bool) -> None:
        super().__init__(matching)
        self._begins = begins
        self._frontiers: dict[tuple[Stage, ...], Frontier] = {}
        self.start = self._start()
        """The stage before any event, if a match may begin anywhere."""

    def _start(self) -> tuple[Stage, ...]:
        return (self.of(self.matching.start()),) if self._begins else ()

    def clear(self) -> None:
        """Forget the stages and frontiers; partial matches of these go on to new ones."""
        super().clear()
        for frontier in self._frontiers.values():
            frontier.plans.clear()
        self._frontiers.clear()
        self.start = self._start()

    def frontier(self, stages: tuple[Stage, ...]) -> Frontier:
        """Return the frontier of partial matches with these stages."""
        found = self._frontiers.get(stages)
        if found is None:
            self.size += len(stages)
            matches = tuple([place for place, stage in enumerate(stages) if stage.is_match])
            found = self._frontiers[stages] = Frontier(stages, matches)
        return found

    def plan(self, frontier: Frontier, event_class: EventClass) -> FrontierPlan:
        """Return the effect of the events of a class on a frontier."""
        if self.is_full:
            self.clear()
        steps = []
        for place, stage in enumerate(frontier.stages):
            for number, move, _ in self.moves(stage, event_class):
                letter = event_class.serving[number]
                open_ = move.joint or move.registers or letter.reader.ways
                certain = None if open_ else self.outcome(move, 0, ())
                steps.append(FrontierStep(place, letter, move, certain and certain[0]))
        after = None
        if not any(step.target is None or step.move.compared for step in steps):
            first: dict[Stage | None, FrontierStep] = {}
            for step in steps:
                first.setdefault(step.target, step)
            # two partial matches of one stage may remember different values
            if len(first) == len(steps) or not any(stage is not None and stage.names for stage in first):
                steps = list(first.values())
                after = self.frontier((*[stage for stage in first if stage is not None], *self.start))
        self.size += 1 + len(steps)
        fresh = bool(self.start) and all(step.place == len(frontier.stages) - 1 for step in steps)
        found = frontier.plans[event_class] = FrontierPlan(tuple(steps), after, fresh)
        return found


class ContiguousMatches(Following):
    """All partial matches use the same events; under `consecutive`, the same since their first."""

    def __init__(
        self, compiled: CompiledTree, letters: TreeLetters, semantics: Semantics, *, limit: int, early: bool = True
    ) -> None:
        super().__init__(compiled, letters, limit=limit, early=early and semantics is Semantics.CONSECUTIVE)
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
        followed = zip(self._frontier.stages, self._settled(), strict=True)
        return [stage.configuration(dict(binding), last) for stage, (binding, last) in followed]

    def _settled(self) -> list[Follower]:
        """Return the partial matches with all steps."""
        for plan, event, position in self._deferred:
            members, made, known = self._members, list[Follower](), dict[int, Mapping[str, Json]]()
            for place, letter, move, target in plan.steps:
                binding, last = members[place if place < len(members) else -1]
                values = known.get(letter.letter)
                if values is None:
                    values = known[letter.letter] = self.letters.values(letter, event)
                names = () if target is None else target.names
                # a partial match that has ended since gets placeholders, which a later plan drops
                kept = {name: binding[name] if name in binding else values.get(name) for name in names}
                made.append(_new(Follower, (kept, _new(Witness, (last, move.node, position, values)))))
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
        known = self._frontier.plans.get(event_class)
        if known is None or known.after is None:  # otherwise nothing is searched
            self.matching.effort.begin()
        plan = known or self._stages.plan(self._frontier, event_class)
        steps, after, fresh = plan
        members: list[Follower] | None = None
        if after is None:
            after, members = self._extended(plan, reading, position)
        else:
            self.noted = bool(steps)
            if len(steps) > self.limit:
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
        stages, made = self._stages, dict[tuple[Any, ...], Follower]()
        members = self._settled() if self._deferred else self._members
        steps, event, event_class = plan.steps, *reading.hits
        timed = event_class.timed
        time = self.letters.time(event) if timed else None
        known = dict[int, Sequence[Mapping[str, Json]]]()
        for place, letter, move, target in steps:
            binding, last = members[place]
            ways = known.get(letter.letter)
            if ways is None:
                ways = self.letters.ways(letter, event, time) if timed else [letter.reader.values(event)]
                known[letter.letter] = ways
            for values in ways:
                if move.compared and not agree(move.compared, binding, values):
                    continue
                bound = {**values, **binding} if binding else values
                stage = target
                if stage is None:
                    outcomes = tuple([holds(bound) for holds in move.joint.values()])
                    stage, _ = stages.outcome(move, 0, outcomes) or (None, False)
                    if stage is None:
                        continue
                bound = move.timed(bound) if move.registers else bound
                kept = {name: bound[name] for name in stage.names}
                key: tuple[Any, ...] = (stage,)
                if timed or len(steps) > 1:
                    key = (stage, *[value if type(value) in OWN_TYPES else exact(value) for value in kept.values()])
                if key not in made:
                    made[key] = _new(Follower, (kept, _new(Witness, (last, move.node, position, values))))
            if len(made) > self.limit:
                self._bound(len(made))
        self.noted = bool(made)
        return stages.frontier((*[key[0] for key in made], *stages.start)), [*made.values(), *self._start]


class LargeContiguousMatches(Following):
    """The strategy of large trees under `strict` and `projected`: all partial matches use the same events."""

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, semantics: Semantics, *, limit: int) -> None:
        assert semantics in (Semantics.STRICT, Semantics.PROJECTED), "the others follow stages"
        super().__init__(compiled, letters, limit=limit)
        self._projected = semantics is Semantics.PROJECTED
        self._begin()

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Replace the partial matches by copies, because a step may change them."""
        self._configurations = [configuration.copy() for configuration in configurations]

    @property
    def partial(self) -> list[Configuration]:
        """The followed partial matches."""
        return self._configurations

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the reading of an event; only `strict` reads irrelevant events."""
        if self._projected and not event_class.relevant:
            return NOTHING
        return self.letters.read(event, event_class)

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        self.matching.effort.begin()
        relevant, hits = reading
        before = self._configurations
        if self._projected and not relevant:
            return Verdict.UNKNOWN if before else Verdict.FALSE
        steps = [(node, hit.values) for hit in hits for node in hit.nodes]
        reuse = len(steps) == 1
        found: dict[Hashable, Configuration] = {}
        for configuration in before:
            for node, values in steps:
                new = self.matching.extended(configuration, node, values, position, reuse=reuse)
                if new is not None:
                    found.setdefault(None if reuse and len(before) == 1 else new.key, new)
            self._bound(len(found))
        standing = self.matching.standing
        self.matches = [new for new in found.values() if standing(new)[0]]
        self._configurations = [] if self.matches else list(found.values())
        if not found:
            self.lost = before
        return Verdict.TRUE if self.matches else Verdict.UNKNOWN if found else Verdict.FALSE
