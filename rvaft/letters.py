"""Letters: patterns with guards over their variables, and how one is read off an event."""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

from rvaft.guards import Guard, Operation
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Pattern, Variable, match, rigid
from rvaft.patterns import variables as pattern_variables
from rvaft.predicates import Predicate, predicate
from rvaft.shapes import flat
from rvaft.values import Json

Values: TypeAlias = Callable[[Mapping[str, Json]], dict[str, Json]]


class Letter(NamedTuple):
    """A pattern and a guard over its variables."""

    pattern: Pattern
    when: Guard | None = None


class Reader(NamedTuple):
    """How one letter, known by a number, is read off an event whose shape does not exclude it."""

    number: int
    pattern: Pattern
    holds: Predicate | None
    plain: bool
    """Whether the shape of an event decides that it fits the pattern. Then `holds` is asked of the event itself."""
    values: Values
    """If so what gives the values of the variables, but for the local ones, in an event that is this letter."""

    def admits(self, event: Mapping[str, Json]) -> bool:
        """Whether an event is this letter."""
        if self.plain:
            return self.holds is None or self.holds(event)
        return self._matched(event) is not None

    def read(self, event: Mapping[str, Json]) -> dict[str, Json] | None:
        """The values of the variables in an event, or None where it is not this letter."""
        if self.plain:
            return self.values(event) if self.admits(event) else None
        found = self._matched(event)
        return None if found is None else rigid(found)

    def _matched(self, event: Mapping[str, Json]) -> dict[str, Json] | None:
        found = match(self.pattern, event, {})
        return found if found is not None and (self.holds is None or self.holds(found)) else None


def reader(number: int, letter: Letter) -> Reader:
    """How a letter is read. A guard with variables that the pattern does not bind never holds."""
    plain = flat(letter.pattern)
    when = letter.when
    fields: tuple[tuple[str, str], ...] = ()
    holds: Predicate | None = None
    if when is not None and not set(guard_variables(when)) <= set(pattern_variables(letter.pattern)):
        holds = _never
    elif plain is not None:
        named = {name: field for field, name in plain.variables.items() if name}
        fields = tuple((name, field) for name, field in named.items() if not name.startswith("_"))
        holds = None if when is None else predicate(_of_fields(when, named))
    elif when is not None:
        holds = predicate(when)
    return Reader(number, letter.pattern, holds, plain is not None, _values(fields))


def _of_fields(guard: Guard, named: Mapping[str, str]) -> Guard:
    """The guard with the fields of an event as its variables; the parser bounds its nesting."""
    match guard:
        case Variable(name):
            return Variable(named[name])
        case Operation(operator, operands):
            return Operation(operator, tuple(_of_fields(operand, named) for operand in operands))
        case _:
            return guard


def _values(fields: tuple[tuple[str, str], ...]) -> Values:
    """Gives variables the values of fields; one or two, as most events have, at once."""
    match fields:
        case ((name, field),):
            return lambda event: {name: event[field]}
        case ((name, field), (other, its)):
            return lambda event: {name: event[field], other: event[its]}
        case _:
            return lambda event: {name: event[field] for name, field in fields}


def _never(_: Mapping[str, Json]) -> bool:
    return False
