"""Cells in processes: the three words, and what goes wrong."""

import multiprocessing
import os
import time
from contextlib import closing
from typing import Any

import pytest

from cross_check.benchmark import Cell, Outcome, Row, Settings, measured, measurement
from cross_check.benchmark.plan import gate_subject, walks
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from tests.comparison.backends_of_others import Odd, broken, endless, greedy, killed, plant, reading, waiting


def one(cell: Cell, settings: Settings | None = None) -> Row:
    ((_, row),) = measured([cell], settings or Settings())
    return row


def odd_cell(semantics: Semantics = Semantics.STRICT) -> Cell:
    return Cell(gate_subject(Gate.AND, 2), semantics, "odd")


def test_what_a_language_cannot_say() -> None:
    row = one(Cell(gate_subject(Gate.AND, 2), Semantics.SCATTERED, "rml-paper"))
    assert (row.result, row.reason, row.run) == (Outcome.NOT_EXPRESSIBLE, "the paper does not say how", None)
    assert row.symbols is row.seconds is row.events is None


def test_what_is_larger_than_the_limit() -> None:
    row = one(Cell(gate_subject(Gate.AND, 8), Semantics.STRICT, "automaton"), Settings(limit=20))
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


def test_a_run_in_a_fork_has_the_time_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, reading(endless))
    start = time.process_time() + sum(os.times()[2:4])
    one(odd_cell(), Settings(timeout=0.3))
    assert time.process_time() + sum(os.times()[2:4]) - start < 0.9


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
    row = one(Cell(gate_subject(Gate.AND, 1), Semantics.STRICT, "rml"), Settings(timeout=0.5))
    assert (row.run, row.events) == (Outcome.OK, 240)


def test_a_tree_that_is_too_much_for_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "walks", lambda *_arguments, **_options: endless())
    monkeypatch.setattr(measurement, "WALKING", 0.05)
    row = one(Cell(gate_subject(Gate.AND, 1), Semantics.STRICT, "rml"))
    assert (row.run, row.walks, row.events, row.events_per_second) == (Outcome.OK, 0, 0, None)
    assert row.run_reason.startswith("no events: ")


def test_the_three_words_differ() -> None:
    assert {str(word) for word in (Outcome.NOT_EXPRESSIBLE, Outcome.TOO_LARGE, Outcome.TIMEOUT)} == {
        "not expressible",
        "too large",
        "timeout",
    }


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
    cells = [odd_cell(), *(Cell(gate_subject(Gate.AND, n), Semantics.STRICT, "rml") for n in range(1, 6))]
    rows = dict(measured(cells, Settings(timeout=1.5), jobs=2))
    assert set(rows) == set(cells)
    assert [rows[cell].result for cell in cells] == [Outcome.TIMEOUT, *[Outcome.OK] * 5]


def test_nothing_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(translating=endless))
    cells = [Cell(gate_subject(Gate.AND, 1), Semantics.STRICT, "rml"), odd_cell(), odd_cell(Semantics.PROJECTED)]
    with closing(measured(cells, Settings(), jobs=3)) as found:
        next(found)
        assert multiprocessing.active_children()
    assert not multiprocessing.active_children()
