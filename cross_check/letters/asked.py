"""What a guard asks of values: constants at which its truth can change, and values that are compared with each other.

Between neighbouring constants an atomic comparison of one variable with a constant does not change, for numbers and for strings. Where
the variable is calculated with (`X / 2 < 1`), every step is monotone, rounding and overflow included, so the places where the
comparison changes are found by bisection, once among the integers and once among the doubles.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from rvaft.guards import UNDEFINED, Guard, Operation, Operator, value, variables
from rvaft.patterns import Literal, Variable
from rvaft.values import Scalar, is_number

ORDER: Final = frozenset({Operator.LT, Operator.LE, Operator.GT, Operator.GE})
COMPARE: Final = ORDER | {Operator.EQ, Operator.NE}
ARITHMETIC: Final = frozenset({Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV, Operator.NEGATE})

SEVERAL: Final = "a guard calculates with several values"
BEYOND: Final = "a guard calculates in a way that has no known bounds"

_MODERATE: Final = 2**64
_BITS: Final = 64
_DOUBLE_BITS: Final = 1024 + _BITS
"""From two to this power on all integers are alike, but for as many bits more as steps with moderate constants can take back."""


@dataclass(slots=True)
class Asked:
    """What a guard asks; `gap` says why that is not all."""

    constants: dict[str, dict[Literal, None]] = field(default_factory=dict)
    pairs: set[tuple[str, str]] = field(default_factory=set)
    ordered: bool = False
    calculated: bool = False
    gap: str = ""

    def constant(self, name: str, given: Scalar) -> None:
        """A value of a variable at which something may change."""
        self.constants.setdefault(name, {})[Literal(given)] = None


def asked(guard: Guard) -> Asked:
    """What a guard asks of its variables."""
    found = Asked()
    _condition(guard, found)
    return found


def _condition(guard: Guard, found: Asked) -> None:
    match guard:
        case Variable(name):
            found.constant(name, given=True)
            found.constant(name, given=False)
        case Operation(Operator.AND | Operator.OR | Operator.NOT, operands):
            for operand in operands:
                _condition(operand, found)
        case Operation(operator, (left, right)) if operator in COMPARE:
            _comparison(operator, left, right, found)
        case Operation() if variables(guard):
            found.gap = BEYOND
        case _:
            pass


def _comparison(operator: Operator, left: Guard, right: Guard, found: Asked) -> None:
    folded = _folded(left), _folded(right)
    if folded[0] is None or folded[1] is None:  # undefined whatever the variables are
        return
    left, right = folded[0], folded[1]
    found.ordered |= operator in ORDER
    match left, right:
        case (Variable(one), Variable(other)):
            if one != other:
                found.pairs.add((one, other))
        case (Variable(name), Literal(constant)) | (Literal(constant), Variable(name)):
            found.constant(name, constant)
        case (Literal(), Literal()):
            pass
        case _:
            _mixed(left, right, found)


def _mixed(left: Guard, right: Guard, found: Asked) -> None:
    """A comparison with conditions or calculations in it."""
    sides = [side for side in (left, right) if isinstance(side, Operation)]
    if any(side.operator in ARITHMETIC for side in sides):
        _calculation(left, right, found)
    if any(side.operator not in ARITHMETIC for side in sides):  # the other side is looked at as a truth value
        for side in (left, right):
            _condition(side, found)


def _folded(guard: Guard) -> Guard | None:
    """An operand without variables as its value; None where that is undefined."""
    if isinstance(guard, Operation) and not variables(guard):
        constant = value(guard, {})
        return None if constant is UNDEFINED else Literal(constant)
    return guard


def _calculation(left: Guard, right: Guard, found: Asked) -> None:
    found.ordered = found.calculated = True
    names = list(dict.fromkeys((*variables(left), *variables(right))))
    for constant in (*_numbers(left), *_numbers(right)):
        for called in names:
            found.constant(called, constant)
    if len(names) > 1:
        found.gap = SEVERAL
        return
    name = names[0]
    calculated, other = (left, right) if isinstance(left, Operation) else (right, left)
    if not (isinstance(other, Literal) and _monotone(calculated)):
        found.gap = BEYOND
        return

    def side(given: Scalar) -> str:
        result = value(calculated, {name: given})
        if result is UNDEFINED:
            return "undefined"
        if not is_number(other.value):
            return "defined"
        return "above" if result > other.value else "below" if result < other.value else "equal"

    last = 2 ** (_DOUBLE_BITS + _BITS * _steps(calculated))
    for bound in (*_changes(side, _integer, last), *_changes(side, _double, _LAST_DOUBLE)):
        found.constant(name, bound)


def _numbers(guard: Guard) -> list[Scalar]:
    match guard:
        case Literal(constant) if is_number(constant):
            return [constant]
        case Operation(_, operands):
            return [constant for operand in operands for constant in _numbers(operand)]
        case _:
            return []


def _monotone(guard: Guard) -> bool:
    """Whether a chain of steps leads from one variable here, each with a constant of moderate size."""
    while isinstance(guard, Operation):
        operands = [_folded(operand) for operand in guard.operands]
        constants = [one.value for one in operands if isinstance(one, Literal)]
        others = [one for one in operands if one is not None and not isinstance(one, Literal)]
        if guard.operator not in ARITHMETIC or len(others) != 1 or len(constants) != len(operands) - 1:
            return False
        if guard.operator is Operator.DIV and isinstance(operands[0], Literal):
            return False
        if not all(map(_moderate, constants)):
            return False
        guard = others[0]
    return isinstance(guard, Variable)


def _steps(guard: Guard) -> int:
    return 1 + sum(map(_steps, guard.operands)) if isinstance(guard, Operation) else 0


def _moderate(constant: Scalar) -> bool:
    return not isinstance(constant, (int, float)) or not constant or 1 / _MODERATE <= abs(constant) <= _MODERATE


def _integer(rank: int) -> int:
    return rank


def _double(rank: int) -> float:
    """The doubles in their order, 0 at rank 0."""
    magnitude: float = struct.unpack("<d", struct.pack("<Q", abs(rank)))[0]
    return magnitude if rank >= 0 else -magnitude


_LAST_DOUBLE: Final[int] = struct.unpack("<Q", struct.pack("<d", 1.7976931348623157e308))[0]


def _changes(side: Callable[[Scalar], str], at: Callable[[int], Scalar], last: int) -> list[Scalar]:
    """The values before and after every change; on either half of the line, what has been left does not come again."""
    found: list[Scalar] = []
    known = {rank: side(at(rank)) for rank in (-last, 0, last)}
    todo = [(-last, 0), (0, last)]
    while todo:
        low, high = todo.pop()
        if known[low] == known[high]:
            continue
        if high - low == 1:
            found += [at(low), at(high)]
        else:
            middle = (low + high) // 2
            known[middle] = side(at(middle))
            todo += [(low, middle), (middle, high)]
    return found
