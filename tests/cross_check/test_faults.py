"""The checker is checked: every planted fault shows in the default run, as verdicts that differ on a trace."""

import json
from collections.abc import Iterator

import pytest

from cross_check.catalogue import EFFORT, catalogue
from cross_check.comparison import Comparison
from cross_check.participants import ENGINE, REFERENCE
from cross_check.results import Job, Result, Status
from cross_check.roster import Roster
from rvaft.verdict import Semantics
from tests.cross_check.faults import FAULTS
from tests.cross_check.faults.planting import clear_caches, import_all

BY_NAME = {fault.name: fault for fault in FAULTS}
PARTICIPANTS = sorted({fault.participant for fault in FAULTS})


@pytest.fixture(autouse=True)
def nothing_remembered() -> Iterator[None]:
    """What a faulty function has found out must not outlive it, nor what a correct one has."""
    import_all()
    clear_caches()
    yield
    clear_caches()


def default_run(participant: str) -> Iterator[Result]:
    """What the run without arguments says of one participant: each of its comparisons, with the reference alone."""
    roster = Roster(() if participant == ENGINE else (participant,))
    for entry in catalogue():
        for semantics in Semantics:
            job = Job(entry.name, semantics, entry.branch, entry.kind)
            candidates = [one for one in roster.candidates(entry.tree, job) if one[0] in (REFERENCE, participant)]
            results = Comparison(entry.tree, job, EFFORT).run(candidates)
            yield next(result for result in results if result.participant == participant)


def test_there_are_enough_faults() -> None:
    assert len(BY_NAME) == len(FAULTS) >= 40


@pytest.mark.parametrize("name", BY_NAME)
def test_a_fault_shows(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fault = BY_NAME[name]
    fault.plant(monkeypatch)
    found = next((one for one in default_run(fault.participant) if one.status is Status.DIFFERS), None)
    assert found is not None, f"no verdict differs: {fault.why}"
    difference = found.difference
    assert difference is not None
    assert difference.expected != difference.got
    print(f"{fault.name}: {found.job.title}, {found.job.semantics}, after {len(difference.trace)} events")
    print(
        f"  expected {''.join(v.symbol for v in difference.expected)}, got {''.join(v.symbol for v in difference.got)}"
    )
    for event in difference.trace:
        print(f"  {json.dumps(event)}")


@pytest.mark.parametrize("participant", PARTICIPANTS)
def test_without_a_fault_nothing_shows(participant: str) -> None:
    assert not [result for result in default_run(participant) if result.status is Status.DIFFERS]
