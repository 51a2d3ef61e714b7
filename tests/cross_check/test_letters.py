"""Letters: every combination of answers that an event can give, and no other."""

from itertools import product
from random import Random
from time import perf_counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cross_check.letters import UNBOUND, VARIABLES, Letters, answers, letters
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Variable
from rvaft.model.values import Json
from tests.cross_check.questions import question, random_event, random_question

ABSENT = object()


def default(name: str) -> Observed:
    return Observed(ObjectPattern((("event", Literal(name)),)))


def words(found: Letters, questions: list[Observed]) -> set[str]:
    return {"".join("01"[one] for one in answers(questions, event)) for event in found.events}


CASES = [
    # questions; the combinations of answers, in their order; why
    ([], "", "nothing is asked: one event"),
    (['{event: "a"}', '{event: "b"}'], "00 10 01", "one value is one literal at most"),
    (["{x: _}", "{y: _}"], "00 10 01 11", "other fields say nothing"),
    (["{x: _}", "{x: 1}", "{x: 1.0}"], "000 100 111", "1 and 1.0 are equal"),
    (["{x: 1}", "{x: true}", '{x: "1"}'], "000 100 010 001", "and nothing else is"),
    (["{}", "{x: 1}"], "10 11", "every event is an object"),
    (["_", "{x: 1}"], "10 11", "`_` as well"),
    (["[_]", "1", "{x: 1}"], "000 001", "and none is a list or a number"),
    (["{x: {y: 1}}", "{x: {z: 1}}", "{x: {}}", "{x: _}"], "0000 0001 0011 1011 0111 1111", "nested"),
    (["{x: [_, 1]}", "{x: [2, _]}", "{x: [_]}", "{x: []}"], "0000 1000 0100 1100 0010 0001", "lists have a length"),
    (["{x: X, y: X}"], "0 1", "a variable used twice"),
    (["{x: X, y: X}", "{x: 1}", "{y: 1}"], "000 100 010 001 111", "no x = y where only one of them is 1"),
    (["{x: X, y: X}", "{x: {a: 1}}", "{y: {b: 1}}"], "000 100 010 110 001 101 011 111", "objects may have more fields"),
    (["{x: X, y: X}", "{x: {}}", "{y: {}}"], "000 100 010 001 011 111", "two objects need not be equal"),
    (["{x: X, y: X}", "{x: []}", "{y: []}"], "000 100 010 001 111", "two empty lists are"),
    (["{x: X, y: X}", "{x: [_]}", "{y: [1]}"], "000 100 010 110 001 011 111", "two lists, if their items are"),
    (["{x: X, y: {a: X}}", "{x: {a: X}, y: X}"], "00 10 01", "no value contains itself"),
    (["{x: X, y: X}", "{y: Y, z: Y}", "{x: Z, z: Z}"], "000 100 010 001 111", "equality is transitive"),
    (["{v: V} when V < 250", "{v: V}"], "00 01 11", "on either side of a bound, and no number"),
    (["{v: V} when V < 250", "{v: V} when V > 250", "{v: _}"], "000 001 101 011", "250 or a string: neither"),
    (["{v: V} when V < 250", "{v: V} when V >= 250", "{v: _}"], "000 001 101 011", "a string: neither"),
    (["{v: V} when V >= 1", "{v: V} when V > 1"], "00 10 11", "on the bound"),
    (["{v: V} when V > 1", "{v: V} when V < 2"], "00 10 01 11", "between neighbouring integers lies 1.5"),
    (["{v: V} when V > 1", "{v: V} when V < 1.0000000000000002"], "00 10 01", "no double lies between two neighbours"),
    (["{v: V} when not V < 1", "{v: V} when V < 1", "{v: _}"], "000 001 101 011", "undefined is not false"),
    (["{v: V} when V == 1", "{v: 1}"], "00 11", ""),
    (["{v: V} when V != 1", "{v: _}"], "00 01 11", ""),
    (["{v: V} when V", "{v: V} when not V", "{v: _}"], "000 001 101 011", "truth values"),
    (["{v: V} when V == null", "{v: _}"], "00 01 11", ""),
    (['{v: V} when V < "b"', '{v: V} when V > "a"', "{v: _}"], "000 001 101 011 111", "strings in between"),
    (['{v: V} when V < "a\\u0000"', '{v: V} when V > "a"'], "00 10 01", "no string in between"),
    (['{v: V} when V < ""', '{v: V} when V <= ""'], "00 01", "nothing is below the empty string"),
    (["{v: V} when V < 1", '{v: V} when V < "a"'], "00 10 01", "a number is no string"),
    (["{v: V, w: W} when V < W", "{v: V, w: W} when V > W", "{v: _, w: _}"], "000 001 101 011", "two values"),
    (["{v: V, w: W} when V == W", "{v: X, w: X}"], "00 11", "a guard and a pattern that say the same"),
    (["{v: V, w: W} when V < W", "{v: 3}", "{w: 3}"], "000 010 001 011 100 110 101", "bounded by literals"),
    (["{v: V, w: W} when V < W", "{v: V} when V > 5", "{w: W} when W < 5"], "000 100 010 001 101 110 011", "and by bounds"),
    (["{v: V, w: W} when V <= W", "{v: V, w: W} when V >= W", "{v: X, w: X}"], "000 001 100 010 111", "null is not ordered"),
    (["{v: V} when V > 1", "{w: W} when W > 1", "{v: X, w: X}"], "000 100 010 110 001 111", "equality across guards"),
    (["{v: V} when V / 2 < 1", "{v: V} when V >= 2"], "00 10 01", "one step of arithmetic"),
    (["{v: V} when V + 1 == 2", "{v: 1}", "{v: _}"], "000 001 101 111", "doubles: 0.9999999999999999 + 1 is 2"),
    (["{v: V} when V * 2 > 3", "{v: V} when V > 1.5", "{v: _}"], "000 001 111 011", "doubles overflow: 1.7e308 * 2 is undefined"),
    (["{v: V} when 1 < 2", "{v: V} when 2 < 1", "{v: _}"], "000 101", "a guard without variables"),
    (["{v: V} when 1 / 0 == 1", "{v: _}"], "00 01", "is never true where it is undefined"),
    (['{x: "~1"}', "{x: _}"], "00 01 11", "a fresh value is none that is asked for"),
    (['{e: "a", v: 1}', '{e: "a", w: 1}'], "00 10 01 11", "one literal in common"),
    (["{v: V} when not V == 1", "{v: [_]}"], "00 10 11", "a value without order is no list that is asked for"),
    (['{v: V} when V < "\\u0000"'], "0 1", "the empty string alone"),
    (
        ["{w: W} when W > 0", "{v: V} when V > 1", "{v: V} when V < 1.0000000000000004"],
        "000 010 011 001 100 110 111 101",
        "one double only, and two guards",
    ),
    (
        [
            "{v: V} when V > 1 and V < 1.0000000000000007",
            "{w: W} when W > 1 and W < 1.0000000000000007",
            "{v: X, w: X}",
            "{u: U} when U > 1",
        ],
        "0000 1000 0100 1100 0010 1110 0001 1001 0101 1101 0011 1111",
        "two doubles, equal or not",
    ),
    (["{v: 9007199254740992}", "{v: V} when V + 1 > 9007199254740992"], "00 01 10 11", "the integer and the double"),
    (["{v: V} when V > 1", "{v: 2, k: _}", "{k: _}"], "000 100 001 101 111", "a value that is no literal elsewhere"),
    (
        ["{v: V} when V > 1", "{v: V} when V < 1.0000000000000004", "{v: 1.0000000000000002, k: _}"],
        "000 010 110 100 111",
        "but that one where there is no other",
    ),
    (["{v: V} when (V < 1) == true", "{v: V} when V < 1"], "00 11", "a condition compared with a truth value"),
]  # fmt: skip


@pytest.mark.parametrize(("asked", "expected", "why"), CASES)
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
