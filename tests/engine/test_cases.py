"""The engine against the hand-written cases, and which of several matches it explains."""

import pytest

import rvaft
from rvaft.core.restriction import restrict
from rvaft.engine import Engine
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.checking import compare, matched_occurrences
from tests.semantics.cases import CASES, Case
from tests.tables import rows


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Case) -> None:
    """The verdicts written down, and under every semantics those of the reference, with the explanation."""
    tree = rvaft.loads(case.tree)
    monitor = Engine(restrict(tree, branch=case.branch, kind=case.kind), case.semantics)
    assert (monitor.verdict, monitor.explanation) == (Verdict.UNKNOWN, None)
    assert [verdict.value for verdict in monitor.run(case.events)] == case.values
    for semantics in Semantics:
        compare(tree, case.events, semantics, branch=case.branch, kind=case.kind)


@pytest.mark.parametrize(("tree", "word", "branch", "matched"), rows(__file__, "lowest.txt"))
def test_the_explanation_is_of_the_lowest_branch(tree: str, word: str, branch: int, matched: dict[str, int]) -> None:
    monitor = compare(rvaft.loads(tree), [{"event": letter} for letter in word.split()], "scattered")
    assert monitor is not None
    assert monitor.explanation is not None
    assert monitor.explanation.branch == branch
    found = matched_occurrences(monitor.tree, monitor.explanation)
    if matched.keys() <= found.keys():
        assert matched.items() <= found.items()


STATES = [
    ("top and x y t; x or p q; p and p1 p2; p1 sand a s; q and a s q2; y and s r;", "as", "sa", False),
    ("top sand a b; a on n(X); b or c d; c on w(1) when X > 5; d on w(2);", [3], [4], True),
    ("top sand a b; a on n(X); b or c d; c on w(1) when X > 5; d on w(2);", [3], [6], False),
]


@pytest.mark.parametrize(("text", "one", "other", "alike"), STATES)
def test_states_remember_broken_orders_and_failed_guards(text: str, one: str, other: str, alike: bool) -> None:
    tree = rvaft.loads("event n(v) = { event: v }; event w(x) = { w: x };" + text)
    low, high = Engine(tree, "strict"), Engine(tree, "strict")
    for monitor, trace in ((low, one), (high, other)):
        assert set(monitor.run({"event": event} for event in trace)) == {Verdict.UNKNOWN}
    assert (low.state == high.state) is alike
