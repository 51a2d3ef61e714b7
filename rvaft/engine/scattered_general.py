"""The general strategy for `scattered`: each partial match stays beside its extensions, because it
may skip any event.

Letters, outcomes and values without effect are cached while the partial matches stay the same.
Otherwise an index finds the partial matches of a stage (see `stages`) that an event can extend.
Subsumed partial matches are dropped (see `subsumption`).
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, Self, TypeAlias

from rvaft.core.times import Extreme
from rvaft.engine.all_matches import Following
from rvaft.engine.compiled_tree import (
    NOTHING,
    NOW,
    QUIET,
    Admission,
    CompiledTree,
    EventClass,
    Inert,
    Reading,
    TreeLetters,
)
from rvaft.engine.configuration import Configuration, Witness, flattened, history, unflattened
from rvaft.engine.independent_parts import Component, IndependentPart, components
from rvaft.engine.partial_matches import NEW
from rvaft.engine.settled_choices import SettledChoices
from rvaft.engine.stage_group import UNRANKED, LaneMember, Member, StageGroup, in_order
from rvaft.engine.stages import Scan, Stage, StageMove, Stages, agree
from rvaft.engine.subsumption import Rank, Term
from rvaft.errors import TooLarge
from rvaft.model.guards import UNDEFINED
from rvaft.model.values import Json, exact, fingerprint
from rvaft.model.verdict import Verdict
from rvaft.support.bits import bits, union

REMEMBERED: Final = 20_000
"""The maximum number of cached values and event classes."""
MIN_STAGES: Final = 1_000
"""The number of stages allowed for any limit."""
STAGE_COST: Final = 10
"""The cost of a stage, in partial matches."""
MOST_SHARED: Final = 64
"""The maximum number of stages with remembered candidates."""
_MANY: Final = 4
"""The maximum number of members to visit without the index."""
_UNKNOWN: Final = Verdict.UNKNOWN
_new: Final = tuple.__new__  # twice as fast as the constructors of the classes


Moves: TypeAlias = Sequence[tuple[StageMove, int]]
"""The possible moves by a letter, with the index of the node among those that the letter serves."""


class RelevantHit(NamedTuple):
    """A letter that may change something: values, guards that hold, and what its cache key has."""

    values: Mapping[str, Json]
    moves: Moves
    held: int
    letter: int
    names: tuple[str, ...]

    @property
    def key(self) -> Hashable:
        """The key of the letter with its relevant values."""
        return _quiet_key(self.letter, [self.values[name] for name in self.names])


class NewMatch(NamedTuple):
    """A new partial match: its order, values to remember, and last step."""

    order: tuple[int, int, int]
    stage: Stage
    binding: dict[str, Json]
    last: Witness
    rank: Rank
    """`UNRANKED` if its stage had no partial match."""


class CandidateMove(NamedTuple):
    """A letter with possible moves.

    `names` are the relevant variables, `fields` their fields, or None if these are unknown.
    """

    admission: Admission
    moves: Moves
    held: int
    names: tuple[str, ...]
    fields: tuple[str, ...] | None


Candidates: TypeAlias = dict[EventClass, tuple[CandidateMove, ...]]
"""By event class, the letters with possible moves from some stages."""


def _quiet_key(letter: int, values: Iterable[Json]) -> Hashable:
    return (letter, *[v if type(v) is str or type(v) is int else exact(v) for v in values])


class ScatteredMatches(Following):
    """The partial matches by stage; an added partial match does not change."""

    uses_up = False
    joins = True

    def __init__(
        self,
        compiled: CompiledTree,
        letters: TreeLetters,
        choices: SettledChoices,
        *,
        limit: int,
        apart: bool = True,
        early: bool = True,
        repeat_by: str | None = None,
    ) -> None:
        super().__init__(compiled, letters, limit=limit, early=early, repeat_by=repeat_by)
        self._stages = Stages(self.matching, choices)
        self._components = components(compiled, letters) if apart else ()
        self._part_of = {node: part for one in self._components for part in one.parts for node in bits(part.nodes)}
        self._base = self.matching.start()
        """The first matches of components; all partial matches contain them."""
        self._begun = 0
        """The nodes of the parts that need not begin again."""
        self._watermark: int | None = None
        self._most = max(limit // STAGE_COST, MIN_STAGES)
        """The maximum number of stages."""
        self._sets: dict[Hashable, Candidates] = {}
        """The candidates by what they depend on; copies share them."""
        self._begin()

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Replace the followed partial matches."""
        if self._stages.is_full:
            self._stages.clear()
            self._sets.clear()
        self._hold((self._stages.of(one), one.binding, one.witness, UNRANKED) for one in configurations)

    def _hold(self, followed: Iterable[tuple[Stage, dict[str, Json], Witness | None, Rank]]) -> None:
        """Replace the followed partial matches."""
        self._groups: dict[Stage, StageGroup] = {}
        self._quiet: set[Hashable] = set()
        """Letters with values that change nothing at present."""
        self._set: Candidates | None = None
        """The candidates of the groups, if known."""
        self._added = 0
        self._complete: dict[IndependentPart, list[tuple[Stage, StageGroup]]] = {}
        """The matches of each part."""
        # a copy must not drop partial matches earlier
        watermark, self._watermark = self._watermark, None
        for stage, binding, last, rank in followed:
            self._add(stage, binding, last, rank)
        self._watermark = watermark
        for group in self._groups.values():
            group.watermark = watermark

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = object.__new__(type(self))  # faster than `copy`, since each detection forks
        vars(twin).update(vars(self))
        twin._hold([(stage, *member[1:]) for stage, member in self._members])
        return twin

    @property
    def _members(self) -> list[tuple[Stage, Member]]:
        members = [(stage, member) for stage, group in self._groups.items() for member in group.members.values()]
        return sorted(members, key=lambda one: one[1].number) if len(members) > 1 else members

    @property
    def partial(self) -> list[Configuration]:
        """The followed partial matches."""
        return [stage.configuration(member.binding, member.last) for stage, member in self._members]

    @property
    def combined(self) -> list[Configuration]:
        """Each partial match of a part, with the first of the others that agree."""
        if not self._components:
            return self.partial
        found: list[list[Configuration]] = []
        followed = self.partial
        for part in dict.fromkeys(self._part_of.values()):
            some = [one for one in followed if self._own(one) & part.nodes]
            begins = not (self._begun | self._base.taken) & part.nodes
            found.append([self._base, *some] if begins else some)
        made = dict[Hashable, Configuration]()
        for place, some in enumerate(found):
            for one in some:
                all_ = one
                for others in (*found[:place], *found[place + 1 :]):
                    all_ = (self._joined(all_, others[0].witness) if others else None) or all_
                if (whole := self._in_order(all_)) is not None:  # an undefined time may be found late
                    made.setdefault(whole.key, whole)
        return list(made.values())

    def _own(self, configuration: Configuration) -> int:
        """Return the nodes taken that not all partial matches contain."""
        return configuration.taken & ~self._base.taken

    def _joined(self, one: Configuration, last: Witness | None) -> Configuration | None:
        """Return the partial match with these steps too, or None; its steps are not in order."""
        joined: Configuration | None = one
        for step in history(last):
            if joined is not None and not one.taken >> step.node & 1:
                joined = self.matching.extended(joined, step.node, step.values, step.position)
        return joined

    def _in_order(self, configuration: Configuration) -> Configuration | None:
        """Return the same partial match with its steps in order, or None if a window has failed."""
        steps = sorted(history(configuration.witness), key=lambda step: step.position)
        return self.matching.replayed((step.node, step.values, step.position) for step in steps)

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        found = frozenset((self._stages.place(stage), fingerprint(one.binding)) for stage, one in self._members)
        return (found, self._begun, self._base.key) if self._components else found

    def snapshot(self) -> object:
        """Return the state for `restore`."""
        return flattened(self.partial, self.matches, self.lost, [self._base]), self._begun

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same tree."""
        self.matching.effort.begin()
        groups, self._begun = snapshot
        followed, self.matches, self.lost, (self._base,) = unflattened(groups)
        self.follow(followed)

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the letters that may change something now."""
        if not event_class.serving:
            return NOTHING
        self.matching.effort.spent = 0  # faster than `begin`; `advance` goes on
        loud, quiet = list[RelevantHit](), self._quiet
        time = self.letters.time(event) if event_class.timed else None
        for admission, moves, held, names, fields in self._candidates(event_class):
            letter = admission.letter
            if fields is not None:
                if not quiet or _quiet_key(letter, [event[field] for field in fields]) not in quiet:
                    hit: tuple[Any, ...] = (admission.reader.values(event), moves, held, letter, names)
                    loud.append(_new(RelevantHit, hit))
                continue
            for values in self.letters.ways(admission, event, time):
                own = sum([bit for bit, holds in admission.own if holds(values)])
                way = RelevantHit(values, moves, held | own, letter, names)
                if way.key not in quiet:
                    loud.append(way)
        return _new(Reading, (False, loud)) if loud else QUIET

    def inert(self, event_class: EventClass) -> Inert:
        """Return which events of a class change nothing until another event is read."""
        self.matching.effort.begin()
        found = self._candidates(event_class)
        return Inert([(one.admission.letter, one.fields) for one in found], self._quiet)

    def _candidates(self, event_class: EventClass) -> tuple[CandidateMove, ...]:
        """Return the letters of a class with possible moves at present."""
        known = self._find_set() if self._set is None else self._set
        candidates = known.get(event_class)
        return self._find(known, event_class) if candidates is None else candidates

    def _find_set(self) -> Candidates:
        stages = tuple(self._groups)
        if len(stages) > MOST_SHARED:
            self._set = {}
        else:
            self._set = self._sets.setdefault((stages, self._begun, self._base.taken), {})
        return self._set

    def _find(self, known: Candidates, event_class: EventClass) -> tuple[CandidateMove, ...]:
        found, by_letter = [], list[list[tuple[StageMove, int]]]([[] for _ in event_class.serving])
        for stage in self._groups:
            for number, move, place in self._stages.moves(stage, event_class):
                if self._may_take(move):
                    by_letter[number].append((move, place))
        for one, held, moves in zip(event_class.serving, event_class.held, by_letter, strict=True):
            if moves:
                names = tuple(dict.fromkeys(name for node in one.nodes for name in self.compiled.exported[node]))
                by_name = one.reader.fields
                names = (*names, NOW) if NOW in one.times else names
                fields = None if by_name is None or one.times else tuple(by_name[name] for name in names)
                found.append(CandidateMove(one, moves, held, names, fields))
                self._stages.size += 1 + len(moves)
        if len(known) >= REMEMBERED:
            known.clear()
        return known.setdefault(event_class, tuple(found))

    def _may_take(self, move: StageMove) -> bool:
        """Whether a partial match may take a node of its own part, or begin that part."""
        if not self._components:
            return True
        part, own = self._part_of[move.node], self._own(move.stage.sample)
        return own & part.nodes > 0 if own else not self._begun & part.nodes

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        if not reading.hits or reading.hits is QUIET.hits:
            self.noted = False
            return _UNKNOWN
        found, ended = list[NewMatch](), dict[int, StageGroup]()
        begun, stages, groups = self._begun, self._stages, self._groups
        for order, (values, moves, held, _, _) in enumerate(reading.hits):
            for move, place in moves:
                group, count = groups[move.stage], len(found)
                parts: Sequence[tuple[Iterable[Member], tuple[tuple[Term, Extreme], ...] | None]] = group.everyone
                compared, joint = move.compared, move.joint
                many = len(group.members) > _MANY  # few members are visited without the index
                if move.scan or compared or many:
                    scan = move.scan or stages.scan(move)
                    if scan.orders and (many or scan.orders[0].term is not None):
                        parts, compared = self._concerned(group, scan, values), ()
                for members, enough in parts:
                    for member in members:
                        number, before, last, _ = member
                        if compared and not agree(compared, before, values):
                            continue
                        bound = {**values, **before} if before else values
                        judged = tuple([holds(bound) for holds in joint.values()]) if joint else ()
                        outcome = stages.outcome(move, held, judged)
                        if outcome is None:
                            continue
                        stage, commits_to_it = outcome
                        if commits_to_it and self._components and not self._own(move.stage.sample):
                            begun |= self._part_of[move.node].nodes  # other parts have yet to begin
                        elif commits_to_it:
                            ended[number] = group
                        binding = stage.remembered(move.timed(bound) if move.registers else bound)
                        step = _new(Witness, (last, move.node, position, values))
                        rivals = groups.get(stage)
                        rank = UNRANKED if rivals is None else rivals.rank(binding, step)
                        if rivals is None or not rivals.excels(rank):
                            found.append(_new(NewMatch, ((number, order, place), stage, binding, step, rank)))
                        if enough is not None and all(one.value(binding) == own.of(values) for one, own in enough):
                            break
                if len(found) > count:
                    self.matching.effort.spend(NEW * (len(found) - count), "new partial matches")
        self.noted = bool(found or ended)
        if begun != self._begun:
            self._begun, self._set = begun, None
        if self.noted:
            self._quiet.clear()
            return self._change(found, ended)
        if len(self._quiet) > REMEMBERED:
            self._quiet.clear()
        self._quiet.update([hit.key for hit in reading.hits])
        return _UNKNOWN

    def _concerned(
        self, group: StageGroup, scan: Scan, values: Mapping[str, Json]
    ) -> Sequence[tuple[Iterable[Member], tuple[tuple[Term, Extreme], ...] | None]]:
        """Return the members that may make a move, with stop conditions."""
        required = [term(values) for term in scan.terms]
        if UNDEFINED in required:
            return ()
        least, lanes, enough, last_first = -1, list[tuple[list[LaneMember], int, int]](), None, False
        for order in scan.orders:
            found = group.between(scan.names, required, order.term, order.bounds, values)
            count = sum([end - start for _, start, end in found])
            if least < 0 or count < least:
                least, lanes, enough, last_first = count, found, order.enough, order.last_first
            if least <= 1:
                break
        return [(in_order(*lane, last_first=last_first), enough) for lane in lanes]

    def _change(self, found: list[NewMatch], ended: Mapping[int, StageGroup]) -> Verdict:
        added, groups = found, self._groups
        if len(found) > 1:
            found.sort()
            added = []
        for new in found:
            _, stage, binding, last, rank = new
            if added is not found:
                if stage in groups:
                    rank = groups[stage].rank(binding, last)
                    if groups[stage].excels(rank):
                        continue
                added.append(new)
            self._add(stage, binding, last, rank)
        for number, group in ended.items():
            group.remove(number)
        if ended:
            self._drop_empty()
        if self._added > self.limit:
            self._bound(sum([len(group.members) for group in groups.values()]))
        able = added if self._components else [one for one in added if one.stage.is_match]
        if not able and not self._stages.is_full:
            return _UNKNOWN
        made = [(one.stage, one.stage.configuration(one.binding, one.last)) for one in able]
        if self._components:
            made = [(stage, one) for stage, one in self._join(made) or made if stage.is_match]
            made = [(stage, whole) for stage, one in made if (whole := self._in_order(one)) is not None]
        self.matches = [one for _, one in made]
        if made:
            self._detected(self.matches)
            return Verdict.TRUE
        if self._stages.is_full:
            self.follow(self.partial)
        return _UNKNOWN

    def _join(self, added: Iterable[tuple[Stage, Configuration]]) -> list[tuple[Stage, Configuration]]:
        """Find a match of a component with a new match of a part, and extend all others by it.

        Returns all partial matches with their stages then, and nothing without such a match.
        """
        for stage, configuration in added:
            part = self._part_of[next(bits(self._own(configuration)))]
            if not self._is_complete(stage, part):
                continue
            component = next(one for one in self._components if part in one.parts)
            others = [one for one in component.parts if one is not part]
            whole = None if component.chooses else self._match(component, configuration, others)
            if whole is not None:
                joined = [self._joined(one, whole.witness) for one in self.partial if self._own(one) & ~component.nodes]
                self._base = whole
                self.follow([whole, *(one for one in joined if one is not None)])
                held = [(stage, one) for stage, group in self._groups.items() for one in group.members.values()]
                return [(stage, stage.configuration(one.binding, one.last)) for stage, one in held]
        return []

    def _is_complete(self, stage: Stage, part: IndependentPart) -> bool:
        return not part.events & ~stage.sample.taken

    def _match(
        self, component: Component, configuration: Configuration, parts: Sequence[IndependentPart]
    ) -> Configuration | None:
        """Return a match of a component that extends a partial match by matches of these parts."""
        if not parts:
            holds = not component.nodes & (configuration.dead | ~(configuration.closed | configuration.held))
            return configuration if holds else None
        ways = [(part, [*self._agreeing(part, configuration.binding)]) for part in parts]
        part, lanes = min(ways, key=lambda way: sum(end - start for _, start, end in way[1]))
        rest = [one for one in parts if one is not part]
        for lane in lanes:
            for member in in_order(*lane, last_first=False):
                self.matching.effort.spend(len(component.parts), "joins of the matches of independent parts")
                joined = self._joined(configuration, member.last)
                whole = None if joined is None else self._match(component, joined, rest)
                if whole is not None:
                    return whole
        return None

    def _agreeing(
        self, part: IndependentPart, binding: Mapping[str, Json]
    ) -> Iterator[tuple[list[LaneMember], int, int]]:
        """Iterate over the matches of a part that may agree with these values."""
        if part not in self._complete:
            stages = [(stage, group) for stage, group in self._groups.items() if self._own(stage.sample) & part.nodes]
            self._complete[part] = [(stage, group) for stage, group in stages if self._is_complete(stage, part)]
        for stage, group in self._complete[part]:
            names, terms = self._stages.equalities(frozenset(binding), stage)
            required = [term(binding) for term in terms]
            if UNDEFINED not in required:
                yield from group.between(names, required, None, (), binding)

    def forget(self, watermark: int) -> None:
        """Set the watermark and drop what it rules out."""
        self._watermark = watermark
        for group in self._groups.values():
            group.forget(watermark)
        self._drop_empty()

    def _drop_empty(self) -> None:
        for stage in [stage for stage, group in self._groups.items() if not group.members]:
            del self._groups[stage]
            self._set = None
            self._complete.clear()

    def _add(self, stage: Stage, binding: dict[str, Json], last: Witness | None, rank: Rank = UNRANKED) -> None:
        group = self._groups.get(stage)
        if group is None:
            if len(self._groups) > self._most:
                named = self.compiled.some(bits(union(one.sample.taken for one in self._groups)))
                what = f"sets of events in partial matches; any of {named} may be skipped"
                raise TooLarge(what, limit=self._most, remedy=self.compiled.prop.remedy)
            group = self._groups[stage] = StageGroup(stage.ranking, stage.rank, stage.deadlines, self._watermark)
            self._set = None
            self._complete.clear()
        group.add(self._added, binding, last, rank)
        self._added += 1
        if not group.members:
            self._drop_empty()
