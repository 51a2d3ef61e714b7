"""The house does not grow: no number exceeds its bar, and a bar follows a number that has fallen."""

import pytest

from tests.house.numbers import bars, measured

NUMBERS = measured()
BARS = bars()
SLACK = 0.9
"""A number below this part of its bar asks for a lower bar."""


def test_every_number_has_a_bar() -> None:
    assert BARS.keys() == NUMBERS.keys(), "run python -m tests.house"


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_keeps_below_its_bar(name: str) -> None:
    assert NUMBERS[name] <= BARS[name], f"{name}: {NUMBERS[name]:,}, and at most {BARS[name]:,}"
    low = NUMBERS[name] < SLACK * BARS[name] - 1
    assert not low, f"{name}: only {NUMBERS[name]:,}; lower the bar of {BARS[name]:,}: python -m tests.house"
