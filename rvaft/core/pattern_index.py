"""Which patterns an event can match, by its shape and by its discriminating fields.

The *shape* of an event is its field names, and its values in fields with a literal in some pattern.
Logs have few shapes, so results are cached by shape. The shape decides patterns of literals and
present fields; other candidates are *open* and matched against each event.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Final, Generic, NamedTuple, TypeVar

from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import KEYS, Json, key

T = TypeVar("T")

MEMORY: Final = 4096
"""The maximum number of cached shapes."""
WIDEST: Final = 64
"""Events with more fields are not cached."""
LONGEST_TEXT: Final = 200
"""Events with longer strings in the fields of literals are not cached."""
_NOT_THERE: Final = ("no scalar",)


class Decided(NamedTuple):
    """The indexes, in order, of the patterns that all (`fits`) or some (`open`) events of a shape
    match.
    """

    fits: tuple[int, ...]
    open: tuple[int, ...]


class Flat(NamedTuple):
    """A pattern that the shape decides.

    `literals` maps fields to the keys of their literals, `variables` other fields to a variable or
    "".
    """

    literals: Mapping[str, Hashable]
    variables: Mapping[str, str]

    def fits(self, event: Mapping[str, Json]) -> bool:
        """Whether an event matches the pattern."""
        return all(key_at(event, field) == value for field, value in self.literals.items()) and all(
            field in event for field in self.variables
        )


class FirstLiterals:
    """An index of patterns by their rarest literal."""

    def __init__(self, literals: Iterable[Mapping[str, Hashable]]) -> None:
        self.by_field: dict[str, dict[Hashable, list[int]]] = {}
        self.rest: list[int] = []
        given = list(literals)
        counts = Counter(item for required in given for item in required.items())
        for number, required in enumerate(given):
            first = min(required.items(), key=counts.__getitem__, default=None)
            if first is None:
                self.rest.append(number)
            else:
                self.by_field.setdefault(first[0], {}).setdefault(first[1], []).append(number)

    def candidates(self, event: Json) -> list[int]:
        """Return the indexes, in order, of the patterns whose rarest literal the event has."""
        found = list(self.rest)
        if isinstance(event, Mapping):
            for field, table in self.by_field.items():
                found.extend(table.get(key_at(event, field), ()))
            found.sort()
        return found


class PatternIndex(Generic[T]):
    """A cache of results by event shape; `derive` computes the result of a classification.

    >>> at = lambda topic: ObjectPattern((("topic", Literal(topic)), ("value", Variable("X"))))
    >>> index = PatternIndex([at("/speed"), at("/goal"), Anything()], lambda decided: decided)
    >>> index.of({"topic": "/goal", "value": 3})
    Decided(fits=(1,), open=(2,))
    """

    def __init__(self, patterns: Iterable[Pattern], derive: Callable[[Decided], T]) -> None:
        self._derive = derive
        self._memory: dict[Hashable, T] = {}
        self._derived: dict[Decided, T] = {}
        given = tuple(patterns)
        literals = [literals_of(pattern) for pattern in given]
        self._filed = FirstLiterals(literals)
        self._flat = {number: plain for number, pattern in enumerate(given) if (plain := flat(pattern)) is not None}
        types_of: dict[str, set[type]] = {}
        for field, value in (item for some in literals for item in some.items()):
            types_of.setdefault(field, set()).add(type(value))
        texts = tuple(field for field, types in types_of.items() if types == {str})
        self._shape = _shape_by(texts, names=any(pattern.variables for pattern in self._flat.values()))
        self.texts = texts
        self.others = tuple(field for field, types in types_of.items() if types != {str})

    def of(self, event: Mapping[str, Json]) -> T:
        """Return the result for the shape of an event."""
        # In Python, 1 == True, so literals other than strings are compared by their keys.
        shape = self._shape(event)
        if self.others:
            shape = (*shape, *[key_at(event, field) for field in self.others])
        try:
            return self._memory[shape]
        except KeyError:
            found = self._found(event)
        except TypeError:  # a list or an object
            return self._found(event)
        if len(event) <= WIDEST and brief(shape):
            if len(self._memory) >= MEMORY:
                self._memory.clear()
            self._memory[shape] = found
        return found

    def _found(self, event: Mapping[str, Json]) -> T:
        candidates = self._filed.candidates(event)
        decided = Decided(
            tuple(number for number in candidates if number in self._flat and self._flat[number].fits(event)),
            tuple(number for number in candidates if number not in self._flat),
        )
        return self.result(decided)

    def result(self, decided: Decided) -> T:
        """Return the result of a classification."""
        found = self._derived.get(decided)
        if found is None:
            if len(self._derived) >= MEMORY:
                self._derived.clear()
            found = self._derived[decided] = self._derive(decided)
        return found


def brief(values: Iterable[Json]) -> bool:
    """Whether no string is too long for the cache."""
    return all(not isinstance(value, str) or len(value) <= LONGEST_TEXT for value in values)


def _shape_by(fields: tuple[str, ...], *, names: bool) -> Callable[[Mapping[str, Json]], tuple[Hashable, ...]]:
    if not names:
        return (lambda event: (event.get(fields[0]),)) if len(fields) == 1 else lambda event: (*map(event.get, fields),)
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
    """Return the pattern in the form that a shape decides, or None."""
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
    """Return the fields with literals in an object pattern, with the keys of these literals."""
    fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    return {field: key(part.value) for field, part in fields if isinstance(part, Literal)}


def key_at(event: Mapping[str, Json], field: str) -> Hashable:
    """Return the key of a field's value; objects, lists and absent fields share one key."""
    value: Hashable = event.get(field, _NOT_THERE)
    if type(value) in KEYS:
        return value
    return _NOT_THERE if isinstance(value, (Mapping, list, tuple)) else key(value)


_OTHER: Final = ("other",)


class Discriminators:
    """The discriminating fields of some patterns, usually one such as `topic`.

    Every pattern with a string literal has one in a discriminating field. The values there limit
    the patterns that an event can match. `fields` are discriminating fields that are known already.
    """

    def __init__(self, patterns: Iterable[Pattern], fields: Iterable[str] = ()) -> None:
        strings = [
            {field: value for field, value in literals_of(pattern).items() if isinstance(value, str)}
            for pattern in patterns
        ]
        # Greedy cover: the most frequent field first.
        cover = list(fields)
        left = [literals for literals in strings if literals and literals.keys().isdisjoint(cover)]
        while left:
            cover.append(Counter(field for literals in left for field in literals).most_common(1)[0][0])
            left = [literals for literals in left if cover[-1] not in literals]
        self.fields = tuple(cover)
        self._literals = tuple(
            {field: literals[field] for field in self.fields if field in literals} for literals in strings
        )
        self._filed = FirstLiterals(self._literals)
        self._values = {
            field: frozenset(literals[field] for literals in strings if field in literals) for field in self.fields
        }

    def values(self, event: Mapping[str, Json]) -> tuple[Hashable, ...]:
        """Return the `value` of each discriminating field of an event."""
        return tuple([self.value(field, event.get(field)) for field in self.fields])

    def value(self, field: str, value: Json) -> Hashable:
        """Return the value of a field if it is a literal of some pattern, else a common key."""
        return value if isinstance(value, str) and value in self._values[field] else _OTHER

    def apart(self, values: Iterable[Json]) -> tuple[Hashable, ...]:
        """Return the cache key of an event that matches no pattern; long strings share a key."""
        return tuple([value if isinstance(value, str) and len(value) <= LONGEST_TEXT else _OTHER for value in values])

    def candidates(self, values: tuple[Hashable, ...]) -> tuple[int, ...]:
        """Return the indexes of the patterns that an event with these values may match."""
        event = dict(zip(self.fields, values, strict=True))
        return tuple(
            number
            for number in self._filed.candidates(event)
            if all(event[field] == value for field, value in self._literals[number].items())
        )
