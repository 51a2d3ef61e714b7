"""Letters: every combination of answers that an event can give, and no other."""

import math
from itertools import product
from random import Random
from time import perf_counter, process_time
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cross_check.generate.strategies import randoms
from cross_check.generate.values import fitting
from cross_check.letters import UNBOUND, VARIABLES, Letters, answers, letters
from rvaft import TooLarge
from rvaft.backend import Observed
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, variables
from rvaft.model.values import Json
from tests.tables import rows


def question(text: str) -> Observed:
    """A question as it is written in a tree, `PATTERN when GUARD`, with variables of its own."""
    pattern, _, guard = text.partition(" when ")
    return Observed(parse_pattern(pattern), parse_guard(guard) if guard else None).untied()


def default(name: str) -> Observed:
    return Observed(ObjectPattern((("event", Literal(name)),)))


def words(found: Letters, asked: list[Observed]) -> set[str]:
    return {"".join("01"[one] for one in answers(asked, event)) for event in found.events}


@pytest.mark.parametrize(("asked", "expected", "why"), rows(__file__, "letters.txt"))
def test_by_hand(asked: list[str], expected: str, why: str) -> None:
    every = [question(one) for one in asked]
    found = letters(every)
    assert found.gap == ""
    assert words(found, every) == set(expected.split() or [""]), why
    assert len(found.events) == len(words(found, every)), "one event for each"
    assert found.events[0] == {}


def test_the_first_event_matches_only_what_every_event_matches() -> None:
    asked = [question(one) for one in ("_", "{}", "X when X != 1", "X when X == 1", "{x: 1}")]
    assert [answers(asked, event) for event in letters(asked).events] == [(1, 1, 1, 0, 0), (1, 1, 1, 0, 1)]


def test_the_same_question_twice_is_one() -> None:
    assert letters([default("a"), default("a")]) == letters([default("a")])


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ("{v: V, w: W} when V + W > 1", "several"),
        ("{v: V, w: W} when V >= W + 10", "several"),
        ("{v: V} when V * V > 1", "without known bounds"),
        ("{v: V} when 1 / V > 1", "without known bounds"),
        ("{v: V} when V - V == 0", "without known bounds"),
        ("{v: V} when 1 == -(V < 1)", "without known bounds"),
        ('{v: V} when like(V, "a*")', "without known bounds"),
        ('{v: V} when lower(V) == "a"', "without known bounds"),
        ("{v: V} when number(V) > 1", "without known bounds"),
        ("{v: V} when abs(V - 1) > 1", "without known bounds"),
    ],
)
def test_a_gap_is_told(asked: str, why: str) -> None:
    both = [question(asked), default("a")]
    found = letters(both)
    assert why in found.gap
    assert {"00", "01"} <= words(found, both)


def test_variables_that_tie_events_together_are_a_gap() -> None:
    shared = [
        Observed(parse_pattern("{a: X, b: Y}")),
        Observed(parse_pattern("{c: X}"), parse_guard("X > 100")),
        default("a"),
    ]
    found = letters(shared)
    assert found.gap == VARIABLES
    assert found.events[:2] == ({}, {"event": "a"})
    values = {event["c"] for event in found.events if "c" in event}
    assert {99, 100, 101} <= values
    assert any(event.get("a") == event.get("c") == 101 for event in found.events)
    assert any(event.get("a") != event.get("b") for event in found.events)


def test_a_guard_on_what_the_pattern_does_not_have_is_a_gap() -> None:
    asked = Observed(ObjectPattern((("v", Anything()),)), Operation(Operator.GT, (Variable("_w"), Literal(1))))
    assert letters([asked, default("a")]) == Letters(({}, {"event": "a"}), UNBOUND)


def test_too_many_letters_and_too_many_values_to_try() -> None:
    many = [question(f"{{f{number}: _}}") for number in range(6)]
    assert len(letters(many, limit=64).events) == 64
    with pytest.raises(TooLarge):
        letters(many, limit=63)
    five = " and ".join(f"V{number} < V{number + 1}" for number in range(5))
    fields = ", ".join(f"v{number}: V{number}" for number in range(6))
    with pytest.raises(TooLarge):
        letters([question(f"{{{fields}}} when {five}")])


@pytest.mark.ci
def test_the_limit_is_reached_in_seconds() -> None:
    patterns = ('{k: "kx", x: X}', "{n: {l: [X, _], x: 1.5}}", "{x: X, y: Y}", "{y: X}")
    guards = (
        "X * 2 != 1 and (not X < X and X >= 0) and abs(X) >= 2",
        "X != X and X / 2 == null",
        'lower(X) != ""',
        "number(X) != 2",
    )
    start = process_time()
    with pytest.raises(TooLarge, match="values to try"):
        letters([question(f"{pattern} when {guard}") for pattern in patterns for guard in guards])
    assert process_time() - start < 30  # 5 s where nothing else runs


def test_speed_of_the_common_case() -> None:
    names = [default(f"n{number}") for number in range(12)]
    overlapping = [question(f'{{event: "n{number}", v: {number}}}') for number in range(5)] + names[:5]
    for asked, count in ((names, 13), (overlapping, 11)):
        times = []
        for _ in range(5):
            start = perf_counter()
            assert len(letters(asked).events) == count
            times.append(perf_counter() - start)
        assert min(times) < 0.01  # 0.4 ms where nothing else runs


# -- random questions, and events that have to do with them ----------------------------------------------------------

FIELDS: Final = ("x", "y", "z")
VALUES: Final[tuple[Json, ...]] = (
    *(0, 1, 2, 1.5, -1, 3, 0.5, 1.0, 1.25, 1.75, 1.9, 4, 6, 5, 100, 2**53 + 1, -0.0),
    *("", "a", "b", "aa", "A", "c", "ab", True, False, None, math.nan, math.inf),
)
LITERALS: Final = st.sampled_from((0, 1, 2, "a", "b", True, None, 1.5)).map(Literal)
COMPARISONS: Final = (Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE)
STEPS: Final = (Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV)


def objects(inner: st.SearchStrategy[Pattern]) -> st.SearchStrategy[Pattern]:
    fields = st.dictionaries(st.sampled_from(FIELDS), inner, min_size=1, max_size=2)
    return fields.map(lambda named: ObjectPattern(tuple(named.items())))


def operation(operators: tuple[Operator, ...], *operands: st.SearchStrategy[Any]) -> st.SearchStrategy[Guard]:
    return st.builds(Operation, st.sampled_from(operators), st.tuples(*operands))


LEAVES: Final = LITERALS | st.sampled_from(("_1", "_2", "_3")).map(Variable) | st.just(Anything())
PATTERNS: Final = objects(
    LEAVES | objects(LEAVES) | st.lists(LEAVES, max_size=2).map(lambda items: ListPattern(tuple(items)))
)


@st.composite
def questions(draw: st.DrawFn) -> Observed:
    """A pattern, half of the time with a guard on its variables."""
    pattern = draw(PATTERNS)
    if not (names := variables(pattern)) or draw(st.booleans()):
        return Observed(pattern)
    variable = st.sampled_from(names).map(Variable)
    step = operation(STEPS, variable, st.sampled_from((2, 3, 0.5, -1)).map(Literal))
    compared = operation(COMPARISONS, variable, LITERALS | variable) | operation(COMPARISONS, LITERALS, variable | step)
    listed = operation((Operator.IN,), variable, LITERALS, LITERALS)
    begun = operation((Operator.STARTSWITH,), variable, st.sampled_from(("", "a", "ab")).map(Literal))
    most = operation((Operator.MIN, Operator.MAX), variable, st.sampled_from((0, 1, 1.5)).map(Literal))
    compared |= listed | begun | operation(COMPARISONS, most | operation((Operator.ABS,), variable), LITERALS)
    guard = compared | operation((Operator.AND, Operator.OR), compared, compared)
    return Observed(pattern, draw(guard | variable | operation((Operator.NOT,), compared)))


def random_value(random: Random, depth: int) -> Json:
    """Any value, mostly a scalar."""
    dice = random.random() if depth else 1
    if dice < 0.12:
        return [random_value(random, depth - 1) for _ in range(random.randint(0, 3))]
    if dice < 0.3:
        return {name: random_value(random, depth - 1) for name in random.sample((*FIELDS, "w"), random.randint(0, 3))}
    return random.choice(VALUES)


def random_event(random: Random, asked: list[Observed]) -> Json:
    """An event that fits some of the patterns, if they fit together; values often repeat."""
    pool = [random_value(random, 2) for _ in range(3)]
    event: Json = {name: random.choice(pool) for name in random.sample(FIELDS, random.randint(0, 3))}
    for one in random.sample(asked, random.randint(0, len(asked))):
        event = merged(event, fitting(random, one.pattern, pool))
    return event


def merged(one: Json, other: Json) -> Json:
    if isinstance(one, dict) and isinstance(other, dict):
        return {**one, **{name: merged(one.get(name), value) for name, value in other.items()}}
    return other


@pytest.mark.ci
@settings(max_examples=80)
@given(st.lists(questions(), min_size=2, max_size=4), randoms())
def test_no_event_is_outside_the_letters(asked: list[Observed], random: Random) -> None:
    """Random questions (nested, lists, equality, guards) and random events that have to do with them."""
    try:
        found = letters(asked)
    except TooLarge:
        return
    known = {answers(asked, event) for event in found.events}
    assert len(known) == len(found.events)
    for _ in range(0 if found.gap else 100):
        event = random_event(random, asked)
        assert answers(asked, event) in known, (asked, event)


ABSENT: Final = object()
GRID: Final[tuple[Any, ...]] = (
    *(ABSENT, 0, 1, 1.0, 1.25, 1.5, 1.75, 2, 3, 1e308, -1.7e308, 10**400, -(10**400), "a", "b", "", True, False, None),
    *([], [1], [3], [1, 1], [2, 1], [2, 2], [3, 3.0], {}, {"x": 1}, {"x": 2.0}, {"x": 3, "y": 1}),
)


def test_an_object_or_a_list_may_be_undefined_as_a_whole() -> None:
    asked = [question(one) for one in ("{x: X} when X == X", "{x: {x: _}}", "{x: [{y: _}, 1]}", "{y: Y} when Y != 1")]
    known = {answers(asked, event) for event in letters(asked).events}
    for x in ({"x": math.inf}, {"x": {}, "y": math.nan}, [{"y": 1, "z": math.nan}, 1]):
        assert answers(asked, {"x": x}) in known
        assert answers(asked, {"x": x, "y": 2}) in known


@pytest.mark.parametrize(
    "asked",
    [
        ["{x: X, y: X}", "{x: 1}", '{y: "a"}', "{x: X} when X < 2", "{x: X, y: Y} when X < Y", "{y: Y} when Y != null"],
        ["{x: {x: X}, y: X}", "{x: {x: 1}}", "{x: {}}", "{x: [X, Y], y: Y} when X > 1", "{y: Y} when Y >= 2"],
        ["{x: X} when X * 2 < 3", "{x: 1}", "{x: X, y: Y} when X <= Y", "{x: X, y: Y} when X == Y", "{y: 2}"],
    ],
)
def test_no_event_of_a_grid_is_outside_the_letters(asked: list[str]) -> None:
    every = [question(one) for one in asked]
    found = letters(every)
    assert found.gap == ""
    known = {answers(every, event) for event in found.events}
    for x, y in product(GRID, GRID):
        event = {name: value for name, value in (("x", x), ("y", y)) if value is not ABSENT}
        assert answers(every, event) in known, event
