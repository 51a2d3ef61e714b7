"""Contradictions are certain: what is called contradictory no values satisfy."""

from random import Random

import pytest

from rvaft.analysis.guard_solver import contradictory, contradictory_over_reals, witness
from rvaft.language.parser import parse_guard
from rvaft.model.guards import Guard, Operation, Operator, holds
from rvaft.model.patterns import Literal, Variable
from tests.tables import rows


def _guards(*texts: str) -> list[Guard]:
    return [parse_guard(text) for text in texts]


@pytest.mark.parametrize(("texts", "expected"), rows(__file__, "contradictions.txt"))
def test_decided(texts: list[str], expected: bool) -> None:
    assert contradictory(_guards(*texts)) is expected


@pytest.mark.parametrize(
    ("text", "value"), [("X + 1 == X", 1e17), ("X + 0.5 < X", 2**53 + 1), ("X + 1 >= 5 and X < 4", 3.9999999999999996)]
)
def test_what_holds_through_rounding_is_not_called_contradictory(text: str, value: float) -> None:
    guard = parse_guard(text)
    assert holds(guard, {"X": value})
    assert contradictory([guard]) is not True
    assert contradictory_over_reals([guard]) is True


def test_what_exact_arithmetic_cannot_tell_is_left_open() -> None:
    guards = _guards("X * X == 2")
    assert contradictory(guards) is None
    assert contradictory_over_reals(guards) is None


@pytest.mark.parametrize("seed", range(2))
def test_no_values_satisfy_what_sympy_refutes(seed: int) -> None:
    random, asked = Random(100 + seed), 0
    numbers = [float(n) / 4 for n in range(-12, 13)] + [2**53 + 1, 1e17, 1, 2, 3]
    while asked < 15:
        sides = [parse_guard(random.choice(("2 * X", "X + 1", "X - 3", "X * X", "X / 3", "-X"))) for _ in range(2)]
        compare = [random.choice((Operator.LT, Operator.GT, Operator.GE)) for _ in range(2)]
        guards: list[Guard] = [
            Operation(operator, (side, Literal(random.choice((-2, 0, 1, 5)))))
            for operator, side in zip(compare, sides, strict=True)
        ]
        if witness(guards) is None:
            asked += 1
            if contradictory(guards):
                assert not any(all(holds(guard, {"X": x}) for guard in guards) for x in numbers), guards


def test_names_of_a_tree_are_never_evaluated() -> None:
    guard = Operation(Operator.EQ, (Variable("Symbol"), Literal("__import__('os').abort()")))
    assert contradictory([guard]) is False
    assert contradictory_over_reals([guard]) is None
