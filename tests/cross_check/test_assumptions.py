"""Texts that rely on an assumption: compared on traces that keep it if they declare it, else caught."""

import pytest

from cross_check.comparison import Comparison
from cross_check.participants import Participant, reference_of
from cross_check.results import Job, Result, Status
from cross_check.traces import Effort
from rvaft import Semantics, loads
from rvaft.backend import Metrics, Specification
from rvaft.model.assumptions import first_violation
from rvaft.model.nodes import Assumption
from rvaft.semantics import Reference

EVENT = 'event e(x: text, n: number) = { k: "e", x: x, n: n }; time t as s;'
PLANTED = {
    # the tree that is meant, and the tree that a text means which silently relies on the assumption
    Assumption.TYPES: (
        f'{EVENT} assume types; top sand a b; a on e(X, _) when X >= ""; b;',
        f"{EVENT} assume types; top sand a b; a on e(X, _) when X != null; b;",
    ),
    Assumption.PRESENT: (
        f"{EVENT} assume present; top sand a b; a on e(_, _); b;",
        'event e(p) = { k: p }; time t as s; top sand a b; a on e("e"); b;',
    ),
    Assumption.CASE: (
        f'{EVENT} assume case; top sand a b; a on e("Root", _); b;',
        f'{EVENT} assume case; top sand a b; a on e(X, _) when lower(X) == "root"; b;',
    ),
    Assumption.EXACT: (
        f"{EVENT} assume exact; top sand a b; a on e(_, N) when N > 9007199254740990; b;",
        f"{EVENT} assume exact; top sand a b; a on e(_, N) when N > 9007199254740990 and N <= 9007199254740991; b;",
    ),
    Assumption.ORDER: (
        f"{EVENT} assume order 1 s; top sand a b; a; b;",
        "time t as s; top sand a b; a; b;",
    ),
}


def compared(assumption: Assumption, *, declared: bool) -> Result:
    meant, other = map(loads, PLANTED[assumption])
    text = Specification("", "planted", Metrics(1), assumes=frozenset({assumption} if declared else ()))
    job = Job("planted", Semantics.SCATTERED)
    candidates = {
        "reference": lambda: reference_of(meant, job.semantics),
        "planted": lambda: Participant("planted", lambda: Reference(other, job.semantics), text),
    }
    found = Comparison(meant, job, Effort(states=0, traces=400)).run(candidates.items())
    return next(one for one in found if one.participant == "planted")


@pytest.mark.ci
@pytest.mark.parametrize("assumption", PLANTED)
def test_a_silent_assumption_is_caught(assumption: Assumption) -> None:
    result = compared(assumption, declared=False)
    assert result.status is Status.DIFFERS
    assert result.difference is not None
    violation = first_violation(loads(PLANTED[assumption][0]), result.difference.trace, [assumption])
    assert violation is not None


@pytest.mark.parametrize("assumption", PLANTED)
def test_a_declared_assumption_is_kept(assumption: Assumption) -> None:
    result = compared(assumption, declared=True)
    assert result.status is Status.TESTED
    assert f"assumes {assumption}" in result.text
