"""The pattern algebra against brute force: a small universe of events, and the least events themselves written out."""

from collections.abc import Sequence
from functools import partial
from itertools import combinations, product
from random import Random
from typing import Any

import pytest

from rvaft import RvaftError
from rvaft.core.overlaps import LeastEvent, Overlaps, Unknown, compatible, implies, least, overlaps
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    match,
    rigid,
    ways,
)
from rvaft.support.bits import bits
from rvaft.support.budget import Budget

LEAVES: tuple[Pattern, ...] = (
    *(Literal(1), Literal(2), Literal("s"), Literal(True), Anything()),
    *(Variable("X"), Variable("X"), Variable("Y"), Variable("_1"), Variable("_1")),
    *(ListPattern((Literal(1), Anything())), ListPattern((Variable("X"), Variable("_1"))), ListPattern(())),
    *(ObjectPattern((("k", Literal(1)),)), ObjectPattern((("k", Variable("X")),)), ObjectPattern(())),
)
VALUES: tuple[Any, ...] = (
    *(1, 1.0, 2, "s", True, None, [], [1, 1], [1, 2], [2, "s"], [[], 1]),
    *({}, {"k": 1}, {"k": 2}, {"k": {}}, {"k": 1, "l": 2}),
)
UNIVERSE = [
    {name: value for name, value in zip("ab", pair, strict=True) if value != "absent"}
    for pair in product((*VALUES, "absent"), repeat=2)
]
SEEDS = range(2)


def random_pattern(random: Random, leaves: Sequence[Pattern] = LEAVES) -> Pattern:
    fields = random.choice(("a", "b", "ab", "ab"))
    return ObjectPattern(tuple((name, random.choice(leaves)) for name in fields))


def matches_all(patterns: list[Pattern], event: Any) -> dict[str, Any] | None:
    binding: dict[str, Any] = {}
    for pattern in patterns:
        found = match(pattern, event, binding)
        if found is None:
            return None
        binding = rigid(found)
    return binding


def instance(event: LeastEvent) -> tuple[Any, dict[str, Any]]:
    """The least event as JSON, and the values of the variables."""
    made: dict[int, Any] = {}

    def build(value: Unknown) -> Any:
        value = value.find()
        if id(value) not in made:
            inner = {name: build(part) for name, part in value.parts.items()}
            match value.head:
                case Literal(literal):
                    made[id(value)] = literal
                case int():
                    made[id(value)] = [inner[place] for place in range(value.head)]
                case "object":
                    made[id(value)] = {"fresh": len(made), **inner}
                case _:
                    made[id(value)] = f"fresh {len(made)}"
        return made[id(value)]

    return build(event.root), {name: build(value) for name, value in event.bound.items()}


@pytest.mark.parametrize("seed", SEEDS)
def test_the_least_event_says_what_all_events_say(seed: int) -> None:
    random = Random(seed)
    for _ in range(30):
        patterns = [random_pattern(random) for _ in range(random.randint(1, 3))]
        matching = [event for event in UNIVERSE if matches_all(patterns, event) is not None]
        event = least(patterns)
        if event is None:
            assert not matching
            continue
        written, values = instance(event)
        assert matches_all(patterns, written) is not None
        for other in (random_pattern(random) for _ in range(10)):
            known = {name: value for name, value in values.items() if not name.startswith("_")}
            found = match(other, written, known)
            implied = event.satisfies(other)
            assert implied == (found is not None and rigid(found).keys() == known.keys()), (patterns, other)
            if implied:
                assert all(match(other, one, matches_all(patterns, one) or {}) is not None for one in matching)


@pytest.mark.parametrize("seed", SEEDS)
def test_overlaps_of_many_patterns(seed: int) -> None:
    random = Random(seed)
    patterns = list(dict.fromkeys(random_pattern(random) for _ in range(25)))
    many = Overlaps(patterns)
    for number, one in enumerate(patterns):
        near = set(bits(many.compatible(number)))
        for index, other in enumerate(patterns):
            assert (index in near) == compatible(one, other)
            assert overlaps(one, other) <= compatible(one, other)
            assert overlaps(one, other) == (least([one, other]) is not None)
            assert number == index or overlaps(one, other) == bool(many.exact(number, Budget()) >> index & 1)
            if any(matches_all([one, other], event) is not None for event in UNIVERSE):
                assert overlaps(one, other)
    pairs = combinations(range(len(patterns)), 2)
    assert list(many.pairs()) == [(i, j) for i, j in pairs if compatible(patterns[i], patterns[j])]


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_implied_holds(seed: int) -> None:
    random, implied = Random(seed), 0
    for _ in range(400):
        special, general = random_pattern(random), random_pattern(random)
        bound = {name: random.choice(VALUES) for name in random.choice(("", "X", "XY"))}
        if implies(special, general, bound.keys()):
            implied += 1
            fitting = partial(match, binding=bound)
            assert all(fitting(general, event) is not None for event in UNIVERSE if fitting(special, event) is not None)
    assert implied > 10


SOME: tuple[Pattern, ...] = tuple(
    map(SomeItem, (LEAVES[0], LEAVES[1], Variable("X"), Variable("_1"), ObjectPattern(())))
)


@pytest.mark.parametrize("seed", SEEDS)
def test_some_item_of_a_list_only_weakens_what_is_certain(seed: int) -> None:
    random, certain = Random(seed), 0
    for _ in range(200):
        one, other = (random_pattern(random, LEAVES + 3 * SOME) for _ in range(2))
        both = [(event, own) for event in UNIVERSE for own in map(rigid, ways(one, event, {}))]
        found = [(event, own) for event, own in both if match(other, event, own) is not None]
        assert overlaps(one, other) or not found
        assert not implies(one, other) or all(match(other, event, {}) is not None for event, _ in both)
        smallest = least([one])
        if smallest is not None and smallest.satisfies(other):
            certain += one != other
            assert len(found) == len(both)
    assert certain > 5


def test_all_ways_to_match_are_found_and_their_number_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = ObjectPattern((("a", SomeItem(Variable("X"))), ("b", SomeItem(Variable("Y")))))
    event = {"a": [1, 2], "b": [3, 4, 3]}
    found = [(one["X"], one["Y"]) for one in ways(pair, event, {})]
    assert sorted(found) == sorted(product([1, 2], [3, 4, 3]))
    monkeypatch.setattr("rvaft.model.patterns.MOST_ITEMS", 5)
    with pytest.raises(RvaftError, match="list items tried"):
        list(ways(pair, event, {}))


def test_patterns_that_are_no_objects() -> None:
    assert overlaps(ListPattern((Literal(1),)), Variable("X"))
    assert not overlaps(ListPattern((Literal(1),)), ObjectPattern(()))
    assert not overlaps(Variable("X"), ListPattern((Variable("X"),)))  # no value is a part of itself


def test_ten_thousand_patterns_are_not_compared_pair_by_pair() -> None:
    told = [ObjectPattern((("topic", Literal(f"t{n}")), ("v", Variable("X")))) for n in range(10_000)]
    none, budget = Overlaps(told), Budget(20_000)
    assert not any(none.exact(number, budget) for number in range(10_000))
    some = Overlaps([*told, ObjectPattern((("v", Literal(1)),))])
    assert sum(1 for _ in some.pairs()) == 10_000
    doubtful = [ObjectPattern((("v", Variable("X")), (f"f{n}", Anything()))) for n in range(100)]
    with pytest.raises(RvaftError, match="limit"):
        Overlaps([*told[:100], *doubtful]).exact(150, Budget(500))
