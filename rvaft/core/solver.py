"""Joint satisfiability of guards: a search for a witness, and proofs of contradiction.

A *witness* is verified by evaluation; a failed search proves nothing. *Refutation* uses the sorts
of values and their order, which is exact between integers and doubles. Of arithmetic it uses only
facts that rounding keeps: adding a larger integer gives no smaller result, and a difference has the
sign of the comparison or is zero. Otherwise sympy decides inequalities weakened by possible
rounding.
"""

import operator as python
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator
from fractions import Fraction
from itertools import chain, combinations, pairwise, product
from typing import Any, Final, NamedTuple, TypeAlias

from rvaft.model.guards import (
    COMPARISONS,
    OPERATORS,
    ORDERINGS,
    UNDEFINED,
    Guard,
    Operation,
    Operator,
    Predicate,
    TermSort,
    definition,
    expanded,
    folded,
    holds,
    predicate,
    value,
    variables,
    walk,
)
from rvaft.model.patterns import Binding, Literal, Variable
from rvaft.model.values import EXACT_INTEGERS, Json, Scalar, is_number, key
from rvaft.support.bits import bits


def contradictory(guards: Iterable[Guard]) -> bool | None:
    """Whether no values satisfy all guards; None if undecided.

    Undefined values, mixed types and rounding are considered.

    >>> X = Variable("X")
    >>> contradictory([Operation(Operator.GT, (X, Literal(5))), Operation(Operator.LT, (X, Literal(3)))])
    True
    """
    given = list(guards)
    if witness(given) is not None:
        return False
    return refuted(given) or contradictory_over_reals(given, weaken=True)


# Necessary conditions of guards as alternatives of comparisons (a disjunctive normal form).
#
# If a guard is true, its deciding comparisons are defined, so `not (a < b)` is `a >= b`. An
# alternative is a list of true comparisons. Other conditions are omitted, which suffices for a
# proof of contradiction.

MAX_ALTERNATIVES: Final = 256


class GuardComparison(NamedTuple):
    """A comparison that is true; its operands are literals, variables or arithmetic."""

    operator: Operator
    left: Guard
    right: Guard


Way: TypeAlias = tuple[GuardComparison, ...]


class TooManyAlternatives(Exception):
    """The guards have more than `MAX_ALTERNATIVES` alternatives."""


def _alternatives(guards: Iterable[Guard]) -> list[Way]:
    """Return the alternatives for all guards: none if unsatisfiable, one empty one if too many."""
    try:
        return _all_of([_when(guard, truth=True) for guard in guards])
    except TooManyAlternatives:
        return [()]


def _when(guard: Guard, *, truth: bool) -> list[Way]:
    """Return the alternatives for a truth value; the parser bounds the depth."""
    if (meaning := definition(guard)) is not None:
        return _when(meaning, truth=truth)
    match guard:
        case Operation(Operator.NOT, (operand,)):
            return _when(operand, truth=not truth)
        case Operation(Operator.AND | Operator.OR as junction, operands):
            decides = junction is Operator.OR
            if truth is not decides:
                return _all_of([_when(operand, truth=truth) for operand in operands])
            # One operand decides; the operands before it have the other truth value.
            ways: list[Way] = []
            for index, operand in enumerate(operands):
                before = [_when(earlier, truth=not decides) for earlier in operands[:index]]
                ways += _all_of([*before, _when(operand, truth=decides)])
            return _bounded(ways)
        case Operation(operator, (left, right)) if operator in COMPARISONS:
            negated = OPERATORS[operator].negated
            compared = GuardComparison(operator if truth or negated is None else negated, folded(left), folded(right))
            if not variables(left) and not variables(right):
                return [()] if holds(Operation(compared.operator, compared[1:]), {}) else []
            truths = any(isinstance(side, Operation) and side.operator not in _VALUES for side in compared[1:])
            return [()] if truths else [(compared,)]
        case Variable():
            return [(GuardComparison(Operator.EQ, guard, Literal(truth)),)]
        case Literal(constant):
            return [()] if constant is truth else []
        case Operation(operator) if operator not in _VALUES:
            if not variables(guard):
                return [()] if value(guard, {}) is truth else []
            if OPERATORS[operator].takes != _TEXTS:
                return [()]
            lowered = [Operation(Operator.LOWER, (operand,)) for operand in guard.operands]  # defined for texts only
            return [tuple(GuardComparison(Operator.EQ, term, term) for term in lowered)]
        case Operation():
            return []  # numbers and texts have no truth value


_UNDEFINED: Final = frozenset(operator for operator, facts in OPERATORS.items() if facts.means is None)
"""Operators without a definition by others."""
_VALUES: Final = frozenset(operator for operator, facts in OPERATORS.items() if facts.gives is not TermSort.TRUTH)
"""Operators that give a number or a text."""
_TEXTS: Final = frozenset({TermSort.TEXT})
_TEXT_TESTS: Final = frozenset(
    operator
    for operator, facts in OPERATORS.items()
    if facts.takes == _TEXTS and facts.gives is TermSort.TRUTH and facts.arity == 2
)


def _all_of(parts: list[list[Way]]) -> list[Way]:
    return _bounded(tuple(dict.fromkeys(chain(*ways))) for ways in product(*parts))


def _bounded(ways: Iterable[Way]) -> list[Way]:
    found: dict[Way, None] = {}
    for count, way in enumerate(ways):
        if count >= MAX_ALTERNATIVES:
            raise TooManyAlternatives
        found[way] = None
    return list(found)


def refuted(guards: Iterable[Guard]) -> bool:
    """Whether it is proved that no values satisfy all guards."""
    return all(_GuardFacts(way).contradict() for way in _alternatives(guards))


class _GuardFacts:
    """Terms with their known sorts and order: pairs of terms with `<=`, `<` and `!=`.

    The operands of a true comparison are defined, so their sorts are known.
    """

    def __init__(self, way: Way) -> None:
        self.at_most: list[tuple[Hashable, Hashable]] = []
        self.less: list[tuple[Hashable, Hashable]] = []
        self.unequal: list[tuple[Hashable, Hashable]] = []
        self.sorts: defaultdict[Hashable, set[TermSort]] = defaultdict(set)  # the sorts of each term
        self.constants: dict[Hashable, Any] = {}
        self.sums: dict[Hashable, dict[int, Hashable]] = {}  # per term, the terms that equal it plus an integer
        self.compared: set[Hashable] = set()
        for operator, left, right in way:
            for part in chain(walk(left), walk(right)):
                self._note(part)
            self._compare(operator, left, right)
            self._difference(operator, left, right)
            self._difference(OPERATORS[operator].mirrored or operator, right, left)

    def _compare(self, operator: Operator, left: Hashable, right: Hashable) -> None:
        if operator in ORDERINGS:
            self.compared.add(left)
        if operator in (Operator.GT, Operator.GE):
            left, right = right, left
        match operator:
            case Operator.EQ:
                self.at_most += [(left, right), (right, left)]
            case Operator.NE:
                self.unequal.append((left, right))
            case Operator.LT | Operator.GT:
                self.less.append((left, right))
            case _:
                self.at_most.append((left, right))

    def _note(self, part: Guard) -> None:
        term = part
        own = self.sorts[term]
        match part:
            case Literal(constant):
                self.constants[term] = constant
                own.add(_sort(constant))
            case Operation(operator, operands) if operator in _VALUES:
                facts = OPERATORS[operator]
                own.add(facts.gives)
                if facts.takes is not None and len(facts.takes) == 1:
                    (taken,) = facts.takes
                    for operand in operands:
                        self.sorts[operand].add(taken)
                if operator is Operator.ADD and isinstance(operands[0], Literal):
                    operands = operands[::-1]
                match operands:
                    case (base, Literal(int() as whole)) if type(whole) is int and operator in _SHIFTS:
                        shift = whole if operator is Operator.ADD else -whole
                        row = self.sums.setdefault(base, {0: base})
                        self._compare(Operator.EQ, row.setdefault(shift, term), term)
            case _:
                pass

    def _difference(self, operator: Operator, side: Guard, limit: Guard) -> None:
        match side, limit:
            case Operation(Operator.SUB, (a, b)), Literal(int() | float() as c) if is_number(c):
                at_least = operator in (Operator.GE, Operator.EQ)
                at_most = operator in (Operator.LE, Operator.EQ)
                if (operator is Operator.GT and c >= 0) or (at_least and c > 0):
                    self.less.append((b, a))
                elif (operator is Operator.LT and c <= 0) or (at_most and c < 0):
                    self.less.append((a, b))

    def contradict(self) -> bool:
        for row in self.sums.values():
            self.at_most += [(row[less], row[more]) for less, more in pairwise(sorted(row))]
        for sort in (TermSort.NUMBER, TermSort.TEXT):
            mine = [term for term, constant in self.constants.items() if _sort(constant) == sort]
            for low, high in pairwise(sorted(mine, key=self.constants.__getitem__)):
                self._compare(Operator.EQ if self.constants[low] == self.constants[high] else Operator.LT, low, high)
        number = {term: index for index, term in enumerate(self.sorts)}
        above, beside = ([1 << index for index in range(len(number))] for _ in range(2))
        for low, high in (*self.at_most, *self.less):
            above[number[low]] |= 1 << number[high]
            beside[number[low]] |= 1 << number[high]
            beside[number[high]] |= 1 << number[low]
        for through in range(len(number)):  # Warshall's closures: reachability, and equality of sort
            for reach in (above, beside):
                for index, reached in enumerate(reach):
                    if reached >> through & 1:
                        reach[index] |= reach[through]

        def same(left: Hashable, right: Hashable) -> bool:
            return bool(above[number[left]] >> number[right] & above[number[right]] >> number[left] & 1)

        if any(same(low, high) for low, high in (*self.less, *self.unequal)):
            return True
        others = [
            term for term, constant in self.constants.items() if _sort(constant) not in (TermSort.NUMBER, TermSort.TEXT)
        ]
        terms = list(number)
        return any(same(*pair) for pair in combinations(others, 2)) or any(
            self._mixed({terms[index] for index in bits(component)}) for component in set(beside)
        )

    def _mixed(self, terms: set[Hashable]) -> bool:
        sorts = set[TermSort]().union(*(self.sorts[term] for term in terms))
        return len(sorts) > 1 or (not sorts <= {TermSort.NUMBER, TermSort.TEXT} and not self.compared.isdisjoint(terms))


_SHIFTS: Final = (Operator.ADD, Operator.SUB)


def _sort(constant: Scalar) -> TermSort:
    if is_number(constant):
        return TermSort.NUMBER
    if isinstance(constant, str):
        return TermSort.TEXT
    return TermSort.NULL if constant is None else TermSort.TRUTH


_DEGREE: Final = 4
_CALCULATED: Final[dict[Operator, Callable[..., Any]]] = {
    Operator.ADD: python.add,
    Operator.SUB: python.sub,
    Operator.MUL: python.mul,
    Operator.NEGATE: python.neg,
}


def contradictory_over_reals(guards: Iterable[Guard], *, weaken: bool = False) -> bool | None:
    """Whether no real numbers satisfy the guards, so that only rounding could; None if undecided.

    `weaken` omits comparisons that rounding could make true.
    """
    kept = (
        [comparison for comparison in way if not weaken or _survives_rounding(comparison)]
        for way in _alternatives(guards)
    )
    return None if any(map(_real_solutions, kept)) else True


def _survives_rounding(comparison: GuardComparison) -> bool:
    """Whether nothing is rounded, or only one side of `<` or `>` against a representable number.

    Rounding is monotone, so `round(x) < c` implies `x < c` for a representable c.
    """

    def representable(number: object) -> bool:
        return isinstance(number, float) or (type(number) is int and abs(number) <= EXACT_INTEGERS)

    operator, left, right = comparison
    if not isinstance(left, Operation) and not isinstance(right, Operation):
        return True
    if isinstance(left, Literal):
        left, right = right, left
    if operator not in (Operator.LT, Operator.GT) or not isinstance(right, Literal) or not representable(right.value):
        return False
    match left:
        case Operation(Operator.NEGATE, (Variable(),)):
            return True
        case Operation(_, (Variable(one), Variable(other))):
            return one == other
        case Operation(_, (Variable(), Literal(number)) | (Literal(number), Variable())):
            return isinstance(number, int) and representable(number)
        case _:
            return False


def _real_solutions(way: list[GuardComparison]) -> bool:
    """Whether real numbers may satisfy the comparisons; True if sympy cannot decide."""
    import sympy  # noqa: PLC0415 -- slow to import
    from sympy.logic.inference import satisfiable  # noqa: PLC0415

    symbols: dict[str, Any] = {}  # no name of a tree has a meaning in sympy

    def number(guard: Guard) -> Any:
        """Return an operand's value; raises `TypeError` for non-numbers."""
        match guard:
            case Literal(int() | float() as constant) if is_number(constant):
                fraction = Fraction(constant)
                return sympy.Rational(fraction.numerator, fraction.denominator)
            case Variable(name):
                return symbols.setdefault(name, sympy.Symbol(f"v{len(symbols)}", real=True))
            case Operation(Operator.DIV, (left, right)) if (divisor := number(right)).is_number and divisor != 0:
                return number(left) / divisor
            case Operation(operator, operands) if operator in _CALCULATED:
                return _CALCULATED[operator](*map(number, operands))
            case _:
                raise TypeError

    relations = []
    for operator, left, right in way:
        numeric = any(
            isinstance(s, Operation) or (isinstance(s, Literal) and is_number(s.value)) for s in (left, right)
        )
        if operator is Operator.NE and not numeric:
            continue
        try:
            relations.append(sympy.Rel(number(left), number(right), operator.value))
        except TypeError:
            continue  # the operand may be no number
    if sympy.false in relations:
        return False
    relations = [relation for relation in relations if relation is not sympy.true]
    unknowns = set[Any]().union(*(relation.free_symbols for relation in relations))
    try:
        polynomials = [sympy.Poly(relation.lhs - relation.rhs, *unknowns) for relation in relations]
        degree = max((polynomial.total_degree() for polynomial in polynomials), default=_DEGREE + 1)
        if len(unknowns) == 1 and degree <= _DEGREE:
            solutions = sympy.And(*relations).as_set()
            return solutions is not sympy.S.EmptySet and solutions.is_empty is not True
        if degree <= 1:  # the theory of linear reals has no `!=`
            split = [sympy.Or(r.lhs < r.rhs, r.lhs > r.rhs) if isinstance(r, sympy.Ne) else r for r in relations]
            return satisfiable(sympy.And(*split), use_lra_theory=True) is not False
    except (NotImplementedError, TypeError, ValueError, AttributeError, sympy.PolynomialError):
        pass
    return True


DEFAULT_TRIES: Final = 4_000


def witness(guards: Iterable[Guard], tries: int = DEFAULT_TRIES) -> dict[str, Json] | None:
    """Return values that satisfy all guards; None if the search fails.

    It makes at most `tries` evaluations, plus 20 per guard.

    >>> greater = Operation(Operator.GT, (Variable("X"), Literal(5)))
    >>> witness([greater, Operation(Operator.LT, (Variable("Y"), Variable("X")))])
    {'X': 6, 'Y': 5}
    """
    todo = list(dict.fromkeys(guards))
    tries += 20 * len(todo)
    if not all(holds(guard, {}) for guard in todo if not variables(guard)):
        return None
    names = list(dict.fromkeys(name for guard in todo for name in variables(guard)))
    rank = {name: index for index, name in enumerate(names)}
    touching: list[list[Guard]] = [[] for _ in names]
    due: list[list[Predicate]] = [[] for _ in names]  # evaluated once the last of their variables has a value
    for guard in todo:
        ranks = [rank[name] for name in variables(guard)]
        for index in ranks:
            touching[index].append(guard)
        if ranks:
            due[max(ranks)].append(predicate(guard))
    literals = [part for guard in todo for part in walk(guard) if isinstance(part, Literal)]
    constants = [literal.value for literal in dict.fromkeys(literals)]
    binding: dict[str, Json] = {}
    levels: list[Iterator[Json]] = []
    while len(binding) < len(names):
        if len(levels) == len(binding):
            index = len(levels)
            levels.append(_candidates([*_near(touching[index], names[index], binding), *constants]))
        here, name = due[len(levels) - 1], names[len(levels) - 1]
        for candidate in levels[-1]:
            binding[name] = candidate
            failing = next((index for index, test in enumerate(here) if not test(binding)), None)
            if failing is None:
                break
            here.insert(0, here.pop(failing))  # a guard that rejects one value probably rejects the next
            tries -= failing + 1
            del binding[name]
            if tries < 0:
                return None
        else:
            levels.pop()
            if not levels:
                return None
            del binding[names[len(levels) - 1]]
    return binding


def _candidates(near: list[Json]) -> Iterator[Json]:
    """Return candidate values, the most promising first, each once."""
    seen: set[Hashable] = set()
    for candidate in _in_turn(near):
        if (known := key(candidate)) not in seen:
            seen.add(known)
            yield candidate


def _in_turn(near: list[Json]) -> Iterator[Json]:
    for value_ in near[:4]:
        yield from (value_, value_ + 1, value_ - 1) if is_number(value_) else (value_,)
    numbers = sorted({v for v in near if is_number(v) and abs(v) < 1e15} | {0})
    strings = sorted({v for v in near if isinstance(v, str)} | {""})
    yield from (numbers[-1] + 1, numbers[0] - 1)
    yield from near
    for number in numbers:
        yield from (number + 1, number - 1)
    yield from ((low + high) / 2 for low, high in pairwise(numbers))
    yield from (10 * numbers[-1] + 10, 10 * numbers[0] - 10)
    yield from strings
    for string in strings:
        yield from (string + "\0", string + "~")
    yield strings[-1] + "\U0010ffff"
    yield from (True, False, None, [])


_INVERSE: Final = {
    Operator.ADD: Operator.SUB,
    Operator.SUB: Operator.ADD,
    Operator.MUL: Operator.DIV,
    Operator.DIV: Operator.MUL,
}


def _near(guards: list[Guard], name: str, binding: Binding) -> Iterator[Json]:
    for guard in guards:
        sides = (side for part in _comparisons(guard) for side in part.operands)
        yield from (known for side in sides if (known := _known(side, binding)) is not UNDEFINED)
        yield from bounds(guard, name, binding)
    yield from _texts(guards, binding)


def _texts(guards: list[Guard], binding: Binding) -> Iterator[str]:
    found: dict[Operator, list[str]] = {}
    for part in chain(*map(walk, guards)):
        if isinstance(part, Operation) and part.operator in _TEXT_TESTS:
            text = _known(part.operands[1], binding)
            if isinstance(text, str):
                found.setdefault(part.operator, []).append(text)
    first, inner, last = (found.get(o, []) for o in (Operator.STARTSWITH, Operator.CONTAINS, Operator.ENDSWITH))
    for glob in found.get(Operator.LIKE, ()):
        for filling in ("", *inner, *first):
            yield glob.replace("*", filling, 1).replace("*", "").replace("?", "a")
    for filling in ("", *inner, "".join(inner)) if found else ():
        for before in ("-", *first):
            yield f"{before}{filling}{max(last, key=len, default='')}"


def bounds(guard: Guard, name: str, binding: Binding) -> Iterator[Json]:
    """Return the values of a variable at which a comparison in the guard changes.

    >>> X, Y = Variable("X"), Variable("Y")
    >>> later = Operation(Operator.GE, (Y, Operation(Operator.ADD, (X, Literal(10)))))
    >>> [*bounds(later, "Y", {"X": 3}), *bounds(later, "X", {"Y": 3})]
    [13, -7]
    """
    for part in _comparisons(guard):
        for side, other in (part.operands, part.operands[::-1]):
            yield from _solved(side, name, _known(other, binding), binding)


def _comparisons(guard: Guard) -> Iterator[Operation]:
    parts = walk(expanded(guard, _UNDEFINED))
    return (part for part in parts if isinstance(part, Operation) and part.operator in COMPARISONS)


def _solved(side: Guard, name: str, goal: Json, binding: Binding) -> Iterator[Json]:
    """Solve a term for a variable that occurs in it once."""
    while isinstance(side, Operation) and goal is not UNDEFINED:
        operator, operands = side.operator, side.operands
        if operator is Operator.NEGATE:
            side, goal = operands[0], value(Operation(operator, (Literal(goal),)), {})
        elif operator is Operator.LOWER and isinstance(goal, str):
            side, goal = operands[0], goal.upper()
        elif operator is Operator.NUMBER and is_number(goal):
            side, goal = operands[0], str(goal)
        elif operator not in _INVERSE:
            return
        elif (other := _known(operands[1], binding)) is not UNDEFINED:
            side, goal = operands[0], _calculated(_INVERSE[operator], goal, other)
        elif (other := _known(operands[0], binding)) is not UNDEFINED:
            turned = operator in (Operator.SUB, Operator.DIV)  # a - x = g if and only if a - g = x
            goal = _calculated(operator, other, goal) if turned else _calculated(_INVERSE[operator], goal, other)
            side = operands[1]
        else:
            return
    if side == Variable(name) and goal is not UNDEFINED:
        yield goal


def _calculated(operator: Operator, *operands: Json) -> Json:
    found = value(Operation(operator, tuple(map(Literal, operands))), {})
    return int(found) if isinstance(found, float) and found.is_integer() and abs(found) < EXACT_INTEGERS else found


def _known(guard: Guard, binding: Binding) -> Json:
    return value(guard, binding) if all(name in binding for name in variables(guard)) else UNDEFINED
