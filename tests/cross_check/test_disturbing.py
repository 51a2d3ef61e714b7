"""Disturbed traces and near misses: each kind is what it says, every kind occurs, and a near miss is one edit from a detection."""

import json
import sys
from collections import Counter
from copy import deepcopy
from random import Random
from typing import Final

import pytest

from cross_check.generate import Disturbance, disturbed, disturbed_by, near_miss
from rvaft import Semantics, Verdict, loads
from rvaft.model.values import Json, equal
from tests.cross_check.edits import is_edit, written
from tests.cross_check.small_trees import found, small_trees, verdicts

TREE: Final = loads(
    """
    event move(wp, t) = { name: "move", wp: wp, t: t };
    event read(v, t) = { name: "read", value: { v: v, list: [t] } };
    top sand a b c d;
    a on move(W, S);
    b on read(V, T) when V >= 250 and T >= S + 10;
    c on move(W, _);
    d;
    """
)
TRACE: Final[list[Json]] = [
    {"name": "move", "wp": 1, "t": 0},
    {"name": "read", "value": {"v": 250.0, "list": [10]}},
    {"name": "move", "wp": 1, "t": 20.5},
    {"event": "d"},
]


@pytest.mark.parametrize("kind", Disturbance)
def test_each_kind_is_one_edit_of_that_kind(kind: Disturbance) -> None:
    seen = set()
    for seed in range(100):
        before = deepcopy(TRACE)
        after = disturbed_by(kind, Random(seed), before, TREE)
        assert after is not None
        assert written(before) == written(TRACE), "the trace itself stays as it is"
        assert is_edit(kind, TREE, TRACE, after), after
        seen.add(json.dumps(after))
    assert len(seen) >= 4


@pytest.mark.parametrize("kind", [kind for kind in Disturbance if kind not in (Disturbance.EXTRA, Disturbance.NOISE)])
def test_an_empty_trace_has_little_to_disturb(kind: Disturbance) -> None:
    assert disturbed_by(kind, Random(0), [], TREE) is None
    assert disturbed_by(Disturbance.SWAPPED, Random(0), [TRACE[0], TRACE[0]], TREE) is None
    assert disturbed_by(Disturbance.BOUND, Random(0), [{"event": "a"}], TREE) is None
    assert disturbed_by(Disturbance.NUMBER, Random(0), [{"a": 1.5, "b": True, "c": 2**60}], TREE) is None


def test_disturbed_traces_are_of_every_kind_and_of_several_at_once() -> None:
    seen: Counter[Disturbance] = Counter()
    several = 0
    for seed in range(200):
        before = deepcopy(TRACE)
        after = disturbed(Random(seed), before, TREE)
        assert written(before) == written(TRACE)
        kinds = [kind for kind in Disturbance if is_edit(kind, TREE, TRACE, after)]
        seen.update(kinds)
        several += not kinds
    assert set(seen) == set(Disturbance)
    assert several > 20


def test_values_next_to_bounds_come_from_the_tree_and_from_sums() -> None:
    moved = set()
    for seed in range(300):
        after = disturbed_by(Disturbance.BOUND, Random(seed), TRACE, TREE)
        assert after is not None
        moved.add((after[1]["value"]["v"], after[1]["value"]["list"][0]))
    assert {249, 251} <= {value for value, _ in moved}
    assert {9, 11} <= {time for _, time in moved}
    late: list[Json] = [{"name": "move", "wp": 1, "t": 7}, {"name": "read", "value": {"v": 300, "list": [90]}}]
    times = {disturbed_by(Disturbance.BOUND, Random(seed), late, TREE)[1]["value"]["list"][0] for seed in range(10_000)}  # type: ignore[index]
    assert {16, 17, 18} <= times


def test_wrong_types_include_those_that_python_confuses() -> None:
    swaps = set()
    for seed in range(300):
        after = disturbed_by(Disturbance.TYPE, Random(seed), [{"a": 1, "b": True}], TREE)
        assert after is not None
        swaps.add(repr(after[0]))
    assert {"{'a': True, 'b': True}", "{'a': 1, 'b': 1}", "{'a': '1', 'b': True}"} <= swaps


def test_a_deep_event_is_edited_without_recursion() -> None:
    value: Json = 1
    for _ in range(sys.getrecursionlimit() + 200):
        value = {"k": value}
    tree = loads("top and a b;")
    for kind in (Disturbance.BOUND, Disturbance.TYPE, Disturbance.NUMBER, Disturbance.FIELD):
        edited = disturbed_by(kind, Random(0), [value], tree)
        assert edited is not None
        assert not equal(edited, [value]) or kind is Disturbance.NUMBER


# -- near misses ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["everything", "plain", "guarded", "shared", "shared thresholds", "variables"])
def test_near_misses_are_one_edit_from_a_detection(shape: str) -> None:
    made = 0
    for random, tree in small_trees(shape, 6):
        for semantics in Semantics:
            near = found(near_miss, random, tree, semantics)
            if near is not None:
                made += 1
                assert Verdict.TRUE not in verdicts(tree, semantics, near.trace)
                assert verdicts(tree, semantics, near.detecting)[-1] is Verdict.TRUE
                assert is_edit(near.edit, tree, near.detecting, near.trace), near
    assert made > 6


def test_near_misses_of_every_kind_that_can_matter() -> None:
    edits = Counter(near_miss(Random(seed), TREE, Semantics.STRICT).edit for seed in range(120))
    assert set(edits) == set(Disturbance) - {Disturbance.NUMBER}
    scattered = {near_miss(Random(seed), TREE, Semantics.SCATTERED).edit for seed in range(50)}
    assert not scattered & {Disturbance.EXTRA, Disturbance.NOISE, Disturbance.REPEATED, Disturbance.NUMBER}


def test_a_tree_of_one_event_is_nearly_missed_by_the_empty_trace() -> None:
    tree = loads("event any(x) = { x: x }; top or a; a on any(_);")
    traces = [near_miss(Random(seed), tree, Semantics.SCATTERED).trace for seed in range(30)]
    assert [] in traces
    assert all("x" not in event for trace in traces for event in trace)
