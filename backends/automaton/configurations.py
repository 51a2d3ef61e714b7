"""What is left to happen: configurations (`Remainder`), and the moves between them.

A configuration is what remains of a set of scenarios after some events have been matched. It
forgets everything that cannot matter any more, so equal configurations have equal futures. Choices
are taken when an event decides them, or when something that comes after them happens and they can
be made without an event.

A graph whose choices can all wait is laid out as tables of bit sets (`Plan`), and a step of the
construction is a handful of operations on integers. Guards (the bits of their propositions),
choices and events have one numbering, in this order.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product
from math import comb
from typing import Final, NamedTuple, assert_never

from backends.automaton.structure import Structure, Work
from rvaft.core.part_numbers import NumberedPart, NumberedParts, PartKind
from rvaft.core.property import Condition
from rvaft.support.bits import bits, mask_of, union

_WIDE: Final = 1 << 61


class Remainder(NamedTuple):
    """Bit sets over one plan.

    `open`: events that must still happen, choices that are undecided, guards that must still hold
    at an event to come. `taken`: alternatives of undecided choices that are taken already.
    `broken`: guards that did not hold, so that no choice may bring them in.
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
    """One more event of `atom`.

    `needed` guards must hold at it, `noted` ones that do not hold are broken from then on.
    """

    atom: int
    needed: int
    noted: int
    target: Remainder


class Alternative(NamedTuple):
    """One child of a choice. `up` is the alternative that contains the choice, if any.

    `mandatory` comes with choosing it, `whole` is all that may; `first` are the events it can begin with, `silent` the
    smallest sets of guards with which it is complete without an event.
    """

    choice: int
    up: int | None
    mandatory: int
    whole: int
    first: int
    silent: tuple[int, ...]


class Choice(NamedTuple):
    """A choice.

    Its alternatives, those of them that can be complete without an event, how many at least, and
    whether more may be taken.
    """

    mask: int
    silent: int
    least: int
    more: bool


class Moment(NamedTuple):
    """One occurrence.

    Its atom, the guards on its variables, the alternative it is below, what comes before it and
    what after.
    """

    atom: int
    bound: int
    alternative: int | None
    before: int
    after: int


class Plan:
    """The tables of one graph, and the moves of its configurations.

    `TooLarge` when a choice has too many ways to be made silently.
    """

    def __init__(self, structure: Structure, form: NumberedParts, number: int, *, at_least: bool, work: Work) -> None:
        self._work = work
        self._moves: dict[Remainder, tuple[Move, ...]] = {}
        graph: dict[int, NumberedPart] = {part: form.parts[part] for part in reversed(form.kept())}
        propositions = len(structure.patterns) + len(structure.guards)
        choosing = [part for part, this in graph.items() if this.chooses]
        happening = [part for part, this in graph.items() if this.op is PartKind.EVENT]
        bit = {part: index for index, part in enumerate(choosing + happening, propositions)}
        whole, mandatory, first, silent = _extents(graph, bit, structure, work)
        above: dict[int, int | None] = dict.fromkeys(graph)  # the alternative that a part is below
        self.alternatives: list[Alternative] = []
        self.choices: dict[int, Choice] = {}
        for part, this in graph.items():
            start, up = len(self.alternatives), above[part]
            for child in this.parts:
                above[child] = len(self.alternatives) if this.chooses else up
                if this.chooses:
                    known = (mandatory[child], whole[child], first[child], silent[child])
                    self.alternatives.append(Alternative(bit[part], up, *known))
            if this.chooses:
                mask = mask_of(range(start, len(self.alternatives)))
                quiet = mask_of(one for one in bits(mask) if self.alternatives[one].silent)
                self.choices[bit[part]] = Choice(mask, quiet, this.need, at_least and this.op is PartKind.AT_LEAST)
        before, after = _around(graph, whole, backwards=False), _around(graph, whole, backwards=True)
        self.moments: dict[int, Moment] = {}
        for part in happening:
            atom = structure.atoms[graph[part].event.pattern]
            self.moments[bit[part]] = Moment(atom, structure.bound[atom], above[part], before[part], after[part])
        self._guards = mask_of(structure.guard_bits.values())
        self._choosing = mask_of(self.choices)
        self._events = mask_of(self.moments)
        self._binders = dict.fromkeys(bits(self._guards), 0)
        for event, moment in self.moments.items():
            self._binders.update((guard, self._binders[guard] | 1 << event) for guard in bits(moment.bound))
        self.width = self._events.bit_length()
        """How many bits its sets may have: what steps cost grows with it."""
        self.start = self._tidy(Remainder(number, mandatory[form.root]))
        """The configuration before any event."""

    def moves(self, configuration: Remainder) -> tuple[Move, ...]:
        """The moves of a configuration, in a stable order; found once."""
        if configuration not in self._moves:
            self._moves[configuration] = found = tuple(dict.fromkeys(self._find(configuration)))
            self._work.step(len(found) * (20 + self.width // 10))
        return self._moves[configuration]

    def breaking(self, move: Move, holding: int) -> Remainder:
        """Where a move leads when of the guards it notes only these hold."""
        broken = move.noted & ~holding
        return self._tidy(move.target._replace(broken=move.target.broken | broken)) if broken else move.target

    def is_complete(self, configuration: Remainder) -> bool:
        """Whether nothing more needs to happen."""
        if configuration.open & self._events:
            return False
        return all(self._silently(configuration, choice) for choice in bits(configuration.open & self._choosing))

    def dominates(self, one: Remainder, other: Remainder) -> bool:
        """Whether `one` completes on every word on which `other` does, when events may be left out."""
        if one.plan != other.plan or one.open & ~other.open or one.broken & ~other.broken:
            return False
        behind = other.taken & ~one.taken
        return not behind or not any(self.choices[choice].mask & behind for choice in bits(one.open & self._choosing))

    def _find(self, configuration: Remainder) -> Iterator[Move]:
        for event in self._candidates(configuration):
            moment = self.moments[event]
            entered = self._enter(configuration, event)
            if entered is None or moment.before & entered.open & self._events:
                continue
            for settled in self._settle(entered, moment.before & entered.open & self._choosing):
                target = settled._replace(open=settled.open & ~(1 << event))
                needed = moment.bound & settled.open
                noted = moment.bound & ~needed
                noted &= self._possible(target) if noted else 0
                yield Move(moment.atom, needed, noted, self._tidy(target))

    def _candidates(self, configuration: Remainder) -> Iterator[int]:
        """Events that may be next: nothing that waits is known to come before them."""
        waiting = configuration.open & self._events
        while waiting:
            event = (waiting & -waiting).bit_length() - 1
            yield event
            waiting &= ~(1 << event | self.moments[event].after)
        yield from bits(union(self.alternatives[number].first for number in bits(self._untaken(configuration))))

    def _untaken(self, configuration: Remainder) -> int:
        """The alternatives of undecided choices that are not taken."""
        masks = (self.choices[choice].mask for choice in bits(configuration.open & self._choosing))
        return union(masks) & ~configuration.taken

    def _possible(self, configuration: Remainder) -> int:
        """All that a choice may still bring in."""
        return union(self.alternatives[number].whole for number in bits(self._untaken(configuration)))

    def _enter(self, configuration: Remainder, event: int) -> Remainder | None:
        """Take the alternatives that an event is below, or None where that is no longer possible."""
        if configuration.open >> event & 1:
            return configuration
        path: list[int] = []
        above = self.moments[event].alternative
        while above is not None:
            path.append(above)
            if configuration.open >> self.alternatives[above].choice & 1:
                break
            above = self.alternatives[above].up
        else:
            return None
        self._work.step(len(path) * (10 + self.width // 50))
        still, taken = configuration.open, configuration.taken
        for number in reversed(path):
            alternative = self.alternatives[number]
            if taken >> number & 1 or alternative.mandatory & configuration.broken:
                return None
            choice = self.choices[alternative.choice]
            chosen = taken & choice.mask | 1 << number
            if chosen == choice.mask or (not choice.more and chosen.bit_count() == choice.least):
                still &= ~(1 << alternative.choice)
                taken &= ~choice.mask
            else:
                taken |= chosen
            still |= alternative.mandatory
        return configuration._replace(open=still, taken=taken)

    def _settle(self, configuration: Remainder, choices: int) -> Iterator[Remainder]:
        """Decide these choices without an event, in every way that is not worse than another."""
        if not choices:
            yield configuration
            return
        ways = [self._silently(configuration, choice) for choice in bits(choices)]
        taken = configuration.taken & ~union(self.choices[choice].mask for choice in bits(choices))
        for guards in _smallest(union(chosen) for chosen in product(*ways)):
            yield configuration._replace(open=configuration.open & ~choices | guards, taken=taken)

    def _silently(self, configuration: Remainder, number: int) -> tuple[int, ...]:
        """The smallest sets of guards with which a choice is decided without an event."""
        choice = self.choices[number]
        missing = choice.least - (configuration.taken & choice.mask).bit_count()
        if missing <= 0:
            return (0,)
        untaken = (self.alternatives[one].silent for one in bits(choice.silent & ~configuration.taken))
        able = [ways for silent in untaken if (ways := [one for one in silent if not one & configuration.broken])]
        return _smallest(union(one) for some in combinations(able, missing) for one in product(*some))

    def _tidy(self, configuration: Remainder) -> Remainder:
        """Forget guards that no event and no choice to come can touch."""
        required = configuration.open & self._guards
        if not (required or configuration.broken):
            return configuration
        possible = self._possible(configuration)
        coming = configuration.open | possible
        idle = mask_of(guard for guard in bits(required) if not self._binders[guard] & coming)
        return configuration._replace(open=configuration.open & ~idle, broken=configuration.broken & possible)


def _extents(
    graph: dict[int, NumberedPart], bit: Mapping[int, int], structure: Structure, work: Work
) -> tuple[dict[int, int], dict[int, int], dict[int, int], dict[int, tuple[int, ...]]]:
    """Of each part all that may happen for it, what must, what may be first, and the guards with
    which it is complete silently.
    """
    whole: dict[int, int] = {}
    mandatory: dict[int, int] = {}
    first: dict[int, int] = {}
    silent: dict[int, tuple[int, ...]] = {}
    for part, this in reversed(graph.items()):
        own = 1 << bit[part] if part in bit else 0
        match this.op:
            case PartKind.EVENT:
                whole[part] = mandatory[part] = first[part] = own
                silent[part] = ()
            case PartKind.CONDITION:
                assert isinstance(this.of, Condition)
                whole[part] = mandatory[part] = guard = 1 << structure.guard_bits[this.of.guard]
                first[part], silent[part] = 0, (guard,)
            case PartKind.ALL | PartKind.SEQUENCE | PartKind.ONE | PartKind.AT_LEAST:
                whole[part] = own | union(whole[child] for child in this.parts)
                mandatory[part] = own or union(mandatory[child] for child in this.parts)
                silent[part] = _silent([silent[child] for child in this.parts], this, work)
                first[part] = 0
                for child in this.parts:
                    first[part] |= first[child]
                    if this.op is PartKind.SEQUENCE and not silent[child]:
                        break
            case _:
                assert_never(this.op)
    return whole, mandatory, first, silent


def _silent(ways: list[tuple[int, ...]], part: NumberedPart, work: Work) -> tuple[int, ...]:
    """The smallest sets of guards with which a part is complete without an event, given those of its parts."""
    able = [way for way in ways if way]
    need = part.need if part.chooses else len(ways)
    if part.chooses and need > 1:
        work.check(comb(len(able), need), "ways to decide choices by guards alone")
    found: set[int] = set()
    for chosen in combinations(able, need):
        together: tuple[int, ...] = (0,)
        for way in chosen:
            if way != (0,):
                together = _smallest(one | other for one in together for other in way)
            work.check(len(together), "ways to decide choices by guards alone")
        found.update(together)
    return _smallest(found)


def _around(graph: Mapping[int, NumberedPart], whole: Mapping[int, int], *, backwards: bool) -> dict[int, int]:
    """What sequences put before each part, or after it."""
    around = dict.fromkeys(graph, 0)
    for number, part in graph.items():
        outside = around[number]
        for child in reversed(part.parts) if backwards else part.parts:
            around[child] |= outside
            if part.op is PartKind.SEQUENCE:
                outside |= whole[child]
    return around


def _smallest(sets: Iterable[int]) -> tuple[int, ...]:
    """The sets that contain no other of them, in a stable order.

    >>> _smallest([0b110, 0b011, 0b010, 0b101])
    (2, 5)
    """
    kept: list[int] = []
    for one in sorted(set(sets), key=lambda mask: (mask.bit_count(), mask)):
        if not any(other & ~one == 0 for other in kept):
            kept.append(one)
    return tuple(kept)
