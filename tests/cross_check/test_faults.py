"""The checker is checked: every planted fault shows in the default run, as verdicts that differ on a trace."""

import json
from collections.abc import Iterator
from importlib.util import find_spec

import pytest

from cross_check.campaign import EFFORT, Task, catalogue
from cross_check.comparison import Comparison, Roster
from cross_check.participants import ENGINE, REFERENCE
from cross_check.results import Job, Result, Status
from rvaft.model.verdict import Semantics, Verdict
from tests.cross_check.faults import FAULTS
from tests.cross_check.faults.planting import clear_caches, import_all

BY_NAME = {fault.name: fault for fault in FAULTS}
NEEDS_SPOT = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]


@pytest.fixture(autouse=True)
def nothing_remembered() -> Iterator[None]:
    """What a faulty function has found out must not outlive it, nor what a correct one has."""
    import_all()
    clear_caches()
    yield
    clear_caches()


def default_run(participant: str) -> Iterator[Task]:
    """The comparisons of the run without arguments."""
    roster = Roster(() if participant == ENGINE else (participant,))
    for entry in catalogue():
        for semantics in Semantics:
            yield Task(entry.tree, Job(entry.name, semantics, entry.branch, entry.kind), roster, EFFORT)


def compared(task: Task, participant: str) -> Result:
    """What a comparison says of one participant, with the reference alone."""
    candidates = [one for one in task.roster.candidates(task.tree, task.job) if one[0] in (REFERENCE, participant)]
    results = Comparison(task.tree, task.job, task.effort).run(candidates)
    return next(result for result in results if result.participant == participant)


def test_there_are_enough_faults() -> None:
    assert len(BY_NAME) == len(FAULTS) >= 40


@pytest.mark.parametrize(
    "name",
    [pytest.param(f.name, marks=NEEDS_SPOT if f.participant in ("ltlf", "automaton") else []) for f in FAULTS],
)
def test_a_fault_shows(name: str) -> None:
    fault = BY_NAME[name]
    with pytest.MonkeyPatch.context() as patch:
        fault.plant(patch)
        results = ((task, compared(task, fault.participant)) for task in default_run(fault.participant))
        task, found = next((one for one in results if one[1].status is Status.DIFFERS), (None, None))
    assert task is not None, f"no verdict differs: {fault.why}"
    assert found is not None
    difference = found.difference
    assert difference is not None
    assert difference.expected != difference.got
    print(f"{fault.name}: {task.job.title}, {task.job.semantics}, differs after {len(difference.trace)} events")
    print(f"  expected {symbols(difference.expected)}, got {symbols(difference.got)}")
    for event in difference.trace:
        print(f"  {json.dumps(event)}")
    clear_caches()
    assert compared(task, fault.participant).status.agrees, "it differs without the fault too"


def symbols(verdicts: tuple[Verdict, ...]) -> str:
    return "".join(verdict.symbol for verdict in verdicts)
