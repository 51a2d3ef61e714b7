"""No module imports another that imports it, also inside functions and by name."""

from tests.house.numbers import measured


def test_there_is_no_circle_of_imports() -> None:
    assert measured()["largest import circle"] == 0
