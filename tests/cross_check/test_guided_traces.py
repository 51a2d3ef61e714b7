"""Guided traces do what they promise, by the reference, and miss no scenario, order or kind of disturbance."""

import json
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise, permutations, product
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cross_check.generate import strategies
from cross_check.generate.disturbances import disturbed, near_miss
from cross_check.generate.traces import (
    PLAIN,
    WILD,
    Cyclic,
    NoTraceFound,
    Scenarios,
    detecting,
    guided,
    noise,
    random_trace,
)
from cross_check.generate.trees import random_tree
from rvaft import RVAFT, Gate, Node, Semantics, Verdict, load, loads, monitor
from rvaft.core.restriction import restrict
from rvaft.core.solver import witness
from rvaft.engine import Engine
from rvaft.model.values import Json
from rvaft.semantics import feasible_scenarios
from rvaft.semantics.reference import relevant
from tests.core.kept import names as kept_names
from tests.core.kept import parts_of
from tests.cross_check.small_trees import SHAPES, detects, found, small_trees, verdicts
from tests.engine.checking import small_and_valid
from tests.engine.dense import SHAPES as DENSE
from tests.tables import sampled
from tests.trees import shipped

STRICT, PROJECTED, CONSECUTIVE, SCATTERED = Semantics
MANNERS: Final = {"wild": WILD, "plain": PLAIN}
ONCE: Final = replace(WILD, attempts=1)
PRUNED: Final = shipped.load("remote_inspection/pruned")
EVENT: Final = "event e(x) = { x: x };"

# -- detection ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", sampled([*SHAPES, *DENSE], 4))
def test_guided_traces_detect_without_a_monitor_being_asked(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cross_check.generate.traces.Engine", None)
    for random, tree in small_trees(shape, 2):
        for semantics in Semantics:
            trace = found(guided, random, tree, semantics)
            assert trace is None or Verdict.TRUE in verdicts(tree, semantics, trace)


@pytest.mark.ci
@pytest.mark.parametrize("name", shipped.names())
def test_shipped_trees(name: str) -> None:
    tree = shipped.load(name)
    for semantics, manner in product(Semantics, MANNERS.values()):
        trace = detecting(Random(1), tree, semantics, manner)
        assert (name, semantics) in shipped.FOLLOWED or detects(tree, semantics, trace)


@pytest.mark.parametrize("part", [{"branch": 2}, {"branch": 3}, {"kind": "attack"}, {"kind": "fault"}])
def test_a_branch_and_a_kind(part: dict[str, Any]) -> None:
    for semantics in Semantics:
        assert detects(PRUNED, semantics, detecting(Random(1), restrict(PRUNED, **part), semantics), **part)


def test_a_monitor_that_does_not_detect_is_not_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    other = loads("top sand b a; a; b;")
    monkeypatch.setattr("cross_check.generate.traces.Engine", lambda _, semantics: Engine(other, semantics))
    with pytest.raises(AssertionError, match="does not detect top under strict"):
        detecting(Random(0), loads("top sand a b;"), STRICT)


def test_noise_is_never_relevant_and_comes_where_it_does_no_harm() -> None:
    def noisy(semantics: Semantics) -> int:
        traces = (guided(Random(seed), tree, semantics) for seed in range(40))
        return sum(any(not relevant(tree, event) for event in trace) for trace in traces)

    tree = loads("top and a b c;")
    assert noisy(STRICT) == 0
    assert min(noisy(PROJECTED), noisy(SCATTERED)) > 3
    events = "event any(x) = { event: x }; event y(x) = { y: x };"
    tree = loads(f"{events} top and a b; a on any(_); b on y(_); ignore any(0);")
    seen = [event for seed in range(100) if (event := noise(Random(seed), tree, (0, "x"))) is not None]
    assert seen
    assert not any(relevant(tree, event) for event in seen)


# -- nothing is left out --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["plain", "shared order", "shared thresholds", "heavily shared"])
def test_every_feasible_scenario_is_drawn(shape: str) -> None:
    for random, tree in small_trees(shape, 8):
        feasible = {frozenset(scenario.kept.items()) for scenario in feasible_scenarios(tree)}
        missing = set(feasible)
        for _ in range(150 * len(feasible)):
            parts = Scenarios(tree).draw(random)
            assert parts is not None
            with suppress(Cyclic):
                Scenarios(tree).order(random, parts)
                kept = frozenset(kept_names(tree, parts).items())
                assert kept in feasible
                missing.discard(kept)
            if not missing:
                break
        assert not missing


@pytest.mark.parametrize("shape", ["plain", "everything", "shared order", "heavily shared", "silent"])
def test_every_order_that_keeps_the_precedence_comes_out_and_no_other(shape: str) -> None:
    compared = 0
    for random, tree in small_trees(shape, 30):
        for scenario in feasible_scenarios(tree)[:3]:
            if len(scenario.occurrences) <= 4:
                orders, drawn = [*permutations(sorted(scenario.occurrences))], Scenarios(tree)
                wanted = {
                    tuple(one.partition("[")[0] for one in o)
                    for o, before in product(orders, scenario.orders)
                    if all(o.index(a) < o.index(b) for b in o for a in before[b])
                }
                kept = parts_of(drawn.prop, scenario)
                assert {tuple(drawn.order(random, kept)) for _ in range(40 * len(wanted))} == wanted
                compared += len(wanted) > 1
    assert compared >= 2


def names(trace: list[Json]) -> list[str]:
    return sorted(event["event"] for event in trace)


def twelve(parts: str) -> str:
    """The same twelve times, all of it needed."""
    tops = " ".join(f"s{i}" for i in range(12))
    return f"top and {tops}; {''.join(parts.format(i) for i in range(12))}"


def chained(count: int) -> str:
    """Variables that separate guards tie to their neighbours."""
    leaves = [f"l{i} on r(V{i}, T{i}) when T{i} >= T{i - 1} + 10 and V{i} > 250;" for i in range(1, count)]
    every = " ".join(f"l{i}" for i in range(count))
    return f"event r(v, t) = {{ v: v, t: t }}; top sand {every}; l0 on r(V0, T0); {' '.join(leaves)}"


NEVER: Final = "".join(f"l{i} on e(X{i}) when X{i} > 5 and X{i} < 5;" for i in range(60))
LAWS: Final[dict[str, tuple[str, Semantics, Any, int, Callable[[list[Json]], bool]]]] = {
    # a tree, how it is led through, for how many seeds, and what is so of each trace
    "a cycle is avoided: the whole of it is not chosen": (
        twelve("s{0} or t{0} f{0}; t{0} sand x{0} y{0}; x{0} and z{0}; y{0} and z{0};"),
        *(STRICT, WILD, 3, lambda trace: names(trace) == sorted(f"f{i}" for i in range(12))),
    ),
    "a cycle is avoided: all its other edges are needed": (
        twelve("s{0} sand x{0} y{0}; x{0} or z{0} f{0}; y{0} and z{0} g{0};"),
        *(STRICT, WILD, 3, lambda trace: set(names(trace)) == {f"{leaf}{i}" for leaf in "fzg" for i in range(12)}),
    ),
    "what cannot hold is not drawn": (
        "event p(x) = { p: x }; top 2of4 a b c d; b on p(1) when 1 > 2; d and e f; f on p(2) when 2 > 3;",
        *(STRICT, ONCE, 10, lambda trace: names(trace) == ["a", "c"]),
    ),
    "a choice without values is not made": (
        f"{EVENT} top or {' '.join(f'l{i}' for i in range(60))} good; good; {NEVER}",
        *(STRICT, WILD, 1, lambda trace: trace == [{"event": "good"}]),
    ),
    "many variables tied together": (
        chained(150),
        *(STRICT, ONCE, 1, lambda trace: all(later["t"] >= earlier["t"] + 10 for earlier, later in pairwise(trace))),
    ),
    "where ignored values do no harm": (
        f"{EVENT} top and a; a on e(X); ignore e(_);",
        *(STRICT, WILD, 1, lambda trace: len(trace) == 1),
    ),
    "a time that is left open beside one that is not": (
        "event e(t) = { times: [t, _] }; top sand a b; a on e(S); b on e(T) when T > S + 5;",
        *(STRICT, PLAIN, 10, lambda trace: all(isinstance(time, int) for event in trace for time in event["times"])),
    ),
    "a longest length, by the choices": (
        f"top and {' '.join(f'o{i}' for i in range(14))};"
        + "".join(f"o{i} or l{i} s{i}; l{i} and x{i} y{i};" for i in range(14)),
        *(STRICT, replace(WILD, longest=14), 1, lambda trace: names(trace) == sorted(f"s{i}" for i in range(14))),
    ),
    "a longest length, by the noise": (
        "top or l s; l and a b c d e f g h i; s 3of9 a b c d e f g h i;",
        *(SCATTERED, replace(WILD, longest=3), 20, lambda trace: len(trace) == 3),
    ),
}


@pytest.mark.parametrize(("text", "semantics", "manner", "seeds", "so"), LAWS.values(), ids=LAWS)
def test_what_is_so_of_each_trace(
    text: str, semantics: Semantics, manner: Any, seeds: int, so: Callable[[list[Json]], bool]
) -> None:
    tree = loads(text)
    for seed in range(seeds):
        trace = guided(Random(seed), tree, semantics, manner)
        assert so(trace), trace


def test_a_vote_has_more_than_k_children_now_and_then() -> None:
    lengths = Counter(len(guided(Random(seed), loads("top 2of4 a b c d;"), STRICT)) for seed in range(120))
    assert set(lengths) == {2, 3, 4}
    assert lengths[2] > lengths[3]


# -- values ---------------------------------------------------------------------------------------------------------

GUARDS: Final = """
X >= 250 and X <= 250; X > 250 and X < 252; X > 1 and X < 2; X == "entrance"; "b" < X and X <= "ba"
Y >= X + 10 and Y <= X + 10
10 - X == 3; X * 4 == 36; 100 / X == 8; -X == 77; 2 * (X - 3) + 1 == 41; X + X == X * 2; X < Y and Y < Z and Z < X + 3
X and not Y; X == null or X != X; X == 1000 or X == 2000; not (X < 100000) and not (X > 100001)
X != Y and Y != Z and X != Z; X != 1 and Y == "a" and not Z
"""


@pytest.mark.parametrize("guard", GUARDS.strip().replace("\n", "; ").split("; "))
@pytest.mark.parametrize("manner", MANNERS)
def test_values_under_which_a_guard_holds(guard: str, manner: str) -> None:
    tree = loads(
        "event e(k, x) = { k: k, x: x }; top and a b c d;"
        f' a on e("a", X); b on e("b", Y); c on e("c", Z); d on e("d", _) when {guard};'
    )
    for seed in range(2):
        assert detects(tree, STRICT, detecting(Random(seed), tree, STRICT, MANNERS[manner]))


@pytest.mark.parametrize("manner", MANNERS)
def test_bounds_are_met_exactly_and_narrowly(manner: str) -> None:
    events = "event e(v, t) = { v: v, t: t };"
    tree = loads(f"{events} top sand a b; a on e(V, S); b on e(_, T) when V >= 250 and T > S + 10;")
    pairs = [guided(Random(seed), tree, STRICT, MANNERS[manner]) for seed in range(150)]
    assert {first["v"] for first, _ in pairs} >= {250, 251}
    assert 11 in {second["t"] - first["t"] for first, second in pairs}


def test_an_early_value_that_leaves_none_for_a_later_variable_is_given_up() -> None:
    tree = loads(f"{EVENT} top sand a b; a on e(X); b on e(Y) when Y > X and Y < 4;")
    assert sum(found(guided, Random(seed), tree, STRICT, ONCE) is not None for seed in range(100)) > 80


@pytest.mark.parametrize("shape", ["guarded", "variables", "shared variables"])
def test_where_none_is_found_another_search_finds_no_values_either(shape: str) -> None:
    missed = [tree for random, tree in small_trees(shape, 6) if found(guided, random, tree) is None]
    for tree in missed:
        for scenario in feasible_scenarios(tree):
            assert witness([node.when for node in scenario.nodes if node.when is not None]) is None
    assert len(missed) < 5


@pytest.mark.parametrize(
    ("text", "nodes", "longest", "said"),
    [
        ("top and a b; a on e(X) when X > 5; b on e(X) when X < 5;", "ab", None, "the guards of a and b do not hold"),
        ("top and a b; a on e(X) when X > 5 and X < 5; b;", "a", None, "the guard of a does not hold"),
        ("top and a b; a on e(_); b; ignore e(_);", "a", None, "`ignore` takes the events of a"),
        ("top and a b; a on e(3); b; ignore e(X) when X > 2;", "a", None, "`ignore` takes the events of a"),
        ("top or l s; l and a b c d; s 3of4 a b c d;", "", 2, "the shortest scenario met has 3 events"),
    ],
)
def test_what_is_in_the_way_is_named(text: str, nodes: str, longest: int | None, said: str) -> None:
    with pytest.raises(NoTraceFound, match=said) as caught:
        guided(Random(0), loads(f"{EVENT} {text}"), PROJECTED, replace(WILD, attempts=40, longest=longest))
    assert set(caught.value.nodes) <= set(nodes)
    assert "40 attempts" in str(caught.value)


IGNORING: Final = f"{EVENT} top and a b; a on e(X); b on e(_); ignore e(X) when X < 1000 or not X > 1000;"
ANYTHING: Final = "event anything() = {}; top sand a b; a on anything(); b;"


@pytest.mark.parametrize(("text", "semantics"), [(IGNORING, PROJECTED), (ANYTHING, STRICT)])
def test_ignored_values_are_avoided_and_an_event_without_fields_is_one(text: str, semantics: Semantics) -> None:
    tree = loads(text)
    for random in map(Random, range(20)):
        trace = detecting(random, tree, semantics)
        assert detects(tree, semantics, trace)
        assert all(isinstance(event, dict) for event in [*disturbed(random, trace, tree), *random_trace(random, tree)])


LOG: Final = load(Path(__file__).with_name("log.rvaft"))


@pytest.mark.parametrize("semantics", Semantics)
def test_people_believe_a_plain_log(semantics: Semantics) -> None:
    for seed in range(12):
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


@pytest.mark.ci
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
        trace = found(guided, random, tree, semantics) or []
        return json.dumps([trace, disturbed(random, trace, tree), found(near_miss, random, tree, semantics)])

    assert len({all_of(seed) for seed in (0, 0, 1, 1, 2, 2, 3, 3)}) == 4


@pytest.mark.ci
@settings(max_examples=10, suppress_health_check=list(HealthCheck), database=None)
@given(st.data(), strategies.semantics(), strategies.trees_with_guided_traces())
def test_strategies(data: st.DataObject, semantics: Semantics, example: tuple[RVAFT, Semantics, list[Json]]) -> None:
    tree, chosen, trace = example
    if small_and_valid(tree):
        assert verdicts(tree, chosen, trace) == list(monitor(tree, semantics=chosen).run(trace))
    trace = data.draw(strategies.detecting_traces(PRUNED, semantics))
    assert verdicts(PRUNED, semantics, trace)[-1] is Verdict.TRUE
    near = data.draw(strategies.near_misses(PRUNED, semantics))
    assert Verdict.TRUE not in verdicts(PRUNED, semantics, near.trace)
    assert isinstance(data.draw(strategies.disturbed_traces(PRUNED, semantics)), list)
