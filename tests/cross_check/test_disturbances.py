"""Disturbed traces and near misses: each kind is what it says, every kind occurs, and a near miss
is one edit from a detection.
"""

import json
import sys
from collections import Counter
from copy import deepcopy
from random import Random
from typing import Final

import pytest

from cross_check.generate.disturbances import Disturbance, disturbed, disturbed_by, near_miss
from cross_check.generate.times import without_time
from rvaft import RVAFT, Semantics, Verdict, loads
from rvaft.model.values import Json, equal, is_number
from rvaft.semantics.events import time_of
from rvaft.semantics.reference import relevant
from tests.cross_check.small_trees import SHAPES, detects, found, small_trees, verdicts
from tests.engine.dense import SHAPES as DENSE
from tests.tables import sampled

TREE: Final = loads(
    """
    time "when" as s late 3 s;
    event move(wp, t) = { name: "move", wp: wp, t: t };
    event read(v, t) = { name: "read", value: { v: v, list: [t] } };
    top sand a b c d within 30 s;
    a on move(W, S);
    b on read(V, T) when V >= 250 and T >= S + 10;
    c on move(W, _);
    d;
    """
)
TRACE: Final[list[Json]] = [
    {"name": "move", "wp": 1, "t": 0, "when": 1.5},
    {"name": "read", "value": {"v": 250.0, "list": [10]}, "when": 11.5},
    {"name": "move", "wp": 1, "t": 20.5, "when": "22.0"},
    {"event": "d", "when": 31},
]


def written(trace: list[Json]) -> list[str]:
    return [json.dumps(event) for event in trace]


def inserted(before: list[Json], after: list[Json]) -> Json | None:
    """The one event that came in, where nothing else changed."""
    for index, event in enumerate(after):
        if written([*after[:index], *after[index + 1 :]]) == written(before):
            return event
    return None


def flat(value: Json, path: tuple[object, ...] = ()) -> dict[tuple[object, ...], Json]:
    """All places and what stands there, containers as their type."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    own = {path: type(value) if isinstance(value, (dict, list)) else value}
    return own | {place: part for name, below in inner for place, part in flat(below, (*path, name)).items()}


def moved(before: list[Json], after: list[Json]) -> tuple[set[tuple[object, ...]], list[tuple[Json, Json]]]:
    """The places that are there in one of them alone, without those further in, and the values that became others."""
    old, new = flat(before), flat(after)
    gone = old.keys() ^ new.keys()
    top = {place for place in gone if not any(place[:length] in gone for length in range(len(place)))}
    return top, [(old[p], new[p]) for p in old.keys() & new.keys() if repr(old[p]) != repr(new[p])]


def a_kind(value: Json) -> object:
    return "number" if is_number(value) else value if isinstance(value, type) else type(value)


def is_edit(kind: Disturbance, tree: RVAFT, before: list[Json], after: list[Json]) -> bool:
    """Whether one trace comes from another by one edit of a kind; told from the traces alone."""
    added, (top, changes) = inserted(before, after), moved(before, after)
    change = changes[0] if len(changes) == 1 and len(before) == len(after) else None
    scalar = None if top else change
    match kind:
        case Disturbance.EXTRA:
            return added is not None
        case Disturbance.REPEATED:
            return added is not None and json.dumps(added) in written(before)
        case Disturbance.NOISE:
            return added is not None and not relevant(tree, added)
        case Disturbance.MISSING:
            return inserted(after, before) is not None
        case Disturbance.SWAPPED:
            pairs = [(a, b) for a, b in zip(written(before), written(after), strict=False) if a != b]
            return len(before) == len(after) and len(pairs) == 2 and pairs[0] == pairs[1][::-1]
        case Disturbance.BOUND:
            return scalar is not None and is_number(scalar[0]) and is_number(scalar[1]) and not equal(*scalar)
        case Disturbance.TYPE:
            return change is not None and a_kind(change[0]) != a_kind(change[1])
        case Disturbance.NUMBER:
            return scalar is not None and equal(*scalar) and type(scalar[0]) is not type(scalar[1])
        case Disturbance.OTHER:
            return scalar is not None and a_kind(scalar[0]) == a_kind(scalar[1]) and not equal(*scalar)
        case Disturbance.THROUGHOUT:
            alike = all(equal(old, changes[0][0]) and repr(new) == repr(changes[0][1]) for old, new in changes)
            left = [one for one in flat(after).values() if not isinstance(one, type)]
            return bool(changes) and not top and alike and not any(equal(one, changes[0][0]) for one in left)
        case Disturbance.TIME | Disturbance.BACK | Disturbance.UNREADABLE | Disturbance.SPELLING:
            if len(before) != len(after) or tree.time is None:
                return False
            old, new = ([time_of(tree.time, event) for event in trace] for trace in (before, after))
            moved_by = {b - a for a, b in zip(old, new, strict=True) if a is not None and b is not None and a != b}
            elsewhere = [flat(without_time(event, tree.time.field)) for event in (*before, *after)]
            if elsewhere[: len(before)] != elsewhere[len(before) :]:
                return False
            lost = any(b is None and a is not None for a, b in zip(old, new, strict=True))
            if kind is Disturbance.SPELLING:
                return old == new and written(before) != written(after)
            return lost and not moved_by if kind is Disturbance.UNREADABLE else len(moved_by) == 1 and not lost
        case Disturbance.FIELD:
            return len(top) == 1 and not changes and top <= flat(before).keys()


@pytest.mark.parametrize("kind", Disturbance)
def test_each_kind_is_one_edit_of_that_kind(kind: Disturbance) -> None:
    seen = set()
    for seed in range(60):
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
    seen: Counter[Disturbance | None] = Counter()
    for seed in range(120):
        before = deepcopy(TRACE)
        after = disturbed(Random(seed), before, TREE)
        assert written(before) == written(TRACE)
        kinds: list[Disturbance | None] = [kind for kind in Disturbance if is_edit(kind, TREE, TRACE, after)]
        seen.update(kinds or [None])
    assert set(seen) == {*Disturbance, None}
    assert seen[None] > 12


def test_values_next_to_bounds_come_from_the_tree_and_from_sums() -> None:
    moved = {"v": set[Json](), "t": set[Json]()}
    for seed in range(300):
        after = disturbed_by(Disturbance.BOUND, Random(seed), TRACE, TREE)
        assert after is not None
        moved["v"].add(after[1]["value"]["v"])
        moved["t"].add(after[1]["value"]["list"][0])
    assert {249, 251} <= moved["v"]
    assert {9, 11} <= moved["t"]
    late: list[Json] = [{"name": "move", "wp": 1, "t": 7}, {"name": "read", "value": {"v": 300, "list": [90]}}]
    every = (disturbed_by(Disturbance.BOUND, Random(seed), late, TREE) for seed in range(1500))
    times = {edited[1]["value"]["list"][0] for edited in every if edited is not None}
    assert {16, 17, 18} <= times, "the sum of a time and a constant"


def test_wrong_types_include_those_that_python_confuses() -> None:
    swaps = {repr(disturbed_by(Disturbance.TYPE, Random(seed), [{"a": 1, "b": True}], TREE)) for seed in range(300)}
    assert {"[{'a': True, 'b': True}]", "[{'a': 1, 'b': 1}]", "[{'a': '1', 'b': True}]"} <= swaps


def test_a_deep_event_is_edited_without_recursion() -> None:
    value: Json = 1
    for _ in range(sys.getrecursionlimit() + 200):
        value = {"k": value}
    tree = loads("top and a b;")
    for kind in (Disturbance.BOUND, Disturbance.TYPE, Disturbance.NUMBER, Disturbance.FIELD):
        edited = disturbed_by(kind, Random(0), [value], tree)
        assert edited is not None
        assert not equal(edited, [value]) or kind is Disturbance.NUMBER


@pytest.mark.parametrize("shape", sampled([*SHAPES, *DENSE], 9, ci=2))
def test_near_misses_are_one_edit_from_a_trace_that_detects_at_its_last_event(shape: str) -> None:
    made = 0
    for random, tree in small_trees(shape, 3):
        for semantics in Semantics:
            near = found(near_miss, random, tree, semantics)
            if near is not None:
                made += 1
                assert Verdict.TRUE not in verdicts(tree, semantics, near.trace)
                assert detects(tree, semantics, near.detecting)
                assert is_edit(near.edit, tree, near.detecting, near.trace), near
    assert made > 1


@pytest.mark.ci
def test_near_misses_of_every_kind_that_can_matter() -> None:
    edits = Counter(near_miss(Random(seed), TREE, Semantics.STRICT).edit for seed in range(90))
    assert set(edits) == set(Disturbance) - {Disturbance.NUMBER, Disturbance.SPELLING}
    scattered = {near_miss(Random(seed), TREE, Semantics.SCATTERED).edit for seed in range(50)}
    assert not scattered & {Disturbance.EXTRA, Disturbance.NOISE, Disturbance.REPEATED, Disturbance.NUMBER}


def test_a_tree_of_one_event_is_nearly_missed_by_the_empty_trace() -> None:
    tree = loads("event any(x) = { x: x }; top or a; a on any(_);")
    traces = [near_miss(Random(seed), tree, Semantics.SCATTERED).trace for seed in range(30)]
    assert [] in traces
    assert all("x" not in event for trace in traces for event in trace)
