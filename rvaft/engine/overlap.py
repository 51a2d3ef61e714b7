"""Can one event fit two patterns? A quick no, or a careful yes."""

from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from itertools import combinations

from rvaft.patterns import ListPattern, Literal, ObjectPattern, Pattern
from rvaft.values import key


def compatible(left: Pattern, right: Pattern) -> bool:
    """False only where no event fits both; what variables demand is not looked at."""
    agenda = [(left, right)]
    while agenda:
        match agenda.pop():
            case Literal() as a, Literal() as b:
                if a != b:
                    return False
            case ObjectPattern(fields), ObjectPattern(others):
                given = dict(others)
                agenda.extend((inner, given[name]) for name, inner in fields if name in given)
            case ListPattern(items), ListPattern(others):
                if len(items) != len(others):
                    return False
                agenda.extend(zip(items, others, strict=True))
            case (
                Literal() | ObjectPattern() | ListPattern() as a,
                Literal() | ObjectPattern() | ListPattern() as b,
            ) if type(a) is not type(b):
                return False
            case _:
                pass
    return True


def overlapping(patterns: Sequence[Pattern]) -> Iterator[tuple[int, int]]:
    """The pairs of patterns that one event may fit.

    The patterns are split by the literals of one field after another, so that many patterns with different names cost
    little; those without a literal there go with each group.
    """
    literals = [_literals(pattern) for pattern in patterns]
    seen: set[tuple[int, int]] = set()
    agenda: list[tuple[list[int], frozenset[str]]] = [(list(range(len(patterns))), frozenset())]
    while agenda:
        group, used = agenda.pop()
        counts = Counter(field for number in group for field in literals[number] if field not in used)
        best = counts.most_common(1)
        if len(group) <= 8 or not best or best[0][1] < 2:
            for pair in combinations(group, 2):
                if pair not in seen and compatible(patterns[pair[0]], patterns[pair[1]]):
                    seen.add(pair)
                    yield pair
            continue
        field = best[0][0]
        rest = [number for number in group if field not in literals[number]]
        tables: dict[Hashable, list[int]] = {}
        for number in group:
            if field in literals[number]:
                tables.setdefault(literals[number][field], []).append(number)
        agenda.extend((sorted([*numbers, *rest]), used | {field}) for numbers in tables.values())


def _literals(pattern: Pattern) -> dict[str, Hashable]:
    if not isinstance(pattern, ObjectPattern):
        return {}
    return {field: key(inner.value) for field, inner in pattern.fields if isinstance(inner, Literal)}
