"""Guards as conditions that RML can check: comparisons of numbers, equality of values, and both combined.

A guard of a tree is three-valued; a condition is a guard that says when another one is true, undefined being neither. It is made of
`and` and `or` over comparisons of numbers, which simply fail on anything else; over *equalities*, of a variable with a literal or
another variable; and of `not` in front of one of the two kinds of `==`.
"""

from collections.abc import Iterable
from typing import Final

from rvaft.model.guards import (
    ARITHMETIC,
    JUNCTIONS,
    OPERATORS,
    ORDERINGS,
    UNDEFINED,
    Guard,
    Operation,
    Operator,
    conjuncts,
    value,
    variables,
)
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import is_number

ALWAYS: Final = Operation(Operator.AND, ())
NEVER: Final = Operation(Operator.OR, ())


class Inexpressible(Exception):
    """A guard that no RML event type can check; the text says why."""


def is_equality(condition: Guard) -> bool:
    """Whether the condition says that a variable has the value of a literal or of another variable."""
    return isinstance(condition, Operation) and (
        condition.operator is Operator.EQ and isinstance(condition.operands[0], Variable)
    )


def is_numeric(condition: Guard) -> bool:
    """Whether the condition consists of comparisons of numbers only."""
    match condition:
        case Operation(operator, parts) if operator in JUNCTIONS:
            return all(map(is_numeric, parts))
        case Operation(operator):
            return operator is not Operator.NOT and not is_equality(condition)
        case _:
            return False


def when_true(guard: Guard) -> Guard:
    """The condition under which the value of the guard is `true`; raises `Inexpressible`."""
    return _when(guard, True)


def _when(guard: Guard, wanted: bool) -> Guard:
    if not variables(guard):
        return ALWAYS if value(guard, {}) is wanted else NEVER
    match guard:
        case Variable():
            return _same(guard, Literal(wanted))
        case Operation(Operator.NOT, (operand,)):
            return _when(operand, not wanted)
        case Operation(Operator.AND | Operator.OR as operator, operands):
            return _junction(operands, decides=operator is Operator.OR, wanted=wanted)
        case Operation(Operator.EQ | Operator.NE as operator, (left, right)):
            return _equality(left, right, positive=(operator is Operator.EQ) is wanted)
        case Operation(operator, (left, right)) if operator in ORDERINGS:
            return _ordering(operator if wanted else OPERATORS[operator].negated or operator, left, right)
        case _:
            return NEVER  # a number is no truth value


def _junction(operands: tuple[Guard, ...], *, decides: bool, wanted: bool) -> Guard:
    """Read from left to right: an operand counts only while those before it do not decide."""
    undecided = [_when(operand, not decides) for operand in operands]
    if wanted is not decides:
        return _every(undecided)
    return _some(_every([*undecided[:i], _when(operand, decides)]) for i, operand in enumerate(operands))


def _same(left: Guard, right: Guard, *, positive: bool = True) -> Guard:
    equal = Operation(Operator.EQ, (left, right))
    return equal if positive else Operation(Operator.NOT, (equal,))


def _equality(left: Guard, right: Guard, *, positive: bool) -> Guard:
    sides = _constant(left), _constant(right)
    if sides[0] is None or sides[1] is None:
        return NEVER
    both_ways = (sides, sides[::-1])
    for one, other in both_ways:
        if isinstance(one, Operation) and one.operator not in ARITHMETIC:
            return _some(_every([_when(one, truth), _equals(other, truth, positive)]) for truth in (True, False))  # type: ignore[arg-type]
    for one, other in both_ways:
        if isinstance(one, Operation):
            return _equality_of_sum(one, other, positive=positive)  # type: ignore[arg-type]
    left, right = sides if isinstance(sides[0], Variable) else sides[::-1]  # type: ignore[assignment]
    if left == right:
        return ALWAYS if positive else NEVER
    return _same(left, right, positive=positive)


def _equals(side: Guard, truth: bool, positive: bool) -> Guard:
    """Whether the side is that truth value (or, not positive, defined and something else)."""
    match side:
        case Variable():
            return _same(side, Literal(truth), positive=positive)
        case Literal(constant):
            return ALWAYS if (constant is truth) is positive else NEVER
        case Operation(operator) if operator not in ARITHMETIC:
            return _when(side, truth is positive)
        case Operation():
            return NEVER if positive else _defined(side)


def _equality_of_sum(arithmetic: Guard, other: Guard, *, positive: bool) -> Guard:
    equal = Operation(Operator.EQ, (arithmetic, other))
    match other:
        case _ if not _is_calculable(arithmetic):
            return NEVER
        case Variable():
            return equal if positive else _every([_defined(arithmetic), Operation(Operator.NOT, (equal,))])
        case Literal(constant) if not is_number(constant):
            return NEVER if positive else _defined(arithmetic)
        case _ if not _is_calculable(other):
            return NEVER
        case _:
            return equal if positive else Operation(Operator.NE, (arithmetic, other))


def _defined(arithmetic: Guard) -> Guard:
    return Operation(Operator.EQ, (arithmetic, arithmetic)) if _is_calculable(arithmetic) else NEVER


def _ordering(operator: Operator, left: Guard, right: Guard) -> Guard:
    sides = [side for side in (_constant(left), _constant(right)) if side is not None]
    text = any(isinstance(side, Literal) and isinstance(side.value, str) for side in sides)
    if text and any(isinstance(side, Variable) for side in sides):
        raise Inexpressible("RML cannot order strings")
    calculable = len(sides) == 2 and all(map(_is_calculable, sides))
    return Operation(operator, (left, right)) if calculable else NEVER


def _constant(guard: Guard) -> Guard | None:
    """A literal for what has no variables, None where that is undefined."""
    if variables(guard):
        return guard
    constant = value(guard, {})
    return None if constant is UNDEFINED else Literal(constant)


def _is_calculable(guard: Guard) -> bool:
    """Whether the expression can be a number at all."""
    match _constant(guard):
        case None:
            return False
        case Literal(constant):
            return is_number(constant)
        case Variable():
            return True
        case Operation(operator, operands):
            return operator in ARITHMETIC and all(map(_is_calculable, operands))


def _every(parts: Iterable[Guard]) -> Guard:
    flat = [inner for part in parts for inner in conjuncts(part)]
    if NEVER in flat:
        return NEVER
    return flat[0] if len(flat) == 1 else Operation(Operator.AND, tuple(dict.fromkeys(flat)))


def _some(parts: Iterable[Guard]) -> Guard:
    flat: list[Guard] = []
    for part in parts:
        is_some = isinstance(part, Operation) and part.operator is Operator.OR
        flat.extend(part.operands if is_some else (part,))  # type: ignore[union-attr]
    if ALWAYS in flat:
        return ALWAYS
    return flat[0] if len(flat) == 1 else Operation(Operator.OR, tuple(dict.fromkeys(flat)))
