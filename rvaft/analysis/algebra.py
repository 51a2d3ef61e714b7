"""Whether guards can hold together: certain answers only, and what exact arithmetic would say."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final

import sympy
from sympy.core.relational import Relational

from rvaft.analysis.guard_solver import Comparison, TooManyAlternatives, alternatives, folded, refuted, witness
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import is_number

# Guards as expressions of sympy over real numbers, as far as they have such a meaning.

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


_EXACT: Final = 2**53
_DEGREE: Final = 4


def contradictory(guards: Iterable[Guard]) -> bool | None:
    """Whether no values at all make these guards hold together; None where that cannot be decided.

    True and False are certain, with undefined values, mixed types and the rounding of doubles taken into account: False has a
    witness, True a proof from sorts and order, or one by sympy of inequalities weakened by what rounding could add.
    """
    given = list(guards)
    if witness(given) is not None:
        return False
    if refuted(given):
        return True
    return True if _impossible(given, weaken=True) else None


def contradictory_over_reals(guards: Iterable[Guard]) -> bool | None:
    """Whether the guards could hold at most through rounding: no real numbers make them hold. None where sympy cannot tell."""
    return _impossible(list(guards), weaken=False) or None


def _impossible(guards: Sequence[Guard], *, weaken: bool) -> bool:
    try:
        ways = alternatives(guards)
    except TooManyAlternatives:
        return False
    return all(_way_impossible(way, weaken=weaken) for way in ways)


def _way_impossible(way: tuple[Comparison, ...], *, weaken: bool) -> bool:
    symbols = Symbols()
    relations = []
    for comparison in way:
        if weaken and not (comparison.operator in _STRICT and _rounds_once(comparison)) and not _exact(comparison):
            continue
        try:
            relations.append(symbols.relation(comparison))
        except Unsayable:
            continue
    if any(relation is sympy.false for relation in relations):
        return True
    relations = [relation for relation in relations if relation is not sympy.true]
    return bool(relations) and not _satisfiable(relations)


def _satisfiable(relations: list[Any]) -> bool:
    """Whether real numbers may satisfy the relations; True where sympy cannot tell."""
    unknowns = set[Any]().union(*(relation.free_symbols for relation in relations))
    try:
        if len(unknowns) == 1 and all(_degree(relation, unknowns) <= _DEGREE for relation in relations):
            solutions = sympy.And(*relations).as_set()
            return solutions is not sympy.S.EmptySet and solutions.is_empty is not True
        if all(_degree(relation, unknowns) <= 1 for relation in relations):
            from sympy.logic.inference import satisfiable  # noqa: PLC0415  (the theory of linear reals came with sympy 1.13)

            return satisfiable(_split(relations), use_lra_theory=True) is not False
    except (NotImplementedError, TypeError, ValueError, AttributeError):
        return True
    return True


def _split(relations: list[Any]) -> Any:
    """The conjunction with `!=` written as `<` or `>`."""
    parts = [
        sympy.Or(relation.lhs < relation.rhs, relation.lhs > relation.rhs)
        if isinstance(relation, sympy.Ne)
        else relation
        for relation in relations
    ]
    return sympy.And(*parts)


def _degree(relation: Relational, unknowns: set[Any]) -> float:
    """The degree of a polynomial relation, infinite where it is none."""
    difference = sympy.expand(relation.lhs - relation.rhs)
    if not difference.is_polynomial(*unknowns):
        return math.inf
    return int(sympy.Poly(difference, *unknowns).total_degree())


_STRICT = frozenset([Operator.LT, Operator.GT])


def _exact(comparison: Comparison) -> bool:
    """Whether nothing is rounded: both sides are variables or numbers, and a variable may only meet numbers there."""
    return all(not isinstance(side, Operation) for side in (comparison.left, comparison.right))


def _rounds_once(comparison: Comparison) -> bool:
    """Whether one side is a representable number and the other at most one operation on a variable and a small integer.

    Rounding is monotone and keeps representable numbers, so `round(x) < c` implies `x < c` for such a c.
    """
    left, right = comparison.left, comparison.right
    if isinstance(left, Literal):
        left, right = right, left
    if not (isinstance(right, Literal) and _representable(right.value)):
        return False
    match left:
        case Operation(Operator.NEGATE, (Variable(),)):
            return True
        case Operation(_, (Variable(one), Variable(other))):
            return one == other
        case Operation(_, (Variable(), Literal(number)) | (Literal(number), Variable())):
            return isinstance(number, int) and _representable(number)
        case _:
            return False


def _representable(number: object) -> bool:
    return is_number(number) and (isinstance(number, float) or abs(number) <= _EXACT)  # type: ignore[arg-type]


# Guards for people, in a shorter form.


def simplified(guard: Guard) -> Guard:
    """A shorter guard to look at, equal over real numbers; not to be run, since undefined values break the laws it uses."""
    symbols = Symbols()
    opaque: dict[Any, Guard] = {}
    try:
        shorter = sympy.simplify(_formula(folded(guard), symbols, opaque))
        variables = {symbol: Variable(name) for name, symbol in symbols.symbols.items()}
        found = _back(shorter, variables | opaque)
    except (Unsayable, NotImplementedError, TypeError, ValueError, AttributeError):
        return guard
    return found if _size(found) < _size(guard) else guard


def simplify_text(guard: Guard) -> str:
    """`simplified`, in the notation of the language."""
    from rvaft.model.expressions import guard_text  # noqa: PLC0415  (the language does not need algebra, nor algebra otherwise the language)

    return guard_text(simplified(guard))


def _formula(guard: Guard, symbols: Symbols, opaque: dict[Any, Guard]) -> Any:
    match guard:
        case Operation(Operator.AND, operands):
            return sympy.And(*(_formula(operand, symbols, opaque) for operand in operands))
        case Operation(Operator.OR, operands):
            return sympy.Or(*(_formula(operand, symbols, opaque) for operand in operands))
        case Operation(Operator.NOT, (operand,)):
            return sympy.Not(_formula(operand, symbols, opaque))
        case Operation(operator, (left, right)) if operator in RELATIONS:
            try:
                return RELATIONS[operator](symbols.number(left), symbols.number(right))
            except Unsayable:
                pass
        case Literal(bool(constant)):
            return sympy.true if constant else sympy.false
        case _:
            pass
    for symbol, known in opaque.items():
        if known == guard:
            return symbol
    made = sympy.Symbol(f"b{len(opaque)}")
    opaque[made] = guard
    return made


_BACK: dict[Any, Operator] = {
    sympy.And: Operator.AND,
    sympy.Or: Operator.OR,
    sympy.Not: Operator.NOT,
    **{relation: operator for operator, relation in RELATIONS.items()},
}


def _back(expression: Any, known: dict[Any, Guard]) -> Guard:
    if expression in known:
        return known[expression]
    if expression in (sympy.true, sympy.false):
        return Literal(expression is sympy.true)
    if expression.is_Rational:
        numerator, denominator = int(expression.p), int(expression.q)
        return (
            Literal(numerator)
            if denominator == 1
            else Operation(Operator.DIV, (Literal(numerator), Literal(denominator)))
        )
    arguments = expression.args
    if expression.func in _BACK:
        ordered = (
            sorted(arguments, key=sympy.default_sort_key) if expression.func in (sympy.And, sympy.Or) else arguments
        )
        return Operation(_BACK[expression.func], tuple(_back(argument, known) for argument in ordered))
    if expression.is_Add:
        return _sum([term.as_coeff_Mul() for term in expression.as_ordered_terms()], known)
    if expression.is_Mul:
        return _joined(Operator.MUL, [_back(factor, known) for factor in expression.as_ordered_factors()])
    if expression.is_Pow and expression.exp.is_Integer and 0 < int(expression.exp) <= 4:
        return _joined(Operator.MUL, [_back(expression.base, known)] * int(expression.exp))
    raise Unsayable


def _sum(terms: list[tuple[Any, Any]], known: dict[Any, Guard]) -> Guard:
    """A sum of coefficients and terms, the negative ones subtracted and not first where that can be."""
    (coefficient, term), *rest = sorted(terms, key=lambda pair: bool(pair[0] < 0))
    total = _back(coefficient * term, known)
    for coefficient, term in rest:
        operator = Operator.SUB if coefficient < 0 else Operator.ADD
        total = Operation(operator, (total, _back(abs(coefficient) * term, known)))
    return total


def _size(guard: Guard) -> int:
    return 1 + sum(_size(operand) for operand in guard.operands) if isinstance(guard, Operation) else 1


def _joined(operator: Operator, parts: list[Guard]) -> Guard:
    joined, *rest = parts
    for part in rest:
        joined = Operation(operator, (joined, part))
    return joined
