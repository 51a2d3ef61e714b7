"""Guards: the expression type, and their value under an assignment of the variables.

A value is JSON or `UNDEFINED` (wrong types, division by zero, overflow, a result that is not finite). Undefined
propagates through every operator, except that `and` and `or` read left to right and do not look at the right side when the left
decides. The parser bounds the nesting of an expression (`MAX_DEPTH`), so the recursion here is bounded too.
"""

import math
import operator
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, TypeAlias

from rvaft.model.patterns import Binding, Literal, Variable
from rvaft.model.values import Json, equal, is_number

MAX_DEPTH: Final = 100


class Operator(StrEnum):
    """The operators, named as they are written; NEGATE is the unary minus."""

    EQ = "=="
    NE = "!="
    LT = "<"
    LE = "<="
    GT = ">"
    GE = ">="
    ADD = "+"
    SUB = "-"
    MUL = "*"
    DIV = "/"
    NEGATE = "neg"
    NOT = "not"
    AND = "and"
    OR = "or"


@dataclass(frozen=True, slots=True, eq=False)
class Operation:
    """An operator applied: one operand for NOT and NEGATE, two or more for AND and OR, else two.

    Operations are equal where they are written alike. 1 and 1.0, equal as values, are not: arithmetic tells them apart.
    """

    operator: Operator
    operands: tuple["Guard", ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Operation) and self._written == other._written

    def __hash__(self) -> int:
        return hash(self._written)

    @property
    def _written(self) -> tuple[Hashable, ...]:
        exact = (("literal", repr(part.value)) if isinstance(part, Literal) else part for part in self.operands)
        return (self.operator, *exact)


Guard: TypeAlias = Literal | Variable | Operation


class _Undefined:
    """The one value that is no JSON value."""

    def __repr__(self) -> str:
        return "UNDEFINED"


UNDEFINED: Final = _Undefined()


def variables(guard: Guard) -> tuple[str, ...]:
    """The variables of a guard, each once, in order of first occurrence."""
    match guard:
        case Variable(name):
            return (name,)
        case Operation(_, operands):
            return tuple(dict.fromkeys(name for operand in operands for name in variables(operand)))
        case _:
            return ()


def holds(guard: Guard, binding: Binding) -> bool:
    """Whether the guard's value is `true`; every variable of it must be bound (KeyError otherwise)."""
    return value(guard, binding) is True


def value(guard: Guard, binding: Binding) -> Json:
    """The value of a guard, or UNDEFINED; never raises on any JSON value."""
    match guard:
        case Literal(constant):
            return constant
        case Variable(name):
            return binding[name]
        case Operation(Operator.AND | Operator.OR as operator, operands):
            return _junction(operator, operands, binding)
        case Operation(operator, operands):
            arguments = [value(operand, binding) for operand in operands]
            return UNDEFINED if UNDEFINED in arguments else _apply(operator, arguments)


def _junction(operator: Operator, operands: tuple[Guard, ...], binding: Binding) -> Json:
    decides = operator is Operator.OR
    for operand in operands:
        truth = value(operand, binding)
        if not isinstance(truth, bool):
            return UNDEFINED
        if truth is decides:
            return decides
    return not decides


def _apply(operator: Operator, arguments: list[Json]) -> Json:
    match operator, arguments:
        case Operator.EQ, [left, right]:
            return equal(left, right)
        case Operator.NE, [left, right]:
            return not equal(left, right)
        case Operator.NOT, [operand]:
            return not operand if isinstance(operand, bool) else UNDEFINED
        case Operator.LT | Operator.LE | Operator.GT | Operator.GE, [left, right]:
            return _compare(operator, left, right)
        case _:
            return _calculate(operator, arguments)


def _compare(operator: Operator, left: Json, right: Json) -> Json:
    if not (is_number(left) and is_number(right)) and not (isinstance(left, str) and isinstance(right, str)):
        return UNDEFINED
    match operator:
        case Operator.LT:
            return left < right
        case Operator.LE:
            return left <= right
        case Operator.GT:
            return left > right
        case _:
            return left >= right


def _calculate(operator: Operator, arguments: list[Json]) -> Json:
    if not all(is_number(argument) for argument in arguments):
        return UNDEFINED
    try:
        match operator, arguments:
            case Operator.NEGATE, [operand]:
                result = -operand
            case Operator.ADD, [left, right]:
                result = left + right
            case Operator.SUB, [left, right]:
                result = left - right
            case Operator.MUL, [left, right]:
                result = left * right
            case _, [left, right]:
                result = left / right
    except (ZeroDivisionError, OverflowError):
        return UNDEFINED
    return result if isinstance(result, int) or math.isfinite(result) else UNDEFINED


# Guards as functions: what `rvaft.guards.holds` says, made ready once for a guard that is asked of very many events.
#
# Only what guards mostly are is made faster: a variable compared with a constant, and `and` over such. Where an operand has another type
# than the constant, and for every other guard, `holds` itself is asked.

Predicate: TypeAlias = Callable[[Mapping[str, Json]], bool]

_COMPARISONS: Final = {
    Operator.EQ: operator.eq,
    Operator.NE: operator.ne,
    Operator.LT: operator.lt,
    Operator.LE: operator.le,
    Operator.GT: operator.gt,
    Operator.GE: operator.ge,
}
_NUMBERS: Final = (int, float)


def predicate(guard: Guard) -> Predicate:
    """A function that says of a binding of the guard's variables whether the guard holds."""
    match guard:
        case Operation(Operator.AND, operands):
            parts = tuple(predicate(operand) for operand in operands)
            return lambda binding: all(part(binding) for part in parts)
        case Operation(sign, (Variable(name), Literal(constant))) if sign in _COMPARISONS:
            types = (str,) if type(constant) is str else _NUMBERS if type(constant) in _NUMBERS else ()
            return _comparison(guard, name, sign, constant, types)
        case _:
            return lambda binding: holds(guard, binding)


def _comparison(guard: Guard, name: str, sign: Operator, constant: Json, types: tuple[type, ...]) -> Predicate:
    compare = _COMPARISONS[sign]

    def compared(binding: Mapping[str, Json]) -> bool:
        value = binding[name]
        if type(value) in types:
            return bool(compare(value, constant))
        return holds(guard, binding)

    return compared
