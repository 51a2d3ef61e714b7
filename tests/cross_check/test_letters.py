"""Letters: every combination of answers that an event can give, and no other."""

from itertools import product
from random import Random
from time import perf_counter
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cross_check.letters import UNBOUND, VARIABLES, Letters, answers, letters, untied
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, variables
from rvaft.model.values import Json, Scalar
from tests.tables import rows

ABSENT = object()


def question(text: str) -> Observed:
    """A question as it is written in a tree, `PATTERN when GUARD`, with variables of its own."""
    pattern, _, guard = text.partition(" when ")
    return untied(Observed(parse_pattern(pattern), parse_guard(guard) if guard else None))


def default(name: str) -> Observed:
    return Observed(ObjectPattern((("event", Literal(name)),)))


def words(found: Letters, questions: list[Observed]) -> set[str]:
    return {"".join("01"[one] for one in answers(questions, event)) for event in found.events}


@pytest.mark.parametrize(("asked", "expected", "why"), rows(__file__, "letters.txt"))
def test_by_hand(asked: list[str], expected: str, why: str) -> None:
    questions = [question(one) for one in asked]
    found = letters(questions)
    assert found.gap == ""
    assert words(found, questions) == set(expected.split() or [""]), why
    assert len(found.events) == len(words(found, questions)), "one event for each"
    assert found.events[0] == {}


def test_the_first_event_matches_only_what_every_event_matches() -> None:
    questions = [question(one) for one in ("_", "{}", "X when X != 1", "X when X == 1", "{x: 1}")]
    found = letters(questions)
    assert [answers(questions, event) for event in found.events] == [(1, 1, 1, 0, 0), (1, 1, 1, 0, 1)]


def test_participants_that_look_at_different_fields() -> None:
    mine = [default("a"), default("b")]
    theirs = [question('{topic: "/a", event: "a"}'), question("{topic: _}")]
    found = letters([*mine, *theirs])
    assert words(found, [*mine, *theirs]) == {"0000", "1000", "0100", "0001", "0101", "1001", "1011"}


def test_the_same_question_twice_is_one() -> None:
    assert letters([default("a"), default("a")]) == letters([default("a")])


GAPS = [
    ("{v: V, w: W} when V + W > 1", "several"),
    ("{v: V, w: W} when V >= W + 10", "several"),
    ("{v: V} when V * V > 1", "no known bounds"),
    ("{v: V} when 1 / V > 1", "no known bounds"),
    ("{v: V} when V - V == 0", "no known bounds"),
    ("{v: V} when 1 == -(V < 1)", "no known bounds"),
]


@pytest.mark.parametrize(("asked", "why"), GAPS)
def test_a_gap_is_told(asked: str, why: str) -> None:
    questions = [question(asked), default("a")]
    found = letters(questions)
    assert why in found.gap
    assert {"00", "01"} <= words(found, questions)


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


def test_too_many_letters() -> None:
    many = [Observed(ObjectPattern(((f"f{number}", Anything()),))) for number in range(6)]
    assert len(letters(many, limit=64).events) == 64
    with pytest.raises(TooLarge):
        letters(many, limit=63)


def test_too_many_values_to_try() -> None:
    five = " and ".join(f"V{number} < V{number + 1}" for number in range(5))
    fields = ", ".join(f"v{number}: V{number}" for number in range(6))
    with pytest.raises(TooLarge):
        letters([question(f"{{{fields}}} when {five}")])


def test_speed_of_the_common_case() -> None:
    plain = [default(f"n{number}") for number in range(12)]
    overlapping = [question(f'{{event: "n{number % 5}", v: {number}}}') for number in range(5)]
    overlapping += [default(f"n{number}") for number in range(5)]
    for questions, count in ((plain, 13), (overlapping, 11)):
        best = 1.0
        for _ in range(5):
            start = perf_counter()
            found = letters(questions)
            best = min(best, perf_counter() - start)
        assert len(found.events) == count
        assert best < 0.01  # 0.4 ms where nothing else runs


# -- random questions, and random events that have to do with them ---------------------------------------------------

FIELDS: Final = ("x", "y", "z")
LITERALS: Final[tuple[Scalar, ...]] = (0, 1, 2, "a", "b", True, None, 1.5)
VALUES: Final[tuple[Json, ...]] = (
    *(0, 1, 2, 1.5, -1, 3, 0.5, 1.0, 1.25, 1.75, 1.9, 4, 6, 5, 100, 2**53 + 1, -0.0),
    *("", "a", "b", "aa", "A", "c", "ab", True, False, None),
)
COMPARISONS: Final = (Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE)
STEPS: Final = (Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV)


def random_question(random: Random, *, calculating: bool) -> Observed:
    """A pattern, half of the time with a guard on its variables."""
    pattern = _object(random, 2)
    names = variables(pattern)
    return Observed(pattern, _guard(random, names, calculating) if names and random.random() < 0.5 else None)


def _object(random: Random, depth: int) -> Pattern:
    names = random.sample(FIELDS, random.randint(0 if depth < 2 else 1, 2))
    return ObjectPattern(tuple((name, _inner(random, depth - 1)) for name in names))


def _inner(random: Random, depth: int) -> Pattern:
    dice = random.random()
    if dice < 0.3:
        return Literal(random.choice(LITERALS))
    if dice < 0.65:
        return Variable(random.choice(("_1", "_2", "_3")))
    if dice < 0.75 or not depth:
        return Anything()
    if dice < 0.85:
        return ListPattern(tuple(_inner(random, depth - 1) for _ in range(random.randint(0, 2))))
    return _object(random, depth)


def _guard(random: Random, names: tuple[str, ...], calculating: bool, depth: int = 1) -> Guard:
    dice = random.random()
    if depth and dice < 0.3:
        both = (_guard(random, names, calculating, 0), _guard(random, names, calculating, 0))
        return Operation(random.choice((Operator.AND, Operator.OR)), both)
    if depth and dice < 0.4:
        return Operation(Operator.NOT, (_guard(random, names, calculating, 0),))
    if dice < 0.45:
        return Variable(random.choice(names))
    left: Guard = Variable(random.choice(names))
    right: Guard = Variable(random.choice(names)) if random.random() < 0.3 else Literal(random.choice(LITERALS))
    if calculating and random.random() < 0.3:
        left = Operation(random.choice(STEPS), (left, Literal(random.choice((2, 3, 0.5, -1)))))
        right = Literal(random.choice(LITERALS))
    return Operation(random.choice(COMPARISONS), (left, right) if random.random() < 0.7 else (right, left))


def random_value(random: Random, depth: int) -> Json:
    """Any value, mostly a scalar."""
    dice = random.random()
    if depth and dice < 0.12:
        return [random_value(random, depth - 1) for _ in range(random.randint(0, 3))]
    if depth and dice < 0.3:
        names = random.sample((*FIELDS, "w"), random.randint(0, 3))
        return {name: random_value(random, depth - 1) for name in names}
    return random.choice(VALUES)


def random_event(random: Random, questions: list[Observed]) -> Json:
    """Any event, or one that fits some of the patterns at once; values often repeat."""
    if random.random() < 0.5:
        pool = [random_value(random, 2) for _ in range(2)]
        names = random.sample(FIELDS, random.randint(1, 3))
        return {name: random.choice(pool) if random.random() < 0.35 else random_value(random, 2) for name in names}
    event: Json = {}
    for one in random.sample(questions, random.randint(1, min(3, len(questions)))):
        event = _merged(event, _fitting(random, one.pattern, {}))
    return event


def _fitting(random: Random, pattern: Pattern, chosen: dict[str, Json]) -> Json:
    match pattern:
        case Literal(value):
            return value
        case Variable(name):
            return chosen.setdefault(name, random_value(random, 1))
        case Anything():
            return random_value(random, 1)
        case ObjectPattern(fields):
            return {name: _fitting(random, inner, chosen) for name, inner in fields}
        case ListPattern(items):
            return [_fitting(random, item, chosen) for item in items]


def _merged(one: Json, other: Json) -> Json:
    if isinstance(one, dict) and isinstance(other, dict):
        return {**one, **{name: _merged(one[name], value) if name in one else value for name, value in other.items()}}
    return other


@settings(max_examples=80, deadline=None)
@given(st.integers(min_value=0), st.booleans())
def test_no_event_is_outside_the_letters(seed: int, calculating: bool) -> None:
    """Random questions (nested, lists, equality, guards) and random events that have to do with them."""
    random = Random(seed)
    questions = [random_question(random, calculating=calculating) for _ in range(random.randint(1, 4))]
    try:
        found = letters(questions)
    except TooLarge:
        return
    known = {answers(questions, event) for event in found.events}
    assert len(known) == len(found.events)
    if found.gap:
        return
    for _ in range(100):
        event = random_event(random, questions)
        assert answers(questions, event) in known, (questions, event)


GRIDS = [
    (
        ["{x: X, y: X}", "{x: 1}", '{y: "a"}', "{x: X} when X < 2", "{x: X, y: Y} when X < Y", "{y: Y} when Y != null"],
        [ABSENT, 0, 1, 1.0, 1.5, 2, 3, "a", "b", "", True, False, None, [], [1], {}, {"x": 1}],
    ),
    (
        ["{x: {x: X}, y: X}", "{x: {x: 1}}", "{x: {}}", "{x: [X, Y], y: Y} when X > 1", "{y: Y} when Y >= 2"],
        [ABSENT, 1, 2, 3, "a", {}, {"x": 1}, {"x": 2.0}, {"x": 3, "y": 1}, [1, 1], [2, 1], [2, 2], [3, 3.0], [3], None],
    ),
    (
        ["{x: X} when X * 2 < 3", "{x: 1}", "{x: X, y: Y} when X <= Y", "{x: X, y: Y} when X == Y", "{y: 2}"],
        [ABSENT, 1, 1.25, 1.5, 1.75, 2, 1e308, -1.7e308, 10**400, -(10**400), "a", "b", None, True, [1], {}],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("asked", "values"), GRIDS)
def test_no_event_of_a_grid_is_outside_the_letters(asked: list[str], values: list[Json]) -> None:
    questions = [question(one) for one in asked]
    found = letters(questions)
    assert found.gap == ""
    known = {answers(questions, event) for event in found.events}
    for x, y in product(values, values):
        event = {name: value for name, value in (("x", x), ("y", y)) if value is not ABSENT}
        assert answers(questions, event) in known, event
