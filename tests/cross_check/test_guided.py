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

from cross_check.generate import PLAIN, WILD, NoTraceFound, detecting, disturbed, guided, near_miss, strategies
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

MANNERS: Final = {"wild": WILD, "plain": PLAIN}
PRUNED: Final = shipped.load("remote_inspection/pruned")

# -- detection ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [*SHAPES, *DENSE])
def test_the_reference_detects_at_the_last_event_and_not_before(shape: str) -> None:
    made = 0
    for random, tree in small_trees(shape, 8):
        for semantics in Semantics:
            trace = found(detecting, random, tree, semantics)
            if trace is not None:
                made += 1
                assert verdicts(tree, semantics, trace)[:-1] == [Verdict.UNKNOWN] * (len(trace) - 1)
                assert verdicts(tree, semantics, trace)[-1] is Verdict.TRUE
    assert made > 8


@pytest.mark.parametrize("shape", ["everything", "guarded", "heavily shared"])
def test_guided_traces_detect_without_a_monitor_being_asked(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cross_check.generate.traces.Engine", None)
    for random, tree in small_trees(shape, 6):
        for semantics in Semantics:
            trace = found(guided, random, tree, semantics)
            assert trace is None or Verdict.TRUE in verdicts(tree, semantics, trace)


@pytest.mark.parametrize("name", shipped.names())
@pytest.mark.parametrize("manner", MANNERS)
def test_shipped_trees(name: str, manner: str) -> None:
    for seed, semantics in enumerate(Semantics):
        trace = detecting(Random(seed), shipped.load(name), semantics, MANNERS[manner])
        assert verdicts(shipped.load(name), semantics, trace)[-1] is Verdict.TRUE


@pytest.mark.parametrize("part", [{"branch": 2}, {"branch": 3}, {"kind": "attack"}, {"kind": "fault"}])
def test_a_branch_and_a_kind(part: dict[str, Any]) -> None:
    for semantics in Semantics:
        trace = detecting(Random(1), restrict(PRUNED, **part), semantics)
        assert verdicts(PRUNED, semantics, trace, **part)[-1] is Verdict.TRUE


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


@pytest.mark.parametrize(
    ("parts", "leaves"),
    [
        ("s{0} or t{0} f{0}; t{0} sand x{0} y{0}; x{0} and z{0}; y{0} and z{0};", "f"),  # the whole of it is not chosen
        (
            "s{0} sand x{0} y{0}; x{0} or z{0} f{0}; y{0} and z{0} g{0};",
            "fzg",
        ),  # all other edges of the cycle are needed
    ],
)
def test_a_cycle_is_avoided_though_only_one_choice_in_many_has_none(parts: str, leaves: str) -> None:
    names = " ".join(f"s{i}" for i in range(12))
    tree = loads(f"top and {names}; {''.join(parts.format(i) for i in range(12))}")
    for seed in range(3):
        trace = guided(Random(seed), tree, Semantics.STRICT)
        assert {event["event"] for event in trace} == {f"{leaf}{i}" for leaf in leaves for i in range(12)}


def test_noise_is_never_relevant() -> None:
    tree = loads(
        "event any(x) = { event: x }; event y(x) = { y: x }; top and a b; a on any(_); b on y(_); ignore any(0);"
    )
    seen = [noise(Random(seed), tree, (0, "x")) for seed in range(100)]
    assert not any(relevant(tree, event) for event in seen if event is not None)
    assert any(event is not None for event in seen)


def test_choices() -> None:
    """What cannot hold is not drawn; a vote has more than K children now and then."""
    dead = loads("event p(x) = { p: x }; top 2of4 a b c d; b on p(1) when 1 > 2; d and e f; f on p(2) when 2 > 3;")
    for seed in range(10):
        trace = guided(Random(seed), dead, Semantics.STRICT, replace(WILD, attempts=1))
        assert sorted(e["event"] for e in trace) == ["a", "c"]
    lengths = Counter(len(guided(Random(seed), loads("top 2of4 a b c d;"), Semantics.STRICT)) for seed in range(200))
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
@pytest.mark.parametrize("manner", MANNERS)
def test_values_under_which_a_guard_holds(guard: str, manner: str) -> None:
    tree = loads(
        "event e(k, x) = { k: k, x: x }; top and a b c d;"
        f' a on e("a", X); b on e("b", Y); c on e("c", Z); d on e("d", _) when {guard};'
    )
    for seed in range(3):
        trace = detecting(Random(seed), tree, Semantics.STRICT, MANNERS[manner])
        assert verdicts(tree, Semantics.STRICT, trace)[-1] is Verdict.TRUE


@pytest.mark.parametrize("manner", MANNERS)
def test_bounds_are_met_exactly_and_narrowly(manner: str) -> None:
    tree = loads(
        "event e(v, t) = { v: v, t: t }; top sand a b; a on e(V, S); b on e(_, T) when V >= 250 and T > S + 10;"
    )
    seen: Counter[tuple[str, float]] = Counter()
    for seed in range(150):
        first, second = guided(Random(seed), tree, Semantics.STRICT, MANNERS[manner])
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
    trace = guided(Random(0), tree, Semantics.STRICT, replace(WILD, attempts=1))
    assert all(later["t"] >= earlier["t"] + 10 for earlier, later in pairwise(trace))


def test_an_early_value_that_leaves_none_for_a_later_variable_is_given_up() -> None:
    tree = loads("event e(x) = { x: x }; top sand a b; a on e(X); b on e(Y) when Y > X and Y < 4;")
    once = replace(WILD, attempts=1)
    traces = [found(guided, Random(seed), tree, Semantics.STRICT, once) for seed in range(100)]
    assert sum(trace is not None for trace in traces) > 80


@pytest.mark.parametrize("shape", ["guarded", "variables", "shared variables"])
def test_where_none_is_found_another_search_finds_no_values_either(shape: str) -> None:
    missed = 0
    for random, tree in small_trees(shape, 12):
        if found(guided, random, tree) is None:
            missed += 1
            for scenario in feasible_scenarios(tree):
                assert witness([node.when for node in scenario.nodes if node.when is not None]) is None
    assert missed < 8


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
    event = "event e(x) = { x: x };"
    tree = loads(f"{event} top and a b; a on e(X); b on e(_); ignore e(X) when X < 1000 or not X > 1000;")
    for seed in range(5):
        trace = guided(Random(seed), tree, Semantics.PROJECTED)
        assert verdicts(tree, Semantics.PROJECTED, trace)[-1] is not Verdict.UNKNOWN
    ignoring = loads(f"{event} top and a; a on e(X); ignore e(_);")
    assert len(guided(Random(0), ignoring, Semantics.STRICT)) == 1


def test_a_longest_length() -> None:
    gates = " ".join(f"o{i}" for i in range(14))
    many = loads(f"top and {gates};" + "".join(f"o{i} or l{i} s{i}; l{i} and x{i} y{i};" for i in range(14)))
    trace = guided(Random(0), many, Semantics.STRICT, replace(WILD, longest=14))
    assert sorted(event["event"] for event in trace) == sorted(f"s{i}" for i in range(14))
    tree, three = loads("top or l s; l and a b c d e f g h i; s 3of9 a b c d e f g h i;"), replace(WILD, longest=3)
    for seed in range(20):
        assert len(guided(Random(seed), tree, Semantics.SCATTERED, three)) == 3
        assert len(near_miss(Random(seed), tree, Semantics.PROJECTED, three).trace) <= 3
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


def test_a_time_that_is_left_open_beside_one_that_is_not() -> None:
    tree = loads("event e(t) = { times: [t, _] }; top sand a b; a on e(S); b on e(T) when T > S + 5;")
    for seed in range(10):
        first, second = (event["times"] for event in guided(Random(seed), tree, Semantics.STRICT, PLAIN))
        assert all(isinstance(time, int) for time in (*first, *second))


@pytest.mark.parametrize("gate", [Gate.SAND_RL, Gate.OR])
def test_thousands_of_nodes_below_one_another(gate: Gate) -> None:
    length = sys.getrecursionlimit() + 200
    nodes = [Node(f"g{i}", gate, (f"l{i}", f"g{i + 1}")) for i in range(length)]
    tree = RVAFT("g0", [*nodes, Node(f"g{length}"), *(Node(f"l{i}") for i in range(length))])
    trace = detecting(Random(3), tree)
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
