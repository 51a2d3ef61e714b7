"""No module imports another that imports it, also inside functions and by name."""

import pytest

from tests.house.numbers import imported, largest_circle


@pytest.mark.ci
def test_there_is_no_circle_of_imports() -> None:
    assert largest_circle(imported()) == 0


def test_a_circle_is_found() -> None:
    assert largest_circle([("a", "b", False, False), ("b", "c", True, False), ("c", "a", False, True)]) == 3
