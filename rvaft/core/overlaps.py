"""Overlap and implication of event patterns.

Patterns never exclude fields or values. So the events that match several patterns have a *least*
event: undetermined values are unique, and objects have a unique additional field. A pattern that
matches the least event matches all of them.

The least event is said to match `[..., P, ...]` only if this very pattern is required there, and two
such patterns never exclude each other. So there may be no event as small as the least one.

Patterns share rigid variables. `compatible` and `implies` are quick one-sided tests that treat
variables as wildcards.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    rigid_variables,
    substitute,
    variables,
    walk,
)
from rvaft.model.tree import find_cycle
from rvaft.support.bits import bits, mask_of, union
from rvaft.support.budget import Budget

Path: TypeAlias = tuple[str | int, ...]
"""The field names and list indexes that lead to a part of a pattern."""
Head: TypeAlias = Literal | int | str | None
"""What a pattern requires of a value itself: a literal, a list length, an object, or nothing."""


def _opened(pattern: Pattern) -> tuple[Head, Iterable[tuple[str | int, Pattern]]]:
    match pattern:
        case Literal():
            return pattern, ()
        case ObjectPattern(fields):
            return "object", fields
        case ListPattern(items):
            return len(items), enumerate(items)
        case Variable() | Anything() | SomeItem():
            return None, ()


def compatible(left: Pattern, right: Pattern) -> bool:
    """Whether one event might match both patterns; False is certain.

    >>> compatible(Literal(1), Literal(2)), compatible(Variable("X"), Literal(2))
    (False, True)
    """
    demanded = dict(_heads(left))
    return all(demanded.get(path, head) == head for path, head in _heads(right))


def implies(special: Pattern, general: Pattern, bound: Set[str] = frozenset()) -> bool:
    """Whether every event that matches `special` matches `general`; True is certain.

    `bound` names variables with a value; another variable that occurs once matches any value.
    """
    names = Counter(part.name for part in walk(general) if isinstance(part, Variable))
    todo = [(special, general)]
    while todo:
        one, other = todo.pop()
        if isinstance(other, Anything) or (
            isinstance(other, Variable) and names[other.name] == 1 and other.name not in bound
        ):
            continue
        (own, parts), (head, demanded) = _opened(one), _opened(other)
        if own != head or (head is None and one != other):
            return False
        there = dict(parts)
        for name, inner in demanded:
            if name not in there:
                return False
            todo.append((there[name], inner))
    return True


class Clash(Exception):
    """No value satisfies all requirements; internal to this module."""


@dataclass(slots=True, eq=False)
class Unknown:
    """A value of the least event with its requirements; `same` is the value it aliases, if any."""

    head: Head = None
    parts: "dict[str | int, Unknown]" = field(default_factory=dict)
    some: frozenset[SomeItem] = frozenset()
    same: "Unknown | None" = None

    def find(self) -> "Unknown":
        """Return the representative of the value (union-find)."""
        value = self
        while value.same is not None:
            value = value.same
        return value


@dataclass(slots=True)
class LeastEvent:
    """The least event that matches the patterns required so far."""

    root: Unknown = field(default_factory=lambda: Unknown("object"))
    bound: dict[str, Unknown] = field(default_factory=dict)

    def demand(self, pattern: Pattern) -> None:
        """Require one more pattern; raises `Clash` if no event matches all."""
        own = {name: Variable(f"_{len(self.bound)}{name}") for name in variables(pattern) if name.startswith("_")}
        todo = [(substitute(pattern, own) if own else pattern, self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            if isinstance(part, Variable):
                _unify(self.bound.setdefault(part.name, known), known)
            if isinstance(part, SomeItem):
                if variables(part) == rigid_variables(part):
                    known.find().some |= {part}
                for variable in rigid_variables(part):
                    self.bound.setdefault(variable, Unknown())
            head, parts = _opened(part)
            if head is not None:
                inside: dict[str | int, Unknown] = {}
                for name, inner in parts:
                    inside[name] = Unknown()
                    todo.append((inner, inside[name]))
                _unify(known, Unknown(head, inside))

    def finite(self) -> bool:
        """Whether no value contains itself."""
        below: dict[int, list[int]] = {}
        todo = [self.root.find()]
        while todo:
            value = todo.pop()
            if id(value) not in below:
                inner = [part.find() for part in value.parts.values()]
                below[id(value)] = [id(part) for part in inner]
                todo += inner
        return not find_cycle(below)

    def satisfies(self, pattern: Pattern) -> bool:
        """Whether the least event matches a pattern, with the rigid variables as bound so far."""
        if not all(name in self.bound for name in rigid_variables(pattern)):
            return False
        bound = {name: value for name, value in self.bound.items() if not name.startswith("_")}
        todo = [(pattern, self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            if isinstance(part, Variable) and not _equal(bound.setdefault(part.name, known), known):
                return False
            head, parts = _opened(part)
            if (isinstance(part, SomeItem) and part not in known.some) or (head is not None and head != known.head):
                return False
            for name, inner in parts:
                if name not in known.parts:
                    return False
                todo.append((inner, known.parts[name]))
        return True


def least(patterns: Iterable[Pattern]) -> LeastEvent | None:
    """Return the least event that matches all patterns, or None if no event does.

    >>> goal, any_goal = ObjectPattern((("goal", Literal("x")),)), ObjectPattern((("goal", Anything()),))
    >>> event = least([goal])
    >>> event.satisfies(any_goal), least([any_goal]).satisfies(goal)
    (True, False)
    """
    event = LeastEvent()
    try:
        for pattern in patterns:
            event.demand(pattern)
    except Clash:
        return None
    return event if event.finite() else None


def _unify(one: Unknown, other: Unknown) -> None:
    todo = [(one, other)]
    while todo:
        a, b = (value.find() for value in todo.pop())
        if a is b:
            continue
        b.same = a
        a.some |= b.some
        if a.head is None:
            a.head, a.parts = b.head, b.parts
        elif b.head is not None:
            if a.head != b.head:
                raise Clash
            todo.extend((a.parts[name], inner) for name, inner in b.parts.items() if name in a.parts)
            a.parts = b.parts | a.parts


def _equal(one: Unknown, other: Unknown) -> bool:
    todo = [(one, other)]
    while todo:
        a, b = (value.find() for value in todo.pop())
        if a is not b:
            if a.head is None or a.head == "object" or a.head != b.head:
                return False  # two objects differ in their unique additional field
            todo.extend((a.parts[name], b.parts[name]) for name in a.parts)
    return True


def overlaps(left: Pattern, right: Pattern) -> bool:
    """Whether some event matches both patterns under one assignment of the rigid variables.

    >>> one = ObjectPattern((("a", Variable("X")), ("b", Literal(1))))
    >>> overlaps(one, ObjectPattern((("a", Literal(2)), ("b", Variable("X")))))
    False
    """
    # Within another object, because a pattern here need not match a whole event.
    return least([ObjectPattern((("event", left),)), ObjectPattern((("event", right),))]) is not None


class Overlaps:
    """The overlaps among many patterns, without a comparison of all pairs.

    Sets of patterns are bit masks by index.

    >>> at = lambda kind, value: ObjectPattern((("kind", Literal(kind)), ("value", value)))
    >>> some = Overlaps([at("a", Variable("X")), at("a", Literal(1)), at("b", Literal(1)), Anything()])
    >>> [list(bits(some.compatible(number))) for number in range(4)]
    [[0, 1, 3], [0, 1, 3], [2, 3], [0, 1, 2, 3]]
    """

    def __init__(self, patterns: Sequence[Pattern]) -> None:
        self.patterns = patterns
        self._all = (1 << len(patterns)) - 1
        self._heads = [_heads(pattern) for pattern in patterns]
        grouped: dict[Path, dict[Head, list[int]]] = {}
        for number, heads in enumerate(self._heads):
            for path, head in heads:
                grouped.setdefault(path, {}).setdefault(head, []).append(number)
        self._same = {path: {head: _members(group) for head, group in of.items()} for path, of in grouped.items()}
        self._open = {
            path: self._all & ~mask_of(number for group in of.values() for number in group)
            for path, of in grouped.items()
        }
        """For each path, the patterns without a requirement there."""

    def compatible(self, number: int) -> int:
        """Return the patterns that are `compatible` with this one, itself included."""
        found = self._all
        for path, head in self._heads[number]:
            found &= self._open[path] | _mask(self._same[path][head])
        return found

    def pairs(self) -> Iterator[tuple[int, int]]:
        """Iterate over the pairs of compatible patterns, lower index first."""
        for number in range(len(self.patterns)):
            for other in bits(self.compatible(number) >> number + 1):
                yield number, number + 1 + other

    def exact(self, number: int, budget: Budget) -> int:
        """Return the other patterns that overlap this one; raises `Undecided` beyond the budget."""
        found = self.compatible(number) ^ 1 << number
        repeating, having = self._doubtful
        names = rigid_variables(self.patterns[number])
        # Compatible patterns can only fail to overlap if one or both have a repeated variable.
        doubtful = self._all if repeating >> number & 1 else repeating | union(_mask(having[name]) for name in names)
        for other in bits(found & doubtful):
            budget.spend(5)
            if not overlaps(self.patterns[number], self.patterns[other]):
                found ^= 1 << other
        return found

    @cached_property
    def _doubtful(self) -> tuple[int, dict[str, "int | list[int]"]]:
        """The patterns with a repeated variable, and the patterns of each variable."""
        repeating = 0
        having: dict[str, list[int]] = {}
        for number, pattern in enumerate(self.patterns):
            if sum(isinstance(part, Variable) for part in walk(pattern)) > len(variables(pattern)):
                repeating |= 1 << number
            for name in rigid_variables(pattern):
                having.setdefault(name, []).append(number)
        return repeating, {name: _members(group) for name, group in having.items()}


def _members(group: list[int]) -> int | list[int]:
    return group if len(group) < 16 else mask_of(group)


def _mask(members: int | list[int]) -> int:
    return members if isinstance(members, int) else mask_of(members)


def _heads(pattern: Pattern) -> list[tuple[Path, Head]]:
    found: list[tuple[Path, Head]] = []
    todo: list[tuple[Path, Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        head, parts = _opened(part)
        if head is not None:
            found.append((path, head))
            todo.extend(((*path, name), inner) for name, inner in parts)
    return found
