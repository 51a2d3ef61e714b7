"""Whether guards can hold together: certain answers only, and what exact arithmetic would say."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import sympy
from sympy.core.relational import Relational

from rvaft.algebra.symbols import Symbols, Unsayable
from rvaft.guards import Guard, Operation, Operator
from rvaft.patterns import Literal, Variable
from rvaft.rules.literals import Comparison, TooManyAlternatives, alternatives
from rvaft.rules.refute import refuted
from rvaft.rules.satisfy import witness
from rvaft.values import is_number

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
