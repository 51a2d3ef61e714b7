"""Guards as expressions of sympy over real numbers, as far as they have such a meaning."""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import sympy

from rvaft.guards import Guard, Operation, Operator
from rvaft.patterns import Literal, Variable
from rvaft.rules.literals import Comparison
from rvaft.values import is_number

RELATIONS: dict[Operator, Any] = {
    Operator.EQ: sympy.Eq,
    Operator.NE: sympy.Ne,
    Operator.LT: sympy.Lt,
    Operator.LE: sympy.Le,
    Operator.GT: sympy.Gt,
    Operator.GE: sympy.Ge,
}


class Unsayable(Exception):
    """An expression that sympy's real numbers cannot stand for."""


@dataclass(slots=True)
class Symbols:
    """One real symbol per variable; the number in its name keeps names of a tree from meaning anything to sympy."""

    symbols: dict[str, Any] = field(default_factory=dict)

    def relation(self, comparison: Comparison) -> Any:
        """The comparison; raises `Unsayable` where it may be about other values than numbers."""
        if comparison.operator is Operator.NE and not (_numeric(comparison.left) or _numeric(comparison.right)):
            raise Unsayable
        return RELATIONS[comparison.operator](self.number(comparison.left), self.number(comparison.right))

    def number(self, guard: Guard) -> Any:
        """The value of an operand; raises `Unsayable` where real numbers have none."""
        match guard:
            case Literal(constant) if is_number(constant):
                fraction = Fraction(constant)  # type: ignore[arg-type]
                return sympy.Rational(fraction.numerator, fraction.denominator)
            case Variable(name):
                return self.symbols.setdefault(name, sympy.Symbol(f"v{len(self.symbols)}", real=True))
            case Operation(operator, operands):
                return _calculated(operator, [self.number(operand) for operand in operands])
            case _:
                raise Unsayable


def _numeric(guard: Guard) -> bool:
    return isinstance(guard, Operation) or (isinstance(guard, Literal) and is_number(guard.value))


def _calculated(operator: Operator, arguments: list[Any]) -> Any:
    match operator, arguments:
        case Operator.ADD, [left, right]:
            return left + right
        case Operator.SUB, [left, right]:
            return left - right
        case Operator.MUL, [left, right]:
            return left * right
        case Operator.DIV, [left, right] if right.is_number and right != 0:
            return left / right
        case Operator.NEGATE, [operand]:
            return -operand
        case _:
            raise Unsayable
