"""What an RML text asks of events, held against the reader."""

from collections.abc import Iterable
from contextlib import suppress
from random import Random

import pytest

from backends.conformance.suite import _answer, _effect
from backends.rml import RmlBackend
from cross_check.letters import VARIABLES, letters
from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import ObjectPattern, Variable
from rvaft.model.values import Json
from rvaft.monitors import Monitor
from tests.backends.rml.programs import Programs, event
from tests.tables import rows

read, observed = RmlBackend().read, RmlBackend().observed


@pytest.mark.parametrize(("declarations", "use", "expected", "why"), rows(__file__, "observed.txt"))
def test_by_hand(declarations: str, use: str, expected: list[str], why: str) -> None:
    found = observed(f"{declarations}\nMain = {use} all;")
    assert found is not None
    asked = [pattern_text(one.pattern) + (f" when {guard_text(one.when)}" if one.when else "") for one in found]
    assert asked == expected, why


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
    ("a matches {v:x} with sin(x) > 1;", "a"),
    ("a matches {v:x} with x ^ 2 > 1;", "a"),
    ("p(x) matches {v:x, w:x}; d matches p({k:1});", "d"),
    ("a matches {" + ", ".join(f"v{n}:1|2" for n in range(20)) + "};", "a"),
    ("a matches " + "{v:" * 200 + "1" + "}" * 200 + ";", "a"),
]


@pytest.mark.parametrize(("declarations", "use"), UNKNOWN)
def test_what_a_pattern_cannot_say_is_unknown(declarations: str, use: str) -> None:
    assert observed(f"{declarations}\nMain = {use} all;") is None


def differing(monitor: Monitor, questions: Iterable[Observed], some: Iterable[Json]) -> list[tuple[Json, Json]]:
    """Pairs of events with equal answers after which the monitor is not the same."""
    first: dict[tuple[object, ...], tuple[Json, object]] = {}
    known = [
        (first.setdefault(tuple(_answer(q, one) for q in questions), (one, _effect(monitor, one))), one) for one in some
    ]
    return [(before, one) for (before, effect), one in known if _effect(monitor, one) != effect]


def test_equal_answers_have_equal_effects_in_random_programs() -> None:
    """Blocks, generics, filters, `not`, `|` in patterns; with shared variables an answer is the values."""
    asked = 0
    for seed in range(80):
        random = Random(seed)
        text = Programs(random).text()
        with suppress(LanguageError, TooLarge):
            monitor, questions = read(text), observed(text)
            asked += questions is not None
            for _ in range(4 if questions is not None else 0):
                assert differing(monitor, questions or (), [event(random) for _ in range(25)]) == [], text
                monitor.step(event(random))
    assert asked > 30
