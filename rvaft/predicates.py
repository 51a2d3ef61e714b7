"""Guards as functions: what `rvaft.guards.holds` says, made ready once for a guard that is asked of very many events.

Only what guards mostly are is made faster: a variable compared with a constant, and `and` over such. Where an operand has another type
than the constant, and for every other guard, `holds` itself is asked.
"""

import operator
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from rvaft.guards import Guard, Operation, Operator, holds
from rvaft.patterns import Literal, Variable
from rvaft.values import Json

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
