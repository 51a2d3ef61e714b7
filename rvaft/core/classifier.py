"""Classification of events: the patterns that an event can match, and the fields to read.

The *shape* of an event is its field names, and its values in fields with a literal in some pattern.
Logs have few shapes, so results are cached by shape. The shape decides patterns of literals and
present fields; other candidates are *open* and matched against each event.
"""

import sys
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from functools import cached_property
from typing import Final, Generic, NamedTuple, TypeAlias, TypeVar

from rvaft.model.assumptions import fields_read
from rvaft.model.event_time import EventTime
from rvaft.model.guards import OPERATORS, ORDERINGS, Guard, Operation, Predicate, predicate, renamed
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    has_ways,
    match,
    rigid,
    rigid_ways,
    ways,
)
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_finite, is_number, key

T = TypeVar("T")
H = TypeVar("H")
H_co = TypeVar("H_co", covariant=True)

MEMORY: Final = 4096
"""The maximum number of cached shapes."""
WIDEST: Final = 64
"""Events with more fields are not cached."""
LONGEST: Final = 200
"""Events with longer strings in the fields of literals are not cached."""
_NOT_THERE: Final = ("no scalar",)
_PLAIN: Final = (str, int, float)


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
    return all(not isinstance(value, str) or len(value) <= LONGEST for value in values)


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
    if type(value) in _PLAIN:
        return value
    return _NOT_THERE if isinstance(value, (Mapping, list, tuple)) else key(value)


# Discriminating fields.

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
        return tuple([value if isinstance(value, str) and len(value) <= LONGEST else _OTHER for value in values])

    def candidates(self, values: tuple[Hashable, ...]) -> tuple[int, ...]:
        """Return the indexes of the patterns that an event with these values may match."""
        event = dict(zip(self.fields, values, strict=True))
        return tuple(
            number
            for number in self._filed.candidates(event)
            if all(event[field] == value for field, value in self._literals[number].items())
        )


# The fields to read.


@dataclass(slots=True)
class Reads:
    """The parts of a value to read: the whole value, or some fields and list items."""

    whole: bool = False
    fields: dict[str, "Reads"] = dataclass_field(default_factory=dict)
    items: "Reads | None" = None

    def add(self, pattern: Pattern) -> None:
        """Add the parts that a pattern reads; a variable reads the whole value."""
        agenda: list[tuple[Reads, Pattern]] = [(self, pattern)]
        while agenda:
            reads, part = agenda.pop()
            match part:
                case ObjectPattern(fields):
                    agenda.extend((reads.fields.setdefault(name, Reads()), inner) for name, inner in fields)
                case ListPattern(items):
                    reads.items = reads.items or Reads()
                    agenda.extend((reads.items, inner) for inner in items)
                case SomeItem(item):
                    reads.items = reads.items or Reads()
                    agenda.append((reads.items, item))
                case Variable():
                    reads.whole = True
                case Literal() | Anything():
                    pass

    def of(self, event: Mapping[str, Json]) -> "Reads":  # noqa: ARG002 (the same in every event)
        """Return the parts of an event to read."""
        return self


class TreeReads:
    """The fields that a monitor reads: those of runtime events, `ignore`, `time`, assumptions and
    the paths `also`. `others` are further trees that are monitored on the same log.
    """

    def __init__(
        self, tree: RVAFT, also: Iterable[tuple[str, ...]] = (), *, others: Iterable["TreeReads"] = ()
    ) -> None:
        more = tuple(others)
        own = (
            *(relevant.pattern for relevant in tree.alphabet),
            *(tree.instantiate(ignore.on) for ignore in tree.ignores),
            *(pattern for _, _, pattern in tree.absences),
        )
        self.patterns: tuple[Pattern, ...] = (*own, *(pattern for one in more for pattern in one.patterns))
        each = [Discriminators(own), *(one.discriminators for one in more)]
        known = dict.fromkeys(name for one in each for name in one.fields) if more else ()
        self.discriminators: Discriminators = Discriminators(self.patterns, known)
        times = [*([tree.time] if tree.time else []), *(time for one in more for time in one.times)]
        self.times: tuple[EventTime, ...] = tuple(dict.fromkeys(times))
        self.always: list[Pattern] = [ObjectPattern(((name, Anything()),)) for name in self.discriminators.fields]
        self.always += [pattern for one in more for pattern in one.always]
        for path in dict.fromkeys((*also, *([tree.time.field] if tree.time else []), *fields_read(tree))):
            at: Pattern = Variable("_")
            for name in reversed(path):
                at = ObjectPattern(((name, at),))
            self.always.append(at)
        self._known: dict[tuple[Hashable, ...], Reads] = {}

    def of(self, event: Mapping[str, Json]) -> Reads:
        """Return the parts of an event to read."""
        return self.where(self.discriminators.values(event))

    def where(self, values: tuple[Hashable, ...]) -> Reads:
        """Return the parts to read of events with these discriminating values."""
        known = self._known.get(values)
        if known is None:
            known = self._known[values] = Reads()
            for pattern in self.always:
                known.add(pattern)
            for number in self.discriminators.candidates(values):
                known.add(self.patterns[number])
        return known


Scope: TypeAlias = Reads | TreeReads


# Letters.

Values: TypeAlias = Callable[[Mapping[str, Json]], dict[str, Json]]


class Letter(NamedTuple):
    """A pattern and a guard over its variables."""

    pattern: Pattern
    when: Guard | None = None


@dataclass(frozen=True, slots=True)
class EventTest:
    """A condition on an event that is no guard over its fields; equal names mean equal tests."""

    name: Hashable
    holds: Predicate = dataclass_field(compare=False)


class Reader(NamedTuple):
    """The evaluation of one letter on an event whose shape does not exclude it."""

    number: int
    pattern: Pattern
    test: Guard | EventTest | None
    """The condition, over fields instead of variables; None if the shape decides."""
    admits: Predicate
    values: Values
    """The values of the rigid variables in a matching event."""
    fields: Mapping[str, str] | None
    """The fields of these values; None if the shape does not decide the match."""
    ways: Callable[[Mapping[str, Json]], list[dict[str, Json]]] | None = None
    """All values of the rigid variables with which an event is the letter, if there may be several."""

    def read(self, event: Mapping[str, Json]) -> dict[str, Json] | None:
        """Return the values of the variables in an event, or None if it is not this letter."""
        return self.values(event) if self.admits(event) else None


def reader(number: int, letter: Letter) -> Reader:
    """Return the reader of a letter; a guard with a variable that the pattern lacks never holds."""
    pattern, when = letter
    plain = flat(pattern)
    if when is not None and not set(guard_variables(when)) <= set(pattern_variables(pattern)):
        when = Literal(False)
    if has_ways(pattern):
        return _reader_of_ways(number, letter, when)
    if plain is None:
        return Reader(
            number, pattern, EventTest(letter, admits := _admits(pattern, when)), admits, _bound(pattern), None
        )
    named = {name: field for field, name in plain.variables.items() if name}
    fields = {name: field for name, field in named.items() if not name.startswith("_")}
    test = None if when is None else renamed(when, named)
    admits = (lambda _: True) if test is None else predicate(test)
    return Reader(number, pattern, test, admits, _values(tuple(fields.items())), fields)


def _reader_of_ways(number: int, letter: Letter, when: Guard | None) -> Reader:
    pattern, holds = letter.pattern, None if when is None else predicate(when)

    def fitting(event: Mapping[str, Json]) -> Iterator[dict[str, Json]]:
        return (found for found in ways(pattern, event, {}) if holds is None or holds(found))

    def admits(event: Mapping[str, Json]) -> bool:
        return any(True for _ in fitting(event))

    def values(event: Mapping[str, Json]) -> dict[str, Json]:
        found = next(fitting(event), None)
        return rigid(found or match(pattern, event, {}) or {})

    test = EventTest(letter, admits)
    return Reader(number, pattern, test, admits, values, None, lambda event: rigid_ways(fitting(event)))


def _admits(pattern: Pattern, when: Guard | None) -> Predicate:
    holds = None if when is None else predicate(when)

    def admits(event: Mapping[str, Json]) -> bool:
        found = match(pattern, event, {})
        return found is not None and (holds is None or holds(found))

    return admits


def _bound(pattern: Pattern) -> Values:
    return lambda event: rigid(match(pattern, event, {}) or {})


def _values(fields: tuple[tuple[str, str], ...]) -> Values:
    match fields:
        case ((name, field),):
            return lambda event: {name: event[field]}
        case ((name, field), (other, its)):
            return lambda event: {name: event[field], other: event[its]}
        case _:
            return lambda event: {name: event[field] for name, field in fields}


_LARGEST: Final = sys.float_info.max


@dataclass(frozen=True, eq=False)
class GuardTable(Generic[H_co]):
    """A cached table from the outcomes of some guards on an event to a result.

    `of` returns the result for an event, `held` the bits of its guards, `at` the result for such
    bits.
    """

    guards: tuple[Guard | EventTest, ...]
    of: Callable[[Mapping[str, Json]], H_co]
    held: Callable[[Mapping[str, Json]], int]
    at: Callable[[int], H_co]

    @cached_property
    def field(self) -> str | None:
        """The only field that the guards use, if there is exactly one."""
        guards = [guard for guard in self.guards if not isinstance(guard, EventTest)]
        names = {name for guard in guards for name in guard_variables(guard)}
        return names.pop() if len(names) == 1 and len(guards) == len(self.guards) else None

    @cached_property
    def ordered(self) -> bool:
        """Whether each guard compares the field with a number by `<`, `<=`, `>` or `>=`."""
        orders = all(isinstance(guard, Operation) and guard.operator in ORDERINGS for guard in self.guards)
        return orders and compared_numbers(self.guards) is not None


def guard_table(
    guards: Sequence[Guard | EventTest | None], derive: Callable[[Sequence[bool]], H_co]
) -> GuardTable[H_co]:
    """Return the table over these guards; None is a guard that always holds.

    `derive` receives the outcome of each guard.

    >>> from rvaft.model.guards import Operation, Operator
    >>> from rvaft.model.patterns import Literal, Variable
    >>> past = lambda number: Operation(Operator.GT, (Variable("X"), Literal(number)))
    >>> table = guard_table([past(1), None, past(5)], lambda holds: [number for number in range(3) if holds[number]])
    >>> table.of({"X": 0}), table.of({"X": 3}), table.of({"X": 9}), table.of({"X": "a"})
    ([1], [0, 1], [0, 1, 2], [1])
    """
    places: dict[Guard | EventTest, int] = {}
    bit = [0 if guard is None else 1 << places.setdefault(guard, len(places)) for guard in guards]
    return _table_by_bits(tuple(places), lambda held: derive([held & one == one for one in bit]))


def joined_tables(tables: Sequence[GuardTable[H]], join: Callable[[tuple[H, ...]], T]) -> GuardTable[T]:
    """Return the table that joins several results; a common guard is evaluated once."""
    places: dict[Guard | EventTest, int] = {}
    for table in tables:
        for guard in table.guards:
            places.setdefault(guard, len(places))
    sources: list[tuple[Callable[[int], H], int, list[tuple[int, int]]]] = []
    for table in tables:
        pairs = [(1 << places[guard], 1 << place) for place, guard in enumerate(table.guards)]
        same = all(bit == own for bit, own in pairs)
        sources.append((table.at, (1 << len(pairs)) - 1 if same else 0, [] if same else pairs))

    def derive(held: int) -> T:
        own = [held & mask | sum([bit for one, bit in pairs if held & one]) for _, mask, pairs in sources]
        return join(tuple([at(bits) for (at, _, _), bits in zip(sources, own, strict=True)]))

    return _table_by_bits(tuple(places), derive)


def _table_by_bits(guards: tuple[Guard | EventTest, ...], derive: Callable[[int], H_co]) -> GuardTable[H_co]:
    """Return the table of a function of the guards that hold, as bits.

    Comparisons of one variable with numbers use binary search.
    """
    memory: dict[int, H_co] = {}
    tests = [
        (1 << at, guard.holds if isinstance(guard, EventTest) else predicate(guard)) for at, guard in enumerate(guards)
    ]

    def derived(event: Mapping[str, Json]) -> H_co:
        return derived_of(held(event))

    def held(event: Mapping[str, Json]) -> int:
        return sum([bit for bit, holds in tests if holds(event)])

    def derived_of(bits: int) -> H_co:
        try:
            return memory[bits]
        except KeyError:
            found = memory[bits] = derive(bits)
        if len(memory) > MEMORY:
            memory.clear()
        return found

    if not guards:
        always = derive(0)
        return GuardTable((), lambda _: always, lambda _: 0, lambda _: always)
    compared = compared_numbers(guards)
    if compared is None:
        if len(guards) == 1:
            ((_, holds_alone),) = tests
            return GuardTable(guards, lambda event: derived_of(1 if holds_alone(event) else 0), held, derived_of)
        return GuardTable(guards, derived, held, derived_of)
    name, points = compared
    by_place: dict[int, H_co] = {}
    """The results by position: below the first number, at it, between it and the second, …"""

    def placed(event: Mapping[str, Json]) -> H_co:
        value = event[name]
        if type(value) is not int and not (type(value) is float and -_LARGEST <= value <= _LARGEST):
            return derived(event)
        place = bisect_left(points, value) + bisect_right(points, value)
        try:
            return by_place[place]
        except KeyError:
            found = by_place[place] = derived(event)
        if len(by_place) > MEMORY:
            by_place.clear()
        return found

    return GuardTable(guards, placed, held, derived_of)


def compared_numbers(guards: Iterable[Guard | EventTest]) -> tuple[str, list[int | float]] | None:
    """Return the variable that all guards compare with numbers, and the sorted numbers, or None."""
    names, points = set[str](), set[int | float]()
    for guard in guards:
        match guard:
            case Operation(operator, (Variable(name), Literal(number))) if OPERATORS[operator].compare:
                if not isinstance(number, (int, float)) or not is_number(number) or not is_finite(number):
                    return None
                names.add(name)
                points.add(number)
            case _:
                return None
    return (names.pop(), sorted(points)) if len(names) == 1 else None
