"""Letters: a pattern with a guard over its variables, and how an event is tested for it."""

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from typing import NamedTuple, TypeAlias

from rvaft.core.pattern_index import flat
from rvaft.model.guards import Guard, Predicate, predicate, renamed
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Literal, Pattern, has_ways, match, rigid, rigid_ways, ways
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.values import Json

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
