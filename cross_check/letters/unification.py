"""The least event that matches some patterns: unification with fresh values for undecided places.

The demands of patterns form a graph of places. A place has a literal, fields, items, or is
undecided; places with equal values are merged. Every event that matches the patterns is an image of
the graph. Fresh values equal no literal and no other value, and fresh fields keep unrelated objects
different. The least event therefore matches only patterns that every matching event matches.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Final, TypeAlias

from rvaft.errors import TooLarge
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, match, walk
from rvaft.model.values import Json
from rvaft.support.bits import bits, union

Place: TypeAlias = int
ROOT: Final[Place] = 0


class Fresh:
    """Values that no given pattern contains; with `apart`, unrelated objects differ."""

    def __init__(self, patterns: Iterable[Pattern], *, apart: bool) -> None:
        self.apart = apart
        parts = [part for pattern in patterns for part in walk(pattern)]
        words = {part.value for part in parts if isinstance(part, Literal) and isinstance(part.value, str)}
        words |= {name for part in parts if isinstance(part, ObjectPattern) for name, _ in part.fields}
        self._longest = max((len(part.items) for part in parts if isinstance(part, ListPattern)), default=0)
        self._mark = "~"
        while any(word.startswith(self._mark) for word in words):
            self._mark += "~"

    def word(self, number: int) -> str:
        """Return a string, also used as a field name."""
        return f"{self._mark}{number}"

    def opaque(self, number: int) -> Json:
        """Return a value without order that no list or object pattern matches."""
        return [self.word(number)] * (self._longest + 1)


class Demands:
    """The demands on an event; places are numbers, `ROOT` is the event."""

    def __init__(self, fresh: Fresh) -> None:
        self._fresh = fresh
        self._same: list[Place] = [ROOT]
        self._has: list[Literal | dict[str, Place] | tuple[Place, ...] | None] = [{}]

    def place(self, given: Place) -> Place:
        """Return the representative of a place."""
        while self._same[given] != given:
            given = self._same[given]
        return given

    def is_free(self, place: Place) -> bool:
        """Return whether the value at a place is undecided."""
        return self._has[self.place(place)] is None

    def literal(self, place: Place) -> Literal | None:
        """Return the required literal at a place, or None."""
        has = self._has[self.place(place)]
        return has if isinstance(has, Literal) else None

    def demand(self, pattern: Pattern) -> dict[str, Place] | None:
        """Add a pattern; return the places of its variables, or None if it cannot match."""
        where: dict[str, Place] = {}
        todo: list[tuple[Pattern, Place]] = [(pattern, ROOT)]
        while todo:
            part, given = todo.pop()
            place = self.place(given)
            match part, self._has[place]:
                case Anything(), _:
                    pass
                case Variable(name), _:
                    if not self._unite(where.setdefault(name, place), place):
                        return None
                case Literal(), None:
                    self._has[place] = part
                case ObjectPattern(fields), None | dict() as found:
                    inner = self._has[place] = {} if found is None else found
                    for name, below in fields:
                        if name not in inner:
                            inner[name] = self._new()
                        todo.append((below, inner[name]))
                case ListPattern(items), None:
                    new = self._has[place] = tuple(self._new() for _ in items)
                    todo.extend(zip(items, new, strict=True))
                case ListPattern(items), tuple() as there if len(there) == len(items):
                    todo.extend(zip(items, there, strict=True))
                case _, has if has != part:
                    return None
        return where

    def _new(self) -> Place:
        self._same.append(len(self._same))
        self._has.append(None)
        return self._same[-1]

    def _unite(self, one: Place, other: Place) -> bool:
        todo = [(one, other)]
        while todo:
            left, right = map(self.place, todo.pop())
            if left == right:
                continue
            kept, lost = self._has[left], self._has[right]
            self._same[right] = left
            match kept, lost:
                case (None, _):
                    self._has[left] = lost
                case (_, None):
                    pass
                case (dict(), dict()):
                    todo.extend((kept[name], place) for name, place in lost.items() if name in kept)
                    self._has[left] = {**lost, **kept}
                case (tuple(), tuple()) if len(kept) == len(lost):
                    todo.extend(zip(kept, lost, strict=True))
                case _ if kept != lost or not isinstance(kept, Literal):
                    return False
        return True

    def carrier(self, place: Place, taken: Collection[Place]) -> Place | None:
        """Return an object, or a free place that is not `taken`, inside a place for a non-finite
        number.
        """
        todo = [self.place(place)]
        while todo:
            here = todo.pop()
            has = self._has[here]
            if isinstance(has, dict) or (has is None and here not in taken):
                return here
            todo.extend(map(self.place, has) if isinstance(has, tuple) else ())
        return None

    def values(self, chosen: Mapping[Place, Json], undefined: Collection[Place] = ()) -> dict[Place, Json] | None:
        """Return the value of every place, with `chosen` values; None if a value would contain
        itself.

        Objects at `undefined` places get a further field with a non-finite number.
        """
        built: dict[Place, Json] = dict(chosen)
        opened: set[Place] = set()
        todo = [ROOT]
        while todo:
            place = todo[-1]
            has = self._has[place]
            if place in built:
                todo.pop()
                continue
            inner = () if has is None or isinstance(has, Literal) else has.values() if isinstance(has, dict) else has
            below = [self.place(one) for one in inner]
            missing = [one for one in below if one not in built]
            if missing:
                if place in opened:
                    return None
                opened.add(place)
                todo.extend(missing)
                continue
            todo.pop()
            match has:
                case None:
                    built[place] = self._fresh.word(place)
                case Literal(value):
                    built[place] = value
                case dict():
                    built[place] = {name: built[one] for name, one in zip(has, below, strict=True)}
                    if place != ROOT and (self._fresh.apart or place in undefined):
                        built[place][self._fresh.word(place)] = math.nan if place in undefined else None
                case _:
                    built[place] = [built[one] for one in below]
        return built


# Closed sets: the sets of patterns that one event can match, each with its least event. A set is
# closed if it contains every pattern that its least event matches. Ganter's algorithm (close by
# one) enumerates them without repetition: a set grows by patterns of increasing number, and a step
# that adds an earlier pattern is skipped.


def closed_sets(patterns: Sequence[Pattern], fresh: Fresh, *, limit: int) -> Iterator[tuple[int, Json]]:
    """Yield each closed set as a bit set with its least event, that of `{}` first; raises
    `TooLarge`.
    """

    def closure(generators: tuple[int, ...], possible: int) -> tuple[int, Json] | None:
        demands = Demands(fresh)
        values = None
        if all(demands.demand(patterns[index]) is not None for index in generators):
            values = demands.values({})
        if values is None:
            return None
        event = values[ROOT]
        return sum(1 << index for index in bits(possible) if match(patterns[index], event, {}) is not None), event

    rivals = _rivals(patterns)
    every = (1 << len(patterns)) - 1
    start: tuple[int, ...] = ()
    todo = [(start, *least, every, 0)] if (least := closure(start, every)) else []
    sets = 0
    while todo:
        generators, closed, event, possible, after = todo.pop()
        sets += 1
        if sets > limit:
            raise TooLarge("sets of patterns that an event can match", limit=limit)
        yield closed, event
        for index in reversed([*bits(possible & ~closed & -(1 << after))]):
            still = possible & ~rivals[index]
            more = closure((*generators, index), still)
            if more is not None and not (more[0] ^ closed) & ((1 << index) - 1):
                todo.append(((*generators, index), *more, still, index + 1))


def _rivals(patterns: Sequence[Pattern]) -> list[int]:
    """Return for each pattern those with another literal in a field: no event matches both."""
    fields = (pattern.fields if isinstance(pattern, ObjectPattern) else () for pattern in patterns)
    literals = [[field for field in some if isinstance(field[1], Literal)] for some in fields]
    having: dict[object, int] = defaultdict(int)
    for index, some in enumerate(literals):
        for what in chain(some, dict(some)):  # a literal in a field, and the field alone
            having[what] |= 1 << index
    return [union(having[name] & ~having[name, literal] for name, literal in some) for some in literals]
