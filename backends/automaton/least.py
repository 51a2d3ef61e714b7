"""The least event that satisfies some patterns, by unification.

Every value that nothing determines is one that occurs nowhere else, and every object has a field that occurs nowhere else.
Patterns demand and never forbid: what the least event matches, every event that satisfies the patterns matches.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from rvaft.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    rigid_variables,
    substitute,
    variables,
)


class Clash(Exception):
    """No value is what it would have to be. Never leaves this module."""


@dataclass(slots=True, eq=False)
class _Value:
    """An unknown value, and what is known of it."""

    literal: Literal | None = None
    fields: "dict[str, _Value] | None" = None
    items: "list[_Value] | None" = None
    same: "_Value | None" = None

    def find(self) -> "_Value":
        value = self
        while value.same is not None:
            value = value.same
        return value

    @property
    def free(self) -> bool:
        return self.literal is None and self.fields is None and self.items is None


@dataclass(slots=True)
class Least:
    """The least event that satisfies some patterns; raises `Clash` where there is none."""

    root: _Value = field(default_factory=lambda: _Value(fields={}))
    bound: dict[str, _Value] = field(default_factory=dict)

    def demand(self, pattern: Pattern) -> None:
        """Make the event satisfy one more pattern, whose local variables are its own."""
        own = {name: Variable(f"_{len(self.bound)}{name}") for name in variables(pattern) if name.startswith("_")}
        todo = [(substitute(pattern, own), self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            match part:
                case Literal():
                    _unify(known, _Value(literal=part))
                case Variable(name):
                    _unify(self.bound.setdefault(name, known), known)
                case Anything():
                    pass
                case ObjectPattern(fields):
                    fresh = [(name, inner, _Value()) for name, inner in fields]
                    for name, _, inside in fresh:
                        _unify(known, _Value(fields={name: inside}))
                        known = known.find()
                    _unify(known, _Value(fields={}))
                    todo.extend((inner, inside) for _, inner, inside in fresh)
                case ListPattern(items):
                    inside_list = [_Value() for _ in items]
                    _unify(known, _Value(items=inside_list))
                    todo.extend(zip(items, inside_list, strict=True))

    def finite(self) -> bool:
        """Whether no value would have to contain itself."""
        done: set[int] = set()
        path: set[int] = set()
        todo = [(self.root.find(), False)]
        while todo:
            value, left = todo.pop()
            if left:
                path.discard(id(value))
                done.add(id(value))
            elif id(value) in path:
                return False
            elif id(value) not in done:
                path.add(id(value))
                todo.append((value, True))
                inner = [*(value.fields or {}).values(), *(value.items or ())]
                todo.extend((part.find(), False) for part in inner if id(part.find()) not in done)
        return True

    def satisfies(self, pattern: Pattern) -> bool:
        """Whether the least event matches a pattern, rigid variables as bound so far."""
        if not all(name in self.bound for name in rigid_variables(pattern)):
            return False
        bound = {name: value for name, value in self.bound.items() if not name.startswith("_")}
        todo = [(pattern, self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            match part:
                case Literal():
                    if known.literal != part:
                        return False
                case Variable(name):
                    if not _equal(bound.setdefault(name, known), known):
                        return False
                case Anything():
                    pass
                case ObjectPattern(fields):
                    if known.fields is None or not all(name in known.fields for name, _ in fields):
                        return False
                    todo.extend((inner, known.fields[name]) for name, inner in fields)
                case ListPattern(items):
                    if known.items is None or len(known.items) != len(items):
                        return False
                    todo.extend(zip(items, known.items, strict=True))
        return True


def least(patterns: Iterable[Pattern]) -> Least | None:
    """The least event that satisfies all these patterns, or None where no event does."""
    event = Least()
    try:
        for pattern in patterns:
            event.demand(pattern)
    except Clash:
        return None
    return event if event.finite() else None


def _unify(one: _Value, other: _Value) -> None:
    todo = [(one, other)]
    while todo:
        a, b = (value.find() for value in todo.pop())
        if a is b:
            continue
        b.same = a
        if a.free:
            a.literal, a.fields, a.items = b.literal, b.fields, b.items
        elif b.free or (a.literal is not None and a.literal == b.literal):
            continue
        elif a.fields is not None and b.fields is not None:
            for name, inner in b.fields.items():
                if name in a.fields:
                    todo.append((a.fields[name], inner))
                else:
                    a.fields[name] = inner
        elif a.items is not None and b.items is not None and len(a.items) == len(b.items):
            todo.extend(zip(a.items, b.items, strict=True))
        else:
            raise Clash


def _equal(one: _Value, other: _Value) -> bool:
    todo = [(one, other)]
    while todo:
        a, b = (value.find() for value in todo.pop())
        if a is b:
            continue
        if a.literal is not None and a.literal == b.literal:
            continue
        if a.items is None or b.items is None or len(a.items) != len(b.items):
            return False  # two objects differ in the field that occurs nowhere else
        todo.extend(zip(a.items, b.items, strict=True))
    return True
