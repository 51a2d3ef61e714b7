"""The least event that matches some patterns: unification, with fresh values for whatever nothing decides.

The demands of the patterns are kept as a graph of places. A place has a literal, fields, items, or
nothing decided yet; places that must hold equal values are one. Every event that matches the
patterns is an image of the graph: equal places have equal values there. A fresh value equals no
literal and no other value, and a fresh field keeps objects apart that nothing makes equal, so the
least event matches only what *every* event matches that matches the patterns.
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
    """Values that no pattern in sight asks for; with `apart`, objects that are not asked to be equal differ."""

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
        """A string, and the name of a field."""
        return f"{self._mark}{number}"

    def opaque(self, number: int) -> Json:
        """A value without order that no pattern of a list or an object matches."""
        return [self.word(number)] * (self._longest + 1)


class Demands:
    """What an event must have; places are numbers, `ROOT` is the event itself."""

    def __init__(self, fresh: Fresh) -> None:
        self._fresh = fresh
        self._same: list[Place] = [ROOT]
        self._has: list[Literal | dict[str, Place] | tuple[Place, ...] | None] = [{}]

    def place(self, given: Place) -> Place:
        """The place that stands for all that are equal to the given one."""
        while self._same[given] != given:
            given = self._same[given]
        return given

    def is_free(self, place: Place) -> bool:
        """Whether nothing is decided about the value there."""
        return self._has[self.place(place)] is None

    def literal(self, place: Place) -> Literal | None:
        """The literal that must be there."""
        has = self._has[self.place(place)]
        return has if isinstance(has, Literal) else None

    def demand(self, pattern: Pattern) -> dict[str, Place] | None:
        """Ask for a match of one more pattern; where its variables are, or None where that is impossible."""
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
        """Where in the object or list there a number that is not finite can be.

        In an object, or at a free place that is not `taken`.
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
        """The value of every place in the event, `chosen` ones as given; None where one would contain itself.

        Objects at `undefined` places have a field more, with a number that is not finite.
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


# Which patterns one event can match together: the closed sets, each with its least event.
#
# A set of patterns is closed when it has every pattern that its own least event matches, and then
# the event matches just these. The sets are enumerated without repetition in Ganter's order ("close
# by one"): a set grows by patterns of increasing number, and a step that brings in an earlier one
# is left to the place where that was added.


def closed_sets(patterns: Sequence[Pattern], fresh: Fresh, *, limit: int) -> Iterator[tuple[int, Json]]:
    """Each closed set of some patterns, a number with one bit for each, and its least event; that of `{}` first.

    Raises `TooLarge` for more than `limit` of them.
    """

    def closure(generators: tuple[int, ...], possible: int) -> tuple[int, Json] | None:
        """Those of the possible patterns that the least event of some matches, and the event; None
        where there is none.
        """
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
    """For each pattern those that ask for another literal in the same field: no event matches both."""
    fields = (pattern.fields if isinstance(pattern, ObjectPattern) else () for pattern in patterns)
    literals = [[field for field in some if isinstance(field[1], Literal)] for some in fields]
    those: dict[object, int] = defaultdict(int)
    for index, some in enumerate(literals):
        for what in chain(some, dict(some)):  # a literal in a field, and the field alone
            those[what] |= 1 << index
    return [union(those[name] & ~those[name, literal] for name, literal in some) for some in literals]
