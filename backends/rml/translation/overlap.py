"""What can be said of two patterns without seeing an event: whether none matches both, whether one implies the other."""

from collections.abc import Mapping, Sequence, Set

from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, walk


def disjoint(left: Pattern, right: Pattern) -> bool:
    """Whether certainly no event matches both patterns: they differ in a literal or in shape at a common place."""
    todo = [(left, right)]
    while todo:
        match todo.pop():
            case (Variable() | Anything(), _) | (_, Variable() | Anything()):
                continue
            case (Literal(), Literal()) as pair:
                if pair[0] != pair[1]:
                    return True
            case (ObjectPattern(fields), ObjectPattern(others)):
                there = dict(others)
                todo.extend((inner, there[name]) for name, inner in fields if name in there)
            case (ListPattern(items), ListPattern(others)):
                if len(items) != len(others):
                    return True
                todo.extend(zip(items, others, strict=True))
            case _:
                return True
    return False


def implies(special: Pattern, general: Pattern, bound: Set[str]) -> bool:
    """Whether certainly every event that matches the special pattern matches the general one.

    `bound` names the variables that have a value already; any other one that stands once in the general pattern takes what is there.
    """
    parts = [part for part in walk(general) if isinstance(part, Variable)]
    free = {part.name for part in parts if part.name not in bound and parts.count(part) == 1}
    todo = [(special, general)]
    while todo:
        match todo.pop():
            case (_, Anything()):
                continue
            case (_, Variable(name)) if name in free:
                continue
            case (ObjectPattern(fields), ObjectPattern(others)):
                there = dict(fields)
                if any(name not in there for name, _ in others):
                    return False
                todo.extend((there[name], inner) for name, inner in others)
            case (ListPattern(items), ListPattern(others)):
                if len(items) != len(others):
                    return False
                todo.extend(zip(items, others, strict=True))
            case (one, other):
                if one != other or isinstance(one, Anything):
                    return False
    return True


def overlaps(patterns: Sequence[Pattern]) -> list[int]:
    """For each pattern the set of those that one event might match as well, itself among them.

    Patterns that have a literal in a common field are compared only where it is the same.
    """
    field = _telling(patterns)
    groups: dict[object, list[int]] = {}
    for i, one in enumerate(patterns):
        groups.setdefault(_literals(one).get(field), []).append(i)
    found = [1 << i for i in range(len(patterns))]
    others = groups.pop(None, [])
    for group in (*([*group, *others] for group in groups.values()), others):
        for position, i in enumerate(group):
            for j in group[position + 1 :]:
                if not found[i] >> j & 1 and not disjoint(patterns[i], patterns[j]):
                    found[i] |= 1 << j
                    found[j] |= 1 << i
    return found


def _telling(patterns: Sequence[Pattern]) -> str:
    """The field that has the most different literals."""
    values: dict[str, set[Literal]] = {}
    for one in patterns:
        for name, literal in _literals(one).items():
            values.setdefault(name, set()).add(literal)
    return max(values, key=lambda name: (len(values[name]), name), default="")


def _literals(one: Pattern) -> Mapping[str, Literal]:
    fields = one.fields if isinstance(one, ObjectPattern) else ()
    return {name: inner for name, inner in fields if isinstance(inner, Literal)}
