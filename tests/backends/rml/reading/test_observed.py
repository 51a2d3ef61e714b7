"""What an RML text asks of events, held against the reader."""

from random import Random

import pytest

from backends.rml.reader.monitor import read
from backends.rml.reader.observations import observed
from cross_check.letters import VARIABLES, answers, letters
from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import ObjectPattern, Variable
from rvaft.model.values import Json
from tests.backends.observing import differing
from tests.backends.rml.reading.programs import Programs, event

CASES = [
    # declarations; uses; the questions, in their order; why
    ("a matches {e:'a'}; b matches {e:'b'};", "a", ['{ e: "a" }'], "what is not used is not asked"),
    ("a(x,y) matches {v:x, w:y};", "a(1,true)", ["{ v: 1, w: true }"], "arguments"),
    ("a(x) matches {v:x, w:_};", "a(1+1)", [], "an argument that is not calculated never matches"),
    ("a(x) matches {v:x} | {w:1};", "a(1+1)", ["{ w: 1 }"], "but the other choice can"),
    ("a matches {v:1|2, w:'x'|'y'};", "a", ['{ v: 1, w: "x" }', '{ v: 1, w: "y" }', '{ v: 2, w: "x" }', '{ v: 2, w: "y" }'], "choices"),
    ("p(x) matches {v:x, w:x}; d matches p(_);", "d", ["{ v: _1, w: _1 }"], "a parameter used twice, called with `_`"),
    ("p(x) matches {v:x}; d matches p('s');", "d", ['{ v: "s" }'], "derived, with a string"),
    ("p(x) matches {v:x}; d matches p({k:[1,_]});", "d", ["{ v: {k: [1, _]} }"], "derived, with a pattern"),
    ("p(x) matches {v:x}; d(y) matches p({k:y, l:y});", "d(3)", ["{ v: {k: 3, l: 3} }"], "with a pattern of its own variables"),
    ("p(x,y) matches {v:x, w:y}; d matches p(z,z);", "d", ["{ v: _1, w: _1 }"], "a name used twice around the use"),
    ("p matches {v:1}; q matches {w:2}; d not matches p | q;", "d", ["{ v: 1 }", "{ w: 2 }"], "`not` asks what it negates"),
    ("p not matches {v:1}; d not matches p | any;", "d", ["{ v: 1 }"], "`any` is no question"),
    ("a matches {v:1};", "none", [], "nor is `none`"),
    ("a matches {v:1};", "any", [], ""),
    ("any matches {v:1};", "any", ["{ v: 1 }"], "a declared `any` is wider"),
    ("a matches {v:1}; a matches {v:2}; a(x) matches {w:x};", "a", ["{ v: 1 }", "{ v: 2 }"], "all declarations of one name and arity"),
    ("a matches {v:1};", "b", [], "an undefined type"),
    ("a matches {v:x} with x > 3;", "a", ["{ v: _1 } when _1 > 3"], "a guard"),
    ("a matches {v:x} with x != 3;", "a", ["{ v: _1 } when _1 < 3 or _1 > 3"], "numbers or strings, nothing else"),
    ("a matches {v:x} with (x > 3) == true;", "a", ["{ v: _1 } when null"], "a truth value equals nothing"),
    ("a(t) matches {v:x} with x >= t + 10;", "a(5)", ["{ v: _1 } when _1 >= 5 + 10"], "a guard with an argument"),
    ("p(x) matches {v:x} with x > 3; d(y) matches p(y) with y < 9;", "d(4)", ["{ v: 4 } when 4 > 3 and 4 < 9"], "guards on the way"),
    ("p(x) matches {v:x}; d matches p(y) with y < 9;", "d", ["{ v: _1 } when _1 < 9"], "a guard around"),
    ("p(x) matches {v:x}; n(x) not matches p(x) with x < 9;", "n(4)", ["{ v: 4 }"], "a guard after `not` asks nothing of events"),
    ("a(x) matches {v:x} | {w:1} with x < 9;", "a(4)", ["{ v: 4 } when 4 < 9", "{ w: 1 } when 4 < 9"], ""),
    ("a matches {v:x} | {w:1} with x < 9;", "a", ["{ v: _1 } when _1 < 9", "{ w: 1 } when null < 9"], "unbound: no value"),
    ("a matches {v:[]};", "a", ["{ v: [] }"], "lists"),
]  # fmt: skip


def questions(text: str) -> list[str] | None:
    found = observed(text)
    if found is None:
        return None
    guards = ["" if one.when is None else f" when {guard_text(one.when)}" for one in found]
    return [pattern_text(one.pattern) + guard for one, guard in zip(found, guards, strict=True)]


@pytest.mark.parametrize(("declarations", "use", "expected", "why"), CASES)
def test_by_hand(declarations: str, use: str, expected: list[str], why: str) -> None:
    text = f"{declarations}\nMain = {use} all;"
    assert questions(text) == expected, why
    _holds(text, Random(why))


def test_a_filter_asks_and_so_do_reachable_equations_only() -> None:
    text = "a matches {e:'a'}; b matches {e:'b'}; c matches {e:'c'};\nMain = a >> B; B = b B; C = c all;"
    assert questions(text) == ['{ e: "a" }', '{ e: "b" }']


@pytest.mark.parametrize("use", ["{let x; a(x) a(x)}", "F<3>"])
def test_variables_of_expressions_are_shared(use: str) -> None:
    text = f"a(x) matches {{v:x, w:y}} with y > x;\nMain = {use} all; F<x> = a(x);"
    shared = Variable("x")
    pattern = ObjectPattern((("v", shared), ("w", Variable("_1"))))
    found = observed(text)
    assert found == (Observed(pattern, Operation(Operator.GT, (Variable("_1"), shared))),)
    assert letters(found).gap == VARIABLES


UNKNOWN = [
    ("a matches {v:[1, ...]};", "a"),
    ("a matches {v:x} with abs(x) > 1;", "a"),
    ("a matches {v:x} with x ^ 2 > 1;", "a"),
    ("p(x) matches {v:x, w:x}; d matches p({k:1});", "d"),
    ("a matches {" + ", ".join(f"v{n}:1|2" for n in range(20)) + "};", "a"),
    ("a matches " + "{v:" * 200 + "1" + "}" * 200 + ";", "a"),
]


@pytest.mark.parametrize(("declarations", "use"), UNKNOWN)
def test_what_a_pattern_cannot_say_is_unknown(declarations: str, use: str) -> None:
    assert observed(f"{declarations}\nMain = {use} all;") is None


def test_a_text_that_cannot_be_read() -> None:
    with pytest.raises(LanguageError):
        observed("Main = ")
    with pytest.raises(LanguageError):
        observed("a matches {};\nMain = A;")


VALUES: tuple[Json, ...] = (
    *(1, 1.0, 2, 3, 4, 5, 9, 15, 16, "s", "x", "y", True, None),
    *([], [1, 2], {"k": 1}, {"k": [1, 2]}, {"k": 3, "l": 3}),
)


def _holds(text: str, random: Random) -> None:
    """Equal answers have equal effects, and no event is outside the letters."""
    asked = observed(text)
    assert asked is not None
    events: list[Json] = [{}]
    for _ in range(150):
        names = random.sample(("v", "w", "e"), random.randint(1, 3))
        same = random.choice(VALUES)
        events.append({name: same if random.random() < 0.3 else random.choice(VALUES) for name in names})
    assert differing(read(text), asked, events) == []
    found = letters(asked)
    assert found.gap == ""
    known = {answers(asked, one) for one in found.events}
    assert all(answers(asked, one) in known for one in events)


def test_equal_answers_have_equal_effects_in_random_programs() -> None:
    """Blocks, generics, filters, `not`, `|` in patterns; with shared variables an answer is the values."""
    asked = 0
    for seed in range(150):
        random = Random(seed)
        text = Programs(random).text()
        try:
            monitor, questions = read(text), observed(text)
        except (LanguageError, TooLarge):
            continue
        if questions is None:
            continue
        asked += 1
        try:
            for _ in range(4):
                assert differing(monitor, questions, [event(random) for _ in range(25)]) == [], text
                monitor.step(event(random))
        except TooLarge:
            continue
    assert asked > 60
