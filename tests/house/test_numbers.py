"""The house does not grow: no number exceeds its bar, and a bar follows a number that has fallen."""

import pytest

from tests.house.numbers import bars, measured

SLACK = 0.9
"""A number below this part of its bar asks for a lower bar."""


@pytest.mark.ci
def test_a_number_keeps_below_its_bar() -> None:
    numbers, highest = measured(), bars()
    assert numbers.keys() == highest.keys(), "run python -m tests.house"
    over = {name: f"{numbers[name]:,}, and at most {bar:,}" for name, bar in highest.items() if numbers[name] > bar}
    assert not over
    low = {
        name: f"only {numbers[name]:,} of {bar:,}" for name, bar in highest.items() if numbers[name] < SLACK * bar - 1
    }
    assert not low, "lower the bars: python -m tests.house"
