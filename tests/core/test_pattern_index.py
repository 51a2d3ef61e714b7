"""What is worked out once for many events is what the patterns and guards say of each."""

from typing import Any

from rvaft.core.pattern_index import MEMORY, WIDEST, Discriminators, PatternIndex
from rvaft.model.patterns import Literal, ObjectPattern


def test_one_and_true_are_two_shapes_where_a_pattern_tells_them_apart() -> None:
    shapes = PatternIndex([ObjectPattern((("x", Literal(one)),)) for one in (1, True)], lambda decided: decided)
    found = [shapes.of({"x": value}).fits for value in (1, True, 1.0, False, "1", [1], 1)]
    assert found == [(0,), (1,), (0,), (), (), (), (0,)]


def test_shapes_without_end_and_wide_events_are_not_remembered() -> None:
    shapes = PatternIndex([ObjectPattern((("x", Literal("1")),))], lambda decided: decided)
    for width, remembered in ((WIDEST, 1), (WIDEST + 1, 1), (10 * WIDEST, 1)):
        assert shapes.of({"x": "1", **{f"f{n}": n for n in range(width - 1)}}).fits == (0,)
        assert len(shapes._memory) == remembered
    for number in range(2 * MEMORY):
        shapes.of({str(number): 1})
    assert len(shapes._memory) <= MEMORY
    assert shapes.of({"x": "1"}).fits == (0,)


class Counting(tuple[dict[str, str], ...]):
    """Counts how often something is taken out of it."""

    taken = 0

    def __getitem__(self, place: Any) -> Any:
        type(self).taken += 1
        return super().__getitem__(place)


def test_an_event_meets_only_the_patterns_that_ask_for_its_value() -> None:
    told = Discriminators(ObjectPattern((("event", Literal(f"e{number}")),)) for number in range(1000))
    told._literals = Counting(told._literals)
    for number in range(1000):
        assert told.candidates(told.values({"event": f"e{number}"})) == (number,)
    assert told.candidates(told.values({"event": "other"})) == ()
    assert Counting.taken == 1000
