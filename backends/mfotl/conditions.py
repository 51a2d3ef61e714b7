"""Guards over several events as disjunctions of conjunctions of MonPoly comparisons.

Expressions over one event that MonPoly evaluates differently become arguments.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain, product
from typing import Final, TypeAlias

from backends.event_columns import constant, require_exact_sums
from backends.mfotl.predicates import Column, argument
from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    SortTest,
    TruthConditions,
    TruthTest,
    Unsayable,
    spelled,
)
from rvaft.errors import TooLarge
from rvaft.model.guards import FUNCTIONS, Guard, Operation, Operator, TermSort, variables
from rvaft.model.patterns import Literal, Variable

Ways: TypeAlias = tuple[tuple[str, ...], ...]
"""A disjunction of conjunctions."""

MOST: Final = 500
"""Maximum number of conjunctions per guard."""
_LEFT_TO_COLUMNS: Final = FUNCTIONS - {Operator.MIN, Operator.MAX} | {Operator.MUL, Operator.DIV}
_ASPECTS: Final = {TermSort.NUMBER: "number", TermSort.TIME: "time", TermSort.TEXT: "string"}
_KINDS: Final = {TermSort.NUMBER: "n", TermSort.TIME: "n", TermSort.TEXT: "s", TermSort.TRUTH: "o"}


def both(*several: Ways) -> Ways:
    """Return the conjunction; raises `TooLarge`."""
    found: Ways = (tuple(dict.fromkeys(chain.from_iterable(ways[0] for ways in several if len(ways) == 1))),)
    for ways in (ways for ways in several if len(ways) != 1):
        if len(found) * len(ways) > MOST:
            raise TooLarge("ways in which a guard can hold", limit=MOST)
        found = tuple(dict.fromkeys(tuple(dict.fromkeys(a + b)) for a, b in product(found, ways)))
    return found


def either(*several: Ways) -> Ways:
    """Return the disjunction."""
    return tuple(dict.fromkeys(way for ways in several for way in ways))


class Conditions:
    """The guards of a scenario.

    `times` are the variables of times, `bound` the variables of each event, and `earlier` for each
    variable of a time those that are never later. `column` returns the argument of a column, and
    `columns` collects the columns used.
    """

    def __init__(
        self,
        times: frozenset[str],
        bound: Collection[frozenset[str]],
        column: Callable[[Column], str],
        earlier: Mapping[str, Collection[str]],
    ) -> None:
        self.columns: set[Column] = set()
        self._bound, self._column, self._earlier = bound, column, earlier
        self._conditions = TruthConditions(times, self._is_argument)

    def _is_argument(self, term: Guard) -> bool:
        left = isinstance(term, Operation) and term.operator in _LEFT_TO_COLUMNS
        return left and any(one.issuperset(variables(term)) for one in self._bound)

    def ways(self, guard: Guard) -> Ways:
        """Return when a guard is true; raises `Unsayable` and `TooLarge`."""
        return spelled(self._conditions.of(guard), self._spelled, lambda every, parts: (either, both)[every](*parts))

    def known(self, name: str) -> Ways:
        """Return that a time is defined."""
        return ((self._is(Variable(name), TermSort.TIME),),)

    def _spelled(self, test: ConditionTest) -> Ways:
        match test:
            case TruthTest(term, wanted) if isinstance(term, Variable) or self._is_argument(term):
                return self._spelled(EqualityTest(term, Literal(wanted), wanted=True))
            case TruthTest(Operation(operator)):
                raise Unsayable(f"it applies {operator.name.lower()} to values of several events")
            case EqualityTest(left, right, wanted):
                same = " = ".join(self._written(one, "text") for one in (left, right))
                sides = () if wanted and isinstance(right, Literal) else (left, right)
                return ((*self._defined(*sides), same if wanted else f"NOT ({same})"),)
            case SortTest(term, sort, wanted=True) if isinstance(term, Variable) or self._is_argument(term):
                return ((self._is(term, sort),),)
            case SortTest(term, sort, wanted=True):
                return tuple(conditions for conditions, _ in self._terms(term, sort))
            case SortTest(term, sort):
                return ((*self._defined(term), f"NOT ({self._is(term, sort)})"),)
            case ComparisonTest(sort, left, sign, right):
                require_exact_sums(left, right, time=sort is TermSort.TIME)
                return self._compared(sort, left, sign, right)
            case _:
                raise AssertionError("a constant has a truth value")

    def _compared(self, sort: TermSort, left: Guard, sign: str, right: Guard) -> Ways:
        if sign in ("<", "<=") and isinstance(left, Operation) and left.operator is Operator.SUB:
            greatest, least = (
                _operands(one, op) for one, op in zip(left.operands, (Operator.MAX, Operator.MIN), strict=True)
            )
            if len(greatest) + len(least) > 2:  # a window: a bound on the extremes is a bound on all pairs
                single = (term for term in (*greatest, *least) if isinstance(term, Variable))
                defined = (((self._is(term, sort),),) for term in single)
                pairs = self._deciding(greatest, least, right)
                return both(
                    *defined, *(self._compared(sort, Operation(Operator.SUB, pair), sign, right) for pair in pairs)
                )
        found = []
        for (some, one), (more, other) in product(self._terms(left, sort), self._terms(right, sort)):
            written = f"NOT ({one} = {other})" if sign == "<>" else f"{one} {sign} {other}"
            found.append((*some, *more, written))
        return both(tuple(found))

    def _deciding(
        self, greatest: Sequence[Guard], least: Sequence[Guard], most: Guard
    ) -> Iterator[tuple[Guard, Guard]]:
        """Yield the pairs whose differences decide the bound of all, if all terms are defined."""

        def earlier(one: Guard, other: Guard) -> bool:
            """Whether the first of two times is never later than the second."""
            match one, other:
                case Variable(name), Variable(later):
                    return name == later or name in self._earlier.get(later, ())
                case _:
                    return False

        ends = [one for one in greatest if not any(earlier(one, other) for other in greatest if other != one)]
        starts = [one for one in least if not any(earlier(other, one) for other in least if other != one)]
        match most:
            case Literal(int() | float() as bound):
                positive = bound > 0
            case _:
                positive = False
        yield from (pair for pair in product(ends, starts) if not (positive and earlier(*pair)))

    def _terms(self, term: Guard, sort: TermSort) -> list[tuple[tuple[str, ...], str]]:
        """Return alternative conditions under which a term has a value, each with the text of the
        term.
        """
        match term:
            case Literal():
                return [((), self._written(term, _ASPECTS[sort]))]
            case _ if isinstance(term, Variable) or self._is_argument(term):
                return [((self._is(term, sort),), self._written(term, _ASPECTS[sort]))]
            case Operation(operator, operands):
                ways = [self._terms(one, sort) for one in operands]
                combined = [
                    (tuple(c for some, _ in way for c in some), [text for _, text in way]) for way in product(*ways)
                ]
                match operator:
                    case Operator.ADD | Operator.SUB:
                        return [(conditions, f"({f' {operator} '.join(texts)})") for conditions, texts in combined]
                    case Operator.NUMBER:
                        return ways[0]
                    case Operator.NEGATE:
                        zero = "0" if sort is TermSort.TIME else "0.0"
                        return [(conditions, f"({zero} - {texts[0]})") for conditions, texts in combined]
                    case Operator.MIN | Operator.MAX:
                        before, after = ("<", "<=") if operator is Operator.MIN else (">", ">=")
                        return [
                            ((*conditions, *_first(texts, number, before, after)), text)
                            for conditions, texts in combined
                            for number, text in enumerate(texts)
                        ]
                    case _:
                        raise Unsayable(f"{operator.name.lower()} of MonPoly's doubles is not exact")
            case _:
                raise AssertionError("a variable is an argument")

    def _written(self, term: Guard, aspect: str) -> str:
        if isinstance(term, Literal):
            return argument(aspect, constant(term, aspect))
        self.columns.add((term, aspect))
        return self._column((term, aspect))

    def _defined(self, *terms: Guard) -> tuple[str, ...]:
        return tuple(f'NOT ({self._written(one, "kind")} = "")' for one in terms if isinstance(one, Operation))

    def _is(self, term: Guard, sort: TermSort) -> str:
        return f'{self._written(term, "kind")} = "{_KINDS[sort]}"'


def _operands(guard: Guard, operator: Operator) -> tuple[Guard, ...]:
    return guard.operands if isinstance(guard, Operation) and guard.operator is operator else (guard,)


def _first(texts: Sequence[str], number: int, before: str, after: str) -> list[str]:
    pairs = ((before if other < number else after, text) for other, text in enumerate(texts) if other != number)
    return [f"{texts[number]} {sign} {text}" for sign, text in pairs]
