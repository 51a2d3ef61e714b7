"""Which atoms one event can make true together: the feasible letters.

An atom that the least event of a set satisfies is satisfied by every event of that set. A letter is
therefore feasible exactly when it contains all that its own least event satisfies. Rigid variables
are shared between atoms (a slice gives them one value) and an atom with a variable that the set
does not bind is false; the entries of the alphabet and the `ignore` declarations share nothing with
anybody. Guards are taken as independent of all that.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain
from typing import NamedTuple, TypeAlias

from rvaft.backend import Observed
from rvaft.core.patterns import LeastEvent, Overlaps, least
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.support.bits import bits, mask_of, union


def apart(pattern: Pattern) -> Pattern:
    """The pattern with variables of its own."""
    return Observed(pattern).untied().pattern


Fits: TypeAlias = tuple[tuple[Pattern, Guard | None], ...]
"""What an event has to fit one of: patterns with guards."""


class Relevance(NamedTuple):
    """What decides whether an event is relevant: the entries of the alphabet, and the `ignore` declarations."""

    alphabet: Fits
    ignored: Fits


class FeasibleLetters:
    """The feasible letters over some atoms, as bits; with `relevance`, those of relevant events
    (guards on entries not looked at).

    >>> from rvaft.language.parser import parse_pattern
    >>> letters = FeasibleLetters([parse_pattern(text) for text in ("{ a: 1 }", "{ a: 2 }", "{ b: _ }", "{ a: _ }")])
    >>> [list(bits(letter)) for letter in letters.over(0b1011)]
    [[], [0, 3], [1, 3], [3]]
    """

    def __init__(self, patterns: Sequence[Pattern], relevance: Relevance | None = None) -> None:
        self._patterns = tuple(patterns)
        self._having: dict[str, int] = {}  # for each rigid variable the atoms that have it
        for atom, pattern in enumerate(self._patterns):
            self._having.update((name, self._having.get(name, 0) | 1 << atom) for name in rigid_variables(pattern))
        alphabet, ignored = ((), ()) if relevance is None else relevance
        entries = tuple(dict.fromkeys(apart(pattern) for pattern, _ in alphabet))
        self._plain = ~union(self._having.values())
        self._decisive = (*self._patterns, *entries)
        self._entries = {entry: index for index, entry in enumerate(entries, len(self._patterns))}
        self._ignored = tuple(apart(pattern) for pattern, guard in ignored if guard is None)
        self._all = (1 << len(self._patterns)) - 1
        self.guards = ~self._all
        """Added to a letter, says that every guard holds."""
        overlaps = Overlaps(self._decisive)
        self._near = [overlaps.compatible(index) for index in range(len(self._decisive))]
        self._relevant: dict[int, tuple[set[int], Iterator[int]]] = {}
        self._together: dict[int, tuple[int, int]] = {}
        self.closure = cache(self._closure)
        self.implying = cache(self._implying)

    def _closure(self, atoms: int) -> int | None:
        """All atoms that hold wherever these hold, or None where they never hold together."""
        event = least(self._patterns[atom] for atom in bits(atoms))
        near = self._all
        for atom in bits(atoms):
            near &= self._near[atom]
        return None if event is None else self._satisfied(event, near)

    def _implying(self, atom: int) -> int:
        """The atoms, itself included, at whose every event this one holds."""
        candidates = bits(self._all & self._near[atom])
        return mask_of(one for one in candidates if (self.closure(1 << one) or 0) >> atom & 1)

    def together(self, atom: int, others: int) -> int:
        """Those of the other atoms that can hold at an event where this one does."""
        known, found = self._together.get(atom, (0, 0))
        for other in bits(others & ~known & self._near[atom]):
            if least([self._patterns[atom], self._patterns[other]]) is not None:
                found |= 1 << other
        self._together[atom] = (known | others, found)
        return found & others

    def over(self, some: int) -> Iterator[int]:
        """The feasible letters as far as these atoms see them, the empty one first where it is feasible."""
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

    def _can_be_relevant(self, letter: int, some: int) -> bool:
        """Whether some relevant event makes exactly this letter true, as far as `some` atoms see it."""
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
        """What the least relevant events at which these atoms hold make true, one for each entry of the alphabet.

        An atom whose every event is ignored keeps its letters: a partial match that waits for it is
        none the less a partial match.
        """
        own = [self._patterns[atom] for atom in bits(letter)]
        if not self._entries or any(self._is_ignored(least([pattern])) for pattern in own):
            yield letter
        likely = [self._entries[entry] for pattern in own if (entry := apart(pattern)) in self._entries]
        for index in chain(likely, self._entries.values()):
            if not letter & ~self._near[index]:
                event = least([*own, self._decisive[index]])
                if event is not None and not self._is_ignored(event):
                    yield self._satisfied(event, self._all & self._near[index])

    def _is_ignored(self, event: LeastEvent | None) -> bool:
        return event is not None and any(event.satisfies(ignored) for ignored in self._ignored)

    def _satisfied(self, event: LeastEvent, among: int) -> int:
        bound = union(self._having.get(name, 0) for name in event.bound)
        possible = among & (bound | self._plain)  # a variable without a value is that of no event
        return mask_of(atom for atom in bits(possible) if event.satisfies(self._patterns[atom]))
