"""What the shape of an event says about the patterns that it fits.

The *shape* of an event is which fields it has, and its values in those fields where some pattern has a literal. Logs hold few shapes, so
what a shape says is worked out once. It decides most patterns: those that ask for literals and for the presence of fields. The others are
*open*: whether one fits has to be asked of the event itself.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Final, Generic, NamedTuple, TypeVar

from rvaft.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.values import Json, key

T = TypeVar("T")

MEMORY: Final = 4096
"""How many shapes are remembered; then the memory starts afresh."""
WIDEST: Final = 64
"""Events with more fields are not remembered: their shapes take too much room."""
LONGEST: Final = 200
"""Nor are those with longer strings where patterns have literals."""
_NOT_THERE: Final = ("no scalar",)
"""In place of the value of a field that is absent, or holds an object or a list."""


class Decided(NamedTuple):
    """The numbers of the patterns that every event of a shape fits, and of those that some may fit; each in order."""

    fits: tuple[int, ...]
    open: tuple[int, ...]


class Flat(NamedTuple):
    """A pattern that the shape decides: the literals it asks for (their keys), and the other fields with their variables ("" for none)."""

    literals: Mapping[str, Hashable]
    variables: Mapping[str, str]


class Shapes(Generic[T]):
    """Events by shape; `derive` makes of what a shape decides whatever is wanted for its events."""

    def __init__(self, patterns: Iterable[Pattern], derive: Callable[[Decided], T]) -> None:
        self._derive = derive
        self._filed: dict[str, dict[Hashable, list[int]]] = {}
        self._rest: list[int] = []
        self._flat: dict[int, Flat] = {}
        self._memory: dict[Hashable, T] = {}
        asked: dict[str, set[type]] = {}
        for number, pattern in enumerate(patterns):
            plain = flat(pattern)
            if plain is not None:
                self._flat[number] = plain
            literals = literals_of(pattern)
            for field, value in literals.items():
                asked.setdefault(field, set()).add(type(value))
            first = next(iter(literals.items()), None)
            if first is None:
                self._rest.append(number)
            else:
                self._filed.setdefault(first[0], {}).setdefault(first[1], []).append(number)
        self._shape = _shape_by(tuple(field for field, types in asked.items() if types == {str}))
        self._others = tuple(field for field, types in asked.items() if types != {str})

    def of(self, event: Mapping[str, Json]) -> T:
        """What was derived for the shape of an event."""
        # Python takes 1 and True for equal. Where only strings are asked for, neither is one; else their keys differ.
        shape = self._shape(event)
        if self._others:
            shape = (*shape, *[_key(event, field) for field in self._others])
        try:
            return self._memory[shape]
        except KeyError:
            found = self._derive(self._decide(event))
        except TypeError:  # a list or an object where patterns have strings
            return self._derive(self._decide(event))
        if len(event) <= WIDEST and brief(shape):
            if len(self._memory) >= MEMORY:
                self._memory.clear()
            self._memory[shape] = found
        return found

    def _decide(self, event: Mapping[str, Json]) -> Decided:
        candidates = list(self._rest)
        for field, table in self._filed.items():
            candidates.extend(table.get(_key(event, field), ()))
        candidates.sort()
        return Decided(
            tuple(number for number in candidates if number in self._flat and _fits(self._flat[number], event)),
            tuple(number for number in candidates if number not in self._flat),
        )


def brief(values: Iterable[Json]) -> bool:
    """Whether no string among these values is too long to be remembered."""
    return all(not isinstance(value, str) or len(value) <= LONGEST for value in values)


def _shape_by(fields: tuple[str, ...]) -> Callable[[Mapping[str, Json]], tuple[Hashable, ...]]:
    """The shape of an event given the fields where patterns have strings: so many values at its end. Few fields are asked for one by one."""
    match fields:
        case (one,):
            return lambda event: (*event, event.get(one))
        case (one, two):
            return lambda event: (*event, event.get(one), event.get(two))
        case (one, two, three):
            return lambda event: (*event, event.get(one), event.get(two), event.get(three))
        case _:
            return lambda event: (*event, *map(event.get, fields))


def flat(pattern: Pattern) -> Flat | None:
    """A pattern as a shape decides it, or None where it does not."""
    if not isinstance(pattern, ObjectPattern):
        return None
    variables: dict[str, str] = {}
    for field, part in pattern.fields:
        match part:
            case Literal():
                pass
            case Variable(name) if name not in variables.values():
                variables[field] = name
            case Anything():
                variables[field] = ""
            case _:
                return None
    return Flat(literals_of(pattern), variables)


def literals_of(pattern: Pattern) -> dict[str, Hashable]:
    """The fields of an object pattern that must have one value, with the keys of these values."""
    fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    return {field: key(part.value) for field, part in fields if isinstance(part, Literal)}


def _fits(plain: Flat, event: Mapping[str, Json]) -> bool:
    return all(_key(event, field) == value for field, value in plain.literals.items()) and all(
        field in event for field in plain.variables
    )


def _key(event: Mapping[str, Json], field: str) -> Hashable:
    value = event.get(field, _NOT_THERE)
    return _NOT_THERE if isinstance(value, (Mapping, list, tuple)) else key(value)
