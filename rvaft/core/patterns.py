"""What can be said of event patterns before any event comes: may one event match them together,
does one imply the other.

Patterns demand and never forbid. What all events that match some patterns have in common is
therefore itself an event, the *least* one: every value that nothing determines is one that occurs
nowhere else, and every object has a field that occurs nowhere else. What the least event matches,
every event matches that matches the patterns. Rigid variables are shared between the patterns (a
tree gives them one value), local ones are each pattern's own. Guards are not looked at.

For each question there is a quick answer, certain in one direction, for which variables stand for
anything: `compatible`, `implies`.
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
"""The names of fields, and places in lists, that lead to a part of a pattern."""
Head: TypeAlias = Literal | int | str | None
"""What a pattern demands of a value itself: a literal, a list of some length, an object; None is nothing."""


def _opened(pattern: Pattern) -> tuple[Head, Iterable[tuple[str | int, Pattern]]]:
    """What a pattern demands of a value, and of the parts of it."""
    match pattern:
        case Literal():
            return pattern, ()
        case ObjectPattern(fields):
            return "object", fields
        case ListPattern(items):
            return len(items), enumerate(items)
        case Variable() | Anything():
            return None, ()


def compatible(left: Pattern, right: Pattern) -> bool:
    """Whether one event might match both patterns, which demand nothing different at any common path; False is certain.

    >>> compatible(Literal(1), Literal(2)), compatible(Variable("X"), Literal(2))
    (False, True)
    """
    demanded = dict(_heads(left))
    return all(demanded.get(path, head) == head for path, head in _heads(right))


def implies(special: Pattern, general: Pattern, bound: Set[str] = frozenset()) -> bool:
    """Whether every event that matches the special pattern matches the general one; True is certain.

    `bound` names the variables that have a value already; any other one that stands once in the
    general pattern takes what is there.
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


# The least event of several patterns.


class Clash(Exception):
    """No value is what it would have to be. Never leaves this module."""


@dataclass(slots=True, eq=False)
class Unknown:
    """A value of the least event, and what is known of it and of its parts; with `same` it is that other one."""

    head: Head = None
    parts: "dict[str | int, Unknown]" = field(default_factory=dict)
    same: "Unknown | None" = None

    def find(self) -> "Unknown":
        """The value that it is."""
        value = self
        while value.same is not None:
            value = value.same
        return value


@dataclass(slots=True)
class LeastEvent:
    """The least event that matches the patterns demanded so far."""

    root: Unknown = field(default_factory=lambda: Unknown("object"))
    bound: dict[str, Unknown] = field(default_factory=dict)

    def demand(self, pattern: Pattern) -> None:
        """Make the event match one more pattern; raises `Clash` where it cannot."""
        own = {name: Variable(f"_{len(self.bound)}{name}") for name in variables(pattern) if name.startswith("_")}
        todo = [(substitute(pattern, own) if own else pattern, self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            if isinstance(part, Variable):
                _unify(self.bound.setdefault(part.name, known), known)
            head, parts = _opened(part)
            if head is not None:
                inside: dict[str | int, Unknown] = {}
                for name, inner in parts:
                    inside[name] = Unknown()
                    todo.append((inner, inside[name]))
                _unify(known, Unknown(head, inside))

    def finite(self) -> bool:
        """Whether no value would have to contain itself."""
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
        """Whether it matches a pattern, rigid variables as bound so far.

        Then every event does that matches the patterns demanded.
        """
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
            if head is not None and head != known.head:
                return False
            for name, inner in parts:
                if name not in known.parts:
                    return False
                todo.append((inner, known.parts[name]))
        return True


def least(patterns: Iterable[Pattern]) -> LeastEvent | None:
    """The least event that matches all these patterns, or None where no event does.

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
                return False  # two objects differ in the field that occurs nowhere else
            todo.extend((a.parts[name], b.parts[name]) for name in a.parts)
    return True


def overlaps(left: Pattern, right: Pattern) -> bool:
    """Whether some event matches both patterns under one assignment of the rigid variables.

    >>> one = ObjectPattern((("a", Variable("X")), ("b", Literal(1))))
    >>> overlaps(one, ObjectPattern((("a", Literal(2)), ("b", Variable("X")))))
    False
    """
    # Within another object, since here a pattern need not be one of a whole event.
    return least([ObjectPattern((("event", left),)), ObjectPattern((("event", right),))]) is not None


# Overlaps among many patterns, found without comparing all pairs.


class Overlaps:
    """Which of many patterns one event may match together; sets of patterns are bits by their place in the sequence.

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
        """For each path the patterns that demand nothing there."""

    def compatible(self, number: int) -> int:
        """The patterns that `compatible` says one event might match together with this one; itself among them."""
        found = self._all
        for path, head in self._heads[number]:
            found &= self._open[path] | _mask(self._same[path][head])
        return found

    def pairs(self) -> Iterator[tuple[int, int]]:
        """The pairs of compatible patterns, the first one first."""
        for number in range(len(self.patterns)):
            for other in bits(self.compatible(number) >> number + 1):
                yield number, number + 1 + other

    def exact(self, number: int, budget: Budget) -> int:
        """The others that some event matches together with this pattern; raises `Undecided`."""
        found = self.compatible(number) ^ 1 << number
        repeating, having = self._doubtful
        names = rigid_variables(self.patterns[number])
        # Only where a variable stands twice, in one of two patterns or in both, can they be compatible and not overlap.
        doubtful = self._all if repeating >> number & 1 else repeating | union(_mask(having[name]) for name in names)
        for other in bits(found & doubtful):
            budget.spend(5)
            if not overlaps(self.patterns[number], self.patterns[other]):
                found ^= 1 << other
        return found

    @cached_property
    def _doubtful(self) -> tuple[int, dict[str, "int | list[int]"]]:
        """The patterns where some variable stands twice, and of each variable the patterns that have it."""
        repeating = 0
        having: dict[str, list[int]] = {}
        for number, pattern in enumerate(self.patterns):
            if sum(isinstance(part, Variable) for part in walk(pattern)) > len(variables(pattern)):
                repeating |= 1 << number
            for name in rigid_variables(pattern):
                having.setdefault(name, []).append(number)
        return repeating, {name: _members(group) for name, group in having.items()}


def _members(group: list[int]) -> int | list[int]:
    """A set of few patterns takes less room as a list."""
    return group if len(group) < 16 else mask_of(group)


def _mask(members: int | list[int]) -> int:
    return members if isinstance(members, int) else mask_of(members)


def _heads(pattern: Pattern) -> list[tuple[Path, Head]]:
    """What a pattern demands at each path."""
    found: list[tuple[Path, Head]] = []
    todo: list[tuple[Path, Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        head, parts = _opened(part)
        if head is not None:
            found.append((path, head))
            todo.extend(((*path, name), inner) for name, inner in parts)
    return found
