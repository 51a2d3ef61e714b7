"""What makes a guard true, and what makes it false, are what the reference says of it."""

import operator
from typing import Any

from hypothesis import assume, given
from hypothesis import strategies as st

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
from rvaft.language.parser import parse_guard
from rvaft.model.guards import OPERATORS, UNDEFINED, Guard, Operation, Operator, Sort, TimePoint, variables
from rvaft.model.patterns import Literal, Variable
from rvaft.semantics.events import same
from tests.core.test_guards import VALUES, of_reference

AT = TimePoint.of("at", "a")
LITERALS = st.sampled_from([Literal(one) for one in (0, 1, 2, 0.5, "a", "b", "1", True, False, None, 1e17, 10**400)])


def operations(parts: st.SearchStrategy[Guard]) -> st.SearchStrategy[Guard]:
    """What is calculated of parts, by each operator."""

    def applied(sign: Operator) -> st.SearchStrategy[Guard]:
        if sign is Operator.IN:
            operands: Any = st.tuples(parts, LITERALS, LITERALS)
        else:
            arity = OPERATORS[sign].arity if OPERATORS[sign].function else None
            operands = st.lists(parts, min_size=arity or 2, max_size=arity or 3).map(tuple)
        return st.builds(Operation, st.just(sign), operands)

    return st.sampled_from(list(Operator)).flatmap(applied)


def guards(*names: Variable) -> st.SearchStrategy[Guard]:
    return st.recursive(LITERALS | st.sampled_from(names) | st.sampled_from(names), operations, max_leaves=8)


def is_of(value: Any, sort: Sort) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return {"text": isinstance(value, str), "truth": isinstance(value, bool), "null": value is None}.get(sort, number)


def is_so(test: ConditionTest, binding: dict[str, Any]) -> bool:
    """Whether a test holds, by the reference's values of its terms."""
    match test:
        case TruthTest(term, wanted):
            return of_reference(term, binding) is wanted
        case SortTest(term, sort, wanted):
            found = of_reference(term, binding)
            return found is not UNDEFINED and is_of(found, sort) is wanted
        case EqualityTest(left, right, wanted):
            sides = of_reference(left, binding), of_reference(right, binding)
            return UNDEFINED not in sides and same(*sides) is wanted
        case ComparisonTest(sort, left, sign, right):
            compare = {"=": operator.eq, "<>": operator.ne, "<": operator.lt, "<=": operator.le}
            compare |= {">": operator.gt, ">=": operator.ge}
            sides = of_reference(left, binding), of_reference(right, binding)
            return all(one is not UNDEFINED and is_of(one, sort) for one in sides) and compare[sign](*sides)


def agree(guard: Guard, conditions: TruthConditions, binding: dict[str, Any]) -> None:
    found = of_reference(guard, binding)
    for wanted in (True, False):
        condition = conditions.of(guard, wanted=wanted)
        told = spelled(condition, lambda test: is_so(test, binding), lambda every, parts: (any, all)[every](parts))
        assert told is (found is wanted), (guard, binding, condition)


@given(guard=guards(Variable("X"), Variable("Y")), x=st.sampled_from(VALUES), y=st.sampled_from(VALUES))
def test_they_are_those_of_the_reference(guard: Guard, x: Any, y: Any) -> None:
    agree(guard, TruthConditions(), {"X": x, "Y": y})
    agree(guard, TruthConditions(is_whole=lambda part: variables(part) == ("X",)), {"X": x, "Y": y})


@given(guard=guards(AT, Variable("X")), at=st.sampled_from([None, 0, 1, 2, 10**18]), x=st.sampled_from(VALUES))
def test_times_are_numbers_or_nothing_and_do_not_mix(guard: Guard, at: Any, x: Any) -> None:
    try:
        agree(guard, TruthConditions([AT.name]), {AT.name: at, "X": x})
    except Unsayable:
        assume(False)


def text(guard: str, *times: str) -> str:
    """The condition as a test of this file sees it: a term is its variables."""

    def test(one: ConditionTest) -> str:
        match one:
            case TruthTest(term, wanted):
                return f"{'' if wanted else 'not '}{'+'.join(variables(term))}"
            case EqualityTest(left, right, wanted):
                return f"{side(left)} {'is' if wanted else 'is not'} {side(right)}"
            case ComparisonTest(sort, left, sign, right):
                return f"{sort} {side(left)} {sign} {side(right)}"
            case SortTest(term, sort, wanted):
                return f"{side(term)} {'is' if wanted else 'is no'} {sort}"

    def side(term: Guard) -> str:
        return repr(term.value) if isinstance(term, Literal) else "+".join(variables(term))

    return spelled(
        TruthConditions(times).of(parse_guard(guard)),
        test,
        lambda every, parts: f"({(' and ' if every else ' or ').join(parts)})",
    )


def test_what_is_no_number_is_not_equal_to_one() -> None:
    assert text("X != Y + 1") == "(number X <> Y or (Y is number and X is no number))"
    assert text("X == 1 or Y < X") == "(X is 1 or number Y < X or text Y < X)"
    assert text("X < 1 or Y") == "(number X < 1 or (number X >= 1 and Y))"
    assert text("(X < 1) == Y") == "((number X < 1 and Y is True) or (number X >= 1 and Y is False))"
    assert text("X in (1, 2) and not (2 > 1 and Y)") == "((X is 1 or X is 2) and not Y)"
    assert text("T - S <= 4", "S", "T") == "time T+S <= 4"
    assert text("T + 1 == S", "S", "T") == "time T = S"
    assert text('lower(X) > 3 or X + "a" == X') == "()"


def test_a_deep_guard_stays_small() -> None:
    """Each part is looked at twice at the most, as true and as false."""
    guard: Guard = Operation(Operator.LT, (Variable("X"), Variable("Y")))
    for number in range(90):
        sign = Operator.OR if number % 2 else Operator.AND
        guard = Operation(sign, (guard, Operation(Operator.LT, (Variable("X"), Literal(number)))))
    tests: list[ConditionTest] = []
    spelled(TruthConditions().of(guard), tests.append, lambda *_: None)
    assert len(tests) < 1_000
