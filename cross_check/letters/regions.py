"""Values to try where guards look: some from every region in which no guard changes its mind."""

import math
import struct
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, count, pairwise, product
from math import prod
from typing import Final, TypeAlias

from cross_check.letters.unification import ROOT, Demands, Fresh, Place, plain
from rvaft.errors import TooLarge
from rvaft.model.guards import (
    ARITHMETIC,
    COMPARISONS,
    ORDERINGS,
    UNDEFINED,
    Guard,
    Operation,
    Operator,
    holds,
    value,
    variables,
    walk,
)
from rvaft.model.patterns import ListPattern, Literal, ObjectPattern, Pattern, Variable, substitute
from rvaft.model.values import Json, Scalar, is_number, key

# What a guard asks of values: constants at which its truth can change, and values that are compared with each other.
#
# Between neighbouring constants an atomic comparison of one variable with a constant does not change, for numbers and for strings. Where
# the variable is calculated with (`X / 2 < 1`), every step is monotone, rounding and overflow included, so the places where the
# comparison changes are found by bisection, once among the integers and once among the doubles.

SEVERAL: Final = "a guard calculates with several values"
BEYOND: Final = "a guard calculates in a way that has no known bounds"

_MODERATE: Final = 2**64
_BITS: Final = 64
_DOUBLE_BITS: Final = 1024 + _BITS
"""From two to this power on all integers are alike, but for as many bits more as steps with moderate constants can take back."""


@dataclass(slots=True)
class Asked:
    """What a guard asks; `gap` says why that is not all."""

    constants: dict[str, dict[Literal, None]] = field(default_factory=dict)
    pairs: set[tuple[str, str]] = field(default_factory=set)
    ordered: bool = False
    calculated: bool = False
    gap: str = ""

    def constant(self, name: str, given: Scalar) -> None:
        """A value of a variable at which something may change."""
        self.constants.setdefault(name, {})[Literal(given)] = None


def asked(guard: Guard) -> Asked:
    """What a guard asks of its variables."""
    found = Asked()
    _condition(guard, found)
    return found


def _condition(guard: Guard, found: Asked) -> None:
    match guard:
        case Variable(name):
            found.constant(name, given=True)
            found.constant(name, given=False)
        case Operation(Operator.AND | Operator.OR | Operator.NOT, operands):
            for operand in operands:
                _condition(operand, found)
        case Operation(operator, (left, right)) if operator in COMPARISONS:
            _comparison(operator, left, right, found)
        case Operation() if variables(guard):
            found.gap = BEYOND
        case _:
            pass


def _comparison(operator: Operator, left: Guard, right: Guard, found: Asked) -> None:
    folded = _folded(left), _folded(right)
    if folded[0] is None or folded[1] is None:  # undefined whatever the variables are
        return
    left, right = folded[0], folded[1]
    found.ordered |= operator in ORDERINGS
    match left, right:
        case (Variable(one), Variable(other)):
            if one != other:
                found.pairs.add((one, other))
        case (Variable(name), Literal(constant)) | (Literal(constant), Variable(name)):
            found.constant(name, constant)
        case (Literal(), Literal()):
            pass
        case _:
            _mixed(left, right, found)


def _mixed(left: Guard, right: Guard, found: Asked) -> None:
    """A comparison with conditions or calculations in it."""
    sides = [side for side in (left, right) if isinstance(side, Operation)]
    if any(side.operator in ARITHMETIC for side in sides):
        _calculation(left, right, found)
    if any(side.operator not in ARITHMETIC for side in sides):  # the other side is looked at as a truth value
        for side in (left, right):
            _condition(side, found)


def _folded(guard: Guard) -> Guard | None:
    """An operand without variables as its value; None where that is undefined."""
    if isinstance(guard, Operation) and not variables(guard):
        constant = value(guard, {})
        return None if constant is UNDEFINED else Literal(constant)
    return guard


def _calculation(left: Guard, right: Guard, found: Asked) -> None:
    found.ordered = found.calculated = True
    names = list(dict.fromkeys((*variables(left), *variables(right))))
    constants = [part.value for part in (*walk(left), *walk(right)) if isinstance(part, Literal)]
    for called, constant in product(names, filter(is_number, constants)):
        found.constant(called, constant)
    if len(names) > 1:
        found.gap = SEVERAL
        return
    name = names[0]
    calculated, other = (left, right) if isinstance(left, Operation) else (right, left)
    if not (isinstance(other, Literal) and _monotone(calculated)):
        found.gap = BEYOND
        return

    def side(given: Scalar) -> str:
        result = value(calculated, {name: given})
        if result is UNDEFINED:
            return "undefined"
        if not is_number(other.value):
            return "defined"
        return "above" if result > other.value else "below" if result < other.value else "equal"

    last = 2 ** (_DOUBLE_BITS + _BITS * sum(isinstance(part, Operation) for part in walk(calculated)))
    for bound in (*_changes(side, int, last), *_changes(side, _double, _LAST_DOUBLE)):
        found.constant(name, bound)


def _monotone(guard: Guard) -> bool:
    """Whether a chain of steps leads from one variable here, each with a constant of moderate size."""
    while isinstance(guard, Operation):
        operands = [_folded(operand) for operand in guard.operands]
        constants = [one.value for one in operands if isinstance(one, Literal)]
        others = [one for one in operands if one is not None and not isinstance(one, Literal)]
        if guard.operator not in ARITHMETIC or len(others) != 1 or len(constants) != len(operands) - 1:
            return False
        if guard.operator is Operator.DIV and isinstance(operands[0], Literal):
            return False
        if not all(map(_moderate, constants)):
            return False
        guard = others[0]
    return isinstance(guard, Variable)


def _moderate(constant: Scalar) -> bool:
    return not isinstance(constant, (int, float)) or not constant or 1 / _MODERATE <= abs(constant) <= _MODERATE


def _double(rank: int) -> float:
    """The doubles in their order, 0 at rank 0."""
    magnitude: float = struct.unpack("<d", struct.pack("<Q", abs(rank)))[0]
    return magnitude if rank >= 0 else -magnitude


_LAST_DOUBLE: Final[int] = struct.unpack("<Q", struct.pack("<d", 1.7976931348623157e308))[0]


def _changes(side: Callable[[Scalar], str], at: Callable[[int], Scalar], last: int) -> list[Scalar]:
    """The values before and after every change; on either half of the line, what has been left does not come again."""
    found: list[Scalar] = []
    known = {rank: side(at(rank)) for rank in (-last, 0, last)}
    todo = [(-last, 0), (0, last)]
    while todo:
        low, high = todo.pop()
        if known[low] == known[high]:
            continue
        if high - low == 1:
            found += [at(low), at(high)]
        else:
            middle = (low + high) // 2
            known[middle] = side(at(middle))
            todo += [(low, middle), (middle, high)]
    return found


Number: TypeAlias = int | float

_PARTS: Final = 16
_READABLE: Final = 8


def regions(
    constants: Iterable[Scalar], avoid: Iterable[Scalar], many: int, fresh: Fresh, *, ordered: bool, calculated: bool
) -> tuple[list[tuple[Json, ...]], tuple[Scalar, ...]]:
    """`many` values from every region between the constants and `many` without order, none of them among those to avoid.

    Without `ordered`, guards ask for equality alone, and values without order are all there is to try. With `calculated`, integers
    and doubles of equal value are told apart. A region with fewer values is there with all that it has; the constants come second.
    """
    opaque = tuple(fresh.opaque(number) for number in range(many))
    if not ordered:
        return [opaque], ()
    points = {key(one): one for one in constants}
    numbers = sorted(one for one in points.values() if isinstance(one, (int, float)) and is_number(one))
    strings = sorted(one for one in points.values() if isinstance(one, str))
    avoided = {key(one) for one in avoid}
    found: list[tuple[Json, ...]] = []
    for low, high in pairwise((None, *numbers, None)):
        sorts = [_integers(low, high), _doubles(low, high)]
        found += [_taken(one, many, avoided) for one in (sorts if calculated else [chain(*sorts)])]
    found += [_taken(_strings(low, high), many, avoided) for low, high in pairwise((None, *strings, None))]
    return [*filter(None, found), opaque], tuple(points.values())


def _taken(values: Iterator[Json], many: int, avoided: set[Hashable]) -> tuple[Json, ...]:
    """So many different values; the avoided ones only where there are too few others."""
    free: dict[Hashable, Json] = {}
    spare: dict[Hashable, Json] = {}
    for one in values:
        (spare if key(one) in avoided else free)[key(one)] = one
        if len(free) == many:
            return tuple(free.values())
    return (*free.values(), *spare.values())


def _integers(low: Number | None, high: Number | None) -> Iterator[int]:
    """The integers strictly between two numbers (None: no bound)."""
    if low is not None:
        first = math.floor(low) + 1
        yield from count(first) if high is None else range(first, math.ceil(high))
    elif high is not None:
        yield from count(math.ceil(high) - 1, -1)
    else:
        yield from count()


def _doubles(low: Number | None, high: Number | None) -> Iterator[float]:
    """The doubles strictly between two numbers, some round ones first."""
    if low is not None and high is not None:
        below, above = _at_most(low), -_at_most(-high)
        for part in range(1, _PARTS):
            middle = below / _PARTS * (_PARTS - part) + above / _PARTS * part
            if low < middle < high:
                yield middle
    up = low is not None
    at = _at_most(low) if low is not None else 0.0 if high is None else -_at_most(-high)
    while math.isfinite(at := math.nextafter(at, math.inf if up else -math.inf)) and (high is None or at < high):
        if low is None or at > low:
            yield at


def _at_most(number: Number) -> float:
    """The last double that is not above a number."""
    try:
        near = float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf
    return near if near <= number else math.nextafter(near, -math.inf)


def _strings(low: str | None, high: str | None) -> Iterator[str]:
    """The strings strictly between two (None: no bound), readable ones first."""
    if low is None:
        yield ""
    low = low or ""
    for number in range(1, _READABLE):
        if high is None or low + "a" * number < high:
            yield low + "a" * number
    for number in count(1):
        if high is not None and low + "\0" * number >= high:
            return
        yield low + "\0" * number


# Values for the variables of guards: one choice for every combination of truths that the guards can have.
#
# The places are those of a closed set that also has the equalities which the guards ask about (`refined`). So two values that a
# guard compares are equal exactly when they are one place, and the value of a free place is no constant of its guards. What is left to
# choose is the region between constants and, where values are compared with each other, their order: a different value from each
# region for every place shows every case. Places in no common guard are chosen independently; they take
# different values, so that no choice makes equal what the closed set leaves apart. Where a region has too few values for that and a
# pattern asks for equality, all choices are tried together.

TRIED: Final = 200_000
"""The most choices of values that are tried."""


@dataclass(frozen=True, slots=True)
class Guarded:
    """A pattern with a guard on its variables, and what the guard asks."""

    pattern: Pattern
    guard: Guard
    asked: Asked

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
        self._many = sum(len(variables(one.guard)) for one in guarded)
        self._literals = {key(literal.value) for pattern in patterns for _, literal in _literals(pattern)}
        self._regions, self._points = self._all_regions()
        self._crowded = self._linked and any(len(region) < self._many for region in self._regions)
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
            _Placed(one.guard, {name: demands.place(where[name]) for name in variables(one.guard)})
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
        found = [region if len(region) < self._many else region[mine] for region in self._regions]
        return [*chain.from_iterable(found), *self._points]

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

    def _all_regions(self) -> tuple[list[tuple[Json, ...]], tuple[Scalar, ...]]:
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
