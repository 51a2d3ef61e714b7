"""What an RML text asks of events, held against the reader."""

from collections.abc import Iterable
from random import Random

import pytest

from backends.rml import RmlBackend
from cross_check.letters import VARIABLES, letters
from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Operation, Operator, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import ObjectPattern, Variable, match, variables
from rvaft.model.values import Json
from rvaft.monitors import Monitor
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
    assert questions(f"{declarations}\nMain = {use} all;") == expected, why


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


def answer(question: Observed, event: Json) -> object:
    """The answer; where other events share variables, all values that the event gives."""
    binding = match(question.pattern, event, {})
    names = (*variables(question.pattern), *(() if question.when is None else guard_variables(question.when)))
    if binding is None or any(not name.startswith("_") for name in names):
        return None if binding is None else tuple((name, repr(value)) for name, value in binding.items())
    return question.when is None or holds(question.when, binding)


def differing(monitor: Monitor, questions: Iterable[Observed], some: Iterable[Json]) -> list[tuple[Json, Json]]:
    """Pairs of events with equal answers after which the monitor is not the same."""
    first: dict[tuple[object, ...], tuple[Json, object]] = {}
    found = []
    for one in some:
        after = monitor.fork()
        effect = after.step(one), after.state
        known = first.setdefault(tuple(answer(question, one) for question in questions), (one, effect))
        found += [(known[0], one)] if known[1] != effect else []
    return found


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
