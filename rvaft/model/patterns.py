"""Event patterns, and matching of events against them.

Names of rigid variables, shared by the whole tree, start with a capital. Names that start with `_`
are local to one pattern. In the pattern of an event type, the lower-case parameters are variables
too; `substitute` replaces them by arguments.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from rvaft.model.values import Json, Scalar, equal, key

Binding: TypeAlias = Mapping[str, Json]


@dataclass(frozen=True, slots=True, eq=False)
class Literal:
    """A string, number, boolean or null; literals are equal if their JSON values are."""

    value: Scalar

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, Literal) and equal(self.value, other.value)

    def __hash__(self) -> int:
        return hash(key(self.value))


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable (`Value`), a local variable (`_1`), or a parameter of an event type (`value`)."""

    name: str

    @property
    def local(self) -> bool:
        """Whether the variable is local to its pattern."""
        return self.name.startswith("_")


@dataclass(frozen=True, slots=True)
class Anything:
    """`_`: any value, including null, but not an absent field."""


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
    """Iterate over the pattern and all its parts in preorder."""
    todo = [pattern]
    while todo:
        part = todo.pop()
        yield part
        if isinstance(part, ObjectPattern):
            todo.extend(inner for _, inner in reversed(part.fields))
        elif isinstance(part, ListPattern):
            todo.extend(reversed(part.items))


def variables(pattern: Pattern) -> tuple[str, ...]:
    """Return the names of the variables, including local ones, in order of first occurrence."""
    return tuple(dict.fromkeys(part.name for part in walk(pattern) if isinstance(part, Variable)))


def rigid_variables(pattern: Pattern) -> tuple[str, ...]:
    """Return the variables shared with the rest of the tree."""
    return tuple(name for name in variables(pattern) if not name.startswith("_"))


def substitute(pattern: Pattern, by: Mapping[str, Pattern]) -> Pattern:
    """Return the pattern with the variables in `by` replaced; the parser bounds the nesting."""
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
    """Return a copy of the binding extended to match the event, or None.

    The result includes local variables; `rigid` removes them.
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
    """Return the binding without local variables."""
    return {name: value for name, value in binding.items() if not name.startswith("_")}
