"""Values for the variables of guards: one choice for every combination of truths that the guards can have.

The places are those of a closed set that also has the equalities which the guards ask about (`refined`). So two values that a
guard compares are equal exactly when they are one place, and the value of a free place is no constant of its guards. What is left to
choose is the region between constants and, where values are compared with each other, their order: a different value from each
region for every place shows every case. Places in no common guard are chosen independently; they take
different values, so that no choice makes equal what the closed set leaves apart. Where a region has too few values for that and a
pattern asks for equality, all choices are tried together.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
from math import prod
from typing import Final

from cross_check.letters.asked import Asked, asked
from cross_check.letters.closed import plain
from cross_check.letters.least import ROOT, Demands, Fresh, Place
from cross_check.letters.regions import Regions, regions
from rvaft.errors import TooLarge
from rvaft.guards import Guard, holds
from rvaft.guards import variables as guard_variables
from rvaft.patterns import ListPattern, Literal, ObjectPattern, Pattern, Variable, substitute
from rvaft.values import Json, Scalar, is_number, key

TRIED: Final = 200_000
"""The most choices of values that are tried."""


@dataclass(frozen=True, slots=True)
class Guarded:
    """A pattern with a guard on its variables, and what the guard asks."""

    pattern: Pattern
    guard: Guard
    asked: Asked

    @classmethod
    def of(cls, pattern: Pattern, guard: Guard) -> "Guarded":
        """The two together."""
        return cls(pattern, guard, asked(guard))

    def refined(self) -> Iterator[Pattern]:
        """The pattern alone, and with each equality that its guard asks about."""
        yield plain(self.pattern)
        for name, constants in self.asked.constants.items():
            for constant in constants:
                yield plain(substitute(self.pattern, {name: constant}))
        for one, other in sorted(self.asked.pairs):
            yield plain(substitute(self.pattern, {other: Variable(one)}))


class Choices:
    """The values to choose from, for all guards together."""

    def __init__(self, guarded: Sequence[Guarded], patterns: Sequence[Pattern], fresh: Fresh) -> None:
        self._guarded = guarded
        self._patterns = patterns
        self._fresh = fresh
        self._number = {pattern: index for index, pattern in enumerate(patterns)}
        self._at = [self._number[plain(one.pattern)] for one in guarded]
        self._calculated = any(one.asked.calculated for one in guarded)
        asked_of = {plain(one.pattern) for one in guarded}
        added = {pattern for one in guarded for pattern in one.refined()} - asked_of
        self._linked = any(True for pattern in patterns if pattern not in added for _ in _parts(pattern, Variable))
        """Whether a question asks for equality in its pattern."""
        self._many = sum(len(guard_variables(one.guard)) for one in guarded)
        self._literals = {key(literal.value) for pattern in patterns for _, literal in _literals(pattern)}
        self._regions = self._all_regions()
        self._crowded = self._linked and any(len(region) < self._many for region in self._regions.regions)
        self._tried = 0

    def events(self, closed: int, event: Json) -> Iterator[Json]:
        """The events of a closed set, `event` being its least."""
        here = [one for one, at in zip(self._guarded, self._at, strict=True) if closed >> at & 1]
        if not here:
            yield event
            return
        demands = Demands(self._fresh)
        for index, pattern in enumerate(self._patterns):
            if closed >> index & 1:
                demands.demand(pattern)
        wheres = [demands.demand(one.pattern) or {} for one in here]
        placed = [
            _Placed(one.guard, {name: demands.place(where[name]) for name in guard_variables(one.guard)})
            for one, where in zip(here, wheres, strict=True)
        ]
        groups = _groups(placed, together=self._crowded)
        for choice in product(*self._of_groups(groups, placed, demands)):
            values = demands.values(dict(chain.from_iterable(part.items() for part in choice)))
            assert values is not None
            yield values[ROOT]

    def _of_groups(
        self, groups: Sequence[Sequence[Place]], placed: Sequence["_Placed"], demands: Demands
    ) -> Iterator[list[Mapping[Place, Json]]]:
        known = demands.values({})
        assert known is not None
        slot = 0
        for group in groups:
            free = [place for place in group if demands.free(place)]
            mine = range(slot, slot + len(free))
            slot += len(free)
            values = {place: self._forms(demands.literal(place)) for place in group} | dict.fromkeys(
                free, self._from(mine)
            )
            yield self._shown(
                [one for one in placed if one.within(group)], known, {p: v for p, v in values.items() if v}
            )

    def _from(self, slots: range) -> list[Json]:
        """Values of every region, not those of other groups where there are enough; then the constants between regions."""
        mine = slice(slots.start, slots.stop)
        found = [region if len(region) < self._many else region[mine] for region in self._regions.regions]
        return [*chain.from_iterable(found), *self._regions.points]

    def _shown(
        self, placed: Sequence["_Placed"], known: Mapping[Place, Json], values: Mapping[Place, Sequence[Json]]
    ) -> list[Mapping[Place, Json]]:
        """A choice for each combination of truths, and for each way in which values are equal."""
        self._tried += prod(map(len, values.values()))
        if self._tried > TRIED:
            raise TooLarge("values to try for the variables of guards", limit=TRIED)
        found: dict[object, Mapping[Place, Json]] = {}
        for some in product(*values.values()):
            choice = dict(zip(values, some, strict=True))
            here = {**known, **choice}
            truths = tuple(one.holds(here) for one in placed)
            found.setdefault((truths, self._equalities(some)), choice)
        return list(found.values())

    def _equalities(self, values: Sequence[Json]) -> tuple[object, ...]:
        """Which values are equal, and which are literals of patterns."""
        keys = [key(value) for value in values]
        return tuple((keys.index(one), one if one in self._literals else None) for one in keys)

    def _forms(self, literal: Literal | None) -> list[Json]:
        """A number as integer and as double, which may differ where guards calculate; nothing to choose elsewhere."""
        value = None if literal is None else literal.value
        if not (self._calculated and isinstance(value, (int, float)) and is_number(value)):
            return []
        try:
            other: int | float = int(value) if isinstance(value, float) else float(value)
        except OverflowError:
            return [value]
        return [value, other] if other == value else [value]

    def _all_regions(self) -> Regions:
        constants = [one.value for about in self._guarded for group in about.asked.constants.values() for one in group]
        literals = [literal.value for pattern in self._patterns for _, literal in _literals(pattern)]
        if any(one.asked.pairs for one in self._guarded):  # a variable is compared with what may be a literal elsewhere
            constants += self._near()
        ordered = any(one.asked.ordered for one in self._guarded)
        return regions(constants, literals, self._many, self._fresh, ordered=ordered, calculated=self._calculated)

    def _near(self) -> Iterator[Scalar]:
        """The literals that can stand where a guard looks: at the same path, or anywhere if patterns link paths."""
        paths = {path for one in self._guarded for path, _ in _parts(one.pattern, Variable)}
        for pattern in self._patterns:
            yield from (literal.value for path, literal in _literals(pattern) if self._linked or path in paths)


@dataclass(frozen=True, slots=True)
class _Placed:
    """A guard, and the places of its variables."""

    guard: Guard
    where: Mapping[str, Place]

    def holds(self, values: Mapping[Place, Json]) -> bool:
        return holds(self.guard, {name: values[place] for name, place in self.where.items()})

    def within(self, group: Sequence[Place]) -> bool:
        return any(place in group for place in self.where.values())


def _groups(placed: Iterable[_Placed], *, together: bool) -> list[list[Place]]:
    """The places of guards, those together that are in one guard, or in guards with a common place."""
    groups: list[set[Place]] = []
    for one in placed:
        joined = set(one.where.values())
        touched = groups if together else [group for group in groups if group & joined]
        groups = [*(group for group in groups if group not in touched), joined.union(*touched)]
    return [sorted(group) for group in groups]


def _literals(pattern: Pattern) -> Iterator[tuple[tuple[str | int, ...], Literal]]:
    return ((path, part) for path, part in _parts(pattern, Literal) if isinstance(part, Literal))


def _parts(pattern: Pattern, kind: type) -> Iterator[tuple[tuple[str | int, ...], Pattern]]:
    """The parts of a kind with their paths."""
    todo: list[tuple[tuple[str | int, ...], Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        if isinstance(part, kind):
            yield path, part
        match part:
            case ObjectPattern(fields):
                todo.extend(((*path, name), inner) for name, inner in fields)
            case ListPattern(items):
                todo.extend(((*path, index), inner) for index, inner in enumerate(items))
            case _:
                pass
