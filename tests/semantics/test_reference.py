"""The reference against the hand-written table."""

import pytest

import rvaft
from rvaft.semantics import Reference
from tests.semantics.cases import CASES, Case


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Case) -> None:
    monitor = Reference(rvaft.loads(case.tree), case.semantics, branch=case.branch, kind=case.kind)
    assert monitor.verdict.value == "unknown"
    assert [verdict.value for verdict in monitor.run(case.events)] == case.values
