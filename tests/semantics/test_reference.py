"""The reference against the hand-written table."""

import pytest

import rvaft
from rvaft.semantics import Reference
from tests.semantics.cases import CASES, Case

SIGNS = {"true": "T", "false": "F", "unknown": "?"}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Case) -> None:
    tree = rvaft.loads(case.tree)
    monitor = Reference(tree, case.semantics, branch=case.branch, kind=case.kind)
    assert monitor.verdict.value == "unknown"
    assert "".join(SIGNS[verdict.value] for verdict in monitor.run(case.events)) == case.verdicts
