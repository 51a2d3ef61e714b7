"""The table of observed verdicts, against this reader and (where they are at hand) against the published tools again."""

from pathlib import Path

import pytest

from backends.rml.prolog import prolog
from tests.backends.rml.published.runner import compiled, needs_published, verdicts
from tests.backends.rml.reading.cases import CASES, Case, events
from tests.backends.rml.reading.letters import letters


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_reader_says_what_was_observed(case: Case) -> None:
    assert {trace: letters(case.whole, events(trace)) for trace in case.runs} == case.runs


def test_names_are_distinct_and_every_case_runs() -> None:
    assert len({case.name for case in CASES}) == len(CASES)
    assert all(case.runs for case in CASES)


@pytest.mark.published
@needs_published
def test_the_published_tools_still_say_so(tmp_path: Path) -> None:
    specifications = compiled([case.whole for case in CASES], tmp_path)
    assert [s for s in specifications if isinstance(s, str)] == []
    _check([Path(s) for s in specifications])


@pytest.mark.published
@needs_published
def test_the_published_monitor_says_so_of_our_prolog(tmp_path: Path) -> None:
    specifications = [tmp_path / f"{index}.pl" for index in range(len(CASES))]
    for case, specification in zip(CASES, specifications, strict=True):
        specification.write_text(prolog(case.whole), encoding="utf-8")
    _check(specifications)


def _check(specifications: list[Path]) -> None:
    jobs = [(path, [events(trace) for trace in case.runs]) for path, case in zip(specifications, CASES, strict=True)]
    for case, found in zip(CASES, verdicts(jobs), strict=True):
        assert {trace: run[1:] for trace, run in zip(case.runs, found, strict=True)} == case.runs, case.name
