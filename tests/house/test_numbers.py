"""The house does not grow: no number exceeds its bar, and a bar follows a number that has fallen."""

import pytest

from tests.house.numbers import bars, measured

NUMBERS = measured()
BARS = bars()
SLACK = 0.9
"""A number below this part of its bar asks for a lower bar."""


@pytest.mark.parametrize("name", sorted(NUMBERS.keys() | BARS.keys()))
def test_a_number_keeps_below_its_bar(name: str) -> None:
    assert name in NUMBERS.keys() & BARS.keys(), "run python -m tests.house"
    assert NUMBERS[name] <= BARS[name], f"{name}: {NUMBERS[name]:,}, and at most {BARS[name]:,}"
    low = NUMBERS[name] < SLACK * BARS[name] - 1
    assert not low, f"{name}: only {NUMBERS[name]:,}; lower the bar of {BARS[name]:,}: python -m tests.house"
