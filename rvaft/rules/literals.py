"""What must be true for guards to hold, as alternatives of comparisons (a disjunctive normal form).

A guard holds when its value is `true`, and then every comparison that decided so was defined. Its negation `not (a < b)` is true
exactly when `a >= b` is: both are defined. So each alternative is a list of comparisons that are all *true*, and no
negation is left. What an alternative cannot say (a comparison of truth values, say) is left out: alternatives are implied by the
guards, not equivalent to them, which is what a proof of contradiction needs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

from rvaft.guards import UNDEFINED, Guard, Operation, Operator, value, variables
from rvaft.patterns import Literal, Variable

MAX_ALTERNATIVES: Final = 256

COMPARISONS: Final = frozenset([Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE])
ARITHMETIC: Final = frozenset([Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV, Operator.NEGATE])
_OPPOSITE: Final = {
    Operator.EQ: Operator.NE,
    Operator.NE: Operator.EQ,
    Operator.LT: Operator.GE,
    Operator.GE: Operator.LT,
    Operator.GT: Operator.LE,
    Operator.LE: Operator.GT,
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison that is true; its operands are literals, variables or arithmetic."""

    operator: Operator
    left: Guard
    right: Guard


class TooManyAlternatives(Exception):
    """The guards have more than `MAX_ALTERNATIVES` alternatives."""


Alternatives = list[tuple[Comparison, ...]]


def alternatives(guards: Iterable[Guard]) -> Alternatives:
    """The ways in which all guards can hold; none where they surely cannot.

    Raises `TooManyAlternatives`.
    """
    return _both([_when(guard, truth=True) for guard in guards])


def _when(guard: Guard, *, truth: bool) -> Alternatives:
    """The ways in which a guard has this truth value. The depth of a guard is bounded by the parser."""
    match guard:
        case Operation(Operator.NOT, (operand,)):
            return _when(operand, truth=not truth)
        case Operation(Operator.AND | Operator.OR as junction, operands):
            decides = junction is Operator.OR
            if truth is not decides:
                return _both([_when(operand, truth=truth) for operand in operands])
            # Read from the left, one operand decides, and those before it have the other truth value: they are defined too.
            return _bounded(
                way
                for index, operand in enumerate(operands)
                for way in _both(
                    [*(_when(before, truth=not decides) for before in operands[:index]), _when(operand, truth=decides)]
                )
            )
        case Operation(operator, (left, right)) if operator in COMPARISONS:
            return _compared(operator if truth else _OPPOSITE[operator], folded(left), folded(right))
        case Variable():
            return [(Comparison(Operator.EQ, guard, Literal(truth)),)]
        case Literal(constant):
            return [()] if constant is truth else []
        case _:
            return []  # arithmetic has no truth value


def _compared(operator: Operator, left: Guard, right: Guard) -> Alternatives:
    if not variables(left) and not variables(right):
        return [()] if value(Operation(operator, (left, right)), {}) is True else []
    if _speakable(left) and _speakable(right):
        return [(Comparison(operator, left, right),)]
    return [()]


def _speakable(operand: Guard) -> bool:
    return not isinstance(operand, Operation) or operand.operator in ARITHMETIC


def folded(guard: Guard) -> Guard:
    """A guard whose parts without variables are replaced by their values, where these are defined."""
    match guard:
        case Operation(operator, operands):
            if not variables(guard):
                constant = value(guard, {})
                return guard if constant is UNDEFINED else Literal(constant)
            return Operation(operator, tuple(folded(operand) for operand in operands))
        case _:
            return guard


def _both(parts: list[Alternatives]) -> Alternatives:
    return _bounded(tuple(dict.fromkeys(c for way in ways for c in way)) for ways in product(*parts))


def _bounded(ways: Iterator[tuple[Comparison, ...]]) -> Alternatives:
    found: dict[tuple[Comparison, ...], None] = {}
    for count, way in enumerate(ways):
        if count >= MAX_ALTERNATIVES:
            raise TooManyAlternatives
        found[way] = None
    return list(found)
