"""Guards for people, in a shorter form."""

from typing import Any

import sympy

from rvaft.algebra.symbols import RELATIONS, Symbols, Unsayable
from rvaft.guards import Guard, Operation, Operator
from rvaft.patterns import Literal, Variable
from rvaft.rules.literals import folded


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
    from rvaft.language import guard_text  # noqa: PLC0415  (the language does not need algebra, nor algebra otherwise the language)

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
