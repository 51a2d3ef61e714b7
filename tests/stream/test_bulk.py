"""Bulk reading changes speed alone: with it switched off every command gives the same answers."""

import csv
import json
from itertools import product
from pathlib import Path
from random import Random
from typing import Any

import pytest

from rvaft import Semantics
from rvaft.readers import json_blocks
from rvaft.stream import batch_steps, sources
from tests.benchmarks.logs import ignoring_tree, inspections
from tests.cli.runs import TREES, lines, run
from tests.tables import sampled
from tests.trees import shipped

OPTIONS = [
    [],
    ["--format", "jsonl", "--per", "branch"],
    ["--explain"],
    ["--key", "topic"],
    ["--order-by", "time", "--window", "9", "--format", "jsonl"],
    ["--repeat", "--format", "jsonl", "--detections"],
]


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_blocks, "SIZE", 900)
    monkeypatch.setattr(sources, "BLOCK", 7)
    monkeypatch.setattr(batch_steps, "FEW", 4)


def answers(monkeypatch: pytest.MonkeyPatch, *args: object) -> tuple[int, str, str]:
    """What a command prints and returns, read in bulk and event by event."""
    found = []
    for enabled in (True, False):
        monkeypatch.setattr(sources, "ENABLED", enabled)
        result = run(*args)
        found.append((result.exit_code, result.stdout, result.stderr))
    assert found[0] == found[1]
    return found[0]


def log_of(name: str, random: Random) -> list[dict[str, Any]]:
    """The traces of a tree one after the other, among telemetry, with repeated and damaged events."""
    events: list[dict[str, Any]] = []
    for _, trace in shipped.traces(name):
        for event in trace:
            events += [{"topic": "/odom", "x": random.random()} for _ in range(random.choice([0, 0, 2, 9]))]
            events += [event] * random.choice([1, 1, 1, 12])
            if random.random() < 0.1:
                events.append({**event, random.choice([*event, "topic"]): random.choice([None, 1.5, "", [1]])})
    return [{"time": number, **event} for number, event in enumerate(events[:400])]


@pytest.mark.ci
@pytest.mark.parametrize("name", sampled(shipped.names(), 5, ci=2))
def test_shipped_trees(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    random, log = Random(name), tmp_path / "log.jsonl"
    events = log_of(name, random)
    log.write_text(lines(events) + random.choice(["", "{"]), encoding="utf-8")
    tree, detected = TREES / f"{name}.rvaft", set()
    for semantics in Semantics:
        for options in random.sample(OPTIONS, 2):
            status, printed, _ = answers(monkeypatch, "monitor", tree, log, "--semantics", semantics, *options)
            detected.add(status == 1 or "true" in printed)
    answers(monkeypatch, "coverage", tree, log)
    assert True in detected


@pytest.mark.parametrize(("options", "semantics"), sampled(product(OPTIONS, Semantics), 3))
def test_long_logs(options: list[str], semantics: Semantics, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, log = ignoring_tree(tmp_path), tmp_path / "log.jsonl"
    inspections(log, 400, readings=1)
    status, _, _ = answers(monkeypatch, "monitor", tree, log, "--semantics", semantics, *options)
    assert status in (0, 1)
    answers(monkeypatch, "coverage", tree, log, "--semantics", semantics)


@pytest.mark.ci
def test_logs_in_another_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, log, table = ignoring_tree(tmp_path), tmp_path / "log.jsonl", tmp_path / "log.csv"
    inspections(log, 200, readings=1)
    events = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    fields = list(dict.fromkeys(field for event in events for field in event))
    with table.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fields)
        writer.writeheader()
        writer.writerows({field: value for field, value in event.items() if field != "name"} for event in events)
    for semantics in Semantics:
        for options in OPTIONS:
            answers(monkeypatch, "monitor", tree, table, "--semantics", semantics, *options)
