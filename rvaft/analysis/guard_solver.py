"""A proof, without any library for algebra, that guards cannot hold together.

It reasons with the sorts of values (a number is no string) and with their order, both of which are exact whatever the values are: comparing
an integer with a double rounds nothing. Of arithmetic, which rounds, it uses only what rounding keeps: adding a
larger whole number gives no smaller result, and a difference has the sign of the comparison or is zero.
"""

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any, Final

import networkx as nx

from rvaft.model.guards import UNDEFINED, Guard, Operation, Operator, holds, value, variables
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import Json, is_number, key

# What must be true for guards to hold, as alternatives of comparisons (a disjunctive normal form).
#
# A guard holds when its value is `true`, and then every comparison that decided so was defined. Its negation `not (a < b)` is true
# exactly when `a >= b` is: both are defined. So each alternative is a list of comparisons that are all *true*, and no
# negation is left. What an alternative cannot say (a comparison of truth values, say) is left out: alternatives are implied by the
# guards, not equivalent to them, which is what a proof of contradiction needs.

MAX_ALTERNATIVES: Final = 256

COMPARISONS: Final = frozenset([Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE])
ARITHMETIC: Final = frozenset([Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV, Operator.NEGATE])
_OPPOSITE: Final = {
    Operator.EQ: Operator.NE,
    Operator.NE: Operator.EQ,
    Operator.LT: Operator.GE,
    Operator.GE: Operator.LT,
    Operator.GT: Operator.LE,
    Operator.LE: Operator.GT,
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison that is true; its operands are literals, variables or arithmetic."""

    operator: Operator
    left: Guard
    right: Guard


class TooManyAlternatives(Exception):
    """The guards have more than `MAX_ALTERNATIVES` alternatives."""


Alternatives = list[tuple[Comparison, ...]]


def alternatives(guards: Iterable[Guard]) -> Alternatives:
    """The ways in which all guards can hold; none where they surely cannot.

    Raises `TooManyAlternatives`.
    """
    return _both([_when(guard, truth=True) for guard in guards])


def _when(guard: Guard, *, truth: bool) -> Alternatives:
    """The ways in which a guard has this truth value. The depth of a guard is bounded by the parser."""
    match guard:
        case Operation(Operator.NOT, (operand,)):
            return _when(operand, truth=not truth)
        case Operation(Operator.AND | Operator.OR as junction, operands):
            decides = junction is Operator.OR
            if truth is not decides:
                return _both([_when(operand, truth=truth) for operand in operands])
            # Read from the left, one operand decides, and those before it have the other truth value: they are defined too.
            return _bounded(
                way
                for index, operand in enumerate(operands)
                for way in _both(
                    [*(_when(before, truth=not decides) for before in operands[:index]), _when(operand, truth=decides)]
                )
            )
        case Operation(operator, (left, right)) if operator in COMPARISONS:
            return _compared(operator if truth else _OPPOSITE[operator], folded(left), folded(right))
        case Variable():
            return [(Comparison(Operator.EQ, guard, Literal(truth)),)]
        case Literal(constant):
            return [()] if constant is truth else []
        case _:
            return []  # arithmetic has no truth value


def _compared(operator: Operator, left: Guard, right: Guard) -> Alternatives:
    if not variables(left) and not variables(right):
        return [()] if value(Operation(operator, (left, right)), {}) is True else []
    if _speakable(left) and _speakable(right):
        return [(Comparison(operator, left, right),)]
    return [()]


def _speakable(operand: Guard) -> bool:
    return not isinstance(operand, Operation) or operand.operator in ARITHMETIC


def folded(guard: Guard) -> Guard:
    """A guard whose parts without variables are replaced by their values, where these are defined."""
    match guard:
        case Operation(operator, operands):
            if not variables(guard):
                constant = value(guard, {})
                return guard if constant is UNDEFINED else Literal(constant)
            return Operation(operator, tuple(folded(operand) for operand in operands))
        case _:
            return guard


def _both(parts: list[Alternatives]) -> Alternatives:
    return _bounded(tuple(dict.fromkeys(c for way in ways for c in way)) for ways in product(*parts))


def _bounded(ways: Iterator[tuple[Comparison, ...]]) -> Alternatives:
    found: dict[tuple[Comparison, ...], None] = {}
    for count, way in enumerate(ways):
        if count >= MAX_ALTERNATIVES:
            raise TooManyAlternatives
        found[way] = None
    return list(found)


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


# A search for values under which guards hold: around their constants, and around the values already chosen.
#
# What is found is a witness, checked with the guards' own evaluation. Finding none proves nothing.

DEFAULT_TRIES: Final = 4_000


def witness(guards: Iterable[Guard], tries: int = DEFAULT_TRIES) -> dict[str, Json] | None:
    """Values under which all guards hold, or None where none were found in so many evaluations (and 20 more for each guard)."""
    todo = list(dict.fromkeys(guards))
    tries += 20 * len(todo)
    names = _order(todo)
    # Each guard is looked at as soon as the last of its variables has a value.
    rank = {name: index for index, name in enumerate(names)}
    due: list[list[Guard]] = [[] for _ in names]
    touching: list[list[Guard]] = [[] for _ in names]
    for guard in todo:
        own = variables(guard)
        if not own:
            if not holds(guard, {}):
                return None
            continue
        due[max(rank[name] for name in own)].append(guard)
        for name in own:
            touching[rank[name]].append(guard)
    constants = _constants(todo)
    binding: dict[str, Json] = {}
    levels: list[Iterator[Json]] = []
    while len(binding) < len(names) or len(levels) < len(names):
        if len(levels) == len(binding):
            levels.append(_candidates(constants, touching[len(levels)], binding))
        name = names[len(levels) - 1]
        for candidate in levels[-1]:
            binding[name] = candidate
            failing = _failing(due[len(levels) - 1], binding)
            if failing is None:
                break
            # What refuses one value most likely refuses the next one too: ask it first.
            due[len(levels) - 1].insert(0, due[len(levels) - 1].pop(failing))
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


def _failing(guards: list[Guard], binding: dict[str, Json]) -> int | None:
    return next((index for index, guard in enumerate(guards) if not holds(guard, binding)), None)


def _order(guards: Sequence[Guard]) -> list[str]:
    return list(dict.fromkeys(name for guard in guards for name in variables(guard)))


def _constants(guards: Iterable[Guard]) -> list[Json]:
    found: dict[object, Json] = {}
    for guard in guards:
        for part in _parts(guard):
            if isinstance(part, Literal):
                found.setdefault(key(part.value), part.value)
    return list(found.values())


def _parts(guard: Guard) -> Iterator[Guard]:
    todo = [guard]
    while todo:
        part = todo.pop()
        yield part
        if isinstance(part, Operation):
            todo.extend(part.operands)


def _candidates(constants: list[Json], guards: list[Guard], binding: dict[str, Json]) -> Iterator[Json]:
    """Values for one variable, those most likely to do first."""
    seen: set[object] = set()
    for candidate in _in_turn([*_sides(guards, binding), *constants]):
        known = key(candidate)
        if known not in seen:
            seen.add(known)
            yield candidate


def _in_turn(near: list[Json]) -> Iterator[Json]:
    for value_ in near[:4]:
        yield value_
        if is_number(value_):
            yield value_ + 1
            yield value_ - 1
    numbers = sorted({v for v in near if is_number(v) and abs(v) < 1e15} | {0})
    strings = sorted({v for v in near if isinstance(v, str)} | {""})
    yield from (numbers[-1] + 1, numbers[0] - 1)
    yield from near
    yield from _around(numbers)
    yield from _between(strings)
    yield from (True, False, None, [])


def _sides(guards: list[Guard], binding: dict[str, Json]) -> list[Json]:
    """What the variable is compared with, and what solves a sum or difference for it, as far as that has a value now."""
    found: list[Json] = []
    for guard in guards:
        for part in _parts(guard):
            if isinstance(part, Operation) and part.operator in COMPARISONS:
                left, right = (_known(side, binding) for side in part.operands)
                found += [v for v in (left, right) if v is not UNDEFINED]
                for side, goal in ((part.operands[0], right), (part.operands[1], left)):
                    if goal is not UNDEFINED and is_number(goal):
                        found += _solved(side, goal, binding)
    return found


def _solved(side: Guard, goal: Json, binding: dict[str, Json]) -> list[Json]:
    """Values for the unknown operand of an arithmetic operation so that it equals the goal."""
    if not (isinstance(side, Operation) and len(side.operands) == 2):
        return []
    left, right = (_known(operand, binding) for operand in side.operands)
    goal_, left_, right_ = Literal(goal), Literal(left), Literal(right)
    ways: dict[Operator, list[tuple[Operator, Guard, Guard]]] = {}
    if right is not UNDEFINED:
        ways = {
            Operator.ADD: [(Operator.SUB, goal_, right_)],
            Operator.SUB: [(Operator.ADD, goal_, right_)],
            Operator.MUL: [(Operator.DIV, goal_, right_)],
            Operator.DIV: [(Operator.MUL, goal_, right_)],
        }
    elif left is not UNDEFINED:
        ways = {
            Operator.ADD: [(Operator.SUB, goal_, left_)],
            Operator.SUB: [(Operator.SUB, left_, goal_)],
            Operator.MUL: [(Operator.DIV, goal_, left_)],
            Operator.DIV: [(Operator.DIV, left_, goal_)],
        }
    answers = (value(Operation(operator, (a, b)), {}) for operator, a, b in ways.get(side.operator, []))
    return [answer for answer in answers if answer is not UNDEFINED]


def _known(guard: Guard, binding: dict[str, Json]) -> Json:
    if isinstance(guard, Variable):
        return binding.get(guard.name, UNDEFINED)
    return value(guard, binding) if all(name in binding for name in variables(guard)) else UNDEFINED


def _around(numbers: list[Json]) -> Iterator[Json]:
    for number in numbers:
        yield number + 1
        yield number - 1
    for low, high in pairwise(numbers):
        yield (low + high) / 2
    yield 10 * numbers[-1] + 10
    yield 10 * numbers[0] - 10


def _between(strings: list[str]) -> Iterator[Json]:
    yield from strings
    for string in strings:
        yield string + "\0"
        yield string + "~"
    yield strings[-1] + "\U0010ffff"
