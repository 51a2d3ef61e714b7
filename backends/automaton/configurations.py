"""What is left to happen: configurations, and the moves between them.

A configuration is what remains of a set of scenarios after some events have been matched. It forgets everything that cannot
matter any more, so equal configurations have equal futures. Choices are taken when an event decides them, or when something
that comes after them happens and they can be made without an event.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Final

from backends.automaton.letters import Atoms, bits
from backends.automaton.structure import Choice, Plan, smallest

_WIDE: Final = 1 << 61


@dataclass(frozen=True, slots=True)
class Configuration:
    """Bit sets over one plan.

    `waiting`: events that must still happen. `undecided`: choices. `taken`: alternatives of undecided choices
    that are taken already. `required`: guards that must still hold at an event to come. `broken`: guards that did not hold, so
    that no choice may bring them in.
    """

    plan: int
    waiting: int
    undecided: int
    taken: int = 0
    required: int = 0
    broken: int = 0

    def __hash__(self) -> int:
        """By bytes: integers of many bits hash alike when one is the other shifted."""
        waiting, undecided = self.waiting, self.undecided
        if waiting | undecided >= _WIDE:
            return hash((self.plan, _bytes(waiting), _bytes(undecided), _bytes(self.taken)))
        return hash((self.plan, waiting, undecided, self.taken, self.required, self.broken))


@dataclass(frozen=True, slots=True)
class Move:
    """One more event of `atom`: `needed` guards must hold at it, `noted` ones that do not hold are broken from then on."""

    atom: int
    needed: int
    noted: int
    target: Configuration


class Moves:
    """The moves of the configurations of some plans; computed once for each configuration."""

    def __init__(self, plans: tuple[Plan, ...]) -> None:
        self._plans = plans
        self._moves: dict[Configuration, tuple[Move, ...]] = {}

    def start(self) -> Iterator[Configuration]:
        """The configurations before any event."""
        for number, plan in enumerate(self._plans):
            inside = plan.start
            yield self._tidy(Configuration(number, inside.events, inside.choices, required=inside.guards))

    def of(self, configuration: Configuration) -> tuple[Move, ...]:
        """The moves of a configuration, in a stable order."""
        if configuration not in self._moves:
            moves = self._find(configuration)
            self._moves[configuration] = tuple(dict.fromkeys(moves))
        return self._moves[configuration]

    def breaking(self, move: Move, holding: int) -> Configuration:
        """Where a move leads when of the guards it notes only these hold."""
        broken = move.noted & ~holding
        if not broken:
            return move.target
        return self._tidy(replace(move.target, broken=move.target.broken | broken))

    def complete(self, configuration: Configuration) -> bool:
        """Whether nothing more needs to happen."""
        if configuration.waiting:
            return False
        return all(self._silently(configuration, choice) for choice in bits(configuration.undecided))

    def dominates(self, one: Configuration, other: Configuration) -> bool:
        """Whether `one` completes on every word on which `other` does, when events may be left out."""
        if one.plan != other.plan:
            return False
        if one.waiting & ~other.waiting or one.undecided & ~other.undecided:
            return False
        if one.required & ~other.required or one.broken & ~other.broken:
            return False
        behind = other.taken & ~one.taken
        if not behind:
            return True
        choices = self._plans[one.plan].choices
        return not any(choices[choice].mask & behind for choice in bits(one.undecided))

    def _find(self, configuration: Configuration) -> Iterator[Move]:
        plan = self._plans[configuration.plan]
        for event in self._candidates(configuration):
            entered = self._enter(configuration, event)
            if entered is None:
                continue
            moment = plan.moments[event]
            if moment.events_before & entered.waiting:
                continue
            for settled in self._settle(entered, moment.choices_before & entered.undecided):
                target = replace(settled, waiting=settled.waiting & ~(1 << event))
                bound = plan.bound[event]
                needed = bound & settled.required
                noted = bound & ~settled.required
                noted &= self._possible_guards(target) if noted else 0
                yield Move(moment.atom, needed, noted, self._tidy(target))

    def _candidates(self, configuration: Configuration) -> Iterator[int]:
        """Events that may be next: nothing that waits is known to come before them."""
        plan = self._plans[configuration.plan]
        waiting = configuration.waiting
        while waiting:
            low = waiting & -waiting
            event = low.bit_length() - 1
            yield event
            waiting &= ~(low | plan.moments[event].events_after)
        first = 0
        for choice in bits(configuration.undecided):
            for alternative in plan.choices[choice].alternatives:
                if not configuration.taken >> alternative & 1:
                    first |= plan.alternatives[alternative].first
        yield from bits(first)

    def _enter(self, configuration: Configuration, event: int) -> Configuration | None:
        """Take the alternatives that an event is below, or None where that is no longer possible."""
        if configuration.waiting >> event & 1:
            return configuration
        plan = self._plans[configuration.plan]
        path: list[int] = []
        alternative = plan.moments[event].alternative
        while alternative is not None:
            path.append(alternative)
            if configuration.undecided >> plan.alternatives[alternative].choice & 1:
                break
            alternative = plan.alternatives[alternative].up
        else:
            return None
        entered = configuration
        for step in reversed(path):
            taken = self._take(entered, step)
            if taken is None:
                return None
            entered = taken
        return entered

    def _take(self, configuration: Configuration, number: int) -> Configuration | None:
        plan = self._plans[configuration.plan]
        alternative = plan.alternatives[number]
        inside = alternative.mandatory
        if configuration.taken >> number & 1 or inside.guards & configuration.broken:
            return None
        choice = plan.choices[alternative.choice]
        taken = configuration.taken & choice.mask | 1 << number
        decided = taken == choice.mask or (not choice.more and taken.bit_count() == choice.least)
        return replace(
            configuration,
            waiting=configuration.waiting | inside.events,
            undecided=configuration.undecided & ~(decided << alternative.choice) | inside.choices,
            taken=configuration.taken & ~choice.mask if decided else configuration.taken | taken,
            required=configuration.required | inside.guards,
        )

    def _settle(self, configuration: Configuration, choices: int) -> Iterator[Configuration]:
        """Decide these choices without an event, in every way that is not worse than another."""
        if not choices:
            yield configuration
            return
        plan = self._plans[configuration.plan]
        ways = [self._silently(configuration, choice) for choice in bits(choices)]
        taken = configuration.taken
        for choice in bits(choices):
            taken &= ~plan.choices[choice].mask
        for guards in smallest(_union(chosen) for chosen in product(*ways)):
            yield replace(
                configuration,
                undecided=configuration.undecided & ~choices,
                taken=taken,
                required=configuration.required | guards,
            )

    def _silently(self, configuration: Configuration, number: int) -> tuple[int, ...]:
        """The smallest sets of guards with which a choice is decided without an event."""
        plan = self._plans[configuration.plan]
        choice = plan.choices[number]
        taken = configuration.taken & choice.mask
        missing = choice.least - taken.bit_count()
        if missing <= 0:
            return (0,)
        able = [ways for ways in self._silent_ways(plan, choice, taken, configuration.broken) if ways]
        chosen = combinations(able, missing)
        return smallest(_union(one) for some in chosen for one in product(*some))

    @staticmethod
    def _silent_ways(plan: Plan, choice: Choice, taken: int, broken: int) -> Iterator[list[int]]:
        for alternative in choice.alternatives:
            if not taken >> alternative & 1:
                yield [guards for guards in plan.alternatives[alternative].silent if not guards & broken]

    def _possible_guards(self, configuration: Configuration) -> int:
        """The guards that a choice may still bring in."""
        plan = self._plans[configuration.plan]
        guards = 0
        for choice in bits(configuration.undecided):
            for alternative in plan.choices[choice].alternatives:
                if not configuration.taken >> alternative & 1:
                    guards |= plan.alternatives[alternative].whole.guards
        return guards

    def _tidy(self, configuration: Configuration) -> Configuration:
        """Forget guards that no event and no choice to come can touch."""
        if not (configuration.required or configuration.broken):
            return configuration
        plan = self._plans[configuration.plan]
        events = configuration.waiting
        for choice in bits(configuration.undecided):
            for alternative in plan.choices[choice].alternatives:
                if not configuration.taken >> alternative & 1:
                    events |= plan.alternatives[alternative].whole.events
        required = _union(1 << guard for guard in bits(configuration.required) if plan.binders[guard] & events)
        broken = configuration.broken & self._possible_guards(configuration)
        return replace(configuration, required=required, broken=broken)


def _bytes(mask: int) -> bytes:
    return mask.to_bytes(mask.bit_length() // 8 + 1, "little")


def _union(masks: Iterator[int] | tuple[int, ...]) -> int:
    union = 0
    for mask in masks:
        union |= mask
    return union


# Where the letters of one state lead: the configurations of each atom found once, then put together as bit sets.
#
# Letters that make several atoms true lead where their atoms lead together. Where a state has many overlapping atoms there are
# exponentially many such letters, so what concerns a pair of configurations is looked at once for the state, not once for a letter.


class Successors:
    """The successors of one state.

    `kept` are configurations that stay whatever happens, none of which dominates another one (under `scattered`, where an event
    may be left out); with them, a configuration that another one dominates is dropped. `step` is told how much is done.
    """

    def __init__(
        self,
        moves: Moves,
        by_atom: Mapping[int, Sequence[Move]],
        kept: Sequence[Configuration],
        *,
        dominating: bool,
        step: Callable[[int], None],
    ) -> None:
        self._moves = moves
        self._by_atom = by_atom
        self._kept = kept
        self._dominating = dominating
        self._step = step
        self._guards = {atom: _guards(own) for atom, own in by_atom.items()}
        self._found = list(kept)
        self._bit: dict[Configuration, int] = {}
        self._worse = [0] * len(kept)
        """For each configuration found, those that it dominates, as bits."""
        self._of: dict[tuple[int, int], int | None] = {}
        self._best: dict[int, frozenset[Configuration]] = {}

    def guards(self, atoms: Atoms) -> int:
        """The guards that matter when these atoms are true."""
        guards = 0
        for atom in bits(atoms):
            guards |= self._guards[atom]
        return guards

    def of(self, atoms: Atoms, holding: int) -> frozenset[Configuration] | None:
        """The configurations after a letter, or None where one of them is complete."""
        together = (1 << len(self._kept)) - 1
        for atom in bits(atoms):
            reached = self._reached(atom, holding & self._guards[atom])
            if reached is None:
                return None
            together |= reached
        self._step(1)
        if together not in self._best:
            self._best[together] = frozenset(self._undominated(together))
        return self._best[together]

    def _undominated(self, together: int) -> Iterable[Configuration]:
        worse = 0
        for index in bits(together):
            worse |= self._worse[index]
        return (self._found[index] for index in bits(together & ~worse))

    def _reached(self, atom: int, holding: int) -> int | None:
        """What the moves of one atom lead to, or None where one of them is complete."""
        if (atom, holding) not in self._of:
            self._of[atom, holding] = self._lead(atom, holding)
        return self._of[atom, holding]

    def _lead(self, atom: int, holding: int) -> int | None:
        moves = self._by_atom[atom]
        self._step(len(moves))
        moved = [self._moves.breaking(move, holding) for move in moves if not move.needed & ~holding]
        if any(self._moves.complete(configuration) for configuration in moved):
            return None
        reached = 0
        for configuration in moved:
            if configuration not in self._bit:
                self._bit[configuration] = self._new(configuration)
            reached |= self._bit[configuration]
        return reached

    def _new(self, configuration: Configuration) -> int:
        """The bit of a configuration; none where one that is kept dominates it."""
        dominates = self._moves.dominates
        bit, worse = 1 << len(self._found), 0
        if self._dominating:
            self._step(len(self._found))
            if any(dominates(other, configuration) for other in self._kept):
                return 0
            for index, other in enumerate(self._found):
                if dominates(other, configuration):
                    self._worse[index] |= bit
                elif dominates(configuration, other):
                    worse |= 1 << index
        self._found.append(configuration)
        self._worse.append(worse)
        return bit


def _guards(moves: Iterable[Move]) -> int:
    guards = 0
    for move in moves:
        guards |= move.needed | move.noted
    return guards
