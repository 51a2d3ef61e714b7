"""The logs are what they claim to be: read here by `json` alone."""

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import rvaft
from tests.benchmarks.logs import BOUND, SSHD_TREE, WAYPOINTS, Log, inspections, sshd, telemetry

TOPICS = {"/move_base/goal": "goal", "/move_base/result": "result", "/radiation_sensor_plugin/sensor_0": "radiation"}


def type_of(event: dict[str, Any]) -> str | None:
    """The event type of the tree that an event is of."""
    return event["name"] if event["topic"] == "/command" else TOPICS.get(event["topic"])


@pytest.mark.parametrize(
    ("make", "events", "readings"),
    [(telemetry, 20_000, {}), (inspections, 3_000, {}), (inspections, 3_000, {"readings": 1})],
)
def test_what_is_known_of_a_log_is_so(tmp_path: Path, make: Any, events: int, readings: dict[str, int]) -> None:
    log: Log = make(tmp_path / "log.jsonl", events, **readings)
    lines = log.file.read_bytes().splitlines()
    assert make(tmp_path / "again", events, **readings).file.read_bytes().splitlines() == lines
    assert make(tmp_path / "other", events, **readings, seed=7).file.read_bytes().splitlines() != lines
    found = [json.loads(line) for line in lines]
    types = [type_of(event) for event in found]
    assert len(found) == log.events
    assert Counter(name for name in types if name) == log.types
    assert types[-5:] == ["move", "inspect", "radiation", "move", "goal"]
    assert [number for number, name in enumerate(types, 1) if name][1] == log.lost
    assert sum(event["topic"].endswith("sensor_1") for event in found) == (20 if make is telemetry else 0)
    assert all(100 <= len(line) <= 500 for line in lines)
    assert all(before["time"] < after["time"] for before, after in pairwise(found))
    before = found[:-5]  # nothing comes of it before the last five events
    assert max(event["value"] for event in before if "value" in event) < BOUND
    waypoints = {event.get("waypoint", event.get("goal")) for event in before if type_of(event)} - {None}
    assert waypoints <= set(WAYPOINTS)


def test_shares(tmp_path: Path) -> None:
    assert telemetry(tmp_path / "log", 20_000).types.total() == 20 + 5
    even = inspections(tmp_path / "log", 10_000, readings=1).types
    assert max(even.values()) - min(even.values()) <= 3
    published = inspections(tmp_path / "log", 10_000).types
    assert published["radiation"] / published.total() == pytest.approx(0.95, abs=0.005)


def test_logins_have_the_attacks_that_are_known(tmp_path: Path) -> None:
    known = sshd(tmp_path / "log", 20_000, 400)
    assert sshd(tmp_path / "again", 20_000, 400) == known
    assert (tmp_path / "again").read_bytes() == (tmp_path / "log").read_bytes()
    events = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    assert len(events) == 20_000
    assert len({event["ip"] for event in events}) == 400
    assert 0.38 < sum(event["event"] == "failed" for event in events) / 20_000 < 0.42
    assert all(before["time"] <= after["time"] for before, after in pairwise(events))
    tree, found = rvaft.loads(SSHD_TREE), Counter[str]()
    for ip in {event["ip"] for event in events}:
        monitor = rvaft.monitor(tree, repeat=True)
        verdicts = [monitor.step(event) for event in events if event["ip"] == ip]
        found[ip] = verdicts.count(rvaft.Verdict.TRUE)
    assert +found == known
    assert found.total() >= 4
