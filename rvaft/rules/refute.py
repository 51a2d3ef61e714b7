"""A proof, without any library for algebra, that guards cannot hold together.

It reasons with the sorts of values (a number is no string) and with their order, both of which are exact whatever the values are: comparing
an integer with a double rounds nothing. Of arithmetic, which rounds, it uses only what rounding keeps: adding a
larger whole number gives no smaller result, and a difference has the sign of the comparison or is zero.
"""

from collections.abc import Hashable, Iterable
from itertools import pairwise
from typing import Any

import networkx as nx

from rvaft.guards import Guard, Operation, Operator
from rvaft.patterns import Literal, Variable
from rvaft.rules.literals import ARITHMETIC, Comparison, TooManyAlternatives, alternatives
from rvaft.values import is_number

_NUMBER, _STRING = "number", "string"


def refuted(guards: Iterable[Guard]) -> bool:
    """Whether it is proved that no values make all guards hold; False says nothing."""
    try:
        return all(_impossible(way) for way in alternatives(guards))
    except TooManyAlternatives:
        return False


def _impossible(way: tuple[Comparison, ...]) -> bool:
    facts = _Facts()
    for comparison in way:
        facts.add(comparison)
    return facts.contradictory()


class _Facts:
    """Terms with what is known of their sorts and order. A node of `order` is a term; an edge says `<=`, or `<` where strict."""

    def __init__(self) -> None:
        self.order = nx.DiGraph()
        self.sorts: dict[Hashable, set[str]] = {}
        self.unequal: list[tuple[Hashable, Hashable]] = []
        self.alike: list[tuple[Hashable, Hashable]] = []
        self.constants: dict[Hashable, Any] = {}
        self.sums: dict[Hashable, dict[int, Hashable]] = {}

    def add(self, comparison: Comparison) -> None:
        left, right = self._term(comparison.left), self._term(comparison.right)
        match comparison.operator:
            case Operator.EQ:
                self._equal(left, right)
            case Operator.NE:
                self.unequal.append((left, right))
            case Operator.LT:
                self._at_most(left, right, strict=True)
            case Operator.LE:
                self._at_most(left, right)
            case Operator.GT:
                self._at_most(right, left, strict=True)
            case _:
                self._at_most(right, left)
        if comparison.operator in _ORDERED:
            self.alike.append((left, right))
        self._difference(comparison.operator, comparison.left, comparison.right)
        self._difference(_TURNED.get(comparison.operator, comparison.operator), comparison.right, comparison.left)

    def _at_most(self, low: Hashable, high: Hashable, *, strict: bool = False) -> None:
        already = self.order.has_edge(low, high) and self.order.edges[low, high]["strict"]
        self.order.add_edge(low, high, strict=strict or already)

    def _equal(self, left: Hashable, right: Hashable) -> None:
        self._at_most(left, right)
        self._at_most(right, left)

    def _term(self, guard: Guard) -> Hashable:
        """The node of a term; that a term occurs in a true comparison says that it is defined."""
        match guard:
            case Literal(constant):
                # 1 and 1.0 are equal, but adding one or the other need not be: they are two terms.
                term: Hashable = ("constant", type(constant).__name__, constant)
                self.constants[term] = constant
                self.sorts[term] = {_sort(constant)}
            case Variable(name):
                term = ("variable", name)
            case Operation(operator, operands):
                inner = [self._term(operand) for operand in operands]
                for part in inner:
                    if operator in ARITHMETIC:
                        self.sorts.setdefault(part, set()).add(_NUMBER)
                term = ("operation", operator, *inner)
                self.sorts.setdefault(term, set()).add(_NUMBER)
                self._sum(operator, operands, inner, term)
        self.order.add_node(term)
        return term

    def _sum(self, operator: Operator, operands: tuple[Guard, ...], inner: list[Hashable], term: Hashable) -> None:
        """Note a term that is another one plus a whole number."""
        if operator not in (Operator.ADD, Operator.SUB):
            return
        left, right = operands
        base, number = inner[0], right
        if operator is Operator.ADD and isinstance(left, Literal):
            base, number = inner[1], left
        if isinstance(number, Literal) and isinstance(number.value, int) and not isinstance(number.value, bool):
            shift = number.value if operator is Operator.ADD else -number.value
            row = self.sums.setdefault(base, {0: base})
            if shift in row:
                self._equal(row[shift], term)
            else:
                row[shift] = term

    def _difference(self, operator: Operator, side: Guard, limit: Guard) -> None:
        """From `a - b > c` with c >= 0, and its like, the order of a and b."""
        if not (isinstance(side, Operation) and side.operator is Operator.SUB):
            return
        if not (isinstance(limit, Literal) and is_number(limit.value)):
            return
        a, b = (self._term(operand) for operand in side.operands)
        c = limit.value
        assert isinstance(c, (int, float))
        positive = (operator is Operator.GT and c >= 0) or (operator in (Operator.GE, Operator.EQ) and c > 0)
        negative = (operator is Operator.LT and c <= 0) or (operator in (Operator.LE, Operator.EQ) and c < 0)
        if positive:
            self._at_most(b, a, strict=True)
        elif negative:
            self._at_most(a, b, strict=True)

    def contradictory(self) -> bool:
        for row in self.sums.values():
            for less, more in pairwise(sorted(row)):
                self._at_most(row[less], row[more])
        for sort in (_NUMBER, _STRING):
            mine = [term for term, constant in self.constants.items() if _sort(constant) == sort]
            mine.sort(key=self.constants.__getitem__)
            for low, high in pairwise(mine):
                if self.constants[low] == self.constants[high]:
                    self._equal(low, high)
                else:
                    self._at_most(low, high, strict=True)
        group: dict[Hashable, int] = {}
        for number, members in enumerate(nx.strongly_connected_components(self.order)):
            group.update(dict.fromkeys(members, number))
        if any(strict and group[low] == group[high] for low, high, strict in self.order.edges(data="strict")):
            return True
        if any(group[left] == group[right] for left, right in self.unequal):
            return True
        others = [group[term] for term, constant in self.constants.items() if _sort(constant) not in (_NUMBER, _STRING)]
        return len(set(others)) < len(others) or self._mixed()

    def _mixed(self) -> bool:
        """Whether one term would have to be of two sorts, or of a sort that has no order."""
        same = nx.Graph(self.order)
        for members in nx.connected_components(same):
            sorts = set[str]().union(*(self.sorts.get(term, set()) for term in members))
            if len(sorts) > 1:
                return True
            compared = any(left in members for left, _ in self.alike)
            if compared and sorts and not sorts <= {_NUMBER, _STRING}:
                return True
        return False


_ORDERED = frozenset([Operator.LT, Operator.LE, Operator.GT, Operator.GE])
_TURNED = {
    Operator.LT: Operator.GT,
    Operator.LE: Operator.GE,
    Operator.GT: Operator.LT,
    Operator.GE: Operator.LE,
}


def _sort(constant: object) -> str:
    if is_number(constant):
        return _NUMBER
    if isinstance(constant, str):
        return _STRING
    return "null" if constant is None else "boolean"
