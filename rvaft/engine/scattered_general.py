"""The general strategy for `scattered`: each partial match stays beside its extensions, because it
may skip any event.

Letters, outcomes and values without effect are cached while the partial matches stay the same.
Otherwise an index finds the partial matches of a stage (see `stages`) that an event can extend.
Subsumed partial matches are dropped (see `subsumption`).
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice, product
from typing import Final, NamedTuple

from rvaft.engine.compiled_tree import (
    NOTHING,
    QUIET,
    Admission,
    CompiledTree,
    EventClass,
    Inert,
    Reading,
    TreeLetters,
)
from rvaft.engine.configuration import SURE, Configuration, Snapshot, Witness, history
from rvaft.engine.independent_parts import IndependentPart, independent_parts
from rvaft.engine.partial_matches import Following
from rvaft.engine.settled_choices import SettledChoices
from rvaft.engine.stage_group import Member, StageGroup, in_order
from rvaft.engine.stages import Scan, Stage, StageMove, Stages
from rvaft.engine.subsumption import Rank, Term
from rvaft.errors import TooLarge
from rvaft.model.guards import (
    UNDEFINED,
    value,
)
from rvaft.model.patterns import Variable
from rvaft.model.values import Json, exact
from rvaft.model.verdict import Verdict
from rvaft.support.bits import bits, union

MEMORY: Final = 500_000
"""The maximum number of nodes with flags in cached stages."""
REMEMBERED: Final = 20_000
"""The maximum number of cached values and event classes."""
MIN_STAGES: Final = 1_000
"""The number of stages allowed for any limit."""
STAGE_COST: Final = 10
"""The cost of a stage, in partial matches."""
_MANY: Final = 4
"""The maximum number of members to visit without the index."""
_UNKNOWN: Final = Verdict.UNKNOWN


@dataclass(slots=True)
class LetterMoves:
    """The possible effects of a letter on the partial matches."""

    names: tuple[str, ...]
    """The relevant variables of the event."""
    moves: list[tuple[StageGroup, StageMove, int]] = field(default_factory=list)
    """The possible moves of groups, with the index of the node."""
    groups: int = 0


class RelevantHit(NamedTuple):
    """A letter that may change something: values, guards that hold, cache key."""

    values: Mapping[str, Json]
    watch: LetterMoves
    held: int
    name: Hashable


class NewMatch(NamedTuple):
    """A new partial match: its order, origin, event, and values to remember."""

    order: tuple[int, int, int]
    before: Configuration
    node: int
    values: Mapping[str, Json]
    stage: Stage
    binding: dict[str, Json]
    rank: Rank


class CandidateMove(NamedTuple):
    """A letter with possible moves.

    `fields` are the relevant fields, or None if they are unknown.
    """

    admission: Admission
    watch: LetterMoves
    held: int
    fields: tuple[str, ...] | None


def _quiet_name(letter: int, values: Iterable[Json]) -> Hashable:
    return (letter, *[v if type(v) is str or type(v) is int else exact(v) for v in values])


class ScatteredMatches(Following):
    """The partial matches by stage; an added partial match does not change."""

    uses_up = False

    def __init__(
        self, compiled: CompiledTree, letters: TreeLetters, choices: SettledChoices, *, limit: int, apart: bool = True
    ) -> None:
        super().__init__(compiled, letters, limit=limit, early=True)
        self._stages = Stages(self.matching, choices)
        self._parts = independent_parts(compiled, letters) if apart else ()
        self._begun = 0
        """The nodes of the parts that need not begin again."""
        self._watermark: int | None = None
        self._begin()

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Replace the followed partial matches."""
        if self._stages.size > MEMORY:
            self._stages = Stages(self.matching, self._stages.choices)  # otherwise copies share the stages
        self._groups: dict[Stage, StageGroup] = {}
        self._watches: dict[int, LetterMoves] = {}
        self._quiet: set[Hashable] = set()
        """Letters with values that change nothing at present."""
        self._candidates: dict[EventClass, tuple[CandidateMove, ...]] = {}
        """By event class, the letters with possible moves at present."""
        self._added = 0
        self._whole = 0
        """The nodes of the parts that have a match."""
        # a copy must not drop partial matches earlier
        watermark, self._watermark = self._watermark, None
        for configuration in configurations:
            self._add(self._stages.of(configuration), configuration)
        self._watermark = watermark
        for group in self._groups.values():
            group.watermark = watermark

    @property
    def partial(self) -> list[Configuration]:
        """The followed partial matches."""
        members = [member for group in self._groups.values() for member in group.members.values()]
        return [member.configuration for member in sorted(members, key=lambda member: member.number)]

    @property
    def combined(self) -> list[Configuration]:
        """Each partial match of a part, with the first of the others."""
        if not self._parts:
            return self.partial
        found: list[list[Configuration]] = [
            [one for one in self.partial if one.taken & part.nodes] for part in self._parts
        ]
        for part, some in zip(self._parts, found, strict=True):
            if not self._begun & part.nodes and not any(self._is_whole(part, one) for one in some):
                some.insert(0, self.matching.start())
        first = [some[:1] for some in found]
        together = [
            chain(*first[:place], [one], *first[place + 1 :]) for place, some in enumerate(found) for one in some
        ]
        made = (self._together(some) for some in together)
        return list({one.key: one for one in made if one is not None}.values())

    def _together(self, configurations: Iterable[Configuration]) -> Configuration | None:
        steps = sorted(
            (step for one in configurations for step in history(one.witness)), key=lambda step: step.position
        )
        return self.matching.replayed((step.node, step.values, step.position) for step in steps)

    def _is_whole(self, part: IndependentPart, configuration: Configuration) -> bool:
        return all(self.matching.progress.flags(configuration, child) & SURE for child in part.children)

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        return (super().state, self._begun) if self._parts else super().state

    def snapshot(self) -> Snapshot:
        """Return the state for `restore`."""
        return super().snapshot()._replace(begun=self._begun)

    def restore(self, snapshot: object) -> None:
        """Restore a snapshot of the same tree."""
        assert isinstance(snapshot, Snapshot), "made by the same strategy"
        self._begun = snapshot.begun
        super().restore(snapshot)

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the letters that may change something now."""
        if not event_class.serving:
            return NOTHING
        candidates = self._candidates.get(event_class)
        loud = list[RelevantHit]()
        for admission, watch, held, fields in self._find(event_class) if candidates is None else candidates:
            if fields is not None:
                name = _quiet_name(admission.letter, [event[field] for field in fields])
                if name not in self._quiet:
                    loud.append(RelevantHit(self.letters.values(admission, event), watch, held, name))
                continue
            for values in self.letters.ways(admission, event):
                name = _quiet_name(admission.letter, [values[name] for name in watch.names])
                if name not in self._quiet:
                    own = sum([bit for bit, holds in admission.own if holds(values)])
                    loud.append(RelevantHit(values, watch, held | own, name))
        return Reading(False, loud) if loud else QUIET

    def inert(self, event_class: EventClass) -> Inert:
        """Return which events of a class change nothing until another event is read."""
        candidates = self._candidates.get(event_class)
        found = self._find(event_class) if candidates is None else candidates
        return Inert([(one.admission.letter, one.fields) for one in found], self._quiet)

    def _find(self, event_class: EventClass) -> tuple[CandidateMove, ...]:
        found = []
        for one, held in zip(event_class.serving, event_class.held, strict=True):
            watch = self._watch(one.letter, one.nodes)
            # the guards of a letter with several ways are not decided yet
            if any(one.reader.ways is not None or self._stages.is_hopeful(move, held) for _, move, _ in watch.moves):
                by_name = one.reader.fields
                named = None if by_name is None or one.time else tuple(by_name[name] for name in watch.names)
                found.append(CandidateMove(one, watch, held, named))
        if len(self._candidates) >= REMEMBERED:
            self._candidates.clear()
        self._candidates[event_class] = tuple(found)
        return self._candidates[event_class]

    def _watch(self, letter: int, nodes: tuple[int, ...]) -> LetterMoves:
        watch = self._watches.get(letter)
        if watch is None:
            exported = dict.fromkeys(name for node in nodes for name in self.compiled.exported[node])
            watch = self._watches[letter] = LetterMoves(tuple(exported))
        for stage, group in islice(self._groups.items(), watch.groups, None):
            for place, node in enumerate(nodes):
                move = self._stages.move(stage, node) if self._may_take(stage, node) else None
                if move is not None:
                    watch.moves.append((group, move, place))
        watch.groups = len(self._groups)
        return watch

    def _may_take(self, stage: Stage, node: int) -> bool:
        """Whether a partial match may take a node of its own part, or begin that part."""
        for part in self._parts:
            if part.nodes >> node & 1:
                taken = stage.sample.taken
                over = self._whole & part.nodes and not part.chooses
                return not over and (taken & part.nodes > 0 if taken else not self._begun & part.nodes)
        return True

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        if not reading.hits or reading.hits is QUIET.hits:
            self.noted = False
            return _UNKNOWN
        found: dict[Hashable, NewMatch] = {}
        ended: dict[int, tuple[StageGroup, Member]] = {}
        begun, followed = self._begun, sum(len(group.members) for group in self._groups.values())
        for order, (values, watch, held, _) in enumerate(reading.hits):
            for group, move, place in watch.moves:
                parts: Sequence[tuple[Iterable[Member], tuple[Term, ...] | None]] = group.everyone
                # few members are visited without the index
                if move.scan or move.compared or len(group.members) > _MANY:
                    scan = move.scan or self._stages.scan(move)
                    parts = self._concerned(group, scan, values) if scan.orders else parts
                for members, enough in parts:
                    for member in members:
                        before = member.configuration
                        bound = {**values, **before.binding} if before.binding else values
                        outcomes = tuple([holds(bound) for holds in move.joint.values()])
                        outcome = self._stages.outcome(move, held, outcomes)
                        if outcome is not None:
                            stage, commits_to_it = outcome
                            if commits_to_it and self._parts and not before.taken:  # other parts have yet to begin
                                begun |= next(part.nodes for part in self._parts if part.nodes >> move.node & 1)
                            elif commits_to_it:
                                ended[member.number] = group, member
                            binding = {name: bound[name] for name in stage.names}
                            at = (member.number, order, place)
                            rank = self._stages.rank(stage, binding, before.witness, move.node)
                            new = NewMatch(at, before, move.node, values, stage, binding, rank)
                            self._note(new, found, followed - len(ended))
                            if enough is not None and all(
                                one.value(binding) == one.extreme.of(values) for one in enough
                            ):
                                break
        self.noted = bool(found or ended)
        if begun != self._begun:
            self._begun = begun
            self._forget_watches()
        if self.noted or len(self._quiet) > REMEMBERED:
            self._quiet.clear()
        if self.noted:
            return self._change(found.values(), ended.values(), position)
        self._quiet.update(name for _, _, _, name in reading.hits)
        return _UNKNOWN

    def _concerned(
        self, group: StageGroup, scan: Scan, values: Mapping[str, Json]
    ) -> Sequence[tuple[Iterable[Member], tuple[Term, ...] | None]]:
        """Return the members that may make a move, with stop conditions."""
        required = [values[one.name] if type(one) is Variable else value(one, values) for one in scan.terms]
        if UNDEFINED in required:
            return ()
        ways = [(one, group.between(scan.names, required, one.term, one.bounds, values)) for one in scan.orders]
        order, lanes = min(ways, key=lambda way: sum(end - start for _, start, end in way[1]))
        return [(in_order(*lane, last_first=order.last_first), order.enough) for lane in lanes]

    def _note(self, new: NewMatch, found: dict[Hashable, NewMatch], others: int) -> None:
        group = self._groups.get(new.stage)
        if group is None or not group.excels(new.rank):
            other = found.get((new.stage, new.rank))
            if other is None or new.order < other.order:
                found[new.stage, new.rank] = new
                self._bound(others + len(found))

    def _change(self, found: Iterable[NewMatch], ended: Iterable[tuple[StageGroup, Member]], position: int) -> Verdict:
        self.matches = []
        for new in sorted(found, key=lambda new: new.order):
            group = self._groups.get(new.stage)
            if group is None or not group.excels(new.rank):
                sample, witness = new.stage.sample, Witness(new.before.witness, new.node, position, new.values)
                fields = sample.inversions, sample.flags, sample.tallies
                made = Configuration(sample.dead, sample.closed, sample.taken, new.binding, *fields, witness)
                self._add(new.stage, made, new.rank)
                if new.stage.is_match:
                    self.matches.append(made)
        if self._whole and all(self._whole & part.nodes for part in self._parts):
            follow, parts = self.partial, self._parts
            whole = [[one for one in follow if one.taken & part.nodes and self._is_whole(part, one)] for part in parts]
            together = map(self._together, product(*whole))
            self.matches = [one for one in together if one is not None]
        if self.matches:
            self.follow([])
            return Verdict.TRUE
        for group, member in ended:
            group.remove(member)
        self._drop_empty()
        if self._stages.size > MEMORY:
            self.follow(self.partial)
        return _UNKNOWN

    def forget(self, watermark: int) -> None:
        """Set the watermark and drop what it rules out."""
        self._watermark = watermark
        for group in self._groups.values():
            group.forget(watermark)
        self._drop_empty()

    def _forget_watches(self) -> None:
        self._watches.clear()
        self._candidates.clear()

    def _drop_empty(self) -> None:
        for stage in [stage for stage, group in self._groups.items() if not group.members]:
            del self._groups[stage]
            self._forget_watches()

    def _add(self, stage: Stage, configuration: Configuration, rank: Rank | None = None) -> None:
        group = self._groups.get(stage)
        if group is None:
            if len(self._groups) > (most := max(self.limit // STAGE_COST, MIN_STAGES)):
                names = [self.compiled.names[node] for node in bits(union(one.sample.taken for one in self._groups))]
                named = f"{', '.join(names[:10])}{', …' if len(names) > 10 else ''}"
                raise TooLarge(f"sets of events in partial matches; any of {named} may be skipped", limit=most)
            group = self._groups[stage] = StageGroup(stage.ranking, stage.deadlines)
            self._candidates.clear()
            group.watermark = self._watermark
        group.add(
            Member(
                self._added,
                configuration,
                rank or self._stages.rank(stage, configuration.binding, configuration.witness),
            )
        )
        self._added += 1
        for part in self._parts if configuration.taken else ():
            if configuration.taken & part.nodes and self._is_whole(part, configuration):
                self._whole |= part.nodes
                self._forget_watches()
                # a complete part without choices needs no other partial match
                for group in () if part.chooses else self._groups.values():
                    for member in [*group.members.values()]:
                        if member.number != self._added - 1 and member.configuration.taken & part.nodes:
                            group.remove(member)
