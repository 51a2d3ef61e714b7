"""Event patterns: what an event must look like, and the matching of an event against one.

A pattern is an immutable term. `Variable` names that start with a capital are the tree's rigid
variables; names that start with `_` are local to one pattern (a parameter used twice and called
with `_` demands equal values, but shares them with nothing else). In the pattern of an event type
the parameters, lower case, are variables too; `substitute` replaces them by arguments.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from rvaft.model.values import Json, Scalar, equal, key

Binding: TypeAlias = Mapping[str, Json]


@dataclass(frozen=True, slots=True, eq=False)
class Literal:
    """A string, number, boolean or null; equal literals are those of equal JSON value."""

    value: Scalar

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, Literal) and equal(self.value, other.value)

    def __hash__(self) -> int:
        return hash(key(self.value))


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable (`Value`), a local one (`_1`), or, in an event type, a parameter (`value`)."""

    name: str

    @property
    def local(self) -> bool:
        """Whether the variable belongs to its own pattern only."""
        return self.name.startswith("_")


@dataclass(frozen=True, slots=True)
class Anything:
    """`_`: any value, null included, but not an absent field."""


@dataclass(frozen=True, slots=True)
class ObjectPattern:
    """Matches an object that has at least these fields."""

    fields: tuple[tuple[str, "Pattern"], ...]


@dataclass(frozen=True, slots=True)
class ListPattern:
    """Matches a list of the same length, elementwise."""

    items: tuple["Pattern", ...]


Pattern: TypeAlias = Literal | Variable | Anything | ObjectPattern | ListPattern


def walk(pattern: Pattern) -> Iterator[Pattern]:
    """The pattern and all its parts, outermost first, in order."""
    todo = [pattern]
    while todo:
        part = todo.pop()
        yield part
        if isinstance(part, ObjectPattern):
            todo.extend(inner for _, inner in reversed(part.fields))
        elif isinstance(part, ListPattern):
            todo.extend(reversed(part.items))


def variables(pattern: Pattern) -> tuple[str, ...]:
    """The names of the variables, each once, in order of first occurrence; local ones included."""
    return tuple(dict.fromkeys(part.name for part in walk(pattern) if isinstance(part, Variable)))


def rigid_variables(pattern: Pattern) -> tuple[str, ...]:
    """The variables that the pattern shares with the rest of the tree."""
    return tuple(name for name in variables(pattern) if not name.startswith("_"))


def substitute(pattern: Pattern, by: Mapping[str, Pattern]) -> Pattern:
    """The pattern with every variable named in `by` replaced. Nesting is bounded by the parser."""
    match pattern:
        case Variable(name):
            return by.get(name, pattern)
        case ObjectPattern(fields):
            return ObjectPattern(tuple((field, substitute(inner, by)) for field, inner in fields))
        case ListPattern(items):
            return ListPattern(tuple(substitute(inner, by) for inner in items))
        case _:
            return pattern


def match(pattern: Pattern, event: Json, binding: Binding) -> dict[str, Json] | None:
    """The binding extended so that the pattern matches the event, or None; `binding` itself is left alone.

    Names of local variables are part of the result; callers that keep it drop them with `rigid`.
    """
    bound = dict(binding)
    todo: list[tuple[Pattern, Json]] = [(pattern, event)]
    while todo:
        part, value = todo.pop()
        match part:
            case Literal(expected):
                if not equal(expected, value):
                    return None
            case Variable(name):
                if name not in bound:
                    bound[name] = value
                elif not equal(bound[name], value):
                    return None
            case ObjectPattern(fields):
                if not isinstance(value, Mapping):
                    return None
                for field, inner in fields:
                    if field not in value:
                        return None
                    todo.append((inner, value[field]))
            case ListPattern(items):
                if not (isinstance(value, list) and len(value) == len(items)):
                    return None
                todo.extend(zip(items, value, strict=True))
            case Anything():
                pass
    return bound


def rigid(binding: Binding) -> dict[str, Json]:
    """The binding without the variables that are local to one pattern."""
    return {name: value for name, value in binding.items() if not name.startswith("_")}
