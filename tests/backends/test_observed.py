"""Random trees through the suite, and what backends say that their texts ask of events: no event is outside of it."""

from random import Random

import pytest

from backends import conformance
from backends.conformance import Example
from cross_check.generate.traces import random_event
from cross_check.generate.trees import VARIABLE_FREE, Shape, random_tree
from cross_check.generate.values import fitting, interesting_values
from cross_check.letters import VARIABLES, answers, letters
from rvaft import RVAFT, NotExpressible, Semantics, TooLarge, TreeError
from rvaft.backend import Observed, backend
from rvaft.model.patterns import variables
from rvaft.model.values import Json
from rvaft.semantics import Reference
from tests.tables import part_and_whole, sampled

SHAPE = Shape(max_nodes=7, variables=0, typed_events=0.8, guards=0.4, ignores=0.6)
BACKENDS = ["rml", "rml-paper", *(pytest.param(name, marks=pytest.mark.spot) for name in ("ltlf", "automaton"))]


def pool(random: Random, tree: RVAFT, size: int) -> list[Json]:
    """Events that fit patterns or nearly do, those that a tree ignores included, and variants with
    one more or one less field.
    """
    values = interesting_values(tree)
    events = [random_event(random, tree, values) for _ in range(size)]
    events += [fitting(random, tree.instantiate(one.on), values) for one in tree.ignores for _ in range(size // 3)]
    events += [{**event, "more": 1} for event in events[: size // 3]]
    return [{}, {"noise": 1}, *events]


def asked(name: str, tree: RVAFT, semantics: Semantics) -> tuple[Observed, ...] | None:
    """What the text of a tree asks; None where it has none (`rml-paper` finds no branch in some valid trees)."""
    if name in ("ltlf", "automaton"):
        pytest.importorskip("spot")
    try:
        return backend(name).observed(backend(name).translate(tree, semantics).text)
    except (NotExpressible, TooLarge, TreeError):
        return None


@pytest.mark.parametrize("count", part_and_whole(4, 30))
@pytest.mark.parametrize("name", BACKENDS)
def test_random_trees_conform_and_equal_answers_have_equal_effects(name: str, count: int) -> None:
    trees = []
    for seed in range(count):
        random = Random(seed)
        tree = random_tree(random, SHAPE if seed % 4 else VARIABLE_FREE)
        questions = asked(name, tree, Semantics.PROJECTED)
        if questions is not None:
            assert all(word.startswith("_") for question in questions for word in variables(question.pattern))
            trees.append(Example(str(seed), tree, tuple(pool(random, tree, 9))))
    report = conformance.run(backend(name), Reference, required=lambda *_: False, trees=trees, words=4)
    wrong = [failure for failure in report.failures if name != "rml-paper" or failure.check == "observed"]
    assert wrong == []
    assert report.translations >= count or name == "rml-paper"


@pytest.mark.parametrize("name", sampled(BACKENDS, 3))
def test_no_event_is_outside_the_letters_of_a_text_and_variables_are_told(name: str) -> None:
    complete = told = 0
    for seed in range(50):
        random = Random(seed)
        tree = random_tree(random, SHAPE)
        questions = asked(name, tree, Semantics.PROJECTED)
        found = letters(questions or ())
        assert found.gap != VARIABLES
        if questions is not None and not found.gap:
            complete += 1
            known = {answers(questions, event) for event in found.events}
            for event in pool(random, tree, 60):
                assert answers(questions, event) in known, (seed, event)
        tree = random_tree(Random(seed), Shape(max_nodes=4, variables=1, typed_events=1, guards=0.3))
        questions = asked(name, tree, Semantics.STRICT)
        told += questions is not None and bool(tree.variables) and letters(questions).gap != ""
    assert complete >= 10
    assert told >= 2
