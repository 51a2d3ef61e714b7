"""Guards as conditions that RML can check: comparisons of numbers, equality of values, and both combined.

A guard of a tree is three-valued. `when_true` and `when_false` say when it is true and when it is false; undefined is neither. What
comes out has no negation but that of an equality: comparisons of numbers simply fail on anything else.
"""

from dataclasses import dataclass
from typing import Final, TypeAlias

from rvaft.model.guards import UNDEFINED, Guard, Operation, Operator, value
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import is_number


class Inexpressible(Exception):
    """A guard that no RML event type can check; the text says why."""


@dataclass(frozen=True, slots=True)
class Compare:
    """Two numbers compared; fails where a side is not one."""

    operator: Operator
    left: Guard
    right: Guard


@dataclass(frozen=True, slots=True)
class Same:
    """A variable has the value of a literal or of another variable."""

    left: Variable
    right: Variable | Literal


@dataclass(frozen=True, slots=True)
class Unless:
    """The condition fails."""

    condition: "Compare | Same"


@dataclass(frozen=True, slots=True)
class Every:
    """All of the conditions hold; none is always true."""

    parts: tuple["Condition", ...]


@dataclass(frozen=True, slots=True)
class Some:
    """One of the conditions holds; none is always false."""

    parts: tuple["Condition", ...]


Condition: TypeAlias = Compare | Same | Unless | Every | Some

ALWAYS: Final = Every(())
NEVER: Final = Some(())

_OPPOSITE: Final = {
    Operator.LT: Operator.GE,
    Operator.LE: Operator.GT,
    Operator.GT: Operator.LE,
    Operator.GE: Operator.LT,
}
_TRUTHS: Final = frozenset([*_OPPOSITE, Operator.EQ, Operator.NE, Operator.NOT, Operator.AND, Operator.OR])
_ARITHMETIC: Final = frozenset([Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV, Operator.NEGATE])


def when_true(guard: Guard) -> Condition:
    """When the value of the guard is `true`; raises `Inexpressible`."""
    return _when(guard, True)


def when_false(guard: Guard) -> Condition:
    """When the value of the guard is `false`; raises `Inexpressible`."""
    return _when(guard, False)


def conjuncts(condition: Condition) -> tuple[Condition, ...]:
    """The conditions that must all hold, nested conjunctions taken apart."""
    if isinstance(condition, Every):
        return tuple(inner for part in condition.parts for inner in conjuncts(part))
    return (condition,)


def numeric(condition: Condition) -> bool:
    """Whether the condition consists of comparisons of numbers only."""
    match condition:
        case Compare():
            return True
        case Every(parts) | Some(parts):
            return all(numeric(part) for part in parts)
        case _:
            return False


def variables(condition: Condition) -> tuple[str, ...]:
    """The variables of a condition, each once."""
    match condition:
        case Compare(_, left, right) | Same(left, right):
            return tuple(dict.fromkeys((*guard_variables(left), *guard_variables(right))))
        case Unless(inner):
            return variables(inner)
        case Every(parts) | Some(parts):
            return tuple(dict.fromkeys(name for part in parts for name in variables(part)))


def _when(guard: Guard, wanted: bool) -> Condition:
    if not guard_variables(guard):
        return ALWAYS if value(guard, {}) is wanted else NEVER
    match guard:
        case Variable():
            return Same(guard, Literal(wanted))
        case Operation(Operator.NOT, (operand,)):
            return _when(operand, not wanted)
        case Operation(Operator.AND | Operator.OR as operator, operands):
            return _junction(operands, decides=operator is Operator.OR, wanted=wanted)
        case Operation(Operator.EQ | Operator.NE as operator, (left, right)):
            return _equality(left, right, positive=(operator is Operator.EQ) is wanted)
        case Operation(operator, (left, right)) if operator in _OPPOSITE:
            return _comparison(operator if wanted else _OPPOSITE[operator], left, right)
        case _:
            return NEVER  # a number is no truth value


def _junction(operands: tuple[Guard, ...], *, decides: bool, wanted: bool) -> Condition:
    """Read from left to right: an operand counts only while those before it do not decide."""
    undecided = [_when(operand, not decides) for operand in operands]
    if wanted is not decides:
        return _every(undecided)
    ways = [_every([*undecided[:i], _when(operand, decides)]) for i, operand in enumerate(operands)]
    return _some(ways)


def _equality(left: Guard, right: Guard, *, positive: bool) -> Condition:
    sides = [_folded(left), _folded(right)]
    if any(side is None for side in sides):
        return NEVER
    for one, other in (sides, sides[::-1]):
        if _is(one, _TRUTHS):
            ways = [_every([_when(one, truth), _equals(other, truth, positive)]) for truth in (True, False)]  # type: ignore[arg-type]
            return _some(ways)
    for one, other in (sides, sides[::-1]):
        if _is(one, _ARITHMETIC):
            return _equality_of_sum(one, other, positive=positive)  # type: ignore[arg-type]
    for one, other in (sides, sides[::-1]):
        if isinstance(one, Variable):
            if one == other:
                return ALWAYS if positive else NEVER
            same = Same(one, other)  # type: ignore[arg-type]
            return same if positive else Unless(same)
    raise AssertionError(left, right)


def _equals(side: Guard | None, truth: bool, positive: bool) -> Condition:
    """Whether the side is that truth value (or, not positive, defined and something else)."""
    match side:
        case Variable():
            same = Same(side, Literal(truth))
            return same if positive else Unless(same)
        case Literal(constant):
            return ALWAYS if (constant is truth) is positive else NEVER
        case Operation(operator) if operator in _TRUTHS:
            return _when(side, truth is positive)
        case Operation():
            return NEVER if positive else _defined(side)
        case _:
            return NEVER


def _equality_of_sum(arithmetic: Guard, other: Guard, *, positive: bool) -> Condition:
    if not _calculable(arithmetic):
        return NEVER
    if _is(other, _ARITHMETIC) or (isinstance(other, Literal) and is_number(other.value)):
        if not _calculable(other):
            return NEVER
        return Compare(Operator.EQ if positive else Operator.NE, arithmetic, other)
    if isinstance(other, Literal):
        return NEVER if positive else _defined(arithmetic)
    equal = Compare(Operator.EQ, arithmetic, other)
    return equal if positive else _every([_defined(arithmetic), Unless(equal)])


def _defined(arithmetic: Guard) -> Condition:
    return Compare(Operator.EQ, arithmetic, arithmetic) if _calculable(arithmetic) else NEVER


def _comparison(operator: Operator, left: Guard, right: Guard) -> Condition:
    sides = (_folded(left), _folded(right))
    for one, other in (sides, sides[::-1]):
        if isinstance(one, Literal) and isinstance(one.value, str) and isinstance(other, Variable):
            raise Inexpressible("RML cannot order strings")
    if not all(side is not None and _calculable(side) for side in sides):
        return NEVER
    return Compare(operator, left, right)


def _folded(guard: Guard) -> Guard | None:
    """A literal for what has no variables, None where that is undefined."""
    if guard_variables(guard):
        return guard
    constant = value(guard, {})
    return None if constant is UNDEFINED else Literal(constant)


def _calculable(guard: Guard) -> bool:
    """Whether the expression can be a number at all."""
    folded = _folded(guard)
    match folded:
        case None:
            return False
        case Literal(constant):
            return is_number(constant)
        case Variable():
            return True
        case Operation(operator, operands):
            return operator in _ARITHMETIC and all(_calculable(operand) for operand in operands)


def _is(side: Guard | None, operators: frozenset[Operator]) -> bool:
    return isinstance(side, Operation) and side.operator in operators


def _every(parts: list[Condition]) -> Condition:
    flat = [inner for part in parts for inner in conjuncts(part)]
    if any(part == NEVER for part in flat):
        return NEVER
    return flat[0] if len(flat) == 1 else Every(tuple(dict.fromkeys(flat)))


def _some(parts: list[Condition]) -> Condition:
    flat = [inner for part in parts for inner in (part.parts if isinstance(part, Some) else (part,))]
    if any(part == ALWAYS for part in flat):
        return ALWAYS
    return flat[0] if len(flat) == 1 else Some(tuple(dict.fromkeys(flat)))
