"""Which event patterns can be served by one event.

Conservative: variables stand for anything, whatever they are bound to, and guards are not looked at. So "cannot" is certain.
"""

from collections import Counter, defaultdict
from collections.abc import Hashable, Iterator, Sequence
from itertools import combinations, product
from typing import TypeAlias

from rvaft.patterns import ListPattern, Literal, ObjectPattern, Pattern
from rvaft.values import key

Path: TypeAlias = tuple[str | int, ...]


def may_overlap(left: Pattern, right: Pattern) -> bool:
    """Whether some event may match both patterns."""
    todo = [(left, right)]
    while todo:
        match todo.pop():
            case Literal() as a, Literal() as b:
                if a != b:
                    return False
            case ObjectPattern(fields), ObjectPattern(others):
                by_name = dict(others)
                todo.extend((inner, by_name[name]) for name, inner in fields if name in by_name)
            case ListPattern(items), ListPattern(others):
                if len(items) != len(others):
                    return False
                todo.extend(zip(items, others, strict=True))
            case (Literal() | ObjectPattern() | ListPattern(), Literal() | ObjectPattern() | ListPattern()):
                return False
            case _:  # a variable or `_` on one side fits anything
                pass
    return True


def overlaps(patterns: Sequence[Pattern]) -> list[int]:
    """For each pattern the set (bits) of the other patterns that one event may match together with it."""
    alike: dict[Pattern, int] = {}
    for number, pattern in enumerate(patterns):
        alike[pattern] = alike.get(pattern, 0) | 1 << number
    together = dict(alike)
    for a, b in _candidates(list(alike)):
        if may_overlap(a, b):
            together[a] |= alike[b]
            together[b] |= alike[a]
    return [together[pattern] & ~(1 << number) for number, pattern in enumerate(patterns)]


def _candidates(patterns: Sequence[Pattern]) -> Iterator[tuple[Pattern, Pattern]]:
    """The pairs that do not differ in the literal at one place (the name of a topic, say), chosen so that they are few."""
    literals = {pattern: dict(_literals(pattern)) for pattern in patterns}
    counts: defaultdict[Path, Counter[Hashable]] = defaultdict(Counter)
    for found in literals.values():
        for place, literal in found.items():
            counts[place][literal] += 1
    if not counts:
        yield from combinations(patterns, 2)
        return
    where = min(counts, key=lambda place: _cost(counts[place], len(patterns)))
    buckets: defaultdict[Hashable, list[Pattern]] = defaultdict(list)
    rest: list[Pattern] = []
    for pattern, found in literals.items():
        (buckets[found[where]] if where in found else rest).append(pattern)
    for bucket in buckets.values():
        yield from combinations(bucket, 2)
        yield from product(rest, bucket)
    yield from combinations(rest, 2)


def _cost(counts: Counter[Hashable], total: int) -> int:
    return sum(count * count for count in counts.values()) + (total - counts.total()) * total


def _literals(pattern: Pattern) -> Iterator[tuple[Path, Hashable]]:
    todo: list[tuple[Path, Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        match part:
            case Literal(value):
                yield path, key(value)
            case ObjectPattern(fields):
                todo.extend(((*path, name), inner) for name, inner in fields)
            case ListPattern(items):
                todo.extend(((*path, index), inner) for index, inner in enumerate(items))
            case _:
                pass
