"""Values to try where guards look: some from every region in which no guard changes its mind."""

import math
from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, count, pairwise
from typing import Final, TypeAlias

from cross_check.letters.least import Fresh
from rvaft.values import Json, Scalar, is_number, key

Number: TypeAlias = int | float

_PARTS: Final = 16
_READABLE: Final = 8


@dataclass(frozen=True, slots=True)
class Regions:
    """For each region some values, all different; `points` are the constants between regions.

    A region with fewer values than were wanted is there with all that it has.
    """

    regions: tuple[tuple[Json, ...], ...]
    points: tuple[Scalar, ...] = ()


def regions(
    constants: Iterable[Scalar], avoid: Iterable[Scalar], many: int, fresh: Fresh, *, ordered: bool, calculated: bool
) -> Regions:
    """`many` values from every region between the constants and `many` without order, none of them among those to avoid.

    Without `ordered`, guards ask for equality alone, and values without order are all there is to try. With `calculated`, integers
    and doubles of equal value are told apart.
    """
    opaque = tuple(fresh.opaque(number) for number in range(many))
    if not ordered:
        return Regions((opaque,))
    points = {key(one): one for one in constants}
    numbers = sorted(one for one in points.values() if isinstance(one, (int, float)) and is_number(one))
    strings = sorted(one for one in points.values() if isinstance(one, str))
    avoided = {key(one) for one in avoid}
    found: list[tuple[Json, ...]] = []
    for low, high in pairwise((None, *numbers, None)):
        sorts = [_integers(low, high), _doubles(low, high)]
        found += [_taken(one, many, avoided) for one in (sorts if calculated else [chain(*sorts)])]
    found += [_taken(_strings(low, high), many, avoided) for low, high in pairwise((None, *strings, None))]
    return Regions((*(region for region in found if region), opaque), tuple(points.values()))


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
