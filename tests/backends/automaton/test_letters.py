"""The feasible letters against all events over a grid of values."""

from collections.abc import Iterator
from itertools import product
from random import Random
from typing import Any

import pytest

from backends.automaton.letters import Letters, Relevance
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, match

LEAVES: tuple[Pattern, ...] = (
    Literal(1),
    Literal(2),
    Literal("a"),
    Anything(),
    Variable("_1"),
    ListPattern((Literal(1), Anything())),
    ListPattern((Variable("_1"), Anything())),
    ObjectPattern((("k", Literal(1)),)),
    ObjectPattern(()),
)
VALUES: tuple[Any, ...] = (
    1,
    2,
    "a",
    "other",
    None,
    [1, 1],
    [1, 2],
    [2, 1],
    ["other", 1],
    [],
    {},
    {"k": 1},
    {"k": 2},
    {"k": 1, "l": 3},
)
ABSENT = object()


def grid() -> Iterator[dict[str, Any]]:
    for x, y in product((ABSENT, *VALUES), repeat=2):
        yield {name: value for name, value in (("x", x), ("y", y)) if value is not ABSENT}
    for value in VALUES:
        yield {"x": value, "y": [value, "other"]}
        yield {"x": [value, "other"], "y": value}


def random_pattern(random: Random) -> ObjectPattern:
    fields = random.choice((("x",), ("y",), ("x", "y")))
    return ObjectPattern(tuple((name, random.choice(LEAVES)) for name in fields))


def holding(patterns: list[ObjectPattern], event: Any) -> int:
    return sum(1 << index for index, pattern in enumerate(patterns) if match(pattern, event, {}) is not None)


@pytest.mark.parametrize("seed", range(60))
def test_letters_are_those_of_concrete_events(seed: int) -> None:
    random = Random(seed)
    patterns = list(dict.fromkeys(random_pattern(random) for _ in range(random.randint(1, 5))))
    letters = Letters(patterns)
    found = {holding(patterns, event) for event in grid()}
    claimed = set(letters.over((1 << len(patterns)) - 1))
    assert found == claimed, (patterns, found ^ claimed)
    for some in range(1 << len(patterns)):
        assert set(letters.over(some)) == {letter & some for letter in found}


@pytest.mark.parametrize("seed", range(60))
def test_relevant_letters_are_those_of_relevant_events(seed: int) -> None:
    random = Random(1000 + seed)
    patterns = list(dict.fromkeys(random_pattern(random) for _ in range(random.randint(1, 3))))
    others = [random_pattern(random) for _ in range(random.randint(0, 2))]
    ignored = [random_pattern(random) for _ in range(random.randint(0, 1))]
    letters = Letters(
        patterns, Relevance(tuple((one, None) for one in (*patterns, *others)), tuple((one, None) for one in ignored))
    )
    relevant = [event for event in grid() if holding([*patterns, *others], event) and not holding(ignored, event)]
    found = {holding(patterns, event) for event in relevant}
    hidden = [
        index
        for index, pattern in enumerate(patterns)
        if not any(match(pattern, event, {}) is not None for event in relevant)
    ]
    claimed = {
        letter for letter in letters.over((1 << len(patterns)) - 1) if not any(letter >> index & 1 for index in hidden)
    }
    assert found == claimed, (patterns, others, ignored)


def test_rigid_variables_are_shared_and_false_while_unbound() -> None:
    x, y = Variable("X"), Variable("Y")
    patterns = [ObjectPattern((("x", x),)), ObjectPattern((("x", y),)), ObjectPattern((("x", x), ("y", Literal(1))))]
    assert set(Letters(patterns).over(0b111)) == {0b000, 0b001, 0b010, 0b011, 0b101, 0b111}


def test_a_value_that_would_contain_itself_is_impossible() -> None:
    x, y = Variable("X"), Variable("Y")
    one = ObjectPattern((("a", x), ("b", ObjectPattern((("k", y),)))))
    other = ObjectPattern((("a", ObjectPattern((("k", y),))), ("b", x)))
    assert Letters([one, other]).closure(0b11) is not None
    inside = ObjectPattern((("a", x), ("b", x)))
    outside = ObjectPattern((("a", ListPattern((x,))),))
    assert Letters([inside, outside]).closure(0b11) is None
