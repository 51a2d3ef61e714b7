"""The conditions under which a guard is true, and those under which it is false.

A condition combines tests by conjunction and disjunction; it is never undefined. A guard may be: `X
< Y` and `not (X < Y)` are each true only for two numbers or two texts. So the conditions for true
and for false are derived separately. A backend only spells the tests.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Self, TypeAlias, TypeVar, assert_never

from rvaft.model.assumptions import Declared, Path
from rvaft.model.guards import (
    ARITHMETIC,
    COMPARISONS,
    FUNCTIONS,
    OPERATORS,
    ORDERINGS,
    Duration,
    Guard,
    Operation,
    Operator,
    TermSort,
    definition,
    folded,
    is_total,
    value,
    variables,
)
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import equal, is_finite, is_number

T = TypeVar("T")


class Unsayable(Exception):
    """The reason why a guard has no conditions."""


@dataclass(frozen=True, slots=True)
class TruthTest:
    """A test that a Boolean term is true (or false); terms of another type satisfy neither."""

    term: Guard
    wanted: bool


@dataclass(frozen=True, slots=True)
class EqualityTest:
    """A test that two variables or constants of any sort are equal (or unequal)."""

    left: Guard
    right: Guard
    wanted: bool


@dataclass(frozen=True, slots=True)
class ComparisonTest:
    """A test that two terms are both numbers (times, texts) and compare by `sign`, such as `<>`."""

    sort: TermSort
    left: Guard
    sign: str
    right: Guard


@dataclass(frozen=True, slots=True)
class SortTest:
    """A test that a term has this sort (or has a value of another sort)."""

    term: Guard
    sort: TermSort
    wanted: bool


@dataclass(frozen=True, slots=True, eq=False)
class ConditionJunction:
    """A conjunction (`every`) or a disjunction of conditions."""

    every: bool
    parts: tuple["TruthCondition", ...] = ()


ConditionTest: TypeAlias = TruthTest | EqualityTest | ComparisonTest | SortTest
TruthCondition: TypeAlias = ConditionTest | ConditionJunction

ALWAYS: Final = ConditionJunction(every=True)
NEVER: Final = ConditionJunction(every=False)
_EQUAL: Final = {True: "=", False: "<>"}


class TruthConditions:
    """Derives the conditions of guards.

    `times` are the variables that hold event times. Mixing them with other numbers raises
    `Unsayable`; a null time is undefined. `is_whole` selects terms to treat as variables. `sorts`
    are the sorts of variables that a log is assumed to keep, and `present` the variables that it
    assumes not to be null.

    >>> from rvaft.language.parser import parse_guard
    >>> guard = parse_guard("not (X < 2 or Y)")
    >>> def spell(test):
    ...     match test:
    ...         case ComparisonTest(sort, _, sign, _):
    ...             return f"{sort}s {sign}"
    ...         case TruthTest(term, wanted):
    ...             return f"{term.name} is {wanted}"
    >>> spelled(TruthConditions().of(guard), spell, lambda every, parts: f" {'and' if every else 'or'} ".join(parts))
    'numbers >= and Y is False'
    """

    def __init__(
        self,
        times: Collection[str] = (),
        is_whole: Callable[[Guard], bool] = lambda _: False,
        sorts: Mapping[str, TermSort] | None = None,
        present: Collection[str] = (),
    ) -> None:
        self._times, self._is_whole, self._sorts = frozenset(times), is_whole, sorts or {}
        self._present = present
        self._known: dict[tuple[Guard, bool], TruthCondition] = {}
        self._sorts_of: dict[ConditionJunction, dict[Guard, TermSort]] = {}

    @classmethod
    def declared(cls, known: Declared, ways: Mapping[str, Path]) -> Self:
        """Return the conditions of guards over variables at these paths of an event, of which something is declared."""
        present = [name for name, way in ways.items() if way in known.present]
        return cls(sorts={name: known.sort_of(way) for name, way in ways.items()}, present=present)

    def of(self, guard: Guard, *, wanted: bool = True) -> TruthCondition:
        """Return a condition that holds exactly where the guard has the truth value `wanted`."""
        return self._when(folded(guard), wanted)

    def _when(self, guard: Guard, wanted: bool) -> TruthCondition:
        known = guard, wanted
        if known not in self._known:
            self._known[known] = self._conditions(guard, wanted)
        return self._known[known]

    def _conditions(self, guard: Guard, wanted: bool) -> TruthCondition:
        if not variables(guard):
            return ALWAYS if value(guard, {}) is wanted else NEVER
        if isinstance(guard, Variable) or self._is_whole(guard):
            return TruthTest(guard, wanted) if self.sort(guard) in (TermSort.TRUTH, TermSort.UNKNOWN) else NEVER
        if (meaning := definition(guard)) is not None:
            return self._when(meaning, wanted)
        assert isinstance(guard, Operation), "a constant has no variables"
        left, *others = guard.operands
        match guard.operator:
            case Operator.NOT:
                return self._when(left, not wanted)
            case Operator.AND | Operator.OR if wanted is (guard.operator is Operator.AND):
                return _all(self._when(operand, wanted) for operand in guard.operands)
            case Operator.AND | Operator.OR:
                return self._decided(guard.operands, wanted)
            case Operator.EQ | Operator.NE:
                return self._equality(left, others[0], wanted is (guard.operator is Operator.EQ))
            case operator if operator in ORDERINGS:
                sign = operator if wanted else OPERATORS[operator].negated
                return _any(
                    self._compared(sort, left, str(sign), others[0]) for sort in (TermSort.NUMBER, TermSort.TEXT)
                )
            case operator:
                assert operator in ARITHMETIC | FUNCTIONS, f"no conditions for {operator}"
                return TruthTest(guard, wanted) if self.sort(guard) is TermSort.TRUTH else NEVER

    def _decided(self, operands: Sequence[Guard], wanted: bool) -> TruthCondition:
        """Return the condition that an operand has the truth value `wanted`, and all before it the opposite one.

        An operand before it need not be tested if it is defined wherever a later one decides.
        """
        ways: list[TruthCondition] = []  # the last one first
        given: Mapping[Guard, TermSort] = {}
        for operand in reversed(operands):
            if ways and not self._is_total(operand, given):
                opposite = self._when(operand, not wanted)
                ways, given = [_all([opposite, _any(reversed(ways))])], {**given, **self._sorts_in(opposite)}
            if (way := self._when(operand, wanted)) is not NEVER:
                sorts = self._sorts_in(way)
                given = {term: sort for term, sort in given.items() if sorts.get(term) is sort} if ways else sorts
                ways.append(way)
        return _any(reversed(ways))

    def _is_total(self, guard: Guard, given: Mapping[Guard, TermSort]) -> bool:
        """Whether a guard is surely true or false where terms have given sorts."""
        match guard:
            case Operation(operator, operands) if operator in COMPARISONS | FUNCTIONS:
                sorts, facts = {self._sure_sort(operand, given) for operand in operands}, OPERATORS[operator]
                known = len(sorts) == 1 and None not in sorts and facts.gives is TermSort.TRUTH
                known &= facts.takes is None or sorts <= facts.takes
            case Operation(Operator.NOT | Operator.AND | Operator.OR, operands):
                known = all(self._is_total(operand, given) for operand in operands)
            case Operation() if (meaning := definition(guard)) is not None:
                known = self._is_total(meaning, given)
            case _:
                known = self._sure_sort(guard, given) is TermSort.TRUTH
        return known or (is_total(guard) and self._times.isdisjoint(variables(guard)))

    def _sure_sort(self, term: Guard, given: Mapping[Guard, TermSort]) -> TermSort | None:
        """Return the sort of a variable that is not null, of a constant, or of a term with a given one; else None."""
        match term:
            case _ if term in given:
                return given[term]
            case Variable(name) if name in self._present and name not in self._times:
                sort = self._sorts.get(name)
                return sort if sort in (TermSort.NUMBER, TermSort.TEXT, TermSort.TRUTH) else None
            case Literal(constant) if is_finite(constant) and not isinstance(term, Duration):
                return self.sort(term) if constant is not None else None
            case _:
                return None

    def _equality(self, left: Guard, right: Guard, wanted: bool) -> TruthCondition:
        for one, other in ((left, right), (right, left)):
            if self.sort(one) is TermSort.TRUTH and not self._is_plain(one):  # a test, compared with a Boolean value
                ways = ([self._when(one, it), self._equality(other, Literal(it), wanted)] for it in (True, False))
                return _any(map(_all, ways))
        sorts = self.sort(left), self.sort(right)
        if TermSort.VOID in sorts:
            return NEVER
        if isinstance(left, Literal) and isinstance(right, Literal):
            return ALWAYS if equal(left.value, right.value) is wanted else NEVER
        if self._is_plain(left) and self._is_plain(right):
            return EqualityTest(left, right, wanted)
        same = [self._compared(sort, left, _EQUAL[wanted], right) for sort in (TermSort.NUMBER, TermSort.TEXT)]
        if wanted:
            return _any(same)
        return _any([*same, *(self._apart(one, other) for one, other in ((left, right), (right, left)))])

    def _apart(self, term: Guard, other: Guard) -> TruthCondition:
        """Return the condition that `term`, a number or a text, and `other` differ in sort."""
        sort, others = self.sort(term), self.sort(other)
        if sort not in (TermSort.NUMBER, TermSort.TEXT, TermSort.TIME) or self._is_plain(term):
            return NEVER
        plain = TermSort.NUMBER if sort is TermSort.TIME else sort
        if others is TermSort.UNKNOWN:
            return _all([self._valued(term), SortTest(other, plain, wanted=False)])
        if (TermSort.NUMBER if others is TermSort.TIME else others) is plain:
            return NEVER
        return _all([self._valued(term), self._valued(other)])

    def _valued(self, term: Guard) -> TruthCondition:
        return ALWAYS if isinstance(term, Literal) else SortTest(term, self.sort(term), wanted=True)

    def _compared(self, sort: TermSort, left: Guard, sign: str, right: Guard) -> TruthCondition:
        sorts = {self.sort(term) for term in (left, right)}
        if TermSort.TIME in sorts and sort is TermSort.NUMBER:
            if {TermSort.UNKNOWN, TermSort.NUMBER} & {self.sort(term) for term in (left, right) if variables(term)}:
                raise Unsayable("it compares a time with a value that is not a time")
            sorts, sort = {TermSort.NUMBER if one is TermSort.TIME else one for one in sorts}, TermSort.TIME
        plain = TermSort.NUMBER if sort is TermSort.TIME else sort
        return ComparisonTest(sort, left, sign, right) if sorts <= {plain, TermSort.UNKNOWN} else NEVER

    def _is_plain(self, term: Guard) -> bool:
        whole = isinstance(term, Literal | Variable) or self._is_whole(term)
        return whole and (isinstance(term, Operation) or self.sort(term) is not TermSort.TIME)

    def _sorts_in(self, condition: TruthCondition) -> dict[Guard, TermSort]:
        """As `_sorts_tested`, of a condition; parts that several conditions share are looked at once."""
        if not isinstance(condition, ConditionJunction):
            return _sorts_tested(condition)
        if condition not in self._sorts_of:
            found: dict[Guard, TermSort] = {}
            of_parts = [self._sorts_in(part) for part in condition.parts]
            if condition.every:
                for one in of_parts:
                    found |= one
            elif of_parts:
                first, *others = of_parts
                found = {term: sort for term, sort in first.items() if all(one.get(term) is sort for one in others)}
            self._sorts_of[condition] = found
        return self._sorts_of[condition]

    def sort(self, term: Guard) -> TermSort:
        """Return the sort of a term's values.

        Raises `Unsayable` for a calculation with a time and another number.
        """
        match term:
            case Literal(constant):
                if isinstance(constant, bool):
                    return TermSort.TRUTH
                return (
                    TermSort.NUMBER
                    if is_number(constant)
                    else TermSort.TEXT
                    if isinstance(constant, str)
                    else TermSort.NULL
                )
            case Variable(name):
                return TermSort.TIME if name in self._times else self._sorts.get(name, TermSort.UNKNOWN)
            case Operation(operator, operands):
                facts = OPERATORS[operator]
                if not variables(term):  # a constant term that has a value is folded
                    return TermSort.VOID
                if operator in ARITHMETIC | FUNCTIONS and facts.takes is not None and facts.means is None:
                    sorts = {self.sort(operand) for operand in operands}
                    taken = {
                        *facts.takes,
                        TermSort.UNKNOWN,
                        *((TermSort.TIME,) if TermSort.NUMBER in facts.takes else ()),
                    }
                    if not sorts <= taken:
                        return TermSort.VOID
                    if facts.gives is TermSort.NUMBER and TermSort.TIME in sorts:
                        if {TermSort.UNKNOWN, TermSort.NUMBER} & {
                            self.sort(operand) for operand in operands if variables(operand)
                        }:
                            raise Unsayable("it calculates with a time and a value that is not a time")
                        return TermSort.TIME
                return facts.gives


def _sorts_tested(test: ConditionTest) -> dict[Guard, TermSort]:
    """Return the terms that are a number, a text or a Boolean wherever a test holds; times count as numbers."""
    found: dict[Guard, TermSort] = {}
    match test:
        case ComparisonTest(sort, left, _, right):
            found = dict.fromkeys((left, right), TermSort.NUMBER if sort is TermSort.TIME else sort)
        case EqualityTest(term, Literal(constant), True) | EqualityTest(Literal(constant), term, True):
            found = {term: TruthConditions().sort(Literal(constant))}
        case TruthTest(Operation(operator, operands)) if (takes := OPERATORS[operator].takes) and len(takes) == 1:
            found = dict.fromkeys(operands, *takes)
        case TruthTest(term):
            found = {term: TermSort.TRUTH}
        case SortTest(term, sort, True):
            found = {term: sort}
        case EqualityTest() | SortTest():
            pass
        case _:
            assert_never(test)
    return {term: sort for term, sort in found.items() if sort in (TermSort.NUMBER, TermSort.TEXT, TermSort.TRUTH)}


def _all(parts: Iterable[TruthCondition]) -> TruthCondition:
    return _joined(True, parts)


def _any(parts: Iterable[TruthCondition]) -> TruthCondition:
    return _joined(False, parts)


def _joined(every: bool, parts: Iterable[TruthCondition]) -> TruthCondition:
    found: dict[TruthCondition, None] = {}
    for part in parts:
        if part is (NEVER if every else ALWAYS):
            return part
        inner = part.parts if isinstance(part, ConditionJunction) and part.every is every else (part,)
        found |= dict.fromkeys(inner)
    return (
        next(iter(found))
        if len(found) == 1
        else ConditionJunction(every, tuple(found))
        if found
        else (ALWAYS if every else NEVER)
    )


def spelled(condition: TruthCondition, test: Callable[[ConditionTest], T], join: Callable[[bool, list[T]], T]) -> T:
    """Return the condition in a language; a shared condition is spelled once.

    `test` spells a test; `join` spells a conjunction (True) or a disjunction (False).
    """
    known: dict[int, T] = {}

    def of(part: TruthCondition) -> T:
        if id(part) not in known:
            if isinstance(part, ConditionJunction):
                known[id(part)] = join(part.every, [of(inner) for inner in part.parts])
            else:
                known[id(part)] = test(part)
        return known[id(part)]

    return of(condition)
