"""Which patterns one event can match together: the closed sets, each with its least event.

A set of patterns is closed when it has every pattern that its own least event matches (`least`), and then the event matches just
these. The sets are enumerated without repetition in Ganter's order ("close by one"): a set grows by patterns of
increasing number, and a step that brings in an earlier one is left to the place where that was added.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from cross_check.letters.least import ROOT, Demands, Fresh
from rvaft.errors import TooLarge
from rvaft.patterns import Anything, Literal, ObjectPattern, Pattern, Variable, match, substitute, walk
from rvaft.values import Json

EMPTY: Final[tuple[int, ...]] = ()


def plain(pattern: Pattern) -> Pattern:
    """The pattern with `_` for variables that demand nothing, and the others numbered: equal demands are equal patterns."""
    uses = [part.name for part in walk(pattern) if isinstance(part, Variable)]
    if not uses:
        return pattern
    by: dict[str, Pattern] = {name: Anything() for name in uses}
    twice = [name for name in by if uses.count(name) > 1]
    by.update((name, Variable(f"_{number}")) for number, name in enumerate(twice, 1))
    return substitute(pattern, by)


class ClosedSets:
    """The closed sets of some patterns; a set is a number with one bit for each pattern."""

    def __init__(self, patterns: Sequence[Pattern], fresh: Fresh, *, limit: int) -> None:
        self._patterns = patterns
        self._fresh = fresh
        self._limit = limit
        self._rivals = _rivals(patterns)
        self._all = (1 << len(patterns)) - 1

    def __iter__(self) -> Iterator[tuple[int, Json]]:
        """Each set and its least event, that of `{}` first; raises `TooLarge`."""
        least = self._closure(EMPTY, self._all)
        assert least is not None
        todo = [(EMPTY, *least, self._all, 0)]
        sets = 0
        while todo:
            generators, closed, event, possible, after = todo.pop()
            sets += 1
            if sets > self._limit:
                raise TooLarge("sets of patterns that an event can match", limit=self._limit)
            yield closed, event
            for index in reversed(_bits(possible & ~closed & -(1 << after))):
                still = possible & ~self._rivals[index]
                more = self._closure((*generators, index), still)
                if more is not None and not (more[0] ^ closed) & ((1 << index) - 1):
                    todo.append(((*generators, index), *more, still, index + 1))

    def _closure(self, generators: tuple[int, ...], possible: int) -> tuple[int, Json] | None:
        """Those of the possible patterns that the least event of some matches, and the event; None where there is none."""
        demands = Demands(self._fresh)
        if any(demands.demand(self._patterns[index]) is None for index in generators):
            return None
        values = demands.values({})
        if values is None:
            return None
        event, closed = values[ROOT], 0
        for index in _bits(possible):
            if match(self._patterns[index], event, {}) is not None:
                closed |= 1 << index
        return closed, event


def _bits(mask: int) -> list[int]:
    found = []
    while mask:
        low = mask & -mask
        found.append(low.bit_length() - 1)
        mask ^= low
    return found


def _rivals(patterns: Iterable[Pattern]) -> list[int]:
    """For each pattern those that ask for another literal in the same field: no event matches both."""
    fields = [_literal_fields(pattern) for pattern in patterns]
    with_field: dict[str, int] = {}
    with_literal: dict[tuple[str, Literal], int] = {}
    for index, found in enumerate(fields):
        for name, literal in found:
            with_field[name] = with_field.get(name, 0) | 1 << index
            with_literal[name, literal] = with_literal.get((name, literal), 0) | 1 << index
    rivals = [0] * len(fields)
    for index, found in enumerate(fields):
        for name, literal in found:
            rivals[index] |= with_field[name] & ~with_literal[name, literal]
    return rivals


def _literal_fields(pattern: Pattern) -> list[tuple[str, Literal]]:
    if not isinstance(pattern, ObjectPattern):
        return []
    return [(name, inner) for name, inner in pattern.fields if isinstance(inner, Literal)]
