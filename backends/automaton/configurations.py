"""What is left to happen: configurations (`Remainder`), and the moves between them.

A configuration is what remains of a set of scenarios after some events have been matched. It forgets everything that cannot
matter any more, so equal configurations have equal futures. Choices are taken when an event decides them, or when something
that comes after them happens and they can be made without an event.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product
from typing import Final, NamedTuple

from backends.automaton.structure import Plan, Work, smallest
from rvaft.support.bits import bits, mask_of, union

_WIDE: Final = 1 << 61


class Remainder(NamedTuple):
    """Bit sets over one plan.

    `open`: events that must still happen, choices that are undecided, guards that must still hold at an event to come. `taken`: alternatives
    of undecided choices that are taken already. `broken`: guards that did not hold, so that no choice may bring them in.
    """

    plan: int
    open: int
    taken: int = 0
    broken: int = 0

    def __hash__(self) -> int:
        """By bytes: integers of many bits hash alike when one is the other shifted."""
        if self.open < _WIDE:
            return hash((self.plan, self.open, self.taken, self.broken))
        return hash((self.plan, self.open.to_bytes(self.open.bit_length() // 8 + 1), self.taken))


class Move(NamedTuple):
    """One more event of `atom`: `needed` guards must hold at it, `noted` ones that do not hold are broken from then on."""

    atom: int
    needed: int
    noted: int
    target: Remainder


class Moves:
    """The moves of the configurations of some plans; computed once for each configuration."""

    def __init__(self, plans: Sequence[Plan], work: Work) -> None:
        self._plans = plans
        self._work = work
        self._moves: dict[Remainder, tuple[Move, ...]] = {}

    def start(self) -> Iterator[Remainder]:
        """The configurations before any event."""
        for number, plan in enumerate(self._plans):
            yield self._tidy(Remainder(number, plan.start))

    def of(self, configuration: Remainder) -> tuple[Move, ...]:
        """The moves of a configuration, in a stable order."""
        if configuration not in self._moves:
            self._moves[configuration] = found = tuple(dict.fromkeys(self._find(configuration)))
            self._work.step(len(found) * (20 + self.width(configuration) // 10))
        return self._moves[configuration]

    def width(self, configuration: Remainder) -> int:
        """How many bits its sets may have: what steps cost grows with it."""
        return self._plans[configuration.plan].events.bit_length()

    def breaking(self, move: Move, holding: int) -> Remainder:
        """Where a move leads when of the guards it notes only these hold."""
        broken = move.noted & ~holding
        return self._tidy(move.target._replace(broken=move.target.broken | broken)) if broken else move.target

    def is_complete(self, configuration: Remainder) -> bool:
        """Whether nothing more needs to happen."""
        plan = self._plans[configuration.plan]
        if configuration.open & plan.events:
            return False
        return all(self._silently(configuration, choice) for choice in bits(configuration.open & plan.choosing))

    def dominates(self, one: Remainder, other: Remainder) -> bool:
        """Whether `one` completes on every word on which `other` does, when events may be left out."""
        if one.plan != other.plan or one.open & ~other.open or one.broken & ~other.broken:
            return False
        behind = other.taken & ~one.taken
        if not behind:
            return True
        plan = self._plans[one.plan]
        return not any(plan.choices[choice].mask & behind for choice in bits(one.open & plan.choosing))

    def _find(self, configuration: Remainder) -> Iterator[Move]:
        plan = self._plans[configuration.plan]
        for event in self._candidates(configuration):
            moment = plan.moments[event]
            entered = self._enter(configuration, event)
            if entered is None or moment.before & entered.open & plan.events:
                continue
            for settled in self._settle(entered, moment.before & entered.open & plan.choosing):
                target = settled._replace(open=settled.open & ~(1 << event))
                needed = moment.bound & settled.open
                noted = moment.bound & ~needed
                noted &= self._possible(target) if noted else 0
                yield Move(moment.atom, needed, noted, self._tidy(target))

    def _candidates(self, configuration: Remainder) -> Iterator[int]:
        """Events that may be next: nothing that waits is known to come before them."""
        plan = self._plans[configuration.plan]
        waiting = configuration.open & plan.events
        while waiting:
            event = (waiting & -waiting).bit_length() - 1
            yield event
            waiting &= ~(1 << event | plan.moments[event].after)
        untaken = self._untaken(configuration)
        yield from bits(union(plan.alternatives[number].first for number in untaken))

    def _untaken(self, configuration: Remainder) -> Iterator[int]:
        """The alternatives of undecided choices that are not taken."""
        plan = self._plans[configuration.plan]
        for choice in bits(configuration.open & plan.choosing):
            yield from bits(plan.choices[choice].mask & ~configuration.taken)

    def _possible(self, configuration: Remainder) -> int:
        """All that a choice may still bring in."""
        alternatives = self._plans[configuration.plan].alternatives
        return union(alternatives[number].whole for number in self._untaken(configuration))

    def _enter(self, configuration: Remainder, event: int) -> Remainder | None:
        """Take the alternatives that an event is below, or None where that is no longer possible."""
        if configuration.open >> event & 1:
            return configuration
        plan = self._plans[configuration.plan]
        path: list[int] = []
        number = plan.moments[event].alternative
        while number is not None:
            path.append(number)
            if configuration.open >> plan.alternatives[number].choice & 1:
                break
            number = plan.alternatives[number].up
        else:
            return None
        entered: Remainder | None = configuration
        while path and entered is not None:
            entered = self._take(entered, path.pop())
        return entered

    def _take(self, configuration: Remainder, number: int) -> Remainder | None:
        plan = self._plans[configuration.plan]
        alternative = plan.alternatives[number]
        if configuration.taken >> number & 1 or alternative.mandatory & configuration.broken:
            return None
        choice = plan.choices[alternative.choice]
        taken = configuration.taken & choice.mask | 1 << number
        decided = taken == choice.mask or (not choice.more and taken.bit_count() == choice.least)
        return configuration._replace(
            open=configuration.open & ~(decided << alternative.choice) | alternative.mandatory,
            taken=configuration.taken & ~choice.mask if decided else configuration.taken | taken,
        )

    def _settle(self, configuration: Remainder, choices: int) -> Iterator[Remainder]:
        """Decide these choices without an event, in every way that is not worse than another."""
        if not choices:
            yield configuration
            return
        plan = self._plans[configuration.plan]
        ways = [self._silently(configuration, choice) for choice in bits(choices)]
        taken = configuration.taken & ~union(plan.choices[choice].mask for choice in bits(choices))
        for guards in smallest(union(chosen) for chosen in product(*ways)):
            yield configuration._replace(open=configuration.open & ~choices | guards, taken=taken)

    def _silently(self, configuration: Remainder, number: int) -> tuple[int, ...]:
        """The smallest sets of guards with which a choice is decided without an event."""
        plan = self._plans[configuration.plan]
        choice = plan.choices[number]
        missing = choice.least - (configuration.taken & choice.mask).bit_count()
        if missing <= 0:
            return (0,)
        untaken = (plan.alternatives[one].silent for one in bits(choice.silent & ~configuration.taken))
        able = [ways for silent in untaken if (ways := [one for one in silent if not one & configuration.broken])]
        return smallest(union(one) for some in combinations(able, missing) for one in product(*some))

    def _tidy(self, configuration: Remainder) -> Remainder:
        """Forget guards that no event and no choice to come can touch."""
        plan = self._plans[configuration.plan]
        required = configuration.open & plan.guards
        if not (required or configuration.broken):
            return configuration
        possible = self._possible(configuration)
        coming = configuration.open | possible
        idle = mask_of(guard for guard in bits(required) if not plan.binders[guard] & coming)
        return configuration._replace(open=configuration.open & ~idle, broken=configuration.broken & possible)


class Successors:
    """Where the letters of one state lead: the configurations of each atom found once, then put together as bit sets.

    Where a state has many overlapping atoms there are exponentially many letters, so what concerns a pair of configurations
    is looked at once for the state. `kept` are configurations that stay whatever happens, none of which dominates another one; under
    `scattered`, where events may be left out, they are those of the state, and a configuration that another one dominates is dropped.
    """

    def __init__(self, moves: Moves, state: Sequence[Remainder], *, scattered: bool, work: Work) -> None:
        self._moves = moves
        self._by_atom: dict[int, list[Move]] = {}
        for configuration in state:
            for move in moves.of(configuration):
                self._by_atom.setdefault(move.atom, []).append(move)
        self.sees = mask_of(self._by_atom)
        self._guards = {atom: union(one.needed | one.noted for one in own) for atom, own in self._by_atom.items()}
        self._scattered = scattered
        self._kept = state if scattered else ()
        self._work = work
        self._found = list(self._kept)
        self._bit: dict[Remainder, int] = {}
        self._worse = [0] * len(self._found)  # for each configuration found, those that it dominates
        self._reached: dict[tuple[int, int], int | None] = {}
        self._best: dict[int, frozenset[Remainder]] = {}

    def asked(self, atoms: int) -> int:
        """The guards that matter when these atoms are true."""
        return union(self._guards[atom] for atom in bits(atoms))

    def of(self, atoms: int, holding: int) -> frozenset[Remainder] | None:
        """The configurations after a letter, or None where one of them is complete."""
        together = (1 << len(self._kept)) - 1
        for atom in bits(atoms):
            case = atom, holding & self._guards[atom]
            if case not in self._reached:
                self._reached[case] = self._lead(*case)
            reached = self._reached[case]
            if reached is None:
                return None
            together |= reached
        self._work.step(1)
        if together not in self._best:
            best = together & ~union(self._worse[index] for index in bits(together))
            self._best[together] = frozenset(self._found[index] for index in bits(best))
        return self._best[together]

    def _lead(self, atom: int, holding: int) -> int | None:
        """What the moves of one atom lead to, or None where one of them is complete."""
        moves = self._by_atom[atom]
        self._work.step(len(moves))
        moved = [self._moves.breaking(move, holding) for move in moves if not move.needed & ~holding]
        if any(self._moves.is_complete(configuration) for configuration in moved):
            return None
        for configuration in moved:
            if configuration not in self._bit:
                self._bit[configuration] = self._new(configuration)
        return union(self._bit[configuration] for configuration in moved)

    def _new(self, configuration: Remainder) -> int:
        """The bit of a configuration; none where one that is kept dominates it."""
        dominates = self._moves.dominates
        bit, worse = 1 << len(self._found), 0
        if self._scattered:
            self._work.step(len(self._found) * (10 + self._moves.width(configuration) // 50))
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


def undominated(configurations: Iterable[Remainder], moves: Moves, work: Work) -> list[Remainder]:
    """The configurations without those that another one dominates."""
    best: list[Remainder] = []
    for one in sorted(configurations):
        work.step(len(best))
        if not any(moves.dominates(other, one) for other in best):
            best = [*(other for other in best if not moves.dominates(one, other)), one]
    return best
