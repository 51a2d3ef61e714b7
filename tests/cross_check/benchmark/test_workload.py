"""What is compared."""

from collections import Counter

import pytest

import rvaft
from cross_check.benchmark import Subject, cells_of, default_languages, gate_subjects
from cross_check.benchmark.measurement import EVENTS, LONGEST, walks
from rvaft.engine import Engine
from rvaft.errors import OptionError
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics, Verdict
from rvaft.rules import require_valid
from tests.cli.runs import PRUNED

SUBJECTS = {subject.name: subject for subject in gate_subjects(max_arity=8)}


def test_every_gate_with_every_number_of_children_and_every_threshold() -> None:
    subjects = list(gate_subjects(max_arity=12))
    counts = Counter(subject.gate for subject in subjects)
    assert counts == {gate: 78 if gate is Gate.VOT else 12 for gate in Gate}
    votes = [(subject.threshold, len(subject.tree.occurrences)) for subject in subjects if subject.gate is Gate.VOT]
    assert votes == [(k, n) for n in range(1, 13) for k in range(1, n + 1)]
    assert len({subject.name for subject in subjects}) == len({subject.digest for subject in subjects}) == len(subjects)
    for subject in subjects:
        require_valid(subject.tree)


def test_cells_are_in_order() -> None:
    cells = cells_of(gate_subjects([Gate.AND], 2), iter(Semantics), iter(["rml", "ltlf"]))
    assert [(cell.subject.name, cell.semantics, cell.language) for cell in cells] == [
        (name, semantics, language)
        for name in ("and 1", "and 2")
        for semantics in Semantics
        for language in ("rml", "ltlf")
    ]


@pytest.mark.parametrize(
    ("subjects", "semantics", "languages"),
    [
        ([], [Semantics.STRICT], ["rml"]),
        ([SUBJECTS["or 1"]], [], ["rml"]),
        ([SUBJECTS["or 1"]], [Semantics.STRICT], []),
    ],
)
def test_a_comparison_of_nothing_is_refused(subjects: list, semantics: list, languages: list) -> None:  # type: ignore[type-arg]
    with pytest.raises(OptionError, match="nothing to compare"):
        cells_of(subjects, semantics, languages)


def test_trees_that_would_be_called_the_same_are_refused() -> None:
    gate = SUBJECTS["and 2"]
    with pytest.raises(OptionError, match=r"2 trees are called and 2: .* as \./and 2"):
        cells_of([gate, Subject("and 2", gate.tree)], [Semantics.STRICT], ["rml"])


def test_the_languages_of_a_comparison() -> None:
    """All but the second form of another one; the one that is not faithful is beside the others."""
    assert default_languages() == ("automaton", "ltlf", "rml", "rml-paper")


@pytest.mark.parametrize("semantics", Semantics)
def test_walks(semantics: Semantics) -> None:
    """The same for the same seed, all of them of use, and with the verdicts of the tree."""
    tree = rvaft.load(PRUNED)
    found = walks(tree, semantics, 5)
    assert found == walks(tree, semantics, 5)
    assert found != walks(tree, semantics, 6)
    assert sum(len(walk.events) for walk in found) == EVENTS
    for walk in found:
        assert 0 < len(walk.events) <= LONGEST
        assert tuple(Engine(tree, semantics).run(walk.events)) == walk.verdicts
        assert not any(verdict.final for verdict in walk.verdicts[:-1])
    assert any(walk.verdicts[-1] is Verdict.TRUE for walk in found)


@pytest.mark.parametrize("gate", Gate)
@pytest.mark.parametrize("semantics", Semantics)
def test_walks_through_gates_detect_or_lose_all_hope(gate: Gate, semantics: Semantics) -> None:
    tree = SUBJECTS["vot 3/5" if gate is Gate.VOT else f"{gate} 5"].tree
    ends = Counter(walk.verdicts[-1] for walk in walks(tree, semantics, 0))
    assert ends[Verdict.UNKNOWN] <= 1  # the last, which ends where the events do
    hopeless = semantics is Semantics.STRICT or (semantics is Semantics.PROJECTED and gate is not Gate.OR)
    assert (ends[Verdict.FALSE] >= len(list(ends.elements())) // 4 - 1) if hopeless else ends[Verdict.FALSE] == 0
    assert ends[Verdict.TRUE] >= ends.total() // 2


def test_walks_end_in_time() -> None:
    tree = SUBJECTS["and 5"].tree
    assert walks(tree, Semantics.STRICT, 0, seconds=0) == ()
    assert 0 < len(walks(tree, Semantics.STRICT, 0, seconds=0.002)) < len(walks(tree, Semantics.STRICT, 0))
