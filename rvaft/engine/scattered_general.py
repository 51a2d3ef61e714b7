"""`scattered` in general: a partial match may pass over any event, so that the ones before an event stay beside the ones after it.

How far a match has come does not depend on the values it saw, but for whether the guards held that were decided. So what taking an event
does to the structure is worked out once for a *stage*, a node and the outcomes of the guards decided there; for each partial match
there remain those guards, and the values to remember.

Most events of a long trace change nothing. So it is kept what is known to change nothing as long as the partial matches are the same:
letters that none of them can take, outcomes of guards that the event alone decides with which none can, values that were there
before. Where an event may do something, the partial matches that it concerns are found by their stages and by the values that it
must repeat. A partial match is dropped where another can do all that it can (see `subsumption`).
"""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice, product
from typing import Final, NamedTuple, TypeAlias

from rvaft.engine.compiled_tree import NOTHING, CompiledTree, Reading, Sketch, TreeLetters
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.partial_matches import Following, Matching
from rvaft.engine.subsumption import at_least, commits, directions, scale
from rvaft.model.guards import Predicate
from rvaft.model.values import Json, exact, key
from rvaft.model.verdict import Verdict
from rvaft.support.bits import bits, mask_of

MEMORY: Final = 500_000
"""How much is remembered of stages: each with the nodes that it knows flags of."""
QUIET: Final = 20_000
"""How many values are remembered that change nothing."""
_MANY: Final = 4
"""Guards of which all outcomes are looked at."""
_PLAIN: Final = (str, int, float)
_UNKNOWN: Final = Verdict.UNKNOWN


@dataclass(slots=True, eq=False)
class Stage:
    """How far a partial match has come; `sample` has it all, with no values that mean anything."""

    sample: Configuration
    is_match: bool
    names: tuple[str, ...]
    """The variables that partial matches here remember."""
    directions: Mapping[str, int]
    """Of these the ones of which a greater (1) or smaller (-1) value can do more."""
    moves: dict[int, "StageMove | None"] = field(default_factory=dict)

    def key(self, binding: Mapping[str, Json]) -> Hashable:
        """Equal for bindings of its variables that nothing can tell apart."""
        return tuple([exact(binding[name]) for name in self.names])


@dataclass(slots=True, eq=False)
class StageMove:
    """A node's event from a stage on: what has to agree, and what is to be decided."""

    stage: Stage
    node: int
    compared: tuple[str, ...]
    """The variables that are bound, and that the event must repeat."""
    alone: int
    """The set of guards that are decided by the values of the event."""
    joint: dict[int, Predicate]
    """The guards that are decided by those and the values remembered."""
    outcomes: dict[tuple[int, tuple[bool, ...]], tuple[Stage, bool] | None] = field(default_factory=dict)
    """Where it leads, and whether the one that took it need not be followed any more; None where it leads nowhere."""


class Stages:
    """The stages of a tree, found when first needed."""

    def __init__(self, matching: Matching) -> None:
        self.matching = matching
        self.size = 0
        self._known: dict[Hashable, Stage] = {}

    def of(self, configuration: Configuration) -> Stage:
        """The stage of a configuration."""
        place = configuration.taken, configuration.dead, configuration.closed, configuration.inversions
        found = self._known.get(place)
        if found is None:
            self.size += 1 + len(configuration.flags)
            sample = configuration.copy()
            sample.binding, sample.witness = dict.fromkeys(configuration.binding), None
            is_match, _ = self.matching.standing(sample)
            ways = directions(self.matching.compiled, sample)
            found = self._known[place] = Stage(sample, is_match, tuple(sorted(sample.binding)), ways)
        return found

    def move(self, stage: Stage, node: int) -> StageMove | None:
        """A node's event from a stage on; None where it cannot come there."""
        if node not in stage.moves:
            found = None
            self.size += 1
            if self.matching.admits(stage.sample, node):
                compiled, remembered = self.matching.compiled, stage.sample.binding
                names = compiled.exported[node]
                bound = stage.sample.copy()
                bound.binding.update(dict.fromkeys(names))
                closing = list(self.matching.closing(bound, names))
                alone = mask_of(guard for guard in closing if remembered.keys().isdisjoint(compiled.needs[guard]))
                decided = ((guard, compiled.predicates[guard]) for guard in closing if not alone >> guard & 1)
                joint = {guard: holds for guard, holds in decided if holds is not None}
                found = StageMove(stage, node, tuple(name for name in names if name in remembered), alone, joint)
            stage.moves[node] = found
        return stage.moves[node]

    def outcome(self, move: StageMove, held: int, outcomes: tuple[bool, ...]) -> tuple[Stage, bool] | None:
        """Where a move leads if, of the guards that its event decides, these hold, and the others have these outcomes."""
        place = (held & move.alone, outcomes)
        if place not in move.outcomes:
            self.size += 1
            judged = {guard: bool(held >> guard & 1) for guard in bits(move.alone)}
            judged.update(zip(move.joint, outcomes, strict=True))
            before, node = move.stage.sample, move.node
            values = dict.fromkeys(self.matching.compiled.exported[node])
            after = self.matching.extended(before, node, values, 0, judged=judged)
            found = None if after is None else (self.of(after), commits(self.matching, before, after, node))
            move.outcomes[place] = found
        return move.outcomes[place]

    def is_hopeful(self, move: StageMove, held: int) -> bool:
        """Whether a move may lead anywhere if, of the guards that its event decides, these hold."""
        if len(move.joint) > _MANY:
            return True
        return any(self.outcome(move, held, outcomes) for outcomes in product((True, False), repeat=len(move.joint)))


class Member(NamedTuple):
    """A partial match that is followed, and its number: an earlier one has a lower number."""

    number: int
    configuration: Configuration


_Index: TypeAlias = dict[Hashable, dict[int, Member]]


class StageGroup:
    """The partial matches of one stage, found by the values they remember."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.members: dict[Hashable, Member] = {}
        """By their keys."""
        self._by_values: dict[tuple[str, ...] | None, _Index] = {}

    def fitting(self, names: tuple[str, ...] | None, values: Mapping[str, Json]) -> Iterable[Member]:
        """The members to which these variables have values equal to these.

        With None those that differ from them at most in values that have a direction and are on one scale.
        """
        if names is not None and not names:
            return self.members.values()
        index = self._by_values.get(names)
        if index is None:
            index = self._by_values[names] = {}
            for member in self.members.values():
                index.setdefault(self._place(names, member.configuration.binding), {})[member.number] = member
        return index.get(self._place(names, values), {}).values()

    def excels(self, binding: Mapping[str, Json]) -> bool:
        """Whether some member can do all that one with this binding could."""
        ways = self.stage.directions
        return bool(ways) and any(
            at_least(rival.configuration.binding, binding, ways) for rival in self.fitting(None, binding)
        )

    def add(self, member: Member) -> None:
        """Take a member in, in place of those that can do no more."""
        binding, ways = member.configuration.binding, self.stage.directions
        rivals = self.fitting(None, binding) if ways else ()
        for rival in [rival for rival in rivals if at_least(binding, rival.configuration.binding, ways)]:
            self.remove(rival)
        self.members[self.stage.key(binding)] = member
        for names, index in self._by_values.items():
            index.setdefault(self._place(names, binding), {})[member.number] = member

    def remove(self, member: Member) -> None:
        """Leave a member out, if it is still here."""
        binding = member.configuration.binding
        name = self.stage.key(binding)
        if self.members.get(name) is member:
            del self.members[name]
            for names, index in self._by_values.items():
                place = self._place(names, binding)
                del index[place][member.number]
                if not index[place]:
                    del index[place]

    def _place(self, names: tuple[str, ...] | None, binding: Mapping[str, Json]) -> Hashable:
        if names is not None:
            values = [binding[name] for name in names]
            return tuple([v if type(v) in _PLAIN and v == v else key(v) for v in values])  # noqa: PLR0124 (NaN is not)
        ways = self.stage.directions
        kinds = ((scale(binding[name]) if name in ways else None, binding[name]) for name in self.stage.names)
        return tuple([exact(value) if kind is None else kind for kind, value in kinds])


@dataclass(slots=True)
class LetterWatch:
    """What an event of one letter may do to the partial matches."""

    alone: tuple[tuple[int, Predicate], ...]
    """The guards that the event may decide, each as a set of one, with what it says."""
    names: tuple[str, ...]
    """The variables of the event that matter."""
    moves: list[tuple[StageGroup, StageMove, int]] = field(default_factory=list)
    """What the groups can take, with the place of the node in the letter."""
    groups: int = 0
    """How many groups were looked at."""
    hopeful: dict[int, bool] = field(default_factory=dict)
    """For the guards that hold whether anything may come of it."""


class LoudHit(NamedTuple):
    """A letter that may change something: its values, the guards decided by them that hold, and what stands for both."""

    values: Mapping[str, Json]
    watch: LetterWatch
    held: int
    name: Hashable


class NewMatch(NamedTuple):
    """A partial match to be: its place in the order, what was before, the event, and what it will remember."""

    order: tuple[int, int, int]
    before: Configuration
    node: int
    values: Mapping[str, Json]
    stage: Stage
    binding: dict[str, Json]


_QUIET: Final = Reading(relevant=False, hits=(None,))
"""An event that fits some node and changes nothing."""


class ScatteredMatches(Following):
    """The partial matches by their stages; none changes once it is there."""

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, *, limit: int) -> None:
        super().__init__(compiled, letters, limit=limit)
        self._stages = Stages(self.matching)
        self._begin()

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Follow these, and nothing else."""
        if self._stages.size > MEMORY:
            self._stages = Stages(self.matching)  # else the same for all copies
        self._groups: dict[Stage, StageGroup] = {}
        self._watches: dict[int, LetterWatch] = {}
        self._quiet: set[Hashable] = set()
        """Letters with values that are known to change nothing as long as the partial matches are the same."""
        self._added = 0
        for configuration in configurations:
            self._add(self._stages.of(configuration), configuration)

    @property
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""
        members = [member for group in self._groups.values() for member in group.members.values()]
        return [member.configuration for member in sorted(members, key=lambda member: member.number)]

    def read(self, event: Mapping[str, Json], sketch: Sketch | None = None) -> Reading:
        """What an event means: of its letters those that may change something as long as nothing else is read."""
        fits, loud, watches, groups = False, list[LoudHit](), self._watches, len(self._groups)
        for letter, nodes, _, test, values_of in (self.letters.sketch(event) if sketch is None else sketch).serving:
            if (test is None or test(event)) and (values := values_of(event)) is not None:
                fits = True
                watch = watches.get(letter)
                if watch is None or watch.groups != groups:
                    watch = self._watch(letter, nodes)
                if not watch.moves:
                    continue
                held = 0
                for guard, holds in watch.alone:
                    if holds(values):
                        held |= guard
                hopeful = watch.hopeful.get(held)
                if hopeful is None:
                    hopeful = any(self._stages.is_hopeful(move, held) for _, move, _ in watch.moves)
                    watch.hopeful[held] = hopeful
                if hopeful:
                    told = [values[name] for name in watch.names]
                    name = (letter, *[value if type(value) is str else exact(value) for value in told])
                    if name not in self._quiet:
                        loud.append(LoudHit(values, watch, held, name))
        return Reading(False, loud) if loud else _QUIET if fits else NOTHING

    def _watch(self, letter: int, nodes: tuple[int, ...]) -> LetterWatch:
        """What is known of a letter, up to date."""
        watch = self._watches.get(letter)
        if watch is None:
            compiled = self.compiled
            alone: dict[int, Predicate] = {}
            for node in nodes:
                own = set(compiled.exported[node])
                for guard in dict.fromkeys(n for name in own for n in compiled.guarded_by.get(name, ())):
                    holds = compiled.predicates[guard]
                    if holds is not None and own.issuperset(compiled.needs[guard]):
                        alone[1 << guard] = holds
            exported = dict.fromkeys(name for node in nodes for name in compiled.exported[node])
            watch = self._watches[letter] = LetterWatch(tuple(alone.items()), tuple(exported))
        for group in islice(self._groups.values(), watch.groups, None):
            for place, node in enumerate(nodes):
                move = self._stages.move(group.stage, node)
                if move is not None:
                    watch.moves.append((group, move, place))
                    watch.hopeful.clear()
        watch.groups = len(self._groups)
        return watch

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        if not reading.hits or reading.hits is _QUIET.hits:
            self.noted = False
            return _UNKNOWN
        found: dict[Hashable, NewMatch] = {}
        ended: dict[int, tuple[StageGroup, Member]] = {}
        for order, (values, watch, held, _) in enumerate(reading.hits):
            for group, move, place in watch.moves:
                for member in group.fitting(move.compared, values):
                    before = member.configuration
                    bound = {**values, **before.binding} if before.binding else values
                    outcomes = tuple([holds(bound) for holds in move.joint.values()])
                    outcome = self._stages.outcome(move, held, outcomes)
                    if outcome is not None:
                        stage, commits_to_it = outcome
                        if commits_to_it:
                            ended[member.number] = group, member
                        binding = {name: bound[name] for name in stage.names}
                        new = NewMatch((member.number, order, place), before, move.node, values, stage, binding)
                        self._note(new, found, len(ended))
        self.noted = bool(found or ended)
        if self.noted or len(self._quiet) > QUIET:
            self._quiet.clear()
        if self.noted:
            return self._change(found.values(), ended.values(), position)
        self._quiet.update(name for _, _, _, name in reading.hits)
        return _UNKNOWN

    def _note(self, new: NewMatch, found: dict[Hashable, NewMatch], ended: int) -> None:
        """Keep what is not there yet; of two that are alike the first."""
        name = new.stage.key(new.binding)
        group = self._groups.get(new.stage)
        if group is None or not (name in group.members or group.excels(new.binding)):
            other = found.get((new.stage, name))
            if other is None or new.order < other.order:
                found[new.stage, name] = new
                self._bound(sum(len(group.members) for group in self._groups.values()) + len(found) - ended)

    def _change(self, found: Iterable[NewMatch], ended: Iterable[tuple[StageGroup, Member]], position: int) -> Verdict:
        """The verdict with these partial matches and without those."""
        self.matches = []
        for new in sorted(found, key=lambda new: new.order):
            group = self._groups.get(new.stage)
            if group is None or not group.excels(new.binding):
                sample, witness = new.stage.sample, Witness(new.before.witness, new.node, position, new.values)
                fields = sample.inversions, sample.flags, sample.tallies
                made = Configuration(sample.dead, sample.closed, sample.taken, new.binding, *fields, witness)
                self._add(new.stage, made)
                if new.stage.is_match:
                    self.matches.append(made)
        if self.matches:
            self.follow([])
            return Verdict.TRUE
        for group, member in ended:
            group.remove(member)
        for stage in [stage for stage, group in self._groups.items() if not group.members]:
            del self._groups[stage]
            self._watches.clear()
        if self._stages.size > MEMORY:
            self.follow(self.partial)
        return _UNKNOWN

    def _add(self, stage: Stage, configuration: Configuration) -> None:
        group = self._groups.get(stage)
        if group is None:
            group = self._groups[stage] = StageGroup(stage)
        group.add(Member(self._added, configuration))
        self._added += 1
