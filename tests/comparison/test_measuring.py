"""What is measured: sizes against what is known of them, traces, speeds."""

from math import comb

import pytest

import rvaft
from rvaft.comparison import Cell, Outcome, Row, Settings, Subject
from rvaft.comparison.measuring import stages
from rvaft.comparison.plan import gate_subject
from rvaft.comparison.walks import EVENTS, LONGEST, walks
from rvaft.engine import engine
from rvaft.model import Gate
from rvaft.verdict import Semantics, Verdict
from tests.cli.runs import PRUNED


def sized(gate: Gate, children: int, semantics: Semantics, language: str, threshold: int | None = None) -> Row:
    """The first that is known: no text is read, so no reader is needed."""
    return next(stages(Cell(gate_subject(gate, children, threshold), semantics, language), Settings()))


@pytest.mark.parametrize("children", range(2, 7))
def test_the_states_of_and(children: int) -> None:
    assert sized(Gate.AND, children, Semantics.STRICT, "automaton").states == 2**children + 2
    assert sized(Gate.AND, children, Semantics.PROJECTED, "automaton").states == 2**children + 2
    assert sized(Gate.AND, children, Semantics.SCATTERED, "automaton").states == 2**children + 1


@pytest.mark.parametrize("children", range(2, 7))
def test_the_subformulas_of_and(children: int) -> None:
    row = sized(Gate.AND, children, Semantics.SCATTERED, "ltlf")
    assert (row.symbols, row.subformulas) == (3 * children - 1, 2 * children + 1)


@pytest.mark.parametrize(("k", "n"), [(k, n) for n in range(1, 6) for k in range(1, n + 1)])
def test_the_states_of_vot(k: int, n: int) -> None:
    row = sized(Gate.VOT, n, Semantics.SCATTERED, "automaton", k)
    assert row.states == sum(comb(n, size) for size in range(k)) + 2


def test_the_symbols_of_sand() -> None:
    """`Main = (a b c) all` grows by one with each child."""
    sizes = [sized(Gate.SAND, n, Semantics.STRICT, "rml").symbols for n in range(2, 7)]
    assert sizes == [6, 7, 8, 9, 10]


@pytest.mark.spot
@pytest.mark.parametrize("language", ["automaton", "ltlf", "rml", "rml-paper"])
def test_a_whole_measurement(language: str) -> None:
    cell = Cell(gate_subject(Gate.VOT, 3, 2), Semantics.PROJECTED, language)
    first, second, last = stages(cell, Settings(seed=3))
    assert (first.result, first.run, first.over) == (Outcome.OK, None, False)
    assert (last.result, last.run, last.over) == (Outcome.OK, Outcome.OK, True)
    assert first.symbols == second.symbols == last.symbols
    assert (last.tree, last.gate, last.children, last.threshold) == ("vot 2/3", Gate.VOT, 3, 2)
    assert (last.events, last.differing, last.seed) == (EVENTS, 0, 3)
    for number in (last.seconds, last.read_seconds, last.events_per_second, last.again_per_second):
        assert number is not None
        assert 0 < number < float("inf")


def test_the_papers_translation_is_caught() -> None:
    """Its union of branches commits to the first, and misses what the others would detect."""
    tree = rvaft.load(PRUNED)
    wrong, right = (
        list(stages(Cell(Subject("pruned", tree), Semantics.PROJECTED, language), Settings()))[-1]
        for language in ("rml-paper", "rml")
    )
    assert wrong.differing
    assert right.differing == 0
    assert wrong.walks == right.walks


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
        assert tuple(engine(tree, semantics).run(walk.events)) == walk.verdicts
        assert not any(verdict.final for verdict in walk.verdicts[:-1])
    assert any(walk.verdicts[-1] is Verdict.TRUE for walk in found)


@pytest.mark.parametrize("gate", Gate)
@pytest.mark.parametrize("semantics", Semantics)
def test_walks_through_gates_detect(gate: Gate, semantics: Semantics) -> None:
    tree = gate_subject(gate, 5, 3 if gate is Gate.VOT else None).tree
    found = walks(tree, semantics, 0)
    assert sum(walk.verdicts[-1] is Verdict.TRUE for walk in found) >= len(found) - 1
