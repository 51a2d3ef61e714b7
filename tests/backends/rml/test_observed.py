"""What an RML text asks of events, held against the reader."""

from random import Random

import pytest

from backends.rml import RmlBackend
from cross_check.letters import VARIABLES, answers, letters
from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import ObjectPattern, Variable
from rvaft.model.values import Json
from tests.backends.observing import differing
from tests.backends.rml.programs import Programs, event
from tests.tables import rows

read, observed = RmlBackend().read, RmlBackend().observed


def questions(text: str) -> list[str] | None:
    found = observed(text)
    if found is None:
        return None
    guards = ["" if one.when is None else f" when {guard_text(one.when)}" for one in found]
    return [pattern_text(one.pattern) + guard for one, guard in zip(found, guards, strict=True)]


@pytest.mark.parametrize(("declarations", "use", "expected", "why"), rows(__file__, "observed.txt"))
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
    for seed in range(80):
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
    assert asked > 30
