"""Which events break the assumptions of a tree, and how traces are made to keep them."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cross_check.generate.assumptions import conforming
from cross_check.generate.strategies import randoms
from cross_check.generate.traces import random_trace
from rvaft import dumps, loads
from rvaft.model.assumptions import AssumptionCheck, first_violation
from rvaft.model.nodes import Assumption
from rvaft.model.values import Json
from tests.tables import rows

ROWS = rows(__file__, "assumptions.txt")
TREES = [*dict.fromkeys(text for text, _, _ in ROWS)]


@pytest.mark.parametrize(("text", "events", "expected"), ROWS)
def test_the_events_that_break_an_assumption(text: str, events: Sequence[Json], expected: list[str]) -> None:
    tree = loads(text)
    check = AssumptionCheck(tree)
    assert [str(one) for event in events for one in check.broken(event)] == expected
    first = first_violation(tree, events, Assumption)
    assert (None if first is None else str(first)) == next(iter(expected), None)
    assert loads(dumps(tree)) == tree
    assert first_violation(loads(dumps(tree)), events, Assumption) == first
    for one in Assumption:  # each by itself
        found = AssumptionCheck(tree, [one])
        assert [str(it) for event in events for it in found.broken(event)] == [
            text for text in expected if f"'{one}'" in text
        ]


@pytest.mark.parametrize(("text", "events", "expected"), ROWS)
def test_a_trace_is_made_to_keep_what_it_can(text: str, events: Sequence[Json], expected: list[str]) -> None:
    tree = loads(text)
    kept = conforming(tree, events, tree.assumes)
    assert first_violation(tree, kept, tree.assumes) is None
    assert len(kept) == len(events)
    if not expected:
        assert kept == list(events)


@given(randoms(), st.sampled_from(TREES), st.sets(st.sampled_from(Assumption)))
def test_random_traces(random: object, text: str, assumptions: set[Assumption]) -> None:
    tree = loads(text)
    trace = random_trace(random, tree, max_length=6)  # type: ignore[arg-type]
    kept = conforming(tree, trace, assumptions)
    assert len(kept) == len(trace)
    assert first_violation(tree, kept, assumptions) is None
    if first_violation(tree, trace, assumptions) is None:
        assert kept == trace
