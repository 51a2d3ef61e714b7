"""Values for guards: some from every region in which no guard changes its truth value."""

import math
import struct
import sys
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count, pairwise, product
from math import prod
from typing import Final, TypeAlias, TypeVar

import networkx as nx

from cross_check.letters.unification import ROOT, Demands, Fresh, Place
from rvaft.errors import TooLarge
from rvaft.model.guards import (
    COMPARISONS,
    NUMERIC,
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
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, substitute
from rvaft.model.values import EXACT_INTEGERS, Json, Scalar, is_number, key

# The constants at which a guard's truth value can change, and the values that it compares. Between
# neighbouring constants, a comparison of a variable with a constant is invariant. If the variable
# occurs in arithmetic (`X / 2 < 1`), every step is monotone, including rounding and overflow.
# Bisection then finds the changes, once among integers and once among doubles.

SEVERAL: Final = "a guard has arithmetic over several values"
BEYOND: Final = "a guard has an operation without known bounds"

_MODERATE: Final = 2**64
_SMALL: Final = 4
"""Largest integer whose products are monotone without bounds."""
_BITS: Final = 64
_DOUBLE_BITS: Final = 1024 + _BITS
"""All integers from two to this power on are equivalent, apart from the bits that steps with
moderate constants can remove.
"""


class GuardFacts:
    """The constants and comparisons of a guard; `gap` is the reason if they are incomplete."""

    def __init__(self, guard: Guard) -> None:
        self.constants: dict[str, dict[Literal, None]] = {}
        self.pairs: set[tuple[str, str]] = set()
        self.ordered = False
        self.equated = False
        self.calculated = False
        self.gap = ""
        self._condition(guard)

    def _constant(self, name: str, *given: Scalar) -> None:
        self.constants.setdefault(name, {}).update(dict.fromkeys(map(Literal, given)))

    def _condition(self, guard: Guard) -> None:
        match guard:
            case Variable(name):
                self._constant(name, True, False)
            case Operation(Operator.AND | Operator.OR | Operator.NOT, operands):
                for operand in operands:
                    self._condition(operand)
            case Operation(operator, operands) if operator in COMPARISONS:
                left, right = map(_folded, operands)
                if left is not None and right is not None:  # otherwise the comparison is always undefined
                    self.ordered |= operator in ORDERINGS
                    self.equated |= operator not in ORDERINGS
                    self._comparison(left, right)
            case Operation(Operator.IN, (one, *listed)):
                for literal in listed:
                    self._condition(Operation(Operator.EQ, (one, literal)))
            case Operation(Operator.STARTSWITH, (Variable(name), Literal(str() as text))):
                self.ordered = True
                self._constant(name, text, *_behind(text))
            case Operation() if variables(guard):
                self.gap = BEYOND
                for name, example in product(variables(guard), _examples(guard)):
                    self._constant(name, example)
            case _:
                pass

    def _comparison(self, left: Guard, right: Guard) -> None:
        match left, right:
            case (Variable(one), Variable(other)):
                if one != other:
                    self.pairs.add((one, other))
            case (Variable(name), Literal(constant)) | (Literal(constant), Variable(name)):
                self._constant(name, constant)
            case _:
                operators = [side.operator for side in (left, right) if isinstance(side, Operation)]
                if any(operator in NUMERIC for operator in operators):
                    self._calculation(left, right)
                if any(operator not in NUMERIC for operator in operators):  # the other side is then a Boolean
                    self._condition(left)
                    self._condition(right)

    def _calculation(self, left: Guard, right: Guard) -> None:
        self.ordered = self.calculated = True
        names = list(dict.fromkeys((*variables(left), *variables(right))))
        constants = [part.value for part in (*walk(left), *walk(right)) if isinstance(part, Literal)]
        for name in names:
            self._constant(name, *filter(is_number, constants))
        calculated, other = (left, right) if isinstance(left, Operation) else (right, left)
        if len(names) > 1 or not (isinstance(other, Literal) and _is_monotone(calculated, other.value)):
            self.gap = SEVERAL if len(names) > 1 else BEYOND
            return
        (name,), limit = names, other.value

        def side(given: Scalar) -> str:
            result = value(calculated, {name: given})
            if result is UNDEFINED:
                return "undefined"
            if not is_number(limit):
                return "defined"
            return "above" if result > limit else "below" if result < limit else "equal"

        last = 2 ** (_DOUBLE_BITS + _BITS * sum(isinstance(part, Operation) for part in walk(calculated)))
        self._constant(name, *_changes(side, int, last), *_changes(side, _double, _LAST_DOUBLE))


def _behind(text: str) -> Iterator[str]:
    rest = text.rstrip(chr(sys.maxunicode))
    if rest:
        yield rest[:-1] + chr(ord(rest[-1]) + 1)


def _examples(guard: Guard) -> Iterator[Scalar]:
    for literal in (part.value for part in walk(guard) if isinstance(part, Literal)):
        yield literal
        if isinstance(literal, str):
            plain = literal.replace("*", "").replace("?", "x")
            yield from dict.fromkeys((plain, f"x{plain}", f"{plain}x", literal.upper()))
        elif is_number(literal):
            yield from (f"{literal}", f"{literal}e0", f"0{literal}")


def _folded(guard: Guard) -> Guard | None:
    if isinstance(guard, Operation) and not variables(guard):
        constant = value(guard, {})
        return None if constant is UNDEFINED else Literal(constant)
    return guard


def _is_monotone(guard: Guard, limit: Scalar) -> bool:
    """Return whether the guard is a chain of steps on one variable, each with a moderate constant.

    A sum with an integer is monotone if the integer is at most 2**53. A product with an integer is
    monotone if its results are less than 2**54; beyond, it does not matter if `limit` is at most
    2**53.
    """
    reach = abs(limit) if isinstance(limit, (int, float)) else 0
    while isinstance(guard, Operation):
        operands = [_folded(operand) for operand in guard.operands]
        constants = [one.value for one in operands if isinstance(one, Literal)]
        others = [one for one in operands if one is not None and not isinstance(one, Literal)]
        if guard.operator not in NUMERIC or len(others) != 1 or len(constants) != len(operands) - 1:
            return False
        if guard.operator is Operator.DIV and isinstance(operands[0], Literal):
            return False
        if guard.operator is Operator.ABS and not isinstance(others[0], Variable):  # monotone on each half-line only
            return False
        sizes = [abs(one) for one in constants if isinstance(one, (int, float)) and one]
        if not all(1 / _MODERATE <= size <= _MODERATE for size in sizes):
            return False
        size = max(sizes, default=1)
        whole = size == int(size)
        match guard.operator:
            case Operator.ADD | Operator.SUB:
                if whole and size > EXACT_INTEGERS:
                    return False
                reach += size
            case Operator.MUL:
                if whole and size > _SMALL and reach > EXACT_INTEGERS:
                    return False
                reach /= size
            case Operator.DIV:
                reach *= size
            case _:
                reach = max(reach, size)
        guard = others[0]
    return isinstance(guard, Variable)


def _double(rank: int) -> float:
    """Return the double of this rank in numeric order; rank 0 is 0."""
    magnitude: float = struct.unpack("<d", struct.pack("<Q", abs(rank)))[0]
    return magnitude if rank >= 0 else -magnitude


_LAST_DOUBLE: Final[int] = struct.unpack("<Q", struct.pack("<d", 1.7976931348623157e308))[0]


def _changes(side: Callable[[Scalar], str], at: Callable[[int], Scalar], last: int) -> list[Scalar]:
    """Return the values before and after every change; on each half-line, a left state does not
    recur.
    """
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


# Regions.

T = TypeVar("T")
Number: TypeAlias = int | float

_PARTS: Final = 16
_READABLE: Final = 8


def regions(
    constants: Iterable[Scalar], avoid: Iterable[Scalar], many: int, *, calculated: bool
) -> list[tuple[Json, ...]]:
    """Return `many` values from every region between constants, avoiding some values.

    With `calculated`, integers and equal doubles are distinguished. A smaller region is returned
    whole.
    """
    points = {key(one): one for one in constants}.values()
    numbers = sorted(one for one in points if isinstance(one, (int, float)) and is_number(one))
    strings = sorted(one for one in points if isinstance(one, str))
    avoided = {key(one) for one in avoid}
    found: list[tuple[Json, ...]] = []
    for low, high in pairwise((None, *numbers, None)):
        sorts = [_integers(low, high), _doubles(low, high)]
        found += [_taken(one, many, avoided) for one in (sorts if calculated else [chain(*sorts)])]
    found += [_taken(_strings(low, high), many, avoided) for low, high in pairwise((None, *strings, None))]
    return [*filter(None, found)]


def _taken(values: Iterator[Json], many: int, avoided: set[Hashable]) -> tuple[Json, ...]:
    free: dict[Hashable, Json] = {}
    spare: dict[Hashable, Json] = {}
    for one in values:
        (spare if key(one) in avoided else free)[key(one)] = one
        if len(free) == many:
            return tuple(free.values())
    return (*free.values(), *spare.values())


def _integers(low: Number | None, high: Number | None) -> Iterator[int]:
    if low is None:
        return count() if high is None else count(math.ceil(high) - 1, -1)
    first = math.floor(low) + 1
    return count(first) if high is None else iter(range(first, math.ceil(high)))


def _doubles(low: Number | None, high: Number | None) -> Iterator[float]:
    if low is not None and high is not None:
        below, above = _at_most(low), -_at_most(-high)
        middles = (below / _PARTS * (_PARTS - part) + above / _PARTS * part for part in range(1, _PARTS))
        yield from (middle for middle in middles if low < middle < high)
    towards = -math.inf if low is None else math.inf
    at = _at_most(low) if low is not None else 0.0 if high is None else -_at_most(-high)
    while math.isfinite(at := math.nextafter(at, towards)) and (high is None or at < high):
        if low is None or at > low:
            yield at


def _at_most(number: Number) -> float:
    try:
        near = float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf
    return near if near <= number else math.nextafter(near, -math.inf)


def _strings(low: str | None, high: str | None) -> Iterator[str]:
    if low is None:
        yield ""
    low = low or ""
    readable = (low + "a" * number for number in range(1, _READABLE))
    yield from (one for one in readable if high is None or one < high)
    for number in count(1):
        if high is not None and low + "\0" * number >= high:
            return
        yield low + "\0" * number


# Values for guard variables: one choice per possible combination of truth values. The places are
# those of a closed set that includes the equalities in guards (`refined`). Two compared values are
# therefore equal exactly if they share a place, and the value of a free place is no constant of its
# guards. A different value from each region for every place then shows every case. Places without a
# common guard get different values, so that no choice equates places of different classes. If a
# region has too few values for that and a pattern requires equality, all choices are tried
# together.

TRIED: Final = 20_000
"""Maximum number of tried choices, each about 0.2 ms; most trees need less than 5,000."""


def plain(pattern: Pattern) -> Pattern:
    """Return the pattern in a form that is equal for equivalent patterns.

    Unconstrained variables become `_`, others are numbered.
    """
    uses = [part.name for _, part in _parts(pattern, Variable)]
    by: dict[str, Pattern] = {name: Anything() for name in uses}
    twice = [name for name in by if uses.count(name) > 1]
    by.update((name, Variable(f"_{number}")) for number, name in enumerate(twice, 1))
    return substitute(pattern, by) if uses else pattern


@dataclass(frozen=True, slots=True)
class Guarded:
    """A pattern with a guard on its variables, and the guard's constants."""

    pattern: Pattern
    guard: Guard
    facts: GuardFacts

    def refined(self) -> Iterator[Pattern]:
        """Yield the pattern, and its variants for each equality in the guard."""
        yield plain(self.pattern)
        for name, constants in self.facts.constants.items():
            for constant in constants:
                yield plain(substitute(self.pattern, {name: constant}))
        for one, other in sorted(self.facts.pairs):
            yield plain(substitute(self.pattern, {other: Variable(one)}))


Choice: TypeAlias = Mapping[Place, Json]
Placed: TypeAlias = tuple[Guard, Mapping[str, Place]]
"""A guard, and the places of its variables."""


@dataclass(frozen=True, slots=True)
class Container:
    """A choice for an object or list: unchanged, or undefined by a non-finite number at the
    carrier.
    """

    carrier: Place | None = None


class Choices:
    """The candidate values for all guards together."""

    def __init__(self, guarded: Sequence[Guarded], patterns: Sequence[Pattern], fresh: Fresh) -> None:
        self._guarded = [(one, patterns.index(plain(one.pattern))) for one in guarded]
        self._patterns = patterns
        self._fresh = fresh
        self._calculated = any(one.facts.calculated for one in guarded)
        self._many = sum(len(variables(one.guard)) for one in guarded)
        self._tried = 0
        added = {pattern for one in guarded for pattern in one.refined()} - {plain(one.pattern) for one in guarded}
        # whether a question requires equality in its pattern
        linked = any(True for pattern in patterns if pattern not in added for _ in _parts(pattern, Variable))
        literals = [(path, part.value) for pattern in patterns for path, part in _parts(pattern, Literal)]
        self._literals = {key(one) for _, one in literals}
        self._regions = [tuple(fresh.opaque(number) for number in range(self._many))]
        self._points: tuple[Scalar, ...] = ()
        # a non-finite number does not equal itself; only it makes `V != 1` undefined
        self._undefined = [math.nan] if any(one.facts.equated for one in guarded) else []
        if any(one.facts.ordered for one in guarded):  # otherwise guards only test equality
            constants = [one.value for about in guarded for some in about.facts.constants.values() for one in some]
            if any(one.facts.pairs for one in guarded):
                # a variable may meet a literal of another pattern at the same or a linked path
                paths = {path for one in guarded for path, _ in _parts(one.pattern, Variable)}
                constants += [one for path, one in literals if linked or path in paths]
            self._points = tuple({key(one): one for one in constants}.values())
            avoid = [one for _, one in literals]
            self._regions[:0] = regions(self._points, avoid, self._many, calculated=self._calculated)
        self._crowded = linked and any(len(region) < self._many for region in self._regions)

    def events(self, closed: int, event: Json) -> Iterator[Json]:
        """Yield the events of a closed set with the least event `event`."""
        here = [one for one, at in self._guarded if closed >> at & 1]
        if not here:
            yield event
            return
        demands = Demands(self._fresh)
        for index, pattern in enumerate(self._patterns):
            if closed >> index & 1:
                demands.demand(pattern)
        wheres = [(one.guard, demands.demand(one.pattern) or {}) for one in here]
        placed: list[Placed] = [
            (guard, {name: demands.place(where[name]) for name in variables(guard)}) for guard, where in wheres
        ]
        for choice in product(*self._of_groups(placed, demands)):
            chosen = dict(chain.from_iterable(part.items() for part in choice))
            undefined = {
                one.carrier for one in chosen.values() if isinstance(one, Container) and one.carrier is not None
            }
            chosen = {place: one for place, one in chosen.items() if not isinstance(one, Container)}
            chosen.update((place, math.nan) for place in undefined if demands.is_free(place))
            values = demands.values(chosen, undefined)
            assert values is not None
            yield values[ROOT]

    def _of_groups(self, placed: Sequence[Placed], demands: Demands) -> Iterator[list[Choice]]:
        known = demands.values({})
        assert known is not None
        slot = 0
        taken = {place for _, where in placed for place in where.values()}
        for group in _groups(placed, together=self._crowded):
            free = [place for place in group if demands.is_free(place)]
            mine = slice(slot, slot + len(free))
            slot = mine.stop
            # values of every region, if possible not those of other groups, then the constants
            parts = (region if len(region) < self._many else region[mine] for region in self._regions)
            some = [*chain.from_iterable(parts), *self._points, *self._undefined]
            values = {place: some if place in free else self._forms(place, demands, taken) for place in group}
            within = [one for one in placed if not set(group).isdisjoint(one[1].values())]
            yield self._shown(within, known, {place: some for place, some in values.items() if some})

    def _shown(self, placed: Sequence[Placed], known: Choice, values: Mapping[Place, Sequence[Json]]) -> list[Choice]:
        """Return a choice per combination of truth values and equalities, also with literals."""
        self._tried += prod(map(len, values.values()))
        if self._tried > TRIED:
            raise TooLarge("values to try for the variables of guards", limit=TRIED)
        found: dict[object, Choice] = {}
        for some in product(*values.values()):
            choice = dict(zip(values, some, strict=True))
            shown = [
                one if not isinstance(one, Container) else known[at] if one.carrier is None else [math.nan]
                for at, one in choice.items()
            ]
            here = {**known, **dict(zip(choice, shown, strict=True))}
            truths = [holds(guard, {name: here[at] for name, at in where.items()}) for guard, where in placed]
            keys = [key(value) for value in shown]
            equalities = [(keys.index(one), one if one in self._literals else None) for one in keys]
            found.setdefault((*truths, *equalities), choice)
        return list(found.values())

    def _forms(self, place: Place, demands: Demands, taken: Collection[Place]) -> list[Json]:
        if demands.literal(place) is not None:
            return []
        carrier = demands.carrier(place, taken) if self._undefined else None
        return [] if carrier is None else [Container(), Container(carrier)]


def _groups(placed: Iterable[Placed], *, together: bool) -> list[list[Place]]:
    graph = nx.Graph()
    for _, where in placed:
        nx.add_path(graph, where.values())
    return [sorted(graph)] if together else [sorted(group) for group in nx.connected_components(graph)]


def _parts(pattern: Pattern, kind: type[T]) -> Iterator[tuple[tuple[str | int, ...], T]]:
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
