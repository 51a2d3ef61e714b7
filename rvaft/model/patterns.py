"""Event patterns, and matching of events against them.

Names of rigid variables, shared by the whole tree, start with a capital. Names that start with `_`
are local to one pattern. In the pattern of an event type, the lower-case parameters are variables
too; `substitute` replaces them by arguments.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from rvaft.errors import TooLarge
from rvaft.model.values import Json, Scalar, equal, fingerprint, key

Binding: TypeAlias = Mapping[str, Json]

MOST_ITEMS: Final = 1_000_000
"""The maximum number of list items tried for one event."""


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


@dataclass(frozen=True, slots=True)
class SomeItem:
    """`[..., item, ...]`: matches a list in which at least one item matches."""

    item: "Pattern"


Pattern: TypeAlias = Literal | Variable | Anything | ObjectPattern | ListPattern | SomeItem


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
        elif isinstance(part, SomeItem):
            todo.append(part.item)


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
        case SomeItem(item):
            return SomeItem(substitute(item, by))
        case _:
            return pattern


def has_ways(pattern: Pattern) -> bool:
    """Whether an event can match with several bindings: a variable stands inside `[..., P, ...]`."""
    return any(isinstance(part, SomeItem) and variables(part.item) for part in walk(pattern))


def match(pattern: Pattern, event: Json, binding: Binding) -> dict[str, Json] | None:
    """Return a copy of the binding extended to match the event in the first way, or None.

    The result includes local variables; `rigid` removes them.
    """
    bound = dict(binding)
    lists = _extend(bound, [(pattern, event)])
    return bound if lists == [] else None if lists is None else next(_ways(bound, lists), None)


def ways(pattern: Pattern, event: Json, binding: Binding) -> Iterator[dict[str, Json]]:
    """Yield all bindings, with local variables, that extend a binding and match the event.

    Several choices of list items may yield one binding. Raises `TooLarge` beyond `MOST_ITEMS`.

    >>> list(ways(SomeItem(Variable("X")), [1, 2], {}))
    [{'X': 1}, {'X': 2}]
    """
    bound = dict(binding)
    lists = _extend(bound, [(pattern, event)])
    return _ways(bound, lists) if lists is not None else iter(())


def _ways(bound: dict[str, Json], lists: "_Lists") -> Iterator[dict[str, Json]]:
    agenda = [_chosen(bound, lists)] if lists else []
    tried = 0
    if not lists:
        yield bound
    while agenda:
        found = next(agenda[-1], None)
        if found is None:
            agenda.pop()
            continue
        tried += 1
        if tried > MOST_ITEMS:
            raise TooLarge("list items tried for one event", limit=MOST_ITEMS)
        extended, todo = found
        left = _extend(extended, todo)
        if left:
            agenda.append(_chosen(extended, left))
        elif left is not None:
            yield extended


_Lists: TypeAlias = list[tuple[SomeItem, list[Json]]]


def _chosen(bound: dict[str, Json], lists: _Lists) -> Iterator[tuple[dict[str, Json], list[tuple[Pattern, Json]]]]:
    """Yield, for each item of the first list, a copy of the binding and what has to match."""
    (some, items), *others = lists
    return ((dict(bound), [*others, (some.item, item)]) for item in items)


def _extend(bound: dict[str, Json], todo: list[tuple[Pattern, Json]]) -> _Lists | None:
    """Extend a binding in place by what has one way to match; return the other parts, or None."""
    lists: _Lists = []
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
            case SomeItem():
                if not isinstance(value, list):
                    return None
                lists.append((part, value))
            case Anything():
                pass
    return lists


def rigid_ways(found: Iterable[Binding]) -> list[dict[str, Json]]:
    """Return the different bindings without local variables."""
    return list({fingerprint(one): one for one in map(rigid, found)}.values())


def rigid(binding: Binding) -> dict[str, Json]:
    """Return the binding without local variables."""
    return {name: value for name, value in binding.items() if not name.startswith("_")}
