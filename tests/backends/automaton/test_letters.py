"""The feasible letters against all events over a grid of values."""

from collections.abc import Iterator
from itertools import product
from random import Random
from typing import Any

import pytest

from backends.automaton.letters import FeasibleLetters, Relevance
from rvaft.language.parser import parse_pattern
from rvaft.model.patterns import ObjectPattern, Pattern, match
from rvaft.support.bits import union

LEAVES: tuple[Pattern, ...] = tuple(
    map(parse_pattern, ("1", "2", '"a"', "_", "_1", "[1, _]", "[_1, _]", "{ k: 1 }", "{}"))
)
VALUES: list[Any] = [1, 2, "a", "other", None, [1, 1], [1, 2], [2, 1], ["other", 1], [], {}]
VALUES += [{"k": 1}, {"k": 2}, {"k": 1, "l": 3}]
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


def relevance(entries: list[ObjectPattern], ignored: list[ObjectPattern]) -> Relevance:
    return Relevance(tuple((one, None) for one in entries), tuple((one, None) for one in ignored))


@pytest.mark.parametrize("seed", range(60))
def test_letters_are_those_of_concrete_events(seed: int) -> None:
    random = Random(seed)
    patterns = list(dict.fromkeys(random_pattern(random) for _ in range(random.randint(1, 5))))
    letters = FeasibleLetters(patterns)
    found = {holding(patterns, event) for event in grid()}
    for some in range(1 << len(patterns)):
        assert set(letters.over(some)) == {letter & some for letter in found}, (patterns, some)


@pytest.mark.parametrize("seed", range(60))
def test_relevant_letters_are_those_of_relevant_events(seed: int) -> None:
    random = Random(1000 + seed)
    patterns = list(dict.fromkeys(random_pattern(random) for _ in range(random.randint(1, 3))))
    entries = patterns + [random_pattern(random) for _ in range(random.randint(0, 2))]
    ignored = [random_pattern(random) for _ in range(random.randint(0, 1))]
    relevant = [event for event in grid() if holding(entries, event) and not holding(ignored, event)]
    found = {holding(patterns, event) for event in relevant}
    seen = union(found)  # a pattern that only ignored events match keeps its letters
    claimed = FeasibleLetters(patterns, relevance(entries, ignored)).over((1 << len(patterns)) - 1)
    assert found == {letter for letter in claimed if not letter & ~seen}, (patterns, entries, ignored)


def test_rigid_variables_are_shared_and_false_while_unbound() -> None:
    patterns = [parse_pattern(text) for text in ("{ x: X }", "{ x: Y }", "{ x: X, y: 1 }")]
    assert set(FeasibleLetters(patterns).over(0b111)) == {0b000, 0b001, 0b010, 0b011, 0b101, 0b111}


def test_a_value_that_would_contain_itself_is_impossible() -> None:
    one, other = (parse_pattern(text) for text in ("{ a: X, b: { k: Y } }", "{ a: { k: Y }, b: X }"))
    assert FeasibleLetters([one, other]).closure(0b11) is not None
    inside, outside = (parse_pattern(text) for text in ("{ a: X, b: X }", "{ a: [X] }"))
    assert FeasibleLetters([inside, outside]).closure(0b11) is None
