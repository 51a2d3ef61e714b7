"""Guards over times as bounds on differences of times.

Times are integers in nanoseconds, so all calculations are exact. A `TimeDifference` states `plus -
minus <= most`; `plus` and `minus` are the maximum or the minimum of some times.

A bound may fail before all times are known, because a maximum only grows and a minimum only falls.
With `late`, it may also fail when the watermark passes its deadline.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

from rvaft.model.event_time import TIME
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator, TimePoint, time_points, variables
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import Json


class Extreme(NamedTuple):
    """The maximum (MAX) or the minimum (MIN) of the times of these variables."""

    operator: Operator
    names: tuple[str, ...]

    def of(self, binding: Mapping[str, Json]) -> Json:
        """Return the value over the bound variables; None if one is undefined or none is bound."""
        operator, names = self
        if len(names) == 1:
            return binding.get(names[0])
        values = [binding[name] for name in names if name in binding]
        if not values or None in values:
            return None
        return max(values) if operator is Operator.MAX else min(values)

    def among(self, names: Collection[str]) -> "Extreme":
        """Return the extreme restricted to some of the variables."""
        return Extreme(self.operator, tuple(name for name in self.names if name in names))

    def known(self, binding: Mapping[str, Json], operator: Operator) -> bool:
        """Whether the bound variables bound the extreme from below (MAX) or from above (MIN).

        One variable suffices if the extreme has this operator; otherwise all must be bound.
        """
        some = self.operator is operator
        return (any if some else all)(name in binding for name in self.names)


class TimeDifference(NamedTuple):
    """The condition `plus - minus <= most`."""

    plus: Extreme
    minus: Extreme
    most: int

    def is_window(self) -> bool:
        """Whether the condition bounds how far some times are apart at most."""
        return self.plus.operator is Operator.MAX and self.minus.operator is Operator.MIN

    def among(self, names: Collection[str]) -> "TimeDifference":
        """Return the condition on some of the times."""
        return TimeDifference(self.plus.among(names), self.minus.among(names), self.most)

    def holds(self, binding: Mapping[str, Json]) -> bool:
        """Whether the condition can still hold given the known times; an undefined time makes it
        fail.
        """
        (late, plus_names), (early, minus_names), most = self
        plus = [binding[name] for name in plus_names if name in binding]
        minus = [binding[name] for name in minus_names if name in binding]
        if None in plus or None in minus:
            return False
        if not (plus if late is Operator.MAX else len(plus) == len(plus_names)):
            return True
        if not (minus if early is Operator.MIN else len(minus) == len(minus_names)):
            return True
        last = max(plus) if late is Operator.MAX else min(plus)
        return bool(last - (min(minus) if early is Operator.MIN else max(minus)) <= most)

    def deadline(self, binding: Mapping[str, Json]) -> int | None:
        """Return the greatest watermark with which the condition can still hold, or None."""
        plus, minus = self.plus, self.minus
        if all(name in binding for name in plus.names) or not minus.known(binding, Operator.MIN):
            return None
        least = minus.of(binding)
        if least is None:
            return None
        if plus.operator is Operator.MIN:
            bound = plus.of(binding)
            if bound is not None and bound - least <= self.most:
                return None
        return int(least) + self.most


def differences(guard: Guard) -> tuple[TimeDifference, ...] | None:
    """Return the bounds that a conjunct over times states; None for other conjuncts.

    >>> from rvaft.language.parser import parse_guard
    >>> differences(parse_guard("A - B < 5"))[0].most
    4
    """
    match guard:
        case Operation(Operator.NOT, (Operation(operator, operands),)) if negated := OPERATORS[operator].negated:
            return differences(Operation(negated, operands))
        case Operation(operator, (left, right)) if OPERATORS[operator].negated:
            todo, most = [(left, 1), (right, -1)], 0
        case _:
            return None
    sides: dict[int, list[tuple[Operator | None, tuple[str, ...]]]] = {1: [], -1: []}
    for part, sign in todo:
        match part:
            case Literal(value) if type(value) is int:
                most -= sign * value
            case Variable(name):
                sides[sign].append((None, (name,)))
            case Operation(Operator.MAX | Operator.MIN as extreme, terms) if all(
                isinstance(term, Variable) for term in terms
            ):
                sides[sign].append((extreme, variables(part)))
            case Operation(Operator.ADD | Operator.SUB as sum_, (one, other)):
                todo += [(one, sign), (other, sign if sum_ is Operator.ADD else -sign)]
            case _:
                return None
    if any(len(side) != 1 for side in sides.values()):
        return None
    ((plus,), (minus,)), strict = sides.values(), operator in (Operator.LT, Operator.GT)
    upper, lower = (
        TimeDifference(
            Extreme(one[0] or Operator.MAX, one[1]), Extreme(other[0] or Operator.MIN, other[1]), bound - strict
        )
        for one, other, bound in ((plus, minus, most), (minus, plus, -most))
    )
    match operator:
        case Operator.EQ:
            return upper, lower
        case Operator.LT | Operator.LE:
            return (upper,)
        case Operator.GT | Operator.GE:
            return (lower,)
        case _:  # times differ in either direction; a term never differs from itself
            return (upper._replace(most=-1),) if plus == minus and most == 0 else None


def point_bounds(guard: Guard) -> Iterator[tuple[TimePoint, TimePoint, int]]:
    """Iterate over the bounds of a conjunct: two time points and their greatest difference.

    >>> from rvaft.language.parser import parse_guard
    >>> [(one.name, other.name, most) for one, other, most in point_bounds(parse_guard("at(b) <= end(a) + 1 s"))]
    [('at(b)', 'end(a)', 1000000000)]
    """
    points = {point.name: point for point in time_points(guard)}
    for (_, names), (_, others), most in differences(guard) or () if points else ():
        if len(names) == len(others) == 1 and points.keys() >= {*names, *others}:
            yield points[names[0]], points[others[0]], most


def timed(pattern: Pattern, name: str) -> Pattern:
    """Return the pattern that also binds the event's time (`EventTime.stamped`) to a variable.

    >>> untimed(timed(ObjectPattern(()), "T1"))
    (ObjectPattern(fields=()), 'T1')
    """
    match pattern:
        case ObjectPattern(fields):
            return ObjectPattern((*fields, (TIME, Variable(name))))
        case Anything():
            return ObjectPattern(((TIME, Variable(name)),))
        case _:
            raise AssertionError("the pattern of an event is an object")


def untimed(pattern: Pattern) -> tuple[Pattern, str | None]:
    """Return the pattern without the event's time, and the variable of that time (or None)."""
    if isinstance(pattern, ObjectPattern):
        for key, part in pattern.fields:
            if key is TIME and isinstance(part, Variable):
                return ObjectPattern(tuple(pair for pair in pattern.fields if pair[0] is not TIME)), part.name
    return pattern, None
