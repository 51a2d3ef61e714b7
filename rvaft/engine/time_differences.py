"""What a guard over times asks: that the difference of two times is at most so much.

The times of events are whole numbers of nanoseconds, so all of this is exact. `plus` and `minus` are the greatest or the least of some
times; `within D` is that the greatest of a part less the least of it is at most D. As long as not all times are known such a guard may be
lost already: the greatest only grows, the least only falls. And where no event to come can have a time before the `floor`, as
`late` says, it may be lost without any further event.
"""

from collections.abc import Collection, Mapping
from typing import Final, NamedTuple

from rvaft.model.guards import OPERATORS, Guard, Operation, Operator
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import Json


class Extreme(NamedTuple):
    """The greatest (MAX) or the least (MIN) of the times that these variables have."""

    operator: Operator
    names: tuple[str, ...]

    def of(self, binding: Mapping[str, Json]) -> Json:
        """Its value as far as these are bound; None where one of them is undefined, or none is bound."""
        values = [binding[name] for name in self.names if name in binding]
        if not values or None in values:
            return None
        return max(values) if self.operator is Operator.MAX else min(values)

    def among(self, names: Collection[str]) -> "Extreme":
        """The same of some of the variables."""
        return Extreme(self.operator, tuple(name for name in self.names if name in names))

    def known(self, binding: Mapping[str, Json], operator: Operator) -> bool:
        """Whether what is bound bounds it: any time the greatest from below and the least from above, all of them both."""
        some = self.operator is operator
        return (any if some else all)(name in binding for name in self.names)


class TimeDifference(NamedTuple):
    """That `plus - minus <= most`."""

    plus: Extreme
    minus: Extreme
    most: int

    def holds(self, binding: Mapping[str, Json]) -> bool:
        """Whether it may hold, as far as the times are known; undefined times never let it hold."""
        if any(name in binding and binding[name] is None for extreme in self[:2] for name in extreme.names):
            return False
        if not (self.plus.known(binding, Operator.MAX) and self.minus.known(binding, Operator.MIN)):
            return True
        return bool(self.plus.of(binding) - self.minus.of(binding) <= self.most)

    def deadline(self, binding: Mapping[str, Json]) -> int | None:
        """The greatest floor of times to come with which it may still hold; None where that says nothing."""
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


_SWAPPED: Final = (Operator.GE, Operator.GT)


def differences(guard: Guard) -> tuple[TimeDifference, ...] | None:
    """The differences that a conjunct over times asks for; None for one that is not of this kind.

    >>> from rvaft.language.parser import parse_guard
    >>> differences(parse_guard("A - B < 5"))[0].most
    4
    """
    match guard:
        case Operation(Operator.NOT, (Operation(operator, operands),)) if negated := OPERATORS[operator].negated:
            return differences(Operation(negated, operands))
        case Operation(operator, (left, right)) if OPERATORS[operator].negated and operator is not Operator.NE:
            sides: dict[int, list[tuple[Operator | None, tuple[str, ...]]]] = {1: [], -1: []}
            first, second = _collect(left, 1, sides), _collect(right, -1, sides)
            if first is None or second is None or any(len(side) != 1 for side in sides.values()):
                return None
            ((plus,), (minus,)), most = (sides[1], sides[-1]), -first - second
            strict = operator in (Operator.LT, Operator.GT)
            upper = _difference(plus, minus, most - strict)
            lower = _difference(minus, plus, -most - strict)
            return (upper, lower) if operator is Operator.EQ else (lower,) if operator in _SWAPPED else (upper,)
        case _:
            return None


def _difference(
    plus: tuple[Operator | None, tuple[str, ...]], minus: tuple[Operator | None, tuple[str, ...]], most: int
) -> TimeDifference:
    return TimeDifference(Extreme(plus[0] or Operator.MAX, plus[1]), Extreme(minus[0] or Operator.MIN, minus[1]), most)


def _collect(term: Guard, sign: int, sides: Mapping[int, list[tuple[Operator | None, tuple[str, ...]]]]) -> int | None:
    """The constant in a sum, with what else it adds and subtracts put on the sides; None for what is no such sum."""
    match term:
        case Literal(value) if type(value) is int:
            return sign * value
        case Variable(name):
            sides[sign].append((None, (name,)))
            return 0
        case Operation(Operator.MAX | Operator.MIN as operator, operands):
            names = tuple(one.name for one in operands if isinstance(one, Variable))
            sides[sign].append((operator, names))
            return 0 if len(names) == len(operands) else None
        case Operation(Operator.ADD | Operator.SUB as operator, (left, right)):
            first = _collect(left, sign, sides)
            second = _collect(right, sign if operator is Operator.ADD else -sign, sides)
            return None if first is None or second is None else first + second
        case _:
            return None
