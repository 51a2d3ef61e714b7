"""`scattered` in general: a partial match may pass over any event, so that the ones before an event stay beside the ones after it.

Most events of a long trace change nothing. So it is kept what is known to change nothing as long as the partial matches are the same:
letters that none of them can take, outcomes of guards that the event alone decides with which none can, values that were there
before. Where an event may do something, the partial matches that it concerns are found by their stages and by the values that it must
repeat.

A partial match is dropped where another can do all that it can (see `commitment` and `dominance`).
"""

from collections.abc import Hashable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field
from itertools import islice
from typing import Final, NamedTuple, Self

from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.following import Following
from rvaft.engine.groups import Group, Member
from rvaft.engine.letters import Hit, Letters, Reading
from rvaft.engine.plan import Plan
from rvaft.engine.stages import Move, Stage, Stages
from rvaft.engine.variables import exact
from rvaft.predicates import Predicate
from rvaft.values import Json
from rvaft.verdict import Verdict

MEMORY: Final = 20_000
"""How many values are remembered that were there before."""

_PLAIN: Final = (str, int, float)
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

    def read(self, event: Json) -> Reading:
        """What an event means; whether it is relevant does not matter here."""
        return self.letters.read(event, relevance=False)

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
                if len(watch.names) == 1 and type(value := values[watch.names[0]]) in _PLAIN:
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
            if len(self._quiet) > MEMORY:
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
