"""The risk given a log: known values, the verdicts of the monitor, and the states of the monitor itself."""

import random
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rvaft
from rvaft.risk.model import RiskError, of_tree
from rvaft.risk.monitor_states import MonitorStates
from rvaft.risk.probability import Analysis
from rvaft.risk.runtime import RiskMonitor
from rvaft.risk.simulation import Simulation
from tests.cli.runs import run
from tests.risk.forms import form

pytest.importorskip("oxidd")


def watching(text: str, horizon: float = 1.0, *, galileo: bool = False) -> RiskMonitor:
    tree = rvaft.loads(text, "t.dft" if galileo else "t.rvaft")
    return RiskMonitor(tree, form(text, galileo=galileo), horizon)


def risks(text: str, word: str, horizon: float = 1.0, *, galileo: bool = False) -> list[float]:
    monitor = watching(text, horizon, galileo=galileo)
    return [monitor.risk, *(monitor.step({"event": name}) for name in word)]


def test_known_values() -> None:
    assert risks("t sand x y; x lambda=.5; y lambda=.2;", "x")[-1] == pytest.approx(0.1812692469)
    text = 'event e(n) = {event: n}; t 2of3 x y z; x on e("x") lambda=.5; y lambda=.2; z lambda=.1;'
    assert risks(text, "xx")[-1] == pytest.approx(0.2591817793)


def test_an_event_that_the_model_excludes_changes_nothing_and_is_counted() -> None:
    monitor = watching("t and x y; x lambda=.5; y lambda=.2;")
    first = monitor.step({"event": "x"})
    assert monitor.step({"event": "x"}) == first
    assert monitor.contradictions == 1
    assert monitor.step({"event": "other"}) == first
    assert monitor.contradictions == 1


def test_what_raises_the_risk_most_is_told() -> None:
    text = "t or g z2; g and x y z; z2 lambda=.001; x lambda=.5; y lambda=.2; z lambda=.1;"
    outlook = watching(text).outlook()
    after = {name: risks(text, [name])[-1] for name in ("x", "y", "z", "z2")}  # type: ignore[arg-type]
    assert [one.leaf for one in outlook.next] == sorted(after, key=lambda name: -after[name])
    assert [one.risk for one in outlook.next] == pytest.approx(sorted(after.values(), reverse=True))


def test_the_most_advanced_match_is_told_with_its_values() -> None:
    text = 'event e(n, u) = {event: n, user: u}; t sand x y; x on e("x", U) lambda=.5; y on e("y", U) lambda=.2;'
    monitor = watching(text)
    events = [("y", "a"), ("x", "a"), ("x", "b"), ("y", "c"), ("y", "b")]
    found = [monitor.step({"event": name, "user": user}) for name, user in events]
    assert found == pytest.approx([0.0398025, 0.1812692, 0.1812692, 0.1812692, 1.0], rel=1e-6)
    assert monitor.outlook().values == {"U": "b"}


@st.composite
def trees(draw: st.DrawFn) -> str:
    """Draw a tree of events that recur, without sharing."""
    count = [0]

    def part(depth: int) -> tuple[str, str]:
        count[0] += 1
        name = f"n{count[0]}"
        if depth == 0 or draw(st.booleans()):
            times = draw(st.sampled_from(["", " times 2"]))
            return name, f"{name}{times} lambda={draw(st.integers(1, 9)) / 10} once=no;"
        children = [part(depth - 1) for _ in range(draw(st.integers(1, 3)))]
        words = ["or", "and", "sand", "sand_rl", f"{(len(children) + 1) // 2}of{len(children)}"]
        names = " ".join(one for one, _ in children)
        return name, f"{name} {draw(st.sampled_from(words))} {names}; {' '.join(text for _, text in children)}"

    name, text = part(2)
    return f"toplevel {name}; {text}"


@given(trees(), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_the_risk_is_1_just_where_the_monitor_detects(text: str, source: random.Random) -> None:
    tree = rvaft.loads(text)
    monitor, risk = rvaft.monitor(tree, semantics="scattered"), RiskMonitor(tree, of_tree(tree), 1.0)
    assert risk.risk == pytest.approx(Analysis(of_tree(tree)).at(1.0), rel=1e-10)
    leaves = [name for name in tree.order if tree.nodes[name].leaf]
    for _ in range(12):
        event = {"event": source.choice(leaves)}
        detected = bool(monitor.step(event))
        assert (risk.step(event) == 1.0) == detected
        if detected:
            break


@given(trees(), st.randoms(use_true_random=False))
@settings(max_examples=25, deadline=None)
def test_a_chain_over_the_states_of_the_monitor_gives_the_same_numbers(text: str, source: random.Random) -> None:
    tree = rvaft.loads(text)
    own = MonitorStates(tree, of_tree(tree), 1.0, rvaft.monitor(tree, semantics="scattered"))
    risk = RiskMonitor(tree, of_tree(tree), 1.0)
    leaves = [name for name in tree.order if tree.nodes[name].leaf]
    for _ in range(6):
        assert own.risk == pytest.approx(risk.risk, rel=1e-9)
        event = {"event": source.choice(leaves)}
        own.step(event)
        risk.step(event)


@st.composite
def events_of_leaves(draw: st.DrawFn) -> str:
    """Draw a tree of which leaves share events and variables, and have guards over the values of others."""
    count = [0]

    def part(depth: int) -> tuple[str, str]:
        count[0] += 1
        name = f"n{count[0]}"
        if depth == 0 or draw(st.booleans()):
            on = draw(st.sampled_from(["a", "b", "c"]))
            value = draw(st.sampled_from(["_", "X", "X", "Y", "1"]))
            guard = draw(st.sampled_from(["", "", " when X < Y", " when X != Y"])) if value in "XY" else ""
            times = draw(st.sampled_from(["", "", " times 2"]))
            return name, f'{name}{times} on e("{on}", {value}){guard} lambda={draw(st.integers(1, 9)) / 10};'
        children = [part(depth - 1) for _ in range(draw(st.integers(1, 3)))]
        words = ["or", "and", "sand", "sand_rl", f"{(len(children) + 1) // 2}of{len(children)}"]
        names = " ".join(one for one, _ in children)
        return name, f"{name} {draw(st.sampled_from(words))} {names}; {' '.join(text for _, text in children)}"

    name, text = part(2)
    rest = 'x on e("d", X) lambda=1; y on e("d", Y) lambda=1;'
    return f"event e(n, v) = {{event: n, value: v}}; toplevel top; top and {name} x y; {text} {rest}"


@given(events_of_leaves(), st.lists(st.tuples(st.sampled_from("aabbccdd"), st.integers(0, 2)), max_size=14))
@settings(max_examples=150, deadline=None)
def test_shared_events_variables_and_guards_lose_no_match(text: str, log: list[tuple[str, int]]) -> None:
    tree = rvaft.loads(text)
    monitor, risk = rvaft.monitor(tree, semantics="scattered"), RiskMonitor(tree, of_tree(tree), 1.0)
    before = risk.risk
    for name, value in log:
        event = {"event": name, "value": value}
        detected = bool(monitor.step(event))
        assert (risk.step(event) == 1.0) == detected
        if detected:
            break
        if " when " not in text:  # events that recur lose nothing by another one
            assert risk.risk >= before * (1 - 1e-12)
        before = risk.risk


@pytest.mark.parametrize(
    ("text", "log", "expected"),
    [  # one more event of an earlier step, and another use of an event, are no steps back
        ("t sand x y z; x on e('x', U) lambda=.5; y on e('y', U) lambda=.2; z on e('z', U) lambda=.1;", "xyxz", 1.0),
        ("t sand x y z; x on e('x', U) lambda=.5; y on e('y', U) lambda=.2; z on e('z', U) lambda=.1;", "xyx", 0.09516),
        (
            (
                "t or g h; g sand a c d; h sand b f; a on e('a', _) lambda=1; b on e('a', _) lambda=1; "
                "c on e('c', _) lambda=1; d on e('d', _) lambda=1; f on e('f', _) lambda=.1;"
            ),
            "acf",
            1.0,
        ),
        ("t sand x y; x on e('x', X) when X < Y lambda=1; y on e('y', Y) lambda=1;", "xy", 0.63212),
    ],
)
def test_no_event_takes_a_match_back(text: str, log: str, expected: float) -> None:
    tree = rvaft.loads("event e(n, v) = {event: n, value: v}; " + text.replace("'", '"'))
    risk = RiskMonitor(tree, of_tree(tree), 1.0)
    assert [risk.step({"event": name, "value": 1}) for name in log][-1] == pytest.approx(expected, rel=1e-4)


def test_an_event_that_another_leaf_takes_contradicts_nothing() -> None:
    text = 'event e(n) = {event: n}; t and a b c; a on e("a") lambda=1 once=yes; b on e("a") lambda=1 once=yes; '
    tree = rvaft.loads(text + "c lambda=1;")
    risk = RiskMonitor(tree, of_tree(tree), 1.0)
    counts = []
    for _ in range(3):
        risk.step({"event": "a"})
        counts.append(risk.contradictions)
    assert counts == [0, 0, 1]


def test_events_that_break_a_match_lower_the_risk_under_projected() -> None:
    tree = rvaft.loads("t sand x y z; x lambda=.5 once=no; y lambda=.2 once=no; z lambda=.9 once=no;")
    own = MonitorStates(tree, of_tree(tree), 1.0, rvaft.monitor(tree, semantics="projected"))
    scattered = RiskMonitor(tree, of_tree(tree), 1.0)
    assert own.risk < scattered.risk
    own.step({"event": "x"})
    own.step({"event": "z"})
    assert own.risk == 0.0


def test_refusals() -> None:
    tree = rvaft.loads("t sand x y; x lambda=.5; y lambda=.2;")
    with pytest.raises(RiskError, match="once=no"):
        MonitorStates(tree, of_tree(tree), 1.0, rvaft.monitor(tree, semantics="projected"))
    tree = rvaft.loads("event e(u) = {u: u}; t sand x y; x on e(U) lambda=.5; y lambda=.2 once=no;")
    with pytest.raises(RiskError, match="variables"):
        MonitorStates(tree, of_tree(tree), 1.0, rvaft.monitor(tree, semantics="projected"))


def test_probabilities_of_leaves_that_share_an_event_are_lower_bounds(tmp_path: Path) -> None:
    tree, log = tmp_path / "t.rvaft", tmp_path / "log.jsonl"
    tree.write_text("event e(k) = {k: k}; t sand a b; a on e(1) lambda=1 once=no; b on e(K) lambda=1;")
    log.write_text('{"k": 1}\n')
    warning = "one event may be that of a and of b"
    assert warning in run("risk", tree, "--time", "1").stderr
    assert warning in run("monitor", tree, log, "--semantics", "scattered", "--risk", "1").stderr
    whole = rvaft.load(tree)
    found = Simulation(whole, of_tree(whole)).estimate(rvaft.monitor(whole, semantics="scattered"), 1.0, samples=2000)
    assert Analysis(of_tree(whole)).at(1.0) < found.low


def test_ignored_events_are_matched_under_scattered() -> None:
    text = 'event e(n) = {event: n}; ignore e("x"); t and x y; x on e("x") lambda=1; y on e("y") lambda=1;'
    tree = rvaft.loads(text)
    monitor, risk = rvaft.monitor(tree, semantics="scattered"), RiskMonitor(tree, of_tree(tree), 1.0)
    for name in ("x", "y"):
        detected = bool(monitor.step({"event": name}))
        assert (risk.step({"event": name}) == 1.0) == detected
    assert detected


def test_predicted_risks_are_observed() -> None:
    text = "toplevel t; t or g h; g sand x y; h and z z2; x lambda=.5; y lambda=.4; z lambda=.7; z2 lambda=.3;"
    tree = rvaft.loads(re.sub(r"(lambda=\S+);", r"\1 once=no;", text))
    rates = {"x": 0.5, "y": 0.4, "z": 0.7, "z2": 0.3}
    source, first = random.Random(7), RiskMonitor(tree, of_tree(tree), 1.0)
    hits = expected = variance = 0.0
    for _ in range(3000):
        log, at = [], 0.0
        while at < 3.0:
            at += source.expovariate(sum(rates.values()))
            log.append((at, source.choices([*rates], [*rates.values()])[0]))
        monitor, risk = rvaft.monitor(tree, semantics="scattered"), first.fresh()
        for _, name in log[:2]:
            monitor.step({"event": name})
            risk.step({"event": name})
        if monitor.verdict.final:
            continue
        expected += risk.risk
        variance += risk.risk * (1 - risk.risk)
        hits += any([monitor.step({"event": name}).final for at, name in log[2:] if at <= log[1][0] + 1.0][-1:])
    assert abs(hits - expected) < 3 * variance**0.5
