"""`scattered` in general: a partial match may pass over any event, so that the ones before an event stay beside the ones after it.

Most events of a long trace change nothing. So it is kept what is known to change nothing as long as the partial matches are the same:
letters that none of them can take, outcomes of guards that the event alone decides with which none can, values that were there
before. Where an event may do something, the partial matches that it concerns are found by their stages and by the values that it must
repeat.

A partial match is dropped where another can do all that it can (see `commitment` and `dominance`).
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field
from itertools import islice, product
from typing import Final, NamedTuple, Self, TypeAlias

from rvaft.engine.compiled_tree import Plan, exact
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.contiguous import Following
from rvaft.engine.event_index import Hit, Letters, Reading, Sketch
from rvaft.engine.steps import Matching
from rvaft.engine.subsumption import Directions, at_least, commits, scale
from rvaft.model.guards import Predicate
from rvaft.model.values import Json, key
from rvaft.model.verdict import Verdict

# Stages: what partial matches that differ in their values alone have in common, and where an event takes all of them.
#
# How far a match has come does not depend on the values it saw, but for whether the guards held that were decided. So what taking an event
# does to the structure is worked out once for a stage, a node and the outcomes of the guards decided there; for each partial match
# there remain those guards, and the values to remember. All of it is found when first needed, and forgotten when it gets large.

MEMORY: Final = 500_000
"""How much is remembered: stages, each with the nodes that it knows flags of."""

_MANY: Final = 4
"""Guards of which all outcomes are looked at."""


@dataclass(slots=True, eq=False)
class Stage:
    """How far a partial match has come; `sample` has it all, with no values that mean anything."""

    sample: Configuration
    is_match: bool
    names: tuple[str, ...]
    """The variables that partial matches here remember."""
    directions: Mapping[str, int]
    """Of these the ones of which a greater (1) or smaller (-1) value can do more."""
    moves: dict[int, "Move | None"] = field(default_factory=dict)

    def key(self, binding: Mapping[str, Json]) -> Hashable:
        """Equal for bindings of its variables that nothing can tell apart."""
        return tuple([exact(binding[name]) for name in self.names])


class Step(NamedTuple):
    """Where a move leads, and whether the one that took it need not be followed any more."""

    stage: Stage
    commits: bool


@dataclass(slots=True, eq=False)
class Move:
    """A node's event from a stage on: what has to agree, and what is to be decided.

    The guards in `alone` are decided by the values of the event, those in `joint` by those and the ones remembered.
    """

    stage: Stage
    node: int
    compared: tuple[str, ...]
    """The variables that are bound, and that the event must repeat."""
    alone: tuple[int, ...]
    joint: tuple[int, ...]
    predicates: tuple[Predicate, ...]
    """What the joint guards say."""
    mask: int
    """The guards in `alone` as a set."""
    steps: dict[tuple[int, tuple[bool, ...]], Step | None] = field(default_factory=dict)


class Stages:
    """The stages of a tree, as far as they are known."""

    def __init__(self, matching: Matching) -> None:
        self.matching = matching
        self.forgotten = 0
        """How often everything was forgotten; stages from before must not be mixed with those after."""
        plan = matching.plan
        self._directions = Directions(plan)
        self._known: dict[Hashable, Stage] = {}
        self._size = 0
        own = [
            [
                other
                for other in dict.fromkeys(n for name in names for n in plan.guarded_by.get(name, ()))
                if set(plan.needs[other]) <= set(names)
            ]
            for names in plan.exported
        ]
        self.alone: tuple[tuple[tuple[int, Predicate], ...], ...] = tuple(
            tuple((1 << other, holds) for other in guards if (holds := matching.predicates[other]) is not None)
            for guards in own
        )
        """For each node the guards that its own event may decide, each as a set of one, with what it says."""

    def tidy(self) -> None:
        """Forget everything where it is too much."""
        if self._size > MEMORY:
            self._known.clear()
            self._size = 0
            self.forgotten += 1

    def of(self, configuration: Configuration) -> Stage:
        """The stage of a configuration."""
        key = configuration.taken, configuration.dead, configuration.closed, configuration.inversions
        found = self._known.get(key)
        if found is None:
            self._size += 1 + len(configuration.flags)
            sample = configuration.copy()
            sample.binding, sample.witness = dict.fromkeys(configuration.binding), None
            is_match, _ = self.matching.standing(sample)
            found = self._known[key] = Stage(
                sample, is_match, tuple(sorted(sample.binding)), self._directions.of(sample)
            )
        return found

    def move(self, stage: Stage, node: int) -> Move | None:
        """A node's event from a stage on; None where it cannot come there."""
        if node not in stage.moves:
            self._size += 1
            stage.moves[node] = self._move(stage, node) if self.matching.admits(stage.sample, node) else None
        return stage.moves[node]

    def _move(self, stage: Stage, node: int) -> Move:
        sample, names = stage.sample, self.matching.plan.exported[node]
        bound = sample.copy()
        bound.binding.update(dict.fromkeys(names))
        closing = list(self.matching.closing(bound, names))
        needs = self.matching.plan.needs
        alone = tuple(guard for guard in closing if not any(name in sample.binding for name in needs[guard]))
        joint = tuple(guard for guard in closing if guard not in alone)
        return Move(
            stage,
            node,
            tuple(name for name in names if name in sample.binding),
            alone,
            joint,
            tuple(holds for guard in joint if (holds := self.matching.predicates[guard]) is not None),
            sum(1 << guard for guard in alone),
        )

    def step(self, move: Move, held: int, outcomes: tuple[bool, ...]) -> Step | None:
        """Where a move leads if, of the guards that its event decides, these hold, and the others have these outcomes."""
        key = (held & move.mask, outcomes)
        if key not in move.steps:
            self._size += 1
            judged = {guard: bool(held >> guard & 1) for guard in move.alone}
            judged.update(zip(move.joint, outcomes, strict=True))
            before, node = move.stage.sample, move.node
            values = dict.fromkeys(self.matching.plan.exported[node])
            after = self.matching.extended(before, node, values, 0, judged=judged)
            step = None if after is None else Step(self.of(after), commits(self.matching, before, after, node))
            move.steps[key] = step
        return move.steps[key]

    def hopeful(self, move: Move, held: int) -> bool:
        """Whether a move may lead anywhere if, of the guards that its event decides, these hold."""
        if len(move.joint) > _MANY:
            return True
        return any(self.step(move, held, outcomes) for outcomes in product((True, False), repeat=len(move.joint)))


# The partial matches of one stage, found by the values they remember.

_PLAIN: Final = (str, int, float)


class Member(NamedTuple):
    """A partial match that is followed, and its number: an earlier one has a lower number."""

    number: int
    configuration: Configuration


_Index: TypeAlias = dict[Hashable, dict[int, Member]]


class Group:
    """The members of one stage."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.members: dict[Hashable, Member] = {}
        """By their keys."""
        self._by_values: dict[tuple[str, ...], _Index] = {}
        self._rivals: _Index = {}
        """Where values have directions, the members that can be compared with one another."""

    def fitting(self, names: tuple[str, ...], values: Mapping[str, Json]) -> Iterable[Member]:
        """The members to which some variables have values equal to these."""
        if not names:
            return self.members.values()
        index = self._by_values.get(names)
        if index is None:
            index = self._by_values[names] = {}
            for member in self.members.values():
                _add(index, _keys(names, member.configuration.binding), member)
        return index.get(_keys(names, values), {}).values()

    def excels(self, binding: Mapping[str, Json]) -> bool:
        """Whether some member can do all that one with this binding could."""
        directions = self.stage.directions
        return any(at_least(rival.configuration.binding, binding, directions) for rival in self._comparable(binding))

    def excelled(self, binding: Mapping[str, Json]) -> list[Member]:
        """The members that can do no more than one with this binding."""
        directions = self.stage.directions
        return [r for r in self._comparable(binding) if at_least(binding, r.configuration.binding, directions)]

    def has(self, member: Member) -> bool:
        """Whether this very member is here."""
        return self.members.get(self.stage.key(member.configuration.binding)) is member

    def add(self, member: Member) -> None:
        """Take a member in."""
        binding = member.configuration.binding
        self.members[self.stage.key(binding)] = member
        for index, place in self._places(binding):
            _add(index, place, member)

    def remove(self, member: Member) -> None:
        """Leave a member out."""
        binding = member.configuration.binding
        del self.members[self.stage.key(binding)]
        for index, place in self._places(binding):
            del index[place][member.number]
            if not index[place]:
                del index[place]

    def _places(self, binding: Mapping[str, Json]) -> Iterator[tuple[_Index, Hashable]]:
        """Where a member is found."""
        for names, index in self._by_values.items():
            yield index, _keys(names, binding)
        if self.stage.directions:
            yield self._rivals, self._contest(binding)

    def _comparable(self, binding: Mapping[str, Json]) -> Iterable[Member]:
        return self._rivals.get(self._contest(binding), {}).values() if self.stage.directions else ()

    def _contest(self, binding: Mapping[str, Json]) -> Hashable:
        """Equal for members that differ at most in values that have a direction and are on one scale."""
        directions = self.stage.directions
        kinds = ((scale(binding[name]) if name in directions else None, binding[name]) for name in self.stage.names)
        return tuple([exact(value) if kind is None else kind for kind, value in kinds])


def _add(index: _Index, place: Hashable, member: Member) -> None:
    index.setdefault(place, {})[member.number] = member


def _keys(names: tuple[str, ...], binding: Mapping[str, Json]) -> Hashable:
    """Equal for bindings to which these variables have equal values."""
    return tuple([value if type(value) in _PLAIN else key(value) for value in (binding[name] for name in names)])


SKIPPING_MEMORY: Final = 20_000
"""How many values are remembered that were there before."""

_SKIPPING_PLAIN: Final = (str, int, float)
_UNKNOWN: Final = Verdict.UNKNOWN


@dataclass(slots=True)
class Watch:
    """What an event of one letter may do to the partial matches."""

    alone: tuple[tuple[int, Predicate], ...]
    """The guards that the event may decide, each as a set of one, with what it says."""
    names: tuple[str, ...]
    """The variables of the event that matter."""
    moves: list[tuple[Group, Move, int]] = field(default_factory=list)
    """What the groups can take, with the place of the node in the letter."""
    groups: int = 0
    """How many groups were looked at."""
    hopeful: dict[int, bool] = field(default_factory=dict)
    """For the guards that hold whether anything may come of it."""


class Call(NamedTuple):
    """A letter of an event that may change something: which guards decided by the event hold, and what stands for the values."""

    hit: Hit
    watch: Watch
    held: int
    key: Hashable


class New(NamedTuple):
    """A partial match to be: its place in the order, what was before, the event, and what it will remember."""

    order: tuple[int, int, int]
    before: Configuration
    node: int
    values: Mapping[str, Json]
    stage: Stage
    binding: dict[str, Json]

    def made(self, position: int) -> Configuration:
        """The configuration."""
        sample = self.stage.sample
        return Configuration(
            sample.dead,
            sample.closed,
            sample.taken,
            self.binding,
            sample.inversions,
            sample.flags,
            sample.tallies,
            Witness(self.before.witness, self.node, position, dict(self.values)),
        )


class Skipping(Following):
    """The partial matches by their stages; none changes once it is there."""

    def __init__(self, plan: Plan, letters: Letters, *, limit: int) -> None:
        super().__init__(plan, letters, limit=limit)
        self._stages = Stages(self.matching)
        """What is known of the stages, the same for all copies."""
        self.follow(self._beginning())

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Follow these, and nothing else."""
        self._groups: dict[Stage, Group] = {}
        self._watches: dict[int, Watch] = {}
        self._quiet: set[Hashable] = set()
        """Letters with values that are known to change nothing."""
        self._added = 0
        self._count = 0
        self._epoch = self._stages.forgotten
        for configuration in configurations:
            self._add(self._stages.of(configuration), configuration)

    @property
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""
        members = [member for group in self._groups.values() for member in group.members.values()]
        return [member.configuration for member in sorted(members, key=lambda member: member.number)]

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        twin.follow(self.partial)
        return twin

    def read(self, event: Json, sketch: Sketch | None = None) -> Reading:
        """What an event means; whether it is relevant does not matter here."""
        return self.letters.read(event, sketch, relevance=False)

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        if self._empty_match:
            return self._at_once()
        if self._epoch != self._stages.forgotten:
            self.follow(self.partial)
        loud: list[Call] = []
        for hit in reading.hits:
            letter, _, values = hit
            watch = self._watches.get(letter)
            if watch is None or watch.groups != len(self._groups):
                watch = self._watch(hit)
            if not watch.moves:
                continue
            held = 0
            for guard, holds in watch.alone:
                if holds(values):
                    held |= guard
            hopeful = watch.hopeful.get(held)
            if hopeful is None:
                hopeful = watch.hopeful[held] = any(self._stages.hopeful(move, held) for _, move, _ in watch.moves)
            if hopeful:
                key: Hashable
                if len(watch.names) == 1 and type(value := values[watch.names[0]]) in _SKIPPING_PLAIN:
                    key = (letter, type(value), value)
                else:
                    key = (letter, *[exact(values[name]) for name in watch.names])
                if key not in self._quiet:
                    loud.append(Call(hit, watch, held, key))
        self.noted = bool(loud)
        return self._answer(loud, position) if loud else _UNKNOWN

    def _watch(self, hit: Hit) -> Watch:
        """What is known of a letter, up to date."""
        watch = self._watches.get(hit.letter)
        if watch is None:
            exported = (name for node in hit.nodes for name in self.plan.exported[node])
            alone = (guard for node in hit.nodes for guard in self._stages.alone[node])
            watch = self._watches[hit.letter] = Watch(tuple(dict.fromkeys(alone)), tuple(dict.fromkeys(exported)))
        for group in islice(self._groups.values(), watch.groups, None):
            for place, node in enumerate(hit.nodes):
                move = self._stages.move(group.stage, node)
                if move is not None:
                    watch.moves.append((group, move, place))
                    watch.hopeful.clear()
        watch.groups = len(self._groups)
        return watch

    def _answer(self, loud: list[Call], position: int) -> Verdict:
        """The verdict after an event that may change something."""
        found: dict[Hashable, New] = {}
        ended: dict[int, tuple[Group, Member]] = {}
        for order, call in enumerate(loud):
            values = call.hit.values
            for group, move, place in call.watch.moves:
                for member in group.fitting(move.compared, values):
                    before = member.configuration
                    bound = {**values, **before.binding} if before.binding else values
                    step = self._stages.step(move, call.held, tuple([holds(bound) for holds in move.predicates]))
                    if step is None:
                        continue
                    if step.commits:
                        ended[member.number] = group, member
                    binding = {name: bound[name] for name in step.stage.names}
                    new = New((member.number, order, place), before, move.node, values, step.stage, binding)
                    self._note(new, found, len(ended))
        if not found and not ended:
            if len(self._quiet) > SKIPPING_MEMORY:
                self._quiet.clear()
            self._quiet.update(call.key for call in loud)
            return Verdict.UNKNOWN
        self._quiet.clear()
        return self._change(sorted(found.values(), key=_order), ended.values(), position)

    def _note(self, new: New, found: dict[Hashable, New], ended: int) -> None:
        """Keep what is not there yet; of two that are alike the first."""
        key = new.stage.key(new.binding)
        group = self._groups.get(new.stage)
        if group is None or not (key in group.members or group.excels(new.binding)):
            other = found.get((new.stage, key))
            if other is None or new.order < other.order:
                found[new.stage, key] = new
                self._bound(self._count + len(found) - ended)

    def _change(self, found: Iterable[New], ended: Iterable[tuple[Group, Member]], position: int) -> Verdict:
        """The verdict with these partial matches and without those."""
        matches: list[Configuration] = []
        for new in found:
            group = self._groups.get(new.stage)
            if group is not None:
                if group.excels(new.binding):
                    continue
                for member in group.excelled(new.binding):
                    self._leave(group, member)
            configuration = new.made(position)
            self._add(new.stage, configuration)
            if new.stage.is_match:
                matches.append(configuration)
        if matches:
            self.matches = matches
            self.follow([])
            return Verdict.TRUE
        for group, member in ended:
            self._leave(group, member)
        for stage in [stage for stage, group in self._groups.items() if not group.members]:
            del self._groups[stage]
            self._watches.clear()
        self._stages.tidy()
        return Verdict.UNKNOWN

    def _add(self, stage: Stage, configuration: Configuration) -> None:
        group = self._groups.get(stage)
        if group is None:
            group = self._groups[stage] = Group(stage)
        group.add(Member(self._added, configuration))
        self._added += 1
        self._count += 1

    def _leave(self, group: Group, member: Member) -> None:
        """Follow a member no more, if it is still followed."""
        if group.has(member):
            group.remove(member)
            self._count -= 1


def _order(new: New) -> tuple[int, int, int]:
    return new.order
