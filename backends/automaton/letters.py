"""Feasible letters: the sets of atoms that one event can satisfy together.

The least event of a set of atoms satisfies exactly the atoms that every event of the set satisfies.
A letter is feasible if and only if its least event satisfies no further atom. Atoms share rigid
variables, because a slice assigns them one value. An atom with a variable that the set does not
bind is false. The alphabet and the `ignore` declarations have their own variables. Guards count as
independent.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain
from typing import NamedTuple, TypeAlias

from rvaft.backend import Observed
from rvaft.core.overlaps import LeastEvent, Overlaps, least
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.support.bits import bits, mask_of, union


def apart(pattern: Pattern) -> Pattern:
    """Return the pattern with fresh variables."""
    return Observed(pattern).untied().pattern


Fits: TypeAlias = tuple[tuple[Pattern, Guard | None], ...]
"""Alternatives, each a pattern with an optional guard."""


class Relevance(NamedTuple):
    """The definition of relevant events: the alphabet, and the `ignore` declarations."""

    alphabet: Fits
    ignored: Fits


class FeasibleLetters:
    """The feasible letters over some atoms, as bits; with `relevance`, those of relevant events.

    Guards in the alphabet are not considered.

    >>> from rvaft.language.parser import parse_pattern
    >>> letters = FeasibleLetters([parse_pattern(text) for text in ("{ a: 1 }", "{ a: 2 }", "{ b: _ }", "{ a: _ }")])
    >>> [list(bits(letter)) for letter in letters.over(0b1011)]
    [[], [0, 3], [1, 3], [3]]
    """

    def __init__(self, patterns: Sequence[Pattern], relevance: Relevance | None = None) -> None:
        self._patterns = tuple(patterns)
        self._having: dict[str, int] = {}  # for each rigid variable, the atoms that contain it
        for atom, pattern in enumerate(self._patterns):
            self._having.update((name, self._having.get(name, 0) | 1 << atom) for name in rigid_variables(pattern))
        alphabet, ignored = ((), ()) if relevance is None else relevance
        entries = tuple(dict.fromkeys(apart(pattern) for pattern, _ in alphabet))
        self._plain = ~union(self._having.values())
        self._decisive = (*self._patterns, *entries)
        self._entries = {entry: index for index, entry in enumerate(entries, len(self._patterns))}
        self._ignored = tuple(apart(pattern) for pattern, guard in ignored if guard is None)
        self._any: FeasibleLetters | None = None
        self._all = (1 << len(self._patterns)) - 1
        self.guards = ~self._all
        """The guard bits of a letter in which every guard holds."""
        overlaps = Overlaps(self._decisive)
        self._near = [overlaps.compatible(index) for index in range(len(self._decisive))]
        self._relevant: dict[int, tuple[set[int], Iterator[int]]] = {}
        self._together: dict[int, tuple[int, int]] = {}
        self.closure = cache(self._closure)
        self.implying = cache(self._implying)

    def _closure(self, atoms: int) -> int | None:
        event = least(self._patterns[atom] for atom in bits(atoms))
        near = self._all
        for atom in bits(atoms):
            near &= self._near[atom]
        return None if event is None else self._satisfied(event, near) | atoms

    def _implying(self, atom: int) -> int:
        candidates = bits(self._all & self._near[atom])
        return mask_of(one for one in candidates if (self.closure(1 << one) or 0) >> atom & 1)

    def together(self, atom: int, others: int) -> int:
        """Return which of the other atoms one event can satisfy together with this atom."""
        known, found = self._together.get(atom, (0, 0))
        for other in bits(others & ~known & self._near[atom]):
            if least([self._patterns[atom], self._patterns[other]]) is not None:
                found |= 1 << other
        self._together[atom] = (known | others, found)
        return found & others

    def over(self, some: int) -> Iterator[int]:
        """Yield the feasible letters restricted to these atoms, the empty one first if feasible."""
        nothing = (self.closure(0) or 0) & some
        seen = {nothing}
        todo = [nothing]
        while todo:
            letter = todo.pop()
            if self._can_be_relevant(letter, some):
                yield letter
            near = some
            for atom in bits(letter):
                near &= self.together(atom, near) | letter
            for atom in reversed(list(bits(near & ~letter))):
                closed = self.closure(letter | 1 << atom)
                if closed is not None and closed & some not in seen:
                    seen.add(closed & some)
                    todo.append(closed & some)

    def irrelevant(self, some: int) -> Iterator[int]:
        """Yield the feasible letters restricted to these atoms, of events of any relevance."""
        if self._any is None:
            self._any = FeasibleLetters(self._patterns)
        return self._any.over(some) if some else iter(())

    def _can_be_relevant(self, letter: int, some: int) -> bool:
        if letter not in self._relevant:
            self._relevant[letter] = (set(), self._find_relevant(letter))
        found, more = self._relevant[letter]
        if any(atoms & some == letter for atoms in found):
            return True
        for atoms in more:
            found.add(atoms)
            if atoms & some == letter:
                return True
        return False

    def _find_relevant(self, letter: int) -> Iterator[int]:
        """Yield the atoms of the least relevant event that satisfies the letter, per alphabet
        entry.

        If all events of an atom are ignored, its partial matches still count, so it keeps its
        letters.
        """
        own = [self._patterns[atom] for atom in bits(letter)]
        if not self._entries or any(self._is_ignored(least([pattern])) for pattern in own):
            yield letter
        likely = [self._entries[entry] for pattern in own if (entry := apart(pattern)) in self._entries]
        for index in chain(likely, self._entries.values()):
            if not letter & ~self._near[index]:
                event = least([*own, self._decisive[index]])
                if event is not None and not self._is_ignored(event):
                    yield self._satisfied(event, self._all & self._near[index]) | letter

    def _is_ignored(self, event: LeastEvent | None) -> bool:
        return event is not None and any(event.satisfies(ignored) for ignored in self._ignored)

    def _satisfied(self, event: LeastEvent, among: int) -> int:
        bound = union(self._having.get(name, 0) for name in event.bound)
        possible = among & (bound | self._plain)  # an atom with an unbound variable is false
        return mask_of(atom for atom in bits(possible) if event.satisfies(self._patterns[atom]))
