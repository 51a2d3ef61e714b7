"""Reading a log many lines at a time tells and counts what reading it one by one does."""

import io
import json
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest

from cross_check.generate.traces import random_trace
from rvaft import RVAFT, Semantics, TraceError, monitor
from rvaft.analysis.pattern_index import TreeReads
from rvaft.model.values import Json
from rvaft.monitoring import fast_reader
from rvaft.monitoring.event_buffer import Recall
from rvaft.monitoring.monitor_set import Bank, Listener, Per, Watch, columns
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.run import Plan, Run, advance, batches_for, events
from tests.trees import shipped


class Told(Listener):
    """Remembers what it was told, and the explanations of then."""

    def __init__(self) -> None:
        self.said: list[Any] = []

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:  # noqa: ARG002
        for column in changed:
            explanation, ended = watch.bank.explanation(column), watch.bank.ended(column)
            known = () if explanation is None else watch.recall.events(set(explanation.matched.values()) - {number})
            times = {at: (known[at].get("time"), known[at].get("topic")) for at in known}
            self.said.append((number, column, watch.bank.verdicts[column], explanation, ended, times))


def run_of(tree: RVAFT, semantics: str, per: Per, told: Told) -> Run:
    bank = Bank(columns(tree, per), lambda part: monitor(part, semantics=semantics), Semantics(semantics))
    plan = Plan(bank, TreeReads(tree))
    return Run(plan, "log", [told], recall=Recall(None, reads=plan.reads), statistics=Statistics(tree))


def outcome(run: Run, told: Told, error: str | None) -> Any:
    statistics = run.statistics
    assert statistics is not None
    counted = statistics.events, statistics.relevant, statistics.never_seen, statistics.near_misses
    return told.said, run.watch.bank.verdicts, run.watch.events, run.number, run.warnings, counted, error


def one_by_one(tree: RVAFT, semantics: str, per: Per, data: bytes) -> Any:
    told = Told()
    run = run_of(tree, semantics, per, told)
    error = None
    try:
        for number, event in events(run, io.BytesIO(data), "log"):
            run.step(number, event)
    except TraceError as failure:
        error = str(failure)
    return outcome(run, told, error)


def quickly(tree: RVAFT, semantics: str, per: Per, data: bytes) -> Any:
    told = Told()
    run = run_of(tree, semantics, per, told)
    batches = batches_for(run)
    assert batches is not None
    assert run.statistics is not None
    error = None
    try:
        for _ in advance(run, batches, io.BytesIO(data), "log", run.statistics):
            pass
    except TraceError as failure:
        error = str(failure)
    return outcome(run, told, error)


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
    for number in range(6):
        trace = random.choice(stored) if number % 2 else random_trace(random, tree, max_length=24)
        data = log_of(trace, random)
        if random.random() < 0.2:
            data += b"\n{"
        assert quickly(tree, semantics, per, data) == one_by_one(tree, semantics, per, data)
