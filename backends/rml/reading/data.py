"""The value of a data expression: exact numbers, and nothing (`None`) where types are wrong or a variable is unbound.

Integers are exact, the rest are IEEE doubles, and two strings compare by code points, as in the tree language; the published monitor calculates with the real
constraints of Prolog instead (see `deviations`). Nothing here recurses: an expression may be nested arbitrarily deep.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

from backends.rml.reading.syntax import Apply, Constant, Data, Name
from rvaft.values import Json, is_number

Number: TypeAlias = int | float

_UNARY: Final[Mapping[str, Callable[[Number], Number]]] = {
    "neg": lambda x: -x,
    "abs": abs,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
}
_BINARY: Final[Mapping[str, Callable[[Number, Number], Number]]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "min": min,
    "max": max,
}
_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "==": lambda x, y: x == y,
    "!=": lambda x, y: x != y,
    "<": lambda x, y: x < y,
    "<=": lambda x, y: x <= y,
    ">": lambda x, y: x > y,
    ">=": lambda x, y: x >= y,
}
_MAX_BITS: Final = 100_000


def truth(data: Data, values: Mapping[str, Json]) -> bool | None:
    """Whether a condition holds, or None where it has no value."""
    found = _evaluate(data, values)
    return found if isinstance(found, bool) else None


def argument(data: Data, values: Mapping[str, Json]) -> Json:
    """The value of an argument of a generic equation; a variable without a value, or an error, counts as false."""
    match data:
        case Constant(value):
            return value
        case Name(name) if name in values:
            return values[name]
        case _:
            found = _evaluate(data, values)
            return False if found is None else found


def _evaluate(data: Data, values: Mapping[str, Json]) -> Json:
    """A number, a truth value or another JSON value; None stands for no value (null counts as none)."""
    order: list[Data] = []
    todo = [data]
    while todo:
        order.append(part := todo.pop())
        if isinstance(part, Apply):
            todo.extend(reversed(part.operands))
    found: list[Json] = []
    for part in reversed(order):
        match part:
            case Constant(value):
                found.append(value)
            case Name(name):
                found.append(values.get(name))
            case Apply(operator, operands):
                # the reversed order has operands from the last to the first, so the first lies on top
                given = [found.pop() for _ in operands]
                found.append(_apply(operator, given))
    return found.pop()


def _apply(operator: str, given: list[Json]) -> Json:
    if operator in ("&&", "||"):
        return _connect(given, decides=operator == "||")
    strings = operator in _COMPARE and all(isinstance(value, str) for value in given)
    if not strings and not all(map(is_number, given)):
        return None
    return _COMPARE[operator](*given) if operator in _COMPARE else _calculate(operator, given)


def _connect(given: list[Json], *, decides: bool) -> bool | None:
    """The first operand where it decides, else the second; an operand that is needed and no truth value gives none."""
    first, second = given
    if not isinstance(first, bool) or first is decides:
        return first if isinstance(first, bool) else None
    return second if isinstance(second, bool) else None


def _calculate(operator: str, given: list[Number]) -> Number | None:
    try:
        if operator in _UNARY:
            result = _UNARY[operator](given[0])
        elif operator in _BINARY:
            result = _BINARY[operator](*given)
        else:
            result = _power(*given)
    except (ZeroDivisionError, OverflowError, ValueError):
        return None
    return result if isinstance(result, int) or math.isfinite(result) else None


def _power(base: Number, exponent: Number) -> Number:
    if isinstance(base, int) and isinstance(exponent, int) and base.bit_length() * abs(exponent) > _MAX_BITS:
        raise OverflowError
    result = base**exponent
    return math.nan if isinstance(result, complex) else result
