"""The strategy for trees with absent events (`without`), under all semantics.

Partial matches are grouped by stage (see `stages`). A partial match with an open clause is marked
when the absent event comes or can come no more: a *mark* leads to another stage, as an event does
(see `configuration.Mark`). A match whose clauses are not all decided waits; the heap of deadlines
has the times that decide.

Under `scattered`, subsumed partial matches are dropped (see `subsumption`). Of two with the same
events taken, the same values and open clauses, an absent event breaks both or, if only one, the one
with the later deadline, which would be decided later. Events that came before a part are remembered
by value. Whether one of them breaks a clause depends on which events a partial match has used, so
partial matches that used different ones are different.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from heapq import heapify, heappop, heappush
from itertools import chain
from math import inf
from typing import Any, Final, NamedTuple, Self

from rvaft.engine.all_matches import Following
from rvaft.engine.compiled_tree import NOTHING, AbsenceClause, CompiledTree, EventClass, Reading, TreeLetters
from rvaft.engine.configuration import Configuration, Mark, Witness, events_of, history
from rvaft.engine.partial_matches import NEW
from rvaft.engine.settled_choices import SettledChoices
from rvaft.engine.stage_group import UNRANKED, Member, StageGroup
from rvaft.engine.stages import Stage, StageMove, Stages, agree
from rvaft.model.guards import Predicate, predicate
from rvaft.model.nodes import Side
from rvaft.model.patterns import rigid_variables
from rvaft.model.values import Json, equal, exact, fingerprint
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Absence, Explanation

_MANY: Final = 4
"""The maximum number of members to visit without the index."""
_STALE: Final = 1_000
"""The minimum number of deadlines without a partial match before they are removed."""


class AbsentCall(NamedTuple):
    """A clause with the test of its guard, and its variables that the absent event repeats."""

    clause: AbsenceClause
    guard: Predicate | None
    names: tuple[str, ...]
    alone: bool
    """Whether the event alone decides the guard."""

    @classmethod
    def of(cls, clause: AbsenceClause) -> "AbsentCall":
        """Return the call of a clause."""
        part = clause.part
        own = rigid_variables(part.pattern)
        names = tuple(name for name in part.shared if name in own)
        guard = None if part.guard is None else predicate(part.guard)
        return cls(clause, guard, names, clause.decided_by_event)

    def matches(self, binding: Mapping[str, Json], values: Mapping[str, Json]) -> bool:
        """Whether an event with these values is the absent one, for the values of a partial match."""
        if not all(equal(binding[name], values[name]) for name in self.names):
            return False
        return self.guard is None or self.alone or self.guard({**binding, **values})


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """The clauses of a stage."""

    open: tuple[AbsenceClause, ...]
    """The clauses that a later event may break."""
    waits: tuple[AbsenceClause, ...]
    """Those of them that wait for a time."""


class Came(NamedTuple):
    """An event that may be absent before a part: its position, time and values."""

    position: int
    time: int | None
    values: Mapping[str, Json]


@dataclass(slots=True)
class Past:
    """The events of a clause `before` in the trace so far, by the values that a match must repeat."""

    events: dict[Hashable, list[Came]] = field(default_factory=dict)
    count: int = 0


class AbsentEvents(Following):
    """The partial matches by stage; a mark or an event leads from one stage to another."""

    joins = True
    sees_irrelevant = True

    def __init__(
        self,
        compiled: CompiledTree,
        letters: TreeLetters,
        semantics: Semantics,
        *,
        limit: int,
        early: bool = True,
        repeat_by: str | None = None,
    ) -> None:
        early = early and semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
        super().__init__(compiled, letters, limit=limit, early=early, repeat_by=repeat_by)
        self.semantics = semantics
        self._scattered = semantics is Semantics.SCATTERED
        self._stages = Stages(self.matching, SettledChoices(compiled) if self._scattered else None)
        self._calls = {node: AbsentCall.of(clause) for node, clause in compiled.clauses.items()}
        after = [one for one in compiled.clauses.values() if one.part.side is Side.AFTER]
        before = [one for one in compiled.clauses.values() if one.part.side is Side.BEFORE]
        self.sees_times = bool(after)
        self._before = {one.node: one for one in before}
        time = compiled.prop.time
        self._late = 0 if time is None else time.late or 0
        self._ordered = time is not None and time.late is not None
        self._standing: dict[Stage, Standing] = {}
        self._marked: dict[tuple[Stage, Mark, int], Stage | None] = {}
        self._most_used = sum(compiled.own) + 1
        self._past: dict[int, Past] = {node: Past() for node in self._before}
        self._watermark: int | None = None
        self._begin()

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Replace the followed partial matches."""
        if self._stages.is_full:
            self._stages.clear()
            self._standing.clear()
            self._marked.clear()
        self._groups: dict[Stage, StageGroup] = {}
        self._deadlines: list[tuple[int, int, Stage, AbsenceClause]] = []
        self._added = 0
        for one in configurations:
            self._add(self._stages.of(one), one.binding, one.witness)

    def go_on_after(self, earlier: Self) -> None:
        """Remember the events of the whole trace."""
        self._past = earlier._past

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = super().fork()
        twin._past = {  # noqa: SLF001 (its own)
            node: Past({key: [*some] for key, some in past.events.items()}, past.count)
            for node, past in self._past.items()
        }
        return twin

    @property
    def _members(self) -> list[tuple[Stage, Member]]:
        members = [(stage, member) for stage, group in self._groups.items() for member in group.members.values()]
        return sorted(members, key=lambda one: one[1].number)

    @property
    def partial(self) -> list[Configuration]:
        """The followed partial matches."""
        return [stage.configuration(member.binding, member.last) for stage, member in self._members]

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        members, came = self._members, list[tuple[int, Came]]()
        used = [self._used(one.last) if self._before else () for _, one in members]
        for node, past in self._past.items():
            came += ((node, one) for some in past.events.values() for one in some)
        # only the order of positions matters
        rank = {one: at for at, one in enumerate(sorted({*chain(*used), *(one.position for _, one in came)}))}
        found = frozenset(
            (self._stages.place(stage), fingerprint(one.binding), tuple(rank[position] for position in own))
            for (stage, one), own in zip(members, used, strict=True)
        )
        return found, frozenset((node, rank[one.position], one.time, fingerprint(one.values)) for node, one in came)

    @staticmethod
    def _used(last: Witness | None) -> tuple[int, ...]:
        return tuple(step.position for step in events_of(last))

    def snapshot(self) -> object:
        """Return the state for `restore`."""
        past = {
            node: ([(key, [tuple(one) for one in some]) for key, some in past.events.items()], past.count)
            for node, past in self._past.items()
        }
        return super().snapshot(), past

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same tree."""
        own, past = snapshot
        super().restore(own)
        self._past = {
            node: Past({key: [Came(*one) for one in some] for key, some in events}, count)
            for node, (events, count) in past.items()
        }

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the event with its class, if it may change anything."""
        if not (self.sees_times or event_class.relevant or event_class.serving or event_class.breaking):
            return NOTHING
        return Reading(event_class.relevant, (event, event_class))

    def forget(self, watermark: int) -> None:
        """Set the watermark and drop what it rules out."""
        self._watermark = watermark
        if self._scattered:
            for group in self._groups.values():
                group.forget(watermark)
            self._drop_empty()

    def _drop_empty(self) -> None:
        for stage in [stage for stage, group in self._groups.items() if not group.members]:
            del self._groups[stage]

    # One event: clauses are decided, partial matches are extended, and those before it are broken.

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        event, event_class = reading.hits or ({}, EventClass())
        self.matching.effort.begin()
        time = self.letters.time(event) if reading.hits else None
        before = self._members if self.semantics in (Semantics.STRICT, Semantics.PROJECTED) else []
        if time is not None:
            self._decide(time, position)
        counts = self._scattered or self.semantics is Semantics.STRICT or reading.relevant
        found = [*self._extensions(event, event_class, time, position)] if counts and event_class.serving else []
        self.noted = bool(found)
        if counts and not self._scattered:
            self._end_others(position)
        if event_class.breaking:
            self._break(event, event_class, time, position)
        for stage, binding, last in found:
            self._add(stage, binding, last)
        if event_class.breaking:
            self._remember(event, event_class, time, position)
        if self.semantics is Semantics.CONSECUTIVE and counts:
            start = self.matching.start()
            self._add(self._stages.of(start), start.binding, None)
        self._bound(sum(len(group.members) for group in self._groups.values()))
        if self._detect():
            return Verdict.TRUE
        if self._stages.is_full:
            self.follow(self.partial)
        if not self._groups:
            self.lost = [stage.configuration(member.binding, member.last) for stage, member in before]
            return Verdict.FALSE
        return Verdict.UNKNOWN

    def pass_time(self, time: int) -> Verdict:
        """Return the verdict after the time has come, without an event."""
        self._decide(time, 0)
        return Verdict.TRUE if self._detect() else Verdict.UNKNOWN

    @property
    def deadline(self) -> float:
        """The least time after which `pass_time` changes the state; perhaps of a match that is gone."""
        return self._deadlines[0][0] if self._deadlines else inf

    def finish(self) -> Verdict:
        """Return the verdict after the end of the trace, which decides every clause."""
        return Verdict.TRUE if self._detect(finished=True) else Verdict.UNKNOWN

    def explain(self) -> Explanation:
        """Return a match of the lowest-numbered branch, with its absent events."""
        found = super().explain()
        positions = [one.event for one in found.matched]
        match = next(one for one in self.matches if [step.position for step in events_of(one.witness)] == positions)
        return replace(found, absences=tuple(self._absences(match)))

    def _absences(self, match: Configuration) -> Iterator[Absence]:
        steps = history(match.witness)
        marks = [(*Mark.of(step.node), step.position) for step in steps if step.node < 0]
        decided = {node: position for mark, node, position in marks if mark is Mark.DECIDED}
        for clause in self.compiled.clauses.values():
            inside = self.compiled.inside[clause.target]
            own = [step.position for step in steps if step.node >= 0 and inside >> step.node & 1]
            if not own:
                continue
            first: int | None
            last: int | None
            match clause.part.side:
                case Side.DURING:
                    first, last = own[0], own[-1]
                case Side.AFTER:
                    first, last = own[-1], decided.get(clause.node) or None
                case Side.BEFORE:
                    first, last = None, own[0]
            if first != last:
                yield Absence(clause.place[0], clause.event, clause.part.side, clause.part.duration, first, last)

    def _detect(self, *, finished: bool = False) -> bool:
        made = [
            stage.configuration(member.binding, member.last)
            for stage, group in self._groups.items()
            if stage.is_match and (finished or not self._of(stage).waits)
            for member in group.members.values()
        ]
        if made:
            self._detected(made)
        return bool(made)

    def _of(self, stage: Stage) -> Standing:
        found = self._standing.get(stage)
        if found is None:
            open_ = self.matching.open_clauses(stage.sample)
            waits = [clause for clause in open_ if clause.part.side is Side.AFTER]
            found = self._standing[stage] = Standing(tuple(open_), tuple(waits))
        return found

    def _mark(self, stage: Stage, mark: Mark, node: int) -> Stage | None:
        """Return the stage after a mark, or None if no match is left."""
        key = stage, mark, node
        if key not in self._marked:
            after = self.matching.marked(stage.sample, mark, node, 0)
            self._marked[key] = None if after is None else self._stages.of(after)
        return self._marked[key]

    def _move(self, stage: Stage, member: Member, mark: Mark, node: int, position: int) -> None:
        """Mark a partial match."""
        target = self._mark(stage, mark, node)
        if target is stage:
            return
        self._groups[stage].remove(member.number)
        if target is not None:
            last = Witness(member.last, mark.at(node), position, {})
            self._add(target, target.remembered(member.binding), last)

    def _add(self, stage: Stage, binding: dict[str, Json], last: Witness | None) -> None:
        group = self._groups.get(stage)
        if group is None:
            deadlines = stage.deadlines if self._scattered else ()
            group = self._groups[stage] = StageGroup(stage.ranking, stage.rank, deadlines, self._watermark)
        rank = UNRANKED
        if group.members:
            rank = group.rank(binding, last)
            if self._before:
                rank = rank._replace(place=(rank.place, self._used(last)))
            if group.excels(rank):
                return
        elif self._before:
            first = stage.rank(binding, last)
            rank = first._replace(place=(first.place, self._used(last)))
        self._added += 1
        number = self._added
        group.add(number, binding, last, rank)
        if number in group.members:
            for clause in self._of(stage).waits:
                self._wait(stage, clause, binding, number)
        elif not group.members:
            del self._groups[stage]

    def _end(self, clause: AbsenceClause, binding: Mapping[str, Json]) -> int | None:
        """Return the end of a part; None if undefined."""
        end = binding.get(self.compiled.register(clause.target).greatest)
        return end if type(end) is int else None

    def _wait(self, stage: Stage, clause: AbsenceClause, binding: Mapping[str, Json], number: int) -> None:
        end = self._end(clause, binding)
        if end is not None:
            deadline = end + (clause.part.duration or 0) + self._late
            heappush(self._deadlines, (deadline, number, stage, clause))  # numbers are different
        if len(self._deadlines) > _STALE and len(self._deadlines) > 2 * self._live_deadlines:
            groups = self._groups
            kept = [one for one in self._deadlines if one[2] in groups and one[1] in groups[one[2]].members]
            heapify(kept)
            self._deadlines = kept

    @property
    def _live_deadlines(self) -> int:
        return sum(len(group.members) * len(self._of(stage).waits) for stage, group in self._groups.items())

    def _decide(self, time: int, position: int) -> None:
        """Mark the clauses that a time decides; position 0 stands for no event."""
        while self._deadlines and self._deadlines[0][0] < time:
            _, number, stage, clause = heappop(self._deadlines)
            group = self._groups.get(stage)
            member = None if group is None else group.members.get(number)
            if member is not None:
                self._move(stage, member, Mark.DECIDED, clause.node, position)
        self._drop_empty()

    def _end_others(self, position: int) -> None:
        """End the partial matches that do not use an event that counts; matches wait on."""
        for stage, group in [*self._groups.items()]:
            for member in [*group.members.values()]:
                if stage.is_match:
                    self._move(stage, member, Mark.FINISHED, self.compiled.root, position)
                else:
                    group.remove(member.number)
        self._drop_empty()

    def _break(self, event: Mapping[str, Json], event_class: EventClass, time: int | None, position: int) -> None:
        """Mark the partial matches with a clause that an event breaks."""
        for admission in event_class.breaking:
            for values in self.letters.ways(admission, event, time):
                for node in admission.breaks:
                    call = self._calls[node]
                    for stage, group in [*self._groups.items()]:
                        if call.clause in self._of(stage).open:
                            for member in self._broken(call, group, values, time):
                                self._move(stage, member, Mark.BROKEN, node, position)
        self._drop_empty()

    def _broken(
        self, call: AbsentCall, group: StageGroup, values: Mapping[str, Json], time: int | None
    ) -> list[Member]:
        """Return the members of a stage that an event breaks."""
        found = []
        for member in _agreeing(group, call.names, values):
            if call.clause.part.side is Side.AFTER:
                end = self._end(call.clause, member.binding)
                if time is None or end is None or time > end + (call.clause.part.duration or 0):
                    continue
            if call.matches(member.binding, values):
                found.append(member)
        return found

    def _extensions(
        self, event: Mapping[str, Json], event_class: EventClass, time: int | None, position: int
    ) -> Iterator[tuple[Stage, dict[str, Json], Witness]]:
        """Iterate over the partial matches that use an event."""
        known = [self.letters.ways(one, event, time) for one in event_class.serving]
        for stage, group in [*self._groups.items()]:
            for number, move, _ in self._stages.moves(stage, event_class):
                admission, held = event_class.serving[number], event_class.held[number]
                for values in known[number]:
                    own = held | sum(bit for bit, holds in admission.own if holds(values))
                    yield from self._extended(group, move, values, own, position)

    def _extended(
        self, group: StageGroup, move: StageMove, values: Mapping[str, Json], held: int, position: int
    ) -> Iterator[tuple[Stage, dict[str, Json], Witness]]:
        compared, joint = move.compared, move.joint
        for member in _agreeing(group, compared, values):
            binding = member.binding
            if compared and not agree(compared, binding, values):
                continue
            bound = {**values, **binding} if binding else values
            judged = tuple([holds(bound) for holds in joint.values()]) if joint else ()
            outcome = self._stages.outcome(move, held, judged)
            if outcome is None:
                continue
            noted = move.timed(bound) if move.registers else bound
            last = Witness(member.last, move.node, position, values)
            self.matching.effort.spend(NEW, "new partial matches")
            made = self._judged(outcome[0], move, noted, last)
            if made is not None:
                yield made

    def _judged(
        self, stage: Stage, move: StageMove, bound: Mapping[str, Json], last: Witness
    ) -> tuple[Stage, dict[str, Json], Witness] | None:
        """Return a partial match after an event with the marks of its clauses, or None."""
        binding = stage.remembered(bound)
        for clause in self.compiled.clauses_around(move.node):
            part = clause.part
            register = self.compiled.register(clause.target)
            if part.side is Side.BEFORE and self._came_before(clause, bound, last):
                return None
            if part.duration is not None and bound[register.least] is None:
                target = self._mark(stage, Mark.BROKEN, clause.node)
                if target is None:
                    return None
                if target is not stage:
                    last = Witness(last, Mark.BROKEN.at(clause.node), last.position, {})
                    stage, binding = target, target.remembered(binding)
        return stage, binding, last

    # Events before a part.

    def _came_before(self, clause: AbsenceClause, bound: Mapping[str, Json], last: Witness) -> bool:
        """Whether an event that breaks `before` came, for a partial match with a new last event."""
        inside = self.compiled.inside[clause.target]
        own = [step.position for step in events_of(last) if inside >> step.node & 1]
        duration, first = clause.part.duration, own[0]
        if duration is None and len(own) > 1:
            return False  # known from the first event on
        start = 0 if duration is None else bound[self.compiled.register(clause.target).least]
        if type(start) is not int:
            return False
        call, used = self._calls[clause.node], {step.position for step in events_of(last)}
        values = _Latest(last)
        key = tuple(exact(values[name]) for name in call.names)
        for one in self._past[clause.node].events.get(key, ()):
            if one.position >= first or one.position in used:
                continue
            near = duration is None or (one.time is not None and one.time >= start - duration)
            if near and call.matches(values, one.values):
                return True
        return False

    def _remember(self, event: Mapping[str, Json], event_class: EventClass, time: int | None, position: int) -> None:
        """Remember an event for the clauses `before`."""
        for admission in event_class.breaking if self._before else ():
            nodes = [node for node in admission.breaks if node in self._before]
            for values in self.letters.ways(admission, event, time) if nodes else ():
                for node in nodes:
                    self._keep(self._calls[node], Came(position, time, values))

    def _keep(self, call: AbsentCall, came: Came) -> None:
        past = self._past[call.clause.node]
        some = past.events.setdefault(tuple(exact(came.values[name]) for name in call.names), [])
        duration = call.clause.part.duration
        if duration is None:
            alike = sum(fingerprint(one.values) == fingerprint(came.values) for one in some)
            if alike >= self._most_used:  # no match uses so many
                return
        elif came.time is None:
            return
        elif self._ordered and self._watermark is not None:
            least = self._watermark - duration
            some[:] = [one for one in some if one.time is not None and one.time >= least]
        some.append(came)


def _agreeing(group: StageGroup, names: tuple[str, ...], values: Mapping[str, Json]) -> list[Member]:
    """Return the members of a group; of many, by the index, only those with these values of some variables."""
    if not names or len(group.members) <= _MANY:
        return [*group.members.values()]
    lanes = group.between(names, [values[name] for name in names], None, (), values)
    return [one.member for lane, start, end in lanes for one in lane[start:end]]


class _Latest(Mapping[str, Json]):
    """The values of all variables that the events of a match have bound."""

    def __init__(self, last: Witness) -> None:
        self._values: dict[str, Json] = {}
        for step in events_of(last):
            self._values = {**step.values, **self._values}

    def __getitem__(self, name: str) -> Json:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)
