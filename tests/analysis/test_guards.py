"""Guards: their values are the reference's own, and what is made of a guard keeps its value."""

from random import Random
from typing import Any

import pytest

from rvaft.analysis.guard_solver import refuted, witness
from rvaft.language.parser import parse_guard
from rvaft.model.expressions import guard_text
from rvaft.model.guards import (
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
    count = OPERATORS[operator].arity if OPERATORS[operator].function else random.choice((2, 3))
    return Operation(operator, tuple(random_guard(random, depth - random.choice((1, depth))) for _ in range(count)))


def of_reference(guard: Guard, binding: dict[str, Any]) -> Any:
    try:
        return evaluate(guard, binding)
    except (Undefined, ZeroDivisionError, OverflowError):
        return UNDEFINED


@pytest.mark.parametrize("seed", range(10))
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
        assert set(names) == {name for name in "XY" if name in guard_words(guard)}


def guard_words(guard: Guard) -> set[str]:
    match guard:
        case Variable(name):
            return {name}
        case Operation(_, operands):
            return set().union(*map(guard_words, operands))
        case Literal():
            return set()


@pytest.mark.parametrize("seed", range(5))
def test_negated_and_mirrored_comparisons(seed: int) -> None:
    random = Random(seed)
    for operator, facts in OPERATORS.items():
        for _ in range(50):
            left, right = Literal(random.choice(VALUES[:16])), Literal(random.choice(VALUES[:16]))
            if facts.negated and facts.mirrored:
                found = value(Operation(operator, (left, right)), {})
                negation = value(Operation(facts.negated, (left, right)), {})
                assert negation is UNDEFINED if found is UNDEFINED else negation is not found
                assert value(Operation(facts.mirrored, (right, left)), {}) is found


def test_signs_are_those_of_the_language() -> None:
    for operator, facts in OPERATORS.items():
        text = f"{facts.sign}X" if facts.arity == 1 else f"X {facts.sign} Y"
        guard = parse_guard(text)
        assert isinstance(guard, Operation)
        assert guard.operator is operator
        assert guard_text(guard) == text


@pytest.mark.parametrize("seed", range(10))
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
            for x in VALUES:
                for y in VALUES:
                    assert not all(holds(guard, {"X": x, "Y": y}) for guard in guards), guards
    assert proofs > 10
    assert found > 10
