"""What backends say that their texts ask of events, held against their readers: equal answers, equal effects."""

from collections.abc import Mapping
from random import Random

import pytest

from backends import conformance
from backends.conformance import examples
from backends.rml import RmlBackend
from cross_check.generate.traces import random_event
from cross_check.generate.trees import VARIABLE_FREE, Shape, random_tree
from cross_check.generate.values import fitting, interesting_values
from cross_check.letters import VARIABLES, answers, letters
from rvaft.backend import Observed, backend
from rvaft.errors import NotExpressible, TooLarge, TreeError
from rvaft.model.patterns import Pattern, variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.observing import differing

SHAPE = Shape(max_nodes=7, variables=0, typed_events=0.8, guards=0.4, ignores=0.6)
BACKENDS = ["rml", "rml-paper", *(pytest.param(name, marks=pytest.mark.spot) for name in ("ltlf", "automaton"))]


REFUSALS = (NotExpressible, TooLarge, TreeError)
"""`rml-paper` finds no branch in some valid trees."""


def pool(random: Random, tree: RVAFT, size: int) -> list[Json]:
    """Events that fit patterns or nearly do, those that a tree ignores included, and variants with one more or one less field."""
    values = interesting_values(tree)
    events = [random_event(random, tree, values) for _ in range(size)]
    events += [fitting(random, tree.instantiate(one.on), values) for one in tree.ignores for _ in range(size // 3)]
    events += [{**event, "more": 1} for event in events[: size // 3]]
    return [{}, {"noise": 1}, *events]


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("semantics", list(Semantics))
def test_equal_answers_have_equal_effects(name: str, semantics: Semantics) -> None:
    if name in ("ltlf", "automaton"):
        pytest.importorskip("spot")
    made, compared = backend(name), 0
    for seed in range(40):
        random = Random(f"{seed} {semantics}")
        tree = random_tree(random, SHAPE if seed % 4 else VARIABLE_FREE)
        try:
            specification = made.translate(tree, semantics)
        except REFUSALS:
            continue
        questions = made.observed(specification.text)
        assert questions is not None
        assert all(name.startswith("_") for question in questions for name in variables(question.pattern))
        events = pool(random, tree, 30)
        compared += 1
        for _ in range(3):
            monitor = specification.monitor()
            for event in random.sample(events, random.randint(0, 3)):
                monitor.step(event)
            assert differing(monitor, questions, events) == [], (seed, specification.text)
    assert compared >= 15 or name == "rml-paper"


@pytest.mark.parametrize("name", BACKENDS)
def test_no_event_is_outside_the_letters_of_a_text(name: str) -> None:
    if name in ("ltlf", "automaton"):
        pytest.importorskip("spot")
    made, complete = backend(name), 0
    for seed in range(40):
        random = Random(seed)
        tree = random_tree(random, SHAPE)
        try:
            questions = made.observed(made.translate(tree, Semantics.PROJECTED).text)
            assert questions is not None
            found = letters(questions)
        except REFUSALS:
            continue
        if found.gap:
            assert found.gap != VARIABLES
            continue
        complete += 1
        known = {answers(questions, event) for event in found.events}
        for event in pool(random, tree, 60):
            assert answers(questions, event) in known, (seed, event)
    assert complete >= 10


@pytest.mark.parametrize("name", BACKENDS)
def test_variables_are_told(name: str) -> None:
    if name in ("ltlf", "automaton"):
        pytest.importorskip("spot")
    made, told = backend(name), 0
    for seed in range(30):
        tree = random_tree(Random(seed), Shape(max_nodes=4, variables=1, typed_events=1, guards=0.3))
        try:
            questions = made.observed(made.translate(tree, Semantics.STRICT).text)
        except REFUSALS:
            continue
        if questions is not None and tree.variables:
            told += letters(questions).gap != ""
    assert told >= 3


class Forgetful(RmlBackend):
    """Keeps its last question to itself."""

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:
        found = super().observed(text, atoms=atoms)
        return None if found is None else found[:-1]


def test_conformance_finds_a_question_that_is_left_out() -> None:
    report = conformance.run(Forgetful(), Reference, trees=[*examples()][:3], words=6)
    assert {failure.check for failure in report.failures} == {"observed"}
