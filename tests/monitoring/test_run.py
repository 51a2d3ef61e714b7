"""Reading a log many lines at a time tells and counts what reading it one by one does."""

import io
import json
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest

from cross_check.generate.traces import random_trace
from rvaft import RVAFT, Semantics, TraceError, loads, monitor
from rvaft.analysis.pattern_index import TreeReads
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from rvaft.monitoring import fast_reader
from rvaft.monitoring.detection import told_fields
from rvaft.monitoring.monitor_set import MonitorSet, Per, columns
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.run import EventBuffer, Key, Listener, MonitoringPlan, TraceRun, VerdictChange
from tests.trees import shipped


class Told(Listener):
    """Remembers what it was told, and the explanations of then."""

    def __init__(self) -> None:
        self.said: list[Any] = []

    def change(self, change: VerdictChange) -> None:
        for column in change.columns:
            explanation, ended = change.watch.monitors.explanation(column), change.watch.monitors.ended(column)
            known = () if explanation is None else change.watch.buffer.events(set(explanation.matched.values()))
            times = {at: (known[at].get("time"), known[at].get("topic")) for at in known}
            self.said.append(
                (change.watch.key, change.number, column, change.verdicts[column], explanation, ended, times)
            )


class Every(Told):
    """Wants to be told of every event."""

    every = True


def run_of(tree: RVAFT, semantics: str, per: Per, told: Told, **options: Any) -> TraceRun:
    monitors = MonitorSet(columns(tree, per), lambda part: monitor(part, semantics=semantics), Semantics(semantics))
    plan = MonitoringPlan(monitors, TreeReads(tree), told=told_fields(tree), **options)
    return TraceRun(plan, "log", [told], buffer=EventBuffer(reads=plan.reads), statistics=Statistics(monitors.types))


def outcome(tree: RVAFT, semantics: str, per: Per, data: bytes, *, by_blocks: bool) -> Any:
    told = Told()
    run = run_of(tree, semantics, per, told)
    error = None
    try:
        for _ in run.read(io.BytesIO(data), "log", by_blocks=by_blocks):
            pass
    except TraceError as failure:
        error = str(failure)
    statistics = run.statistics
    assert statistics is not None
    counted = statistics.events, statistics.relevant, statistics.never_seen, statistics.near_misses
    return told.said, run.watch.monitors.verdicts, run.watch.events, run.number, list(run.warnings), counted, error


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fast_reader, "SIZE", 300)


def log_of(trace: Sequence[Json], random: Random) -> bytes:
    """A trace among telemetry, blank lines, and times that go back now and then."""
    lines: list[str] = []
    for event in trace:
        lines.extend(json.dumps({"topic": "/odom", "x": random.random()}) for _ in range(random.choice([0, 0, 1, 5])))
        lines.extend([""] * random.choice([0, 0, 0, 1]))
        timed = event if "time" in event or random.random() < 0.5 else {**event, "time": random.random()}
        lines.append(json.dumps(timed))
    return "\n".join(lines).encode()


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("per", Per)
@pytest.mark.parametrize("name", shipped.names())
def test_shipped_trees(name: str, per: Per, semantics: Semantics) -> None:
    tree = shipped.load(name)
    random = Random(f"{name} {per} {semantics}")
    stored = [events for _, events in shipped.traces(name)]
    for number in range(4):
        trace = random.choice(stored) if number % 2 else random_trace(random, tree, max_length=24)
        data = log_of(trace, random)
        if random.random() < 0.2:
            data += b"\n{"
        assert outcome(tree, semantics, per, data, by_blocks=True) == outcome(
            tree, semantics, per, data, by_blocks=False
        )


TREE = loads('event a(v) = { kind: "k", value: v }; toplevel r; r and x y; x on a(1); y on a(2);')


def test_what_has_to_see_every_event_as_it_stands() -> None:
    assert run_of(TREE, "projected", Per.TREE, Told()).plan.fast_reader is not None
    for options in ({"key": Key.parse(["id"])}, {"order_by": "time"}):
        assert run_of(TREE, "projected", Per.TREE, Told(), **options).plan.fast_reader is None
    every = Every()
    list(run_of(TREE, "projected", Per.TREE, every).read(io.BytesIO(b'{"event": 1}'), "log", by_blocks=True))


def test_the_topic_and_time_of_a_match_are_known_where_no_pattern_has_them() -> None:
    data = b'{"kind":"k","value":1,"topic":"/a","time":5}\n{"kind":"w"}\n{"kind":"k","value":2,"topic":"/b","time":4}\n'
    found = outcome(TREE, "scattered", Per.TREE, data, by_blocks=True)
    assert found == outcome(TREE, "scattered", Per.TREE, data, by_blocks=False)
    [(_, number, *_, times)] = found[0]
    assert (number, times) == (3, {1: (5, "/a"), 3: (4, "/b")})


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("seed", range(4))
def test_each_key_gets_the_verdicts_and_matches_of_its_events_alone(seed: int, semantics: Semantics) -> None:
    tree = shipped.load("remote_inspection/pruned")
    random = Random(seed)
    traces = dict(shipped.traces("remote_inspection/pruned"))
    left = {name: list(events) for name, events in traces.items()}
    given: dict[str, list[int]] = {name: [] for name in traces}
    mixed: list[Json] = []
    while any(left.values()):
        name = random.choice([name for name, events in left.items() if events])
        mixed.append({**left[name].pop(0), "robot": name})
        given[name].append(len(mixed))
    run = run_of(tree, semantics, Per.TREE, Told(), key=Key.parse(["robot"]))
    list(run.read(mixed, "log"))
    assert {watch.key[0] for watch in run.watches if watch.key} == set(traces)
    for watch in run.watches:
        assert watch.key is not None
        name = watch.key[0]
        alone = monitor(tree, semantics=semantics)
        *_, last = alone.run(traces[name])
        assert watch.monitors.verdicts == (last,)
        explanation, own = watch.monitors.explanation(0), alone.explanation
        assert (explanation is None) is (own is None)
        if explanation is not None and own is not None:
            assert explanation.branch == own.branch
            assert explanation.matched == {node: given[name][at - 1] for node, at in own.matched.items()}
        if alone.ended is not None:
            assert watch.monitors.since[0] == given[name][alone.ended.event - 1]


def test_events_without_the_key_and_too_many_keys() -> None:
    run = run_of(TREE, "projected", Per.TREE, Told(), key=Key.parse(["robot.id", "x"]), max_keys=2)
    log = [{"robot": {"id": None}, "x": 1}, {"robot": {"id": 1}}, {}, {"robot": {"id": 1}, "x": 1}]
    list(run.read(log, "log"))
    assert [watch.key for watch in run.watches] == [(None, 1), (1, 1)]
    assert list(run.warnings) == ["2 events without the field robot.id or x, given to no monitor (first: event 2)"]
    with pytest.raises(TooLarge, match=r"different values of robot.id and x") as raised:
        list(run.read([{"robot": {"id": 1}, "x": 2}], "log"))
    assert raised.value.limit == 2


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (1, 1.0, True),
        (1, True, False),
        (0, False, False),
        ("1", 1, False),
        (None, False, False),
        ([1, 2], [1.0, 2], True),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, True),
        (2**60, float(2**60), True),
    ],
)
def test_keys_are_told_apart_as_everywhere(one: Any, other: Any, same: bool) -> None:
    for fields in (["k"], ["k", "m"]):
        run = run_of(TREE, "projected", Per.TREE, Told(), key=Key.parse(fields))
        list(run.read([{"k": one, "m": 1}, {"k": other, "m": 1}], "log"))
        assert len(run.watches) == 2 - same
