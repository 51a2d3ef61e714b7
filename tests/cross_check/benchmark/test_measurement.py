"""What is measured: sizes, traces and speeds; the three words, and what goes wrong."""

import multiprocessing
import time
from contextlib import closing
from typing import Any, ClassVar

import pytest

import rvaft
from backends.rml.reader.monitor import RmlMonitor, rules
from cross_check.benchmark import Cell, Measurement, Outcome, Settings, Subject, gate_subjects, measured, measurement
from cross_check.benchmark.measurement import EVENTS, READERS, walks
from rvaft.backend import backend
from rvaft.model.nodes import Gate
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from tests.cli.runs import PRUNED
from tests.cross_check.benchmark.backends_of_others import (
    Odd,
    broken,
    endless,
    greedy,
    killed,
    plant,
    reading,
    waiting,
)

SUBJECTS = {subject.name: subject for subject in gate_subjects(max_arity=8)}


def one(cell: Cell, settings: Settings | None = None) -> Measurement:
    ((_, row),) = measured([cell], settings or Settings())
    return row


def odd_cell(semantics: Semantics = Semantics.STRICT) -> Cell:
    return Cell(SUBJECTS["and 2"], semantics, "odd")


def test_what_a_language_cannot_say() -> None:
    row = one(Cell(SUBJECTS["and 2"], Semantics.SCATTERED, "rml-paper"))
    assert (row.result, row.reason, row.run) == (Outcome.NOT_EXPRESSIBLE, "the paper does not say how", None)
    assert row.symbols is row.seconds is row.events is None


def test_what_is_larger_than_the_limit() -> None:
    row = one(Cell(SUBJECTS["and 8"], Semantics.STRICT, "automaton"), Settings(limit=20))
    assert row.result is Outcome.TOO_LARGE
    assert "(limit 20)" in row.reason
    assert row.limit == 20


def test_a_translation_that_takes_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(translating=endless))
    start = time.monotonic()
    row = one(odd_cell(), Settings(timeout=0.2))
    assert time.monotonic() - start < 5
    assert (row.result, row.reason, row.run, row.symbols) == (Outcome.TIMEOUT, "not within 0.2 s", None, None)


def test_a_reader_that_takes_too_long_does_not_cost_the_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, reading(endless))
    row = one(odd_cell(), Settings(timeout=1))
    assert (row.result, row.symbols, row.run, row.run_reason) == (Outcome.OK, 7, Outcome.TIMEOUT, "not within 1 s")
    assert row.events_per_second is None


def test_time_is_that_of_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever only waits is ended by the clock, a good while later."""
    plant(monkeypatch, Odd(translating=waiting))
    monkeypatch.setattr(measurement, "GRACE", 0)
    start = time.monotonic()
    row = one(odd_cell(), Settings(timeout=0.02))
    assert 0.2 <= time.monotonic() - start < 5
    assert (row.result, row.reason) == (Outcome.TIMEOUT, "not within 0.2 s by the clock")


def test_a_run_has_the_time_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, reading(endless))
    start = time.monotonic()
    one(odd_cell(), Settings(timeout=0.3))
    assert time.monotonic() - start < 5


@pytest.mark.parametrize("odd", [Odd(translating=greedy), reading(greedy)], ids=["translating", "reading"])
def test_what_needs_more_memory(monkeypatch: pytest.MonkeyPatch, odd: Odd, capfd: pytest.CaptureFixture[str]) -> None:
    plant(monkeypatch, odd)
    row = one(odd_cell(), Settings(memory=5000))
    assert Outcome.TOO_LARGE in (row.result, row.run)
    assert "megabytes of memory (limit 5000)" in (row.reason, row.run_reason)
    assert capfd.readouterr().err == ""


def test_events_are_not_found_at_the_expense_of_a_language(monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*arguments: Any, **options: Any) -> Any:
        end = time.thread_time() + 0.6
        while time.thread_time() < end:
            pass
        return walks(*arguments, **options)

    monkeypatch.setattr(measurement, "walks", slow)
    row = one(Cell(SUBJECTS["and 1"], Semantics.STRICT, "rml"), Settings(timeout=0.5))
    assert (row.run, row.events) == (Outcome.OK, 240)


def test_a_tree_that_is_too_much_for_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "walks", lambda *_arguments, **_options: endless())
    monkeypatch.setattr(measurement, "WALKING", 0.05)
    row = one(Cell(SUBJECTS["and 1"], Semantics.STRICT, "rml"))
    assert (row.run, row.walks, row.events, row.events_per_second) == (Outcome.OK, 0, 0, None)
    assert row.run_reason.startswith("no events: ")


def test_a_process_that_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(translating=killed))
    row = one(odd_cell())
    assert (row.result, row.reason) == (Outcome.FAILED, "the process that measured it was killed (SIGKILL)")
    plant(monkeypatch, reading(killed))
    row = one(odd_cell())
    assert (row.result, row.run) == (Outcome.OK, Outcome.FAILED)


def test_a_backend_with_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(translating=broken))
    row = one(odd_cell())
    assert (row.result, row.reason) == (Outcome.FAILED, "ZeroDivisionError: a defect of somebody")


def test_a_backend_that_is_not_there() -> None:
    assert one(odd_cell()).result is Outcome.FAILED


def test_several_at_a_time_hinder_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(translating=endless))
    cells = [odd_cell(), *(Cell(SUBJECTS[f"and {n}"], Semantics.STRICT, "rml") for n in range(1, 6))]
    rows = dict(measured(cells, Settings(timeout=1.5), jobs=2))
    assert set(rows) == set(cells)
    assert [rows[cell].result for cell in cells] == [Outcome.TIMEOUT, *[Outcome.OK] * 5]


def test_nothing_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(translating=endless))
    cells = [Cell(SUBJECTS["and 1"], Semantics.STRICT, "rml"), odd_cell(), odd_cell(Semantics.PROJECTED)]
    with closing(measured(cells, Settings(), jobs=3)) as found:
        next(found)
        assert multiprocessing.active_children()
    assert not multiprocessing.active_children()


@pytest.mark.spot
@pytest.mark.parametrize("language", ["automaton", "ltlf", "rml", "rml-paper"])
def test_a_whole_measurement(language: str) -> None:
    pytest.importorskip("spot") if language in ("automaton", "ltlf") else None
    last = one(Cell(SUBJECTS["vot 2/3"], Semantics.PROJECTED, language), Settings(seed=3))
    assert (last.result, last.run) == (Outcome.OK, Outcome.OK)
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
        one(Cell(Subject("pruned", tree), Semantics.PROJECTED, language)) for language in ("rml-paper", "rml")
    )
    assert wrong.differing
    assert right.differing == 0
    assert wrong.walks == right.walks


class Slow(Monitor):
    """A reader that is slow with what the process has not met before."""

    met: ClassVar[set[str]] = set()

    def _advance(self, event: Json) -> Verdict:
        end = time.thread_time() + (0.002 if str(event) not in self.met else 0)
        while time.thread_time() < end:
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
    row = one(Cell(SUBJECTS["or 5"], Semantics.STRICT, "odd"))
    assert row.first_events == READERS
    assert row.events_per_second is not None
    assert row.again_per_second is not None
    assert row.events_per_second <= 500
    assert row.again_per_second > 5000


@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_a_text_that_never_says_that_hope_is_lost_is_found(
    monkeypatch: pytest.MonkeyPatch, semantics: Semantics
) -> None:
    subject = SUBJECTS["sand 4"]
    text = backend("rml").translate(subject.tree, semantics).text
    plant(monkeypatch, Odd(reader=lambda _text: Deaf(rules(text))))
    row = one(Cell(subject, semantics, "odd"))
    assert row.walks is not None
    assert row.differing is not None
    assert 0 < row.differing < row.walks
