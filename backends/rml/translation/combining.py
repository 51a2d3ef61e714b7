"""Which sets of letters one event can be at once, the largest first. A set is an integer, bit i standing for the i-th letter."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from backends.rml.translation.letters import Letter
from backends.rml.translation.observations import Call, pattern
from backends.rml.translation.overlap import implies, overlaps
from backends.rml.translation.scenarios import bits
from rvaft.guards import Guard
from rvaft.tree import RVAFT


class Move(Protocol):
    """Where a letter leads; all that matters here is whether it detects."""

    detects: bool


@dataclass(frozen=True, slots=True)
class Combination:
    """All the letters that an event is (`fits`), and those that have to be written to say so."""

    letters: tuple[Letter, ...]
    fits: int


class Combinations:
    """The combinations of some letters; `count` is called for each before it is looked at, and may raise."""

    def __init__(
        self, tree: RVAFT, moves: Mapping[Letter, Move], bound: frozenset[str], count: Callable[[], None]
    ) -> None:
        self.letters = list(moves)
        self._count = count
        calls = list(dict.fromkeys(letter.call for letter in self.letters))
        number = {call: position for position, call in enumerate(calls)}
        self._call = [number[letter.call] for letter in self.letters]
        patterns = [pattern(tree, call) for call in calls]
        self._overlap = overlaps(patterns)
        self._implies = [
            sum(1 << j for j in bits(near) if i == j or implies(patterns[i], patterns[j], bound))
            for i, near in enumerate(self._overlap)
        ]
        self._registers = [frozenset(call.registers) for call in calls]
        self._calls: Sequence[Call] = calls
        facts = dict.fromkeys(guard for letter in self.letters for guard in letter.guards)
        bit = {guard: 1 << position for position, guard in enumerate(facts)}
        self._facts: Sequence[Guard] = list(facts)
        self._guards = [sum(bit[guard] for guard in letter.guards) for letter in self.letters]
        everywhere = range(len(self.letters))
        self.detecting = self._weakest([i for i, letter in enumerate(self.letters) if moves[letter].detects])
        self.others = [
            i
            for i in everywhere
            if not moves[self.letters[i]].detects
            and not (self._says_more(i) and any(self._entails(i, other) for other in self.detecting))
        ]

    def all(self) -> Iterator[Combination]:
        """Each letter that detects, alone; then all closed sets of the others, larger ones before those they contain."""
        for i in self.detecting:
            self._count()
            yield Combination((self.letters[i],), 1 << i)
        called = [self._call[i] for i in self.others]
        known = sum(1 << call for call in set(called))
        if len(set(called)) == len(called) and all(self._overlap[call] & known == 1 << call for call in called):
            for i in self.others:
                self._count()
                yield Combination((self.letters[i],), 1 << i)
            return
        yield from sorted(self._closed(), key=lambda combination: -combination.fits.bit_count())

    def _closed(self) -> Iterator[Combination]:
        """An event that is some letters is also those that their calls imply and their guards allow."""
        single = list(dict.fromkeys(self._closure(1 << i) for i in self.others))
        seen = dict.fromkeys(single)
        agenda = list(single)
        for fits in agenda:
            self._count()
            if any(self._covers(fits, i) for i in self.detecting):
                continue  # the alternative that detects comes first
            yield Combination(self._written(fits), fits)
            excluded = 0
            for i in bits(fits):
                excluded |= self._excluded[i]
            for other in single:
                if other & ~fits and not other & excluded:
                    union = self._closure(fits | other)
                    if union not in seen:
                        seen[union] = None
                        agenda.append(union)

    def _closure(self, fits: int) -> int:
        allowed, possible = self._given(fits)
        return sum(1 << i for i in bits(possible) if not self._guards[i] & ~allowed)

    def _covers(self, fits: int, letter: int) -> bool:
        allowed, _ = self._given(fits)
        return not self._guards[letter] & ~allowed and any(
            self._implies[self._call[i]] >> self._call[letter] & 1 for i in bits(fits)
        )

    def _given(self, fits: int) -> tuple[int, int]:
        """The guards that hold, and the letters whose calls match."""
        allowed = possible = 0
        for i in bits(fits):
            allowed |= self._guards[i]
            possible |= self._implied[i]
        return allowed, possible

    @cached_property
    def _implied(self) -> list[int]:
        return self._related(lambda i, j: self._implies[self._call[i]] >> self._call[j] & 1)

    @cached_property
    def _excluded(self) -> list[int]:
        return self._related(lambda i, j: not self._overlap[self._call[i]] >> self._call[j] & 1)

    def _related(self, test: Callable[[int, int], int]) -> list[int]:
        return [sum(1 << j for j in self.others if test(i, j)) for i in range(len(self.letters))]

    def _written(self, fits: int) -> tuple[Letter, ...]:
        """One letter per call, with all its guards, without calls that another one implies and that bind nothing more."""
        guards: dict[int, int] = {}
        for i in bits(fits):
            guards[self._call[i]] = guards.get(self._call[i], 0) | self._guards[i]

        def spares(one: int, other: int) -> bool:
            return (
                bool(self._implies[one] >> other & 1)
                and not guards[other] & ~guards[one]
                and self._registers[other] <= self._registers[one]
            )

        needed = [
            call
            for call in guards
            if not any(spares(one, call) and (one < call or not spares(call, one)) for one in guards if one != call)
        ]
        return tuple(Letter(self._calls[c], frozenset(self._facts[g] for g in bits(guards[c]))) for c in needed)

    def _weakest(self, letters: list[int]) -> list[int]:
        return [
            i
            for i in letters
            if not self._says_more(i)
            or not any(self._entails(i, j) and (j < i or not self._entails(j, i)) for j in letters if j != i)
        ]

    def _says_more(self, letter: int) -> bool:
        """Whether the letter may entail another one at all."""
        return bool(self._guards[letter]) or self._implies[self._call[letter]].bit_count() > 1

    def _entails(self, letter: int, other: int) -> bool:
        called = self._implies[self._call[letter]] >> self._call[other] & 1
        return bool(called) and not self._guards[other] & ~self._guards[letter]
