"""Guards: their values are the reference's own, and what is made of a guard keeps its value."""

import math
import re
from collections import Counter
from itertools import product
from random import Random
from typing import Any

import pytest

from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    SortTest,
    TruthCondition,
    TruthConditions,
    TruthTest,
    spelled,
)
from rvaft.core.solver import contradictory, contradictory_over_reals, refuted, witness
from rvaft.language.parser import parse_guard
from rvaft.model.expressions import guard_text
from rvaft.model.guards import (
    COMPARISONS,
    FUNCTIONS,
    OPERATORS,
    UNDEFINED,
    Guard,
    Operation,
    Operator,
    TermSort,
    conjuncts,
    expanded,
    folded,
    holds,
    predicate,
    renamed,
    value,
    variables,
    walk,
)
from rvaft.model.patterns import Literal, Variable
from rvaft.semantics.events import Undefined, evaluate, same
from tests.tables import rows

VALUES: tuple[Any, ...] = (
    *(0, 1, 2, 0.5, -1, -0.0, 1e17, 1e308, 2**53 + 1, 10**400, "", "a", "b", True, False, None, [], [1], {}, {"a": 1}),
)


def random_guard(random: Random, depth: int) -> Guard:
    leaf: list[Guard] = [
        *(Variable("X"), Variable("Y")),
        Literal(random.choice((0, 1, 2, 0.5, "a", "b", True, False, None, 1e17, 10**400))),
    ]
    if depth == 0:
        return random.choice(leaf)
    operator = random.choice(list(Operator))
    count = OPERATORS[operator].arity if OPERATORS[operator].function else None
    count = random.choice((2, 3)) if count is None else count
    operands = [random_guard(random, depth - random.choice((1, depth))) for _ in range(count)]
    if operator is Operator.IN:
        operands[1:] = [one if isinstance(one, Literal) else Literal(1) for one in operands[1:]]
    return Operation(operator, tuple(operands))


def of_reference(guard: Guard, binding: dict[str, Any]) -> Any:
    try:
        return evaluate(guard, binding)
    except (Undefined, ZeroDivisionError, OverflowError):
        return UNDEFINED


@pytest.mark.parametrize("seed", range(2))
def test_values_are_those_of_the_reference(seed: int) -> None:
    random = Random(seed)
    for _ in range(400):
        guard = random_guard(random, random.choice((1, 2, 3)))
        ready, names = predicate(guard), variables(guard)
        swapped = renamed(guard, {"X": "Y", "Y": "X"})
        for _ in range(5):
            x, y = random.choice(VALUES), random.choice(VALUES)
            binding, found = {"X": x, "Y": y}, value(guard, {"X": x, "Y": y})
            expected = of_reference(guard, binding)
            assert found is expected or same(found, expected), (guard, binding)
            assert type(found) is type(expected)
            assert ready(binding) == holds(guard, binding) == (expected is True)
            assert holds(swapped, {"X": y, "Y": x}) == holds(guard, binding)
            assert holds(folded(guard), binding) == holds(guard, binding)
            assert all(holds(part, binding) for part in conjuncts(guard)) == holds(guard, binding)
        assert set(names) == set(re.findall("[XY]", guard_text(guard)))


@pytest.mark.parametrize("operator", [one for one in Operator if OPERATORS[one].means])
def test_an_operator_has_the_value_of_its_definition(operator: Operator) -> None:
    assert OPERATORS[operator].function is None or operator is Operator.IN
    listed = tuple(map(Literal, (1, "a", None, False)))
    for guard in (Operation(operator, (Variable("X"), *listed[:count])) for count in (1, 2, 4)):
        meaning = expanded(guard, set(Operator) - {operator})
        assert operator not in {part.operator for part in walk(meaning) if isinstance(part, Operation)}
        for given in (*VALUES, math.nan, [math.inf]):
            assert value(guard, {"X": given}) is value(meaning, {"X": given}), (guard, given)
            assert of_reference(guard, {"X": given}) is of_reference(meaning, {"X": given})


def test_a_definition_is_used_where_all_of_its_operators_are_known() -> None:
    guard = parse_guard("not (X in (1, 2))")
    assert expanded(guard, {Operator.IN}) is guard
    assert expanded(guard, {Operator.NOT, Operator.EQ}) is guard
    assert guard_text(expanded(guard, {Operator.OR, Operator.EQ})) == "not (X == 1 or X == 2)"
    deep = parse_guard("(" * 40 + "X == true" + ") in (true, false)" * 40)
    assert expanded(deep, {Operator.OR, Operator.EQ}) is deep


SORTED: dict[TermSort, tuple[Any, ...]] = {
    TermSort.NUMBER: (0, 1, 2, 0.5, -1),
    TermSort.TEXT: ("", "a", "b"),
    TermSort.TRUTH: (True, False),
    TermSort.UNKNOWN: (0, 1, "a", "b", True, False, [], [1]),
}


def is_met(condition: TruthCondition, binding: dict[str, Any]) -> bool:
    """Whether a condition is met, by the meaning of each test."""

    def sort_of(term: Guard) -> TermSort | None:
        found = value(term, binding)
        kinds = {bool: TermSort.TRUTH, int: TermSort.NUMBER, float: TermSort.NUMBER, str: TermSort.TEXT}
        return kinds.get(type(found))

    def met(test: ConditionTest) -> bool:
        match test:
            case TruthTest(term, wanted):
                return value(term, binding) is wanted
            case EqualityTest(left, right, wanted):
                return value(Operation(Operator.EQ, (left, right)), binding) is wanted
            case ComparisonTest(sort, left, sign, right):
                operator = Operator({"=": "==", "<>": "!="}.get(sign, sign))
                return sort_of(left) is sort_of(right) is sort and holds(Operation(operator, (left, right)), binding)
            case SortTest(term, sort, wanted):
                return value(term, binding) is not UNDEFINED and (sort_of(term) is sort) is wanted

    return spelled(condition, met, lambda every, parts: all(parts) if every else any(parts))


@pytest.mark.parametrize("seed", range(4))
def test_the_conditions_of_a_guard(seed: int) -> None:
    random, told = Random(seed), Counter[bool]()
    for _ in range(250):
        guard = random_guard(random, random.choice((1, 2, 3)))
        sorts = {name: random.choice(list(SORTED)) for name in "XY"}
        present = [name for name in "XY" if random.random() < 0.7]
        conditions = TruthConditions(sorts=sorts, present=present)
        for wanted, _ in product((True, False), range(4)):
            values = {name: (*SORTED[sort], *([] if name in present else [None])) for name, sort in sorts.items()}
            binding = {name: random.choice(some) for name, some in values.items()}
            met = is_met(conditions.of(guard, wanted=wanted), binding)
            assert met is (of_reference(guard, binding) is wanted), (guard_text(guard), sorts, present, binding)
            told[met] += 1
    assert min(told.values()) > 100


@pytest.mark.parametrize(
    ("guard", "sorts", "text"),
    [
        ("X < 1 or X > 2", {}, "X < 1 | X > 2"),
        ("not (X < 1 and X > 2)", {}, "X >= 1 | X <= 2"),
        ("X + 1 == 1 or X + 1 == 2", {}, "X + 1 = 1 | X + 1 = 2"),
        ('contains(X, "a") or X < "b" or X == "c"', {}, 'contains(X, "a") | X < "b" | X = "c"'),
        ('contains(X, "a") or X == 1', {}, 'contains(X, "a") | (contains(X, "a") & X = 1)'),
        ("X < 1 or Y > 2", {}, "X < 1 | (X >= 1 & Y > 2)"),
        ("X < 1 or Y > 2", {"X": TermSort.NUMBER}, "X < 1 | Y > 2"),
        ("X < true or Y", {"X": TermSort.TRUTH}, ""),
    ],
)
def test_an_earlier_operand_is_not_tested_where_a_later_one_implies_that_it_is_defined(
    guard: str, sorts: dict[str, TermSort], text: str
) -> None:
    def spell(test: ConditionTest) -> str:
        match test:
            case ComparisonTest(_, left, sign, right):
                return f"{guard_text(left)} {sign} {guard_text(right)}"
            case TruthTest(term, _):
                return guard_text(term)
            case EqualityTest(left, right):
                return f"{guard_text(left)} = {guard_text(right)}"
            case SortTest():
                raise AssertionError(test)

    condition = TruthConditions(sorts=sorts, present=[*sorts]).of(parse_guard(guard))
    joined = spelled(condition, spell, lambda every, parts: f"({(' & ' if every else ' | ').join(parts)})")
    assert joined.removeprefix("(").removesuffix(")") == text


def test_negated_and_mirrored_comparisons() -> None:
    for operator in COMPARISONS:
        facts = OPERATORS[operator]
        assert facts.negated is not None
        assert facts.mirrored is not None
        for left, right in product(map(Literal, VALUES[:16]), repeat=2):
            found, negation = (value(Operation(sign, (left, right)), {}) for sign in (operator, facts.negated))
            assert negation is UNDEFINED if found is UNDEFINED else negation is not found
            assert value(Operation(facts.mirrored, (right, left)), {}) is found


def test_signs_are_those_of_the_language() -> None:
    for operator, facts in OPERATORS.items():
        text = f"{facts.sign}X" if facts.arity == 1 else f"X {facts.sign} Y"
        if operator in FUNCTIONS:
            text = f"{facts.sign}(X)" if facts.arity == 1 else f'{facts.sign}(X, "Y")'
        elif operator is Operator.IN:
            text = 'X in (1, "a", null)'
        guard = parse_guard(text)
        assert isinstance(guard, Operation)
        assert guard.operator is operator
        assert guard_text(guard) == text


@pytest.mark.parametrize("seed", range(2))
def test_witnesses_hold_and_what_is_refuted_has_none(seed: int) -> None:
    """Strings, truth values, huge integers and doubles that round included."""
    random, proofs, found = Random(seed), 0, 0
    for _ in range(200):
        guards = [random_guard(random, random.choice((2, 3))) for _ in range(random.choice((1, 2)))]
        binding = witness(guards)
        if binding is not None:
            found += 1
            assert all(holds(guard, binding) for guard in guards)
            assert not refuted(guards)
        elif refuted(guards):
            proofs += 1
            for x, y in product(VALUES, repeat=2):
                assert not all(holds(guard, {"X": x, "Y": y}) for guard in guards), guards
    assert proofs > 10
    assert found > 10


def _guards(*texts: str) -> list[Guard]:
    return [parse_guard(text) for text in texts]


@pytest.mark.parametrize(("texts", "expected"), rows(__file__, "contradictions.txt"))
def test_decided(texts: list[str], expected: bool | None) -> None:
    assert contradictory(_guards(*texts)) is expected
    assert expected or not refuted(_guards(*texts))
    assert expected is not None or contradictory_over_reals(_guards(*texts)) is None


@pytest.mark.parametrize(
    ("text", "value"),
    [("X + 0.5 == X", 1e17), ("X + 0.5 < X", 2**53 + 1), ("X + 1 >= 5 and X < 4", 3.9999999999999996)],
)
def test_what_holds_through_rounding_is_not_called_contradictory(text: str, value: float) -> None:
    guard = parse_guard(text)
    assert holds(guard, {"X": value})
    assert contradictory([guard]) is not True
    assert contradictory_over_reals([guard]) is True


def test_no_values_satisfy_what_sympy_refutes() -> None:
    random, asked = Random(100), 0
    numbers = [float(n) / 4 for n in range(-12, 13)] + [2**53 + 1, 1e17, 1, 2, 3]
    while asked < 20:
        sides = (random.choice(("2 * X", "X + 1", "X - 3", "X * X", "X / 3", "-X")) for _ in range(2))
        guards = _guards(
            *(f"{side} {random.choice(('<', '>', '>='))} {random.choice((-2, 0, 1, 5))}" for side in sides)
        )
        if witness(guards) is None:
            asked += 1
            if contradictory(guards):
                assert not any(all(holds(guard, {"X": x}) for guard in guards) for x in numbers), guards


def test_names_of_a_tree_are_never_evaluated() -> None:
    guard = Operation(Operator.EQ, (Variable("Symbol"), Literal("__import__('os').abort()")))
    assert contradictory([guard]) is False
    assert contradictory_over_reals([guard]) is None
