"""Cached tables from the outcomes of guards on one event to a result."""

import sys
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Generic, TypeVar

from rvaft.core.letters import EventTest
from rvaft.core.pattern_index import MEMORY
from rvaft.model.guards import OPERATORS, ORDERINGS, Guard, Operation, predicate
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import Json, is_finite, is_number

T = TypeVar("T")
H = TypeVar("H")
H_co = TypeVar("H_co", covariant=True)
_LARGEST: Final = sys.float_info.max


@dataclass(frozen=True, eq=False)
class GuardTable(Generic[H_co]):
    """A cached table from the outcomes of some guards on an event to a result.

    `of` returns the result for an event, `held` the bits of its guards, `at` the result for such
    bits.
    """

    guards: tuple[Guard | EventTest, ...]
    of: Callable[[Mapping[str, Json]], H_co]
    held: Callable[[Mapping[str, Json]], int]
    at: Callable[[int], H_co]

    @cached_property
    def field(self) -> str | None:
        """The only field that the guards use, if there is exactly one."""
        guards = [guard for guard in self.guards if not isinstance(guard, EventTest)]
        names = {name for guard in guards for name in guard_variables(guard)}
        return names.pop() if len(names) == 1 and len(guards) == len(self.guards) else None

    @cached_property
    def ordered(self) -> bool:
        """Whether each guard compares the field with a number by `<`, `<=`, `>` or `>=`."""
        orders = all(isinstance(guard, Operation) and guard.operator in ORDERINGS for guard in self.guards)
        return orders and compared_numbers(self.guards) is not None


def guard_table(
    guards: Sequence[Guard | EventTest | None], derive: Callable[[Sequence[bool]], H_co]
) -> GuardTable[H_co]:
    """Return the table over these guards; None is a guard that always holds.

    `derive` receives the outcome of each guard.

    >>> from rvaft.model.guards import Operation, Operator
    >>> from rvaft.model.patterns import Literal, Variable
    >>> past = lambda number: Operation(Operator.GT, (Variable("X"), Literal(number)))
    >>> table = guard_table([past(1), None, past(5)], lambda holds: [number for number in range(3) if holds[number]])
    >>> table.of({"X": 0}), table.of({"X": 3}), table.of({"X": 9}), table.of({"X": "a"})
    ([1], [0, 1], [0, 1, 2], [1])
    """
    places: dict[Guard | EventTest, int] = {}
    bit = [0 if guard is None else 1 << places.setdefault(guard, len(places)) for guard in guards]
    return _table_by_bits(tuple(places), lambda held: derive([held & one == one for one in bit]))


def joined_tables(tables: Sequence[GuardTable[H]], join: Callable[[tuple[H, ...]], T]) -> GuardTable[T]:
    """Return the table that joins several results; a common guard is evaluated once."""
    places: dict[Guard | EventTest, int] = {}
    for table in tables:
        for guard in table.guards:
            places.setdefault(guard, len(places))
    sources: list[tuple[Callable[[int], H], int, list[tuple[int, int]]]] = []
    for table in tables:
        pairs = [(1 << places[guard], 1 << place) for place, guard in enumerate(table.guards)]
        same = all(bit == own for bit, own in pairs)
        sources.append((table.at, (1 << len(pairs)) - 1 if same else 0, [] if same else pairs))

    def derive(held: int) -> T:
        own = [held & mask | sum([bit for one, bit in pairs if held & one]) for _, mask, pairs in sources]
        return join(tuple([at(bits) for (at, _, _), bits in zip(sources, own, strict=True)]))

    return _table_by_bits(tuple(places), derive)


def _table_by_bits(guards: tuple[Guard | EventTest, ...], derive: Callable[[int], H_co]) -> GuardTable[H_co]:
    """Return the table of a function of the guards that hold, as bits.

    Comparisons of one variable with numbers use binary search.
    """
    memory: dict[int, H_co] = {}
    tests = [
        (1 << at, guard.holds if isinstance(guard, EventTest) else predicate(guard)) for at, guard in enumerate(guards)
    ]

    def derived(event: Mapping[str, Json]) -> H_co:
        return derived_of(held(event))

    def held(event: Mapping[str, Json]) -> int:
        return sum([bit for bit, holds in tests if holds(event)])

    def derived_of(bits: int) -> H_co:
        try:
            return memory[bits]
        except KeyError:
            found = memory[bits] = derive(bits)
        if len(memory) > MEMORY:
            memory.clear()
        return found

    if not guards:
        always = derive(0)
        return GuardTable((), lambda _: always, lambda _: 0, lambda _: always)
    compared = compared_numbers(guards)
    if compared is None:
        if len(guards) == 1:
            ((_, holds_alone),) = tests
            return GuardTable(guards, lambda event: derived_of(1 if holds_alone(event) else 0), held, derived_of)
        return GuardTable(guards, derived, held, derived_of)
    name, points = compared
    by_place: dict[int, H_co] = {}
    """The results by position: below the first number, at it, between it and the second, …"""

    def placed(event: Mapping[str, Json]) -> H_co:
        value = event[name]
        if type(value) is not int and not (type(value) is float and -_LARGEST <= value <= _LARGEST):
            return derived(event)
        place = bisect_left(points, value) + bisect_right(points, value)
        try:
            return by_place[place]
        except KeyError:
            found = by_place[place] = derived(event)
        if len(by_place) > MEMORY:
            by_place.clear()
        return found

    return GuardTable(guards, placed, held, derived_of)


def compared_numbers(guards: Iterable[Guard | EventTest]) -> tuple[str, list[int | float]] | None:
    """Return the variable that all guards compare with numbers, and the sorted numbers, or None."""
    names, points = set[str](), set[int | float]()
    for guard in guards:
        match guard:
            case Operation(operator, (Variable(name), Literal(number))) if OPERATORS[operator].compare:
                if not isinstance(number, (int, float)) or not is_number(number) or not is_finite(number):
                    return None
                names.add(name)
                points.add(number)
            case _:
                return None
    return (names.pop(), sorted(points)) if len(names) == 1 else None
