"""`rvaft monitor` on one log: verdicts, explanations, and what the traces held."""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import PRUNED, ROW1, SAND, failed, jsonl, lines, run, written

ATTACK = [
    {"topic": "/command", "name": "move", "waypoint": 1, "time": 1},
    {"topic": "/command", "name": "inspect", "waypoint": 1},
    {"topic": "/radiation_sensor_plugin/sensor_0", "value": 260, "time": 10.5},
    {"topic": "/command", "name": "move", "waypoint": 2, "time": 11},
    {"topic": "/move_base/goal", "goal": 3},
]
ATTACK_TOLD = """\
event 5: true
  branch 3: attack
  event 1 at 1 on /command is ev1 (Moving to an inspection waypoint)
  event 2 on /command is ev3 (Take radiation reading)
  event 3 at 10.5 on /radiation_sensor_plugin/sensor_0 is ev4 (New radiation message)
  event 4 at 11 on /command is ev6 (Command to move on)
  event 5 on /move_base/goal is ev9 (Waypoint sent to the planner)
  Waypoint = 1
  Value = 260
  T1 = 10.5
  NewWp = 2
  T2 = 11
  MBGoal = 3
verdict true after 5 events
events read: 5; relevant: move 2, result 0, inspect 1, radiation 1, goal 1
warning: no event of type result
"""


@pytest.fixture
def attack(tmp_path: Path) -> Path:
    return written(tmp_path / "attack.jsonl", lines(ATTACK))


def test_text_says_when_the_verdict_changes_why_and_what_was_read(attack: Path) -> None:
    for words in ([attack], [], ["-"]):
        result = run("monitor", PRUNED, *words, data=lines(ATTACK))
        assert (result.exit_code, result.stdout, result.stderr) == (1, ATTACK_TOLD, "")


def test_jsonl_is_one_object_per_event_and_nothing_else(attack: Path) -> None:
    *before, last = jsonl(PRUNED, attack)
    assert before == [{"event": number, "verdict": "unknown"} for number in range(1, 5)]
    places = [{name: event[name] for name in ("time", "topic") if name in event} for event in ATTACK]
    nodes = ("ev1", "ev3", "ev4", "ev6", "ev9")
    assert last == {
        "event": 5,
        "verdict": "true",
        "branch": 3,
        "kinds": ["attack"],
        "matched": [{"node": node, "event": i + 1, **places[i]} for i, node in enumerate(nodes)],
        "variables": {"Waypoint": 1, "Value": 260, "T1": 10.5, "NewWp": 2, "T2": 11, "MBGoal": 3},
    }


def test_several_traces_are_named_and_start_afresh(attack: Path, tmp_path: Path) -> None:
    other = written(tmp_path / "other.jsonl", lines(ATTACK[:1]))
    said = jsonl(PRUNED, attack, other, attack)
    assert [one["trace"] for one in said] == [str(attack)] * 5 + [str(other)] + [str(attack)] * 5
    assert said[5] == {"trace": str(other), "event": 1, "verdict": "unknown"}
    text = run("monitor", PRUNED, attack, other).stdout
    assert f"{attack}: event 5: true\n" in text
    assert f"{other}: verdict unknown after 1 event\n" in text
    assert "events read: 6; relevant: move 3" in text


def test_letters_that_look_like_a_mistake_are_named(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "event named(x) = { event: x };\ntoplevel a;\na on named(X);\n")
    odd = "the letter ev1 is its default event, but the node ev1 has the event move(Waypoint, _)"
    for where, word, status, said in (
        (PRUNED, "ev1 ev1", 0, odd),
        (SAND, "a q b z c q", 1, "no node has the default event q or z"),
        (SAND, "a b c", 1, ""),
        (tree, "q", 1, ""),
    ):
        result = run("monitor", where, "--word", word)
        assert (result.exit_code, result.stderr) == (status, said and f"rvaft: warning: {said}\n")


@pytest.mark.parametrize(("option", "status"), [("--branch 3", 1), ("--branch 1", 0), ("--kind fault", 0), ("", 1)])
def test_a_monitor_for_a_branch_or_a_kind(attack: Path, option: str, status: int) -> None:
    assert run("monitor", PRUNED, attack, *option.split()).exit_code == status


def test_a_verdict_of_false_is_nothing_found() -> None:
    result = run("monitor", SAND, "--word", "b a")
    assert result.exit_code == 0
    assert result.stdout.startswith("event 1: false\n  branch 1 waited for a\nverdict false after 2 events\n")
    expected = [{"branch": 1, "awaited": [{"node": "a", "event": "a"}], "variables": {}}]
    assert jsonl(SAND, "--word", "b a")[0] == {"event": 1, "verdict": "false", "expected": expected}


def test_a_malformed_line_ends_its_trace_after_the_verdicts_before_it(tmp_path: Path) -> None:
    torn = written(tmp_path / "torn.jsonl", lines(ATTACK) + "\n" + '{"topic": ')
    result = run("monitor", PRUNED, torn)
    failed(result, f"{torn}:7: ")
    assert result.stdout.startswith("event 5: true\n")
    assert "verdict" not in result.stdout
    result = run("monitor", PRUNED, torn, "--format", "jsonl")
    failed(result, f"{torn}:7: ")
    assert [json.loads(line)["verdict"] for line in result.stdout.splitlines()] == ["unknown"] * 4 + ["true"]
    result = run("monitor", SAND, written(torn, lines([{"event": "a"}, {"event": "c"}]) + "[]"), "--format", "table")
    failed(result, f"{torn}:3: ")
    assert [line.split()[-1] for line in result.stdout.splitlines()[:3]] == ["φ", "?", "⊥"]
    result = run("monitor", SAND, written(torn, "[]"), "--format", "table")
    failed(result, f"{torn}:1: ")
    assert result.stdout == ""


def test_the_other_traces_are_still_read_after_a_malformed_one(attack: Path, tmp_path: Path) -> None:
    torn = written(tmp_path / "torn.jsonl", "{")
    result = run("monitor", PRUNED, torn, tmp_path / "missing", "no/such/*", attack, "--format", "jsonl")
    assert result.exit_code == 2
    said = result.stderr.splitlines()
    assert [part in line for part, line in zip(("no/such/*", f"{torn}:1: ", "missing"), said, strict=True)]
    assert len(result.stdout.splitlines()) == 5


def test_the_end_warns_of_types_never_seen_and_of_near_misses(tmp_path: Path) -> None:
    events: list[dict[str, Any]] = [
        {"topic": "command", "name": "move", "waypoint": 1, "time": 1},
        {"topic": "/command", "name": "inspect", "way_point": 1},
        {"topic": "/command", "name": "inspect"},
        {"topic": "/move_base/result", "waypoint": 1, "result": "failure"},
        {"topic": "/else"},
    ]
    result = run("monitor", PRUNED, written(tmp_path / "log.jsonl", lines(events)))
    near = "warning: near miss:"
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-8:] == [
        "events read: 5; relevant: move 0, result 0, inspect 0, radiation 0, goal 0",
        *(f"warning: no event of type {name}" for name in ("move", "inspect", "radiation", "goal")),
        f'{near} 1 event would be move but for the field topic, which is "command", not "/command" (first: event 1)',
        f"{near} 2 events would be inspect but for the field waypoint, which is missing (first: event 2)",
        f'{near} 1 event would be result but for the field result, which is "failure", not "success" (first: event 4)',
    ]


def test_values_cannot_steer_the_terminal(tmp_path: Path) -> None:
    events: list[dict[str, Any]] = [
        {**event, "waypoint": "\x9b31m\u202e"} if "waypoint" in event else event for event in ATTACK[:2]
    ]
    tree = written(tmp_path / "tree.rvaft", "event move(w) = { waypoint: w };\ntoplevel a;\na and b;\nb on move(W);\n")
    result = run("monitor", tree, written(tmp_path / "log.jsonl", lines(events)))
    assert result.exit_code == 1
    assert all(line.isprintable() for line in result.stdout.splitlines())


needs_spot = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]


@pytest.mark.parametrize("backend", ["rml", *(pytest.param(name, marks=needs_spot) for name in ("ltlf", "automaton"))])
def test_a_backend_gives_the_same_verdicts_without_an_explanation(backend: str) -> None:
    expected = [{key: one[key] for key in ("event", "verdict")} for one in jsonl(SAND, "--word", "a b c")]
    assert jsonl(SAND, "--word", "a b c", "--backend", backend) == expected
    assert run("monitor", SAND, "--word", "a b c", "--backend", backend).exit_code == 1


def test_what_tells_an_event_apart_is_told(tmp_path: Path) -> None:
    events = 'event e(x) = { kind: "k", x: x };\ntoplevel t; t sand a b c; a on e(1); b on e(_); c;'
    tree = written(tmp_path / "t.rvaft", events)
    log = written(tmp_path / "l", lines([{"kind": "k", "x": 1, "time": 3}, {"kind": "k", "x": 2}, {"event": "c"}]))
    assert run("monitor", tree, log).stdout.splitlines()[1:5] == [
        "  branch 1",
        "  event 1 at 3 with kind k is a",
        "  event 2 with kind k is b",
        "  event 3 is c",
    ]
    (told,) = jsonl(tree, log, "--detections")
    assert told["matched"] == [
        {"node": "a", "event": 1, "time": 3, "fields": {"kind": "k"}},
        {"node": "b", "event": 2, "fields": {"kind": "k"}},
        {"node": "c", "event": 3},
    ]


def test_events_of_a_stream_that_are_forgotten_are_not_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.monitoring.run.BOUND", 2)
    data = ROW1.read_text(encoding="utf-8")
    said = run("monitor", PRUNED, data=data).stdout
    assert "  event 1 (no longer known) is ev1" in said
    assert "  event 4 at 30.241 on /command is ev6" in said
    last = jsonl(PRUNED, data=data)[-1]
    assert last["matched"][0] == {"node": "ev1", "event": 1}
    assert last["matched"][3] == {"node": "ev6", "event": 4, "time": 30.241, "topic": "/command"}
    assert "no longer known" not in run("monitor", PRUNED, ROW1).stdout


def test_a_limit_of_partial_matches_ends_the_run(tmp_path: Path) -> None:
    put, get = ('event put(x) = { event: "put", x: x };', 'event get(x) = { event: "get", x: x };')
    tree = written(tmp_path / "tree.rvaft", f"{put}{get} toplevel t; t sand a b c; a on put(X); b on get(X); c;")
    log = written(tmp_path / "log.jsonl", lines([{"event": "put", "x": number} for number in range(50)]))
    assert run("monitor", tree, log, "--semantics", "scattered", "--max-configurations", 60).exit_code == 0
    result = run("monitor", tree, log, "--semantics", "scattered", "--max-configurations", 20)
    failed(result, "too large", "X", "limit 20", str(log), "event 2")
