"""A `with` of RML as a guard that holds for the same values.

RML compares two numbers or two strings and nothing else, while `==` of a guard compares all values. So `x == y` becomes
`x <= y and x >= y`, and `x != y` becomes `x < y or x > y`, which are undefined where RML's have no value.
"""

from collections.abc import Mapping
from typing import Final

from backends.rml.reading.syntax import Apply, Constant, Data, Name
from rvaft.guards import MAX_DEPTH, Guard, Operation, Operator
from rvaft.patterns import Literal, Pattern, Variable

NOTHING: Final = Literal(None)
"""Stands for no value: whatever is asked of null in these guards is undefined."""

_SAME: Final = {
    "<": Operator.LT,
    "<=": Operator.LE,
    ">": Operator.GT,
    ">=": Operator.GE,
    "+": Operator.ADD,
    "-": Operator.SUB,
    "*": Operator.MUL,
    "/": Operator.DIV,
    "neg": Operator.NEGATE,
    "&&": Operator.AND,
    "||": Operator.OR,
}


_TRUTHS: Final = frozenset({Operator.AND, Operator.OR, Operator.LT, Operator.LE, Operator.GT, Operator.GE})


class Untranslatable(Exception):
    """A condition that no guard says."""


def condition(data: Data, values: Mapping[str, Pattern], depth: int = 0) -> Guard:
    """The guard, with a value for each name (`NOTHING` for unbound ones, and for objects and lists); raises `Untranslatable`."""
    if depth > MAX_DEPTH:
        raise Untranslatable
    match data:
        case Constant(value):
            return Literal(value)
        case Name(name):
            value = values.get(name, NOTHING)
            return value if isinstance(value, (Literal, Variable)) else NOTHING
        case Apply(operator, operands):
            parts = tuple(condition(operand, values, depth + 1) for operand in operands)
            return _applied(operator, parts)


def _applied(operator: str, parts: tuple[Guard, ...]) -> Guard:
    if operator not in ("&&", "||") and any(
        map(_truth, parts)
    ):  # a truth value is neither compared nor calculated with
        return NOTHING
    if operator == "==":
        return Operation(Operator.AND, (Operation(Operator.LE, parts), Operation(Operator.GE, parts)))
    if operator == "!=":
        return Operation(Operator.OR, (Operation(Operator.LT, parts), Operation(Operator.GT, parts)))
    if operator not in _SAME:
        raise Untranslatable
    return Operation(_SAME[operator], parts)


def _truth(guard: Guard) -> bool:
    return isinstance(guard, Operation) and guard.operator in _TRUTHS
