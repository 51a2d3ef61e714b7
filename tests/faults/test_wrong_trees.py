"""The cross-checker finds everybody who has translated another tree, with the reference alone."""

from functools import partial
from importlib.util import find_spec

import pytest

from cross_check import traces
from cross_check.campaign import Entry, catalogue
from cross_check.comparison import Comparison
from cross_check.participants import ENGINE, REFERENCE, engine_of, faithful_backends, reference_of, translated
from cross_check.results import Job, Result, Status
from rvaft import RVAFT, Semantics
from rvaft.analysis.branches import restrict
from tests.faults.wrong_trees import MISTAKES

CATALOGUE = tuple(catalogue())
PARTICIPANTS = (ENGINE, *faithful_backends())
NEEDS_SPOT = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]


def compared(entry: Entry, semantics: Semantics, participant: str, given: RVAFT) -> Result:
    """What the comparison of a tree says of a participant that was given another one."""
    job = Job(entry.name, semantics, entry.branch, entry.kind)
    expected = partial(reference_of, entry.tree, semantics, branch=entry.branch, kind=entry.kind)
    enlist = partial(engine_of, given) if participant == ENGINE else partial(translated, participant, given)
    candidates = [(REFERENCE, expected), (participant, partial(enlist, semantics))]
    return Comparison(entry.tree, job, traces.CATALOGUE).run(candidates)[1]


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize(
    "participant",
    [pytest.param(name, marks=NEEDS_SPOT if name in ("automaton", "ltlf") else []) for name in PARTICIPANTS],
)
def test_a_wrong_tree_shows(participant: str, mistake: str) -> None:
    for entry in CATALOGUE:
        right = restrict(entry.tree, branch=entry.branch, kind=entry.kind)
        wrong = MISTAKES[mistake](right)
        for semantics in Semantics if wrong != right else ():
            if compared(entry, semantics, participant, wrong).status is Status.DIFFERS:
                assert compared(entry, semantics, participant, right).status.agrees, (
                    "it differs with the right tree too"
                )
                return
    pytest.fail("no verdict differs")
