"""Guards: their values are the reference's own, and what is made of a guard keeps its value."""

import re
from itertools import product
from random import Random
from typing import Any

import pytest

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
    conjuncts,
    folded,
    holds,
    predicate,
    renamed,
    value,
    variables,
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
    return Operation(operator, tuple(random_guard(random, depth - random.choice((1, depth))) for _ in range(count)))


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
