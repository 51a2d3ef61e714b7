"""Where the paper's translation is known to differ from the meaning: each row of `known.txt` is
told, found, and shrunk to what it has there.
"""

import pytest

from cross_check.campaign import Task
from cross_check.comparison import Roster
from cross_check.counterexamples import shrunk
from cross_check.participants import verdicts_of
from cross_check.results import Job, Status
from cross_check.traces import Effort
from rvaft import Semantics, dumps, loads
from tests.tables import rows

KNOWN = {what.partition(":")[0]: row for what, *row in rows(__file__, "known.txt")}


@pytest.mark.parametrize("known", KNOWN)
def test_the_paper_s_translation_differs(known: str) -> None:
    text, trace, reference, paper, small, left = KNOWN[known]
    task = Task(loads(text), Job("known", Semantics.STRICT), Roster(backends=("rml-paper",)), Effort())
    said = {name: verdicts_of(enlist(), trace) for name, enlist in task.roster.candidates(task.tree, task.job)}
    signs = {"reference": reference, "engine": reference, "rml-paper": paper}
    assert {name: "".join(one.symbol for one in verdicts) for name, verdicts in said.items()} == signs  # type: ignore[union-attr]
    (differing,) = [result for result in task.run() if result.status is Status.DIFFERS]
    assert differing.participant == "rml-paper"
    case = shrunk(task, differing)
    assert (dumps(case.tree), list(case.trace)) == (small, left)
    assert set(case.verdicts) == {"reference", "rml-paper"}
    assert case.specifications["rml-paper"][0] == "rml"
