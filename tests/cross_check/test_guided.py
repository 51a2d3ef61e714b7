"""Guided traces do what they promise, by the reference, and miss no scenario, order or kind of disturbance."""

import json
import sys
from collections import Counter
from dataclasses import replace
from itertools import pairwise, permutations
from random import Random
from typing import Any, Final

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cross_check.generate import PLAIN, WILD, Manner, NoTraceFound, detecting, disturbed, guided, near_miss, strategies
from cross_check.generate.traces import Cyclic, Scenarios, noise, random_order, random_trace
from cross_check.generate.trees import random_tree
from rvaft import RVAFT, Gate, Node, Semantics, Verdict, loads, monitor
from rvaft.analysis.branches import restrict
from rvaft.analysis.guard_solver import witness
from rvaft.engine import Engine
from rvaft.model.values import Json
from rvaft.semantics import feasible_scenarios
from rvaft.semantics.reference import relevant
from tests.cross_check.small_trees import SHAPES, found, small_trees, verdicts
from tests.engine.checking import small_and_valid
from tests.engine.dense import SHAPES as DENSE
from tests.trees import shipped

# -- detection ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [*SHAPES, *DENSE])
def test_the_reference_detects_at_the_last_event_and_not_before(shape: str) -> None:
    made = 0
    for random, tree in small_trees(shape, 12):
        for semantics in Semantics:
            trace = found(detecting, random, tree, semantics)
            if trace is not None:
                made += 1
                assert verdicts(tree, semantics, trace)[:-1] == [Verdict.UNKNOWN] * (len(trace) - 1)
                assert verdicts(tree, semantics, trace)[-1] is Verdict.TRUE
    assert made > 15


@pytest.mark.parametrize("shape", ["everything", "guarded", "heavily shared"])
def test_guided_traces_detect_without_a_monitor_being_asked(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cross_check.generate.traces.Engine", None)
    for random, tree in small_trees(shape, 12):
        for semantics in Semantics:
            trace = found(guided, random, tree, semantics)
            assert trace is None or Verdict.TRUE in verdicts(tree, semantics, trace)


@pytest.mark.parametrize("name", shipped.names())
@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("manner", [WILD, PLAIN], ids=["wild", "plain"])
def test_shipped_trees(name: str, semantics: Semantics, manner: Manner) -> None:
    tree = shipped.load(name)
    for seed in range(4):
        trace = detecting(Random(seed), tree, semantics, manner)
        assert verdicts(tree, semantics, trace)[-1] is Verdict.TRUE


@pytest.mark.parametrize("part", [{"branch": 2}, {"branch": 3}, {"kind": "attack"}, {"kind": "fault"}])
def test_a_branch_and_a_kind(part: dict[str, Any]) -> None:
    tree = shipped.load("remote_inspection/pruned")
    for semantics in Semantics:
        trace = detecting(Random(1), restrict(tree, **part), semantics)
        assert verdicts(tree, semantics, trace, **part)[-1] is Verdict.TRUE


def test_a_monitor_that_does_not_detect_is_not_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = loads("top sand a b;")
    other = loads("top sand b a; a; b;")
    monkeypatch.setattr("cross_check.generate.traces.Engine", lambda _, semantics: Engine(other, semantics))
    with pytest.raises(AssertionError, match="does not detect top under strict"):
        detecting(Random(0), tree, Semantics.STRICT)


def test_noise_comes_where_it_does_no_harm() -> None:
    tree = loads("top and a b c;")
    noisy = Counter[Semantics]()
    for seed in range(60):
        for semantics in Semantics:
            trace = guided(Random(seed), tree, semantics)
            noisy[semantics] += any(not relevant(tree, event) for event in trace)
    assert noisy[Semantics.STRICT] == 0
    assert min(noisy[Semantics.PROJECTED], noisy[Semantics.SCATTERED]) > 5


# -- nothing is left out --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["plain", "shared order", "shared thresholds", "heavily shared"])
def test_every_feasible_scenario_is_drawn(shape: str) -> None:
    for random, tree in small_trees(shape, 12):
        wanted = {frozenset(scenario.kept.items()) for scenario in feasible_scenarios(tree)}
        drawn = set()
        for _ in range(150 * len(wanted)):
            kept = Scenarios(tree).draw(random)
            assert kept is not None
            try:
                random_order(random, tree, kept)
            except Cyclic:
                continue
            drawn.add(frozenset(kept.items()))
            if drawn == wanted:
                break
        assert drawn == wanted


@pytest.mark.parametrize("shape", ["plain", "everything", "shared order", "heavily shared", "silent"])
def test_every_order_that_keeps_the_precedence_comes_out_and_no_other(shape: str) -> None:
    compared = 0
    for random, tree in small_trees(shape, 40):
        for scenario in feasible_scenarios(tree)[:3]:
            if len(scenario.occurrences) > 4:
                continue
            wanted = {
                order
                for order in permutations(sorted(scenario.occurrences))
                if all(order.index(a) < order.index(b) for b in order for a in scenario.before[b])
            }
            drawn = {tuple(random_order(random, tree, scenario.kept)) for _ in range(40 * len(wanted))}
            assert drawn == wanted
            compared += len(wanted) > 1
    assert compared >= 5


def test_a_cycle_is_told_by_its_tree_edges_and_avoided() -> None:
    """Only one choice in 2^12 orders nothing before itself."""
    gates = " ".join(f"o{i}" for i in range(12))
    text = f"top and {gates};" + "".join(
        f"o{i} or s{i} f{i}; s{i} sand x{i} y{i}; x{i} and z{i}; y{i} and z{i};" for i in range(12)
    )
    tree = loads(text)
    kept = {"s": ("x", "y"), "x": ("z",), "y": ("z",), "z": ()}
    gates_of = {"s": Gate.SAND, "x": Gate.AND, "y": Gate.AND, "z": None}
    small = RVAFT("s", [Node(name, gates_of[name], children) for name, children in kept.items()])
    with pytest.raises(Cyclic) as caught:
        random_order(Random(0), small, kept)
    assert {("x", "z"), ("y", "z")} <= set(caught.value.edges)
    for seed in range(5):
        trace = guided(Random(seed), tree, Semantics.STRICT)
        assert {event["event"] for event in trace} == {f"f{i}" for i in range(12)}


def test_a_cycle_is_broken_at_a_choice_inside_it() -> None:
    """Only one of 2^12 ways to choose has no cycle, and all other edges of the cycles are needed."""
    gates = " ".join(f"s{i}" for i in range(12))
    parts = "".join(f"s{i} sand x{i} y{i}; x{i} or z{i} f{i}; y{i} and z{i} g{i};" for i in range(12))
    nodes = loads(f"top and {gates}; {parts}")
    for seed in range(5):
        trace = guided(Random(seed), nodes, Semantics.STRICT)
        assert {event["event"] for event in trace} == {f"{leaf}{i}" for leaf in "fzg" for i in range(12)}


def test_noise_is_never_relevant() -> None:
    tree = loads(
        "event any(x) = { event: x }; event y(x) = { y: x }; top and a b; a on any(_); b on y(_); ignore any(0);"
    )
    seen = [noise(Random(seed), tree, (0, "x")) for seed in range(100)]
    assert not any(relevant(tree, event) for event in seen if event is not None)
    assert any(event is not None for event in seen)


def test_dead_guards_are_avoided() -> None:
    tree = loads(
        "event p(x) = { p: x }; top 2of4 a b c d; a; b on p(1) when 1 > 2; c; d and e f; e; f on p(2) when 2 > 3;"
    )
    for seed in range(10):
        assert sorted(e["event"] for e in guided(Random(seed), tree, Semantics.STRICT, replace(WILD, attempts=1))) == [
            "a",
            "c",
        ]


def test_more_than_k_children_sometimes() -> None:
    tree = loads("top 2of4 a b c d;")
    lengths = Counter(len(guided(Random(seed), tree, Semantics.STRICT)) for seed in range(200))
    assert set(lengths) == {2, 3, 4}
    assert lengths[2] > lengths[3]


# -- values ---------------------------------------------------------------------------------------------------------

GUARDS: Final = {
    "bound": "X >= 250 and X <= 250",
    "next to a bound": "X > 250 and X < 252",
    "between": "X > 1 and X < 2",
    "string": 'X == "entrance"',
    "strings in order": '"b" < X and X <= "ba"',
    "sum": "Y >= X + 10 and Y <= X + 10",
    "difference": "10 - X == 3",
    "product": "X * 4 == 36",
    "quotient": "100 / X == 8",
    "minus": "-X == 77",
    "nested": "2 * (X - 3) + 1 == 41",
    "variable twice": "X + X == X * 2",
    "chain": "X < Y and Y < Z and Z < X + 3",
    "boolean": "X and not Y",
    "null": "X == null or X != X",
    "choice": "X == 1000 or X == 2000",
    "not": "not (X < 100000) and not (X > 100001)",
    "different": "X != Y and Y != Z and X != Z",
    "wrong types": 'X != 1 and Y == "a" and not Z',
}


@pytest.mark.parametrize("guard", GUARDS.values(), ids=GUARDS)
@pytest.mark.parametrize("manner", [WILD, PLAIN], ids=["wild", "plain"])
def test_values_under_which_a_guard_holds(guard: str, manner: Manner) -> None:
    tree = loads(
        "event e(k, x) = { k: k, x: x }; top and a b c d;"
        f' a on e("a", X); b on e("b", Y); c on e("c", Z); d on e("d", _) when {guard};'
    )
    for seed in range(5):
        trace = detecting(Random(seed), tree, Semantics.STRICT, manner)
        assert verdicts(tree, Semantics.STRICT, trace)[-1] is Verdict.TRUE


@pytest.mark.parametrize("manner", [WILD, PLAIN], ids=["wild", "plain"])
def test_bounds_are_met_exactly_and_narrowly(manner: Manner) -> None:
    tree = loads(
        "event e(v, t) = { v: v, t: t }; top sand a b; a on e(V, S); b on e(_, T) when V >= 250 and T > S + 10;"
    )
    seen: Counter[tuple[str, float]] = Counter()
    for seed in range(150):
        first, second = guided(Random(seed), tree, Semantics.STRICT, manner)
        seen["v", first["v"]] += 1
        seen["t", second["t"] - first["t"]] += 1
    assert seen["v", 250]
    assert seen["v", 251]
    assert seen["t", 11]


def test_many_variables_tied_together_by_separate_guards() -> None:
    count = 150
    leaves = [f"l{i} on r(V{i}, T{i}) when T{i} >= T{i - 1} + 10 and V{i} > 250;" for i in range(1, count)]
    names = " ".join(f"l{i}" for i in range(count))
    tree = loads(f"event r(v, t) = {{ v: v, t: t }}; top sand {names}; l0 on r(V0, T0); {' '.join(leaves)}")
    for seed in range(3):
        trace = guided(Random(seed), tree, Semantics.STRICT, replace(WILD, attempts=1))
        assert all(later["t"] >= earlier["t"] + 10 for earlier, later in pairwise(trace))


def test_an_early_value_that_leaves_none_for_a_later_variable_is_given_up() -> None:
    tree = loads("event e(x) = { x: x }; top sand a b; a on e(X); b on e(Y) when Y > X and Y < 4;")
    traces = [found(guided, Random(seed), tree, Semantics.STRICT, replace(WILD, attempts=1)) for seed in range(100)]
    assert sum(trace is not None for trace in traces) > 80


@pytest.mark.parametrize("shape", ["guarded", "variables", "shared variables"])
def test_where_none_is_found_another_search_finds_no_values_either(shape: str) -> None:
    missed = 0
    for random, tree in small_trees(shape, 30):
        if found(guided, random, tree) is None:
            missed += 1
            for scenario in feasible_scenarios(tree):
                assert witness([node.when for node in scenario.nodes if node.when is not None]) is None
    assert missed < 15


def test_a_choice_without_values_is_not_made() -> None:
    never = "".join(f"l{i} on e(X{i}) when X{i} > 5 and X{i} < 5;" for i in range(60))
    names = " ".join(f"l{i}" for i in range(60))
    tree = loads(f"event e(x) = {{ x: x }}; top or {names} good; good; {never}")
    assert detecting(Random(0), tree, Semantics.STRICT) == [{"event": "good"}]


@pytest.mark.parametrize(
    ("text", "nodes", "said"),
    [
        ("top and a b; a on e(X) when X > 5; b on e(X) when X < 5;", {"a", "b"}, "the guards of a and b do not hold"),
        ("top and a b; a on e(X) when X > 5 and X < 5; b;", {"a"}, "the guard of a does not hold"),
        ("top and a b; a on e(_); b; ignore e(_);", {"a"}, "`ignore` takes the events of a"),
        ("top and a b; a on e(3); b; ignore e(X) when X > 2;", {"a"}, "`ignore` takes the events of a"),
    ],
)
def test_what_is_in_the_way_is_named(text: str, nodes: set[str], said: str) -> None:
    tree = loads(f"event e(x) = {{ x: x }}; {text}")
    with pytest.raises(NoTraceFound, match=said) as caught:
        guided(Random(0), tree, Semantics.PROJECTED, replace(WILD, attempts=40))
    assert set(caught.value.nodes) <= nodes
    assert "40 attempts" in str(caught.value)


def test_ignored_values_are_avoided_only_where_that_matters() -> None:
    tree = loads("event e(x) = { x: x }; top and a b; a on e(X); b on e(_); ignore e(X) when X < 1000 or not X > 1000;")
    for seed in range(5):
        trace = guided(Random(seed), tree, Semantics.PROJECTED)
        assert verdicts(tree, Semantics.PROJECTED, trace)[-1] is not Verdict.UNKNOWN
    with_ignored = guided(
        Random(0), loads("event e(x) = { x: x }; top and a; a on e(X); ignore e(_);"), Semantics.STRICT
    )
    assert len(with_ignored) == 1


def test_the_shortest_scenario_is_found_among_many() -> None:
    gates = " ".join(f"o{i}" for i in range(14))
    tree = loads(f"top and {gates};" + "".join(f"o{i} or l{i} s{i}; l{i} and x{i} y{i};" for i in range(14)))
    trace = guided(Random(0), tree, Semantics.STRICT, replace(WILD, longest=14))
    assert sorted(event["event"] for event in trace) == sorted(f"s{i}" for i in range(14))


def test_a_longest_length() -> None:
    tree = loads("top or l s; l and a b c d e f g h i; s 3of9 a b c d e f g h i;")
    for seed in range(20):
        assert len(guided(Random(seed), tree, Semantics.SCATTERED, replace(WILD, longest=3))) == 3
        assert len(near_miss(Random(seed), tree, Semantics.PROJECTED, replace(WILD, longest=3)).trace) <= 3
    with pytest.raises(NoTraceFound, match="the shortest scenario met has 3 events"):
        guided(Random(0), tree, Semantics.PROJECTED, replace(WILD, longest=2))


LOG: Final = loads(
    """
    event login(u, t)   = { event: "login", user: u, time: t };
    event read(f, n, t) = { event: "read", file: f, bytes: n, time: t };
    event logout(u)     = { event: "logout", user: u, time: _, note: _ };
    theft sand enter takes leave;
    enter on login(User, T1);
    takes on read(_, Bytes, T2) when Bytes > 5000 and T2 <= T1 + 60 and T2 >= T1;
    leave on logout(Other) when Other != User;
    """
)


@pytest.mark.parametrize("semantics", Semantics)
def test_people_believe_a_plain_log(semantics: Semantics) -> None:
    for seed in range(20):
        trace = detecting(Random(seed), LOG, semantics, PLAIN)
        near = near_miss(Random(seed), LOG, semantics, PLAIN).trace
        assert verdicts(LOG, semantics, trace)[-1] is Verdict.TRUE
        assert Verdict.TRUE not in verdicts(LOG, semantics, near)
        for log in (trace, near):
            times = [event["time"] for event in log if "time" in event]
            assert times == sorted(times)
            assert all(isinstance(time, int) and 0 <= time < 200 for time in times)
            assert {event["user"] for event in log if "user" in event} <= {"alice", "bob", "carol", "dave", "erin"}
        assert all(5000 <= event["bytes"] <= 5010 for event in trace if "bytes" in event)


# -- size -----------------------------------------------------------------------------------------------------------


def chain(gate: Gate, length: int) -> RVAFT:
    nodes = [Node(f"g{i}", gate, (f"l{i}", f"g{i + 1}")) for i in range(length)]
    return RVAFT("g0", [*nodes, Node(f"g{length}"), *(Node(f"l{i}") for i in range(length))])


@pytest.mark.parametrize("gate", [Gate.AND, Gate.SAND, Gate.SAND_RL, Gate.OR])
def test_thousands_of_nodes_below_one_another(gate: Gate) -> None:
    length = sys.getrecursionlimit() + 200
    tree = chain(gate, length)
    trace = detecting(Random(3), tree)
    assert monitor(tree).run(trace) is not None
    assert len(trace) > length or gate is Gate.OR
    assert len(disturbed(Random(3), trace, tree)) >= len(trace) - 3


# -- reproducible, and for other people's tests ---------------------------------------------------------------------


@pytest.mark.parametrize("semantics", Semantics)
def test_the_same_seed_gives_the_same_traces(semantics: Semantics) -> None:
    def all_of(seed: int) -> str:
        random = Random(seed)
        tree = random_tree(random, SHAPES["shared"])
        trace = guided(random, tree, semantics)
        return json.dumps([trace, disturbed(random, trace, tree), near_miss(random, tree, semantics)])

    first = [all_of(seed) for seed in range(8)]
    assert first == [all_of(seed) for seed in range(8)]
    assert len(set(first)) == 8


PRUNED: Final = shipped.load("remote_inspection/pruned")
few = settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck), database=None)


@few
@given(st.data(), strategies.semantics())
def test_strategies_for_one_tree(data: st.DataObject, semantics: Semantics) -> None:
    trace = data.draw(strategies.detecting_traces(PRUNED, semantics))
    assert verdicts(PRUNED, semantics, trace)[-1] is Verdict.TRUE
    near = data.draw(strategies.near_misses(PRUNED, semantics))
    assert Verdict.TRUE not in verdicts(PRUNED, semantics, near.trace)
    assert isinstance(data.draw(strategies.disturbed_traces(PRUNED, semantics)), list)


@few
@given(strategies.trees_with_guided_traces())
def test_a_strategy_for_trees_too(example: tuple[RVAFT, Semantics, list[Json]]) -> None:
    tree, semantics, trace = example
    if small_and_valid(tree):
        assert verdicts(tree, semantics, trace) == list(monitor(tree, semantics=semantics).run(trace))


def test_an_event_without_fields_is_led_through_and_disturbed_too() -> None:
    tree = loads("event anything() = {}; top sand a b; a on anything(); b;")
    for seed in range(100):
        random = Random(seed)
        trace = detecting(random, tree, Semantics.STRICT)
        assert verdicts(tree, Semantics.STRICT, trace)[-1] is Verdict.TRUE
        assert all(isinstance(event, dict) for event in [*disturbed(random, trace, tree), *random_trace(random, tree)])
