"""What is measured: sizes against what is known of them, traces, speeds."""

from collections import Counter
from math import comb
from time import thread_time
from typing import ClassVar

import pytest

import rvaft
from backends.rml.reader.monitor import RmlMonitor, RmlRules
from cross_check.benchmark import Cell, Outcome, Row, Settings, Subject
from cross_check.benchmark.measurement import READERS, stages
from cross_check.benchmark.plan import EVENTS, LONGEST, gate_subject, walks
from rvaft.backend import backend
from rvaft.engine import engine
from rvaft.model.nodes import Gate
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from tests.cli.runs import PRUNED
from tests.comparison.backends_of_others import Odd, plant


def sized(gate: Gate, children: int, semantics: Semantics, language: str, threshold: int | None = None) -> Row:
    """The first that is known: no text is read, so no reader is needed."""
    return next(stages(Cell(gate_subject(gate, children, threshold), semantics, language), Settings(), ()))


def whole(subject: Subject, semantics: Semantics, language: str, seed: int = 0) -> list[Row]:
    found = walks(subject.tree, semantics, seed)
    return list(stages(Cell(subject, semantics, language), Settings(seed=seed), found))


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
    pytest.importorskip("spot") if language in ("automaton", "ltlf") else None
    first, second, last = whole(gate_subject(Gate.VOT, 3, 2), Semantics.PROJECTED, language, seed=3)
    assert (first.result, first.run, first.over) == (Outcome.OK, None, False)
    assert (last.result, last.run, last.over) == (Outcome.OK, Outcome.OK, True)
    assert first.symbols == second.symbols == last.symbols
    assert (last.tree, last.gate, last.children, last.threshold) == ("vot 2/3", Gate.VOT, 3, 2)
    assert (last.events, last.differing, last.seed) == (EVENTS, 0, 3)
    assert last.first_events is not None
    assert 1 <= last.first_events <= EVENTS
    for number in (last.seconds, last.read_seconds, last.events_per_second, last.again_per_second):
        assert number is not None
        assert 0 < number < float("inf")


def test_the_papers_translation_is_caught() -> None:
    """Its union of branches commits to the first, and misses what the others would detect."""
    tree = rvaft.load(PRUNED)
    wrong, right = (
        whole(Subject("pruned", tree), Semantics.PROJECTED, language)[-1] for language in ("rml-paper", "rml")
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
def test_walks_through_gates_detect_or_lose_all_hope(gate: Gate, semantics: Semantics) -> None:
    tree = gate_subject(gate, 5, 3 if gate is Gate.VOT else None).tree
    ends = Counter(walk.verdicts[-1] for walk in walks(tree, semantics, 0))
    assert ends[Verdict.UNKNOWN] <= 1  # the last, which ends where the events do
    hopeless = semantics is Semantics.STRICT or (semantics is Semantics.PROJECTED and gate is not Gate.OR)
    assert (ends[Verdict.FALSE] >= len(list(ends.elements())) // 4 - 1) if hopeless else ends[Verdict.FALSE] == 0
    assert ends[Verdict.TRUE] >= ends.total() // 2


def test_walks_end_in_time() -> None:
    tree = gate_subject(Gate.AND, 5).tree
    assert walks(tree, Semantics.STRICT, 0, seconds=0) == ()
    assert 0 < len(walks(tree, Semantics.STRICT, 0, seconds=0.002)) < len(walks(tree, Semantics.STRICT, 0))


class Slow(Monitor):
    """A reader that is slow with what the process has not met before."""

    met: ClassVar[set[str]] = set()

    def _advance(self, event: Json) -> Verdict:
        end = thread_time() + (0.002 if str(event) not in self.met else 0)
        while thread_time() < end:
            pass
        self.met.add(str(event))
        return Verdict.TRUE

    @property
    def state(self) -> Verdict:
        """Nothing else is remembered of a trace."""
        return self.verdict


class Deaf(RmlMonitor):
    """Never says that no hope is left."""

    def _advance(self, event: Json) -> Verdict:
        verdict = super()._advance(event) if self._term is not None else Verdict.FALSE
        return verdict if verdict is Verdict.TRUE else Verdict.UNKNOWN


def test_the_first_time_is_that_of_readers_that_have_met_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under OR each trace is one event, nearly always one of five: one reader for all of them would have met it."""
    plant(monkeypatch, Odd(reader=lambda _text: Slow()))
    row = whole(gate_subject(Gate.OR, 5), Semantics.STRICT, "odd")[-1]
    assert row.first_events == READERS
    assert row.events_per_second is not None
    assert row.again_per_second is not None
    assert row.events_per_second <= 500
    assert row.again_per_second > 5000


@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_a_text_that_never_says_that_hope_is_lost_is_found(
    monkeypatch: pytest.MonkeyPatch, semantics: Semantics
) -> None:
    subject = gate_subject(Gate.SAND, 4)
    text = backend("rml").translate(subject.tree, semantics).text
    plant(monkeypatch, Odd(reader=lambda _text: Deaf(RmlRules(text))))
    row = whole(subject, semantics, "odd")[-1]
    assert row.walks is not None
    assert row.differing is not None
    assert 0 < row.differing < row.walks
