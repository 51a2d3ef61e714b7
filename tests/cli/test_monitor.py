"""`rvaft monitor`: verdicts, explanations, and what the traces held."""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from rvaft import Semantics, load
from rvaft.semantics import Reference
from tests.cli.runs import PRUNED, TREES, failed, run

SAND = TREES / "gates" / "sand.rvaft"
ATTACK = [
    {"topic": "/command", "name": "move", "waypoint": 1, "time": 1},
    {"topic": "/command", "name": "inspect", "waypoint": 1},
    {"topic": "/radiation_sensor_plugin/sensor_0", "value": 260, "time": 10.5},
    {"topic": "/command", "name": "move", "waypoint": 2, "time": 11},
    {"topic": "/move_base/goal", "goal": 3},
]


def lines(events: list[dict[str, Any]]) -> str:
    return "".join(json.dumps(event) + "\n" for event in events)


@pytest.fixture
def attack(tmp_path: Path) -> Path:
    log = tmp_path / "attack.jsonl"
    log.write_text(lines(ATTACK))
    return log


def test_text_says_when_the_verdict_changes_why_and_what_was_read(attack: Path) -> None:
    result = run("monitor", PRUNED, attack)
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        "event 5: true",
        "  branch 3: attack",
        "  event 1 at 1 on /command is ev1 (Moving to an inspection waypoint)",
        "  event 2 on /command is ev3 (Take radiation reading)",
        "  event 3 at 10.5 on /radiation_sensor_plugin/sensor_0 is ev4 (New radiation message)",
        "  event 4 at 11 on /command is ev6 (Command to move on)",
        "  event 5 on /move_base/goal is ev9 (Waypoint sent to the planner)",
        "  Waypoint = 1",
        "  Value = 260",
        "  T1 = 10.5",
        "  NewWp = 2",
        "  T2 = 11",
        "  MBGoal = 3",
        "verdict true after 5 events",
        "events read: 5; relevant: move 2, result 0, inspect 1, radiation 1, goal 1",
        "warning: no event of type result",
    ]
    assert result.stderr == ""


def test_jsonl_is_one_object_per_event_and_nothing_else(attack: Path) -> None:
    result = run("monitor", PRUNED, attack, "--format", "jsonl")
    assert result.exit_code == 1
    *before, last = map(json.loads, result.stdout.splitlines())
    assert before == [{"event": number, "verdict": "unknown"} for number in range(1, 5)]
    assert last == {
        "event": 5,
        "verdict": "true",
        "branch": 3,
        "kinds": ["attack"],
        "matched": [
            {
                "node": node,
                "event": i,
                **{name: ATTACK[i - 1][name] for name in ("time", "topic") if name in ATTACK[i - 1]},
            }
            for i, node in enumerate(("ev1", "ev3", "ev4", "ev6", "ev9"), 1)
        ],
        "variables": {"Waypoint": 1, "Value": 260, "T1": 10.5, "NewWp": 2, "T2": 11, "MBGoal": 3},
    }


def test_several_traces_are_named_and_start_afresh(attack: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.jsonl"
    other.write_text(lines(ATTACK[:1]))
    result = run("monitor", PRUNED, attack, other, attack, "--format", "jsonl")
    said = [json.loads(line) for line in result.stdout.splitlines()]
    assert result.exit_code == 1
    assert [one["trace"] for one in said] == [str(attack)] * 5 + [str(other)] + [str(attack)] * 5
    assert said[5] == {"trace": str(other), "event": 1, "verdict": "unknown"}
    text = run("monitor", PRUNED, attack, other).stdout
    assert f"{attack}: event 5: true\n" in text
    assert f"{other}: verdict unknown after 1 event\n" in text
    assert "events read: 6; relevant: move 3" in text


@pytest.mark.parametrize("option", [(), ("-",)])
def test_standard_input_is_a_trace(option: tuple[str, ...]) -> None:
    result = run("monitor", PRUNED, *option, data=lines(ATTACK))
    assert result.exit_code == 1
    assert result.stdout.startswith("event 5: true\n")


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize("word", ["", "a", "a b c", "x a b c", "a x b c", "c b a", "a a b c"])
def test_words_get_the_verdicts_of_the_definition(semantics: Semantics, word: str) -> None:
    result = run("monitor", SAND, "--word", word, "--semantics", semantics, "--format", "jsonl")
    verdicts = [json.loads(line)["verdict"] for line in result.stdout.splitlines()]
    expected = list(Reference(load(SAND), semantics).run({"event": letter} for letter in word.split()))
    assert verdicts == [verdict.value for verdict in expected]
    assert result.exit_code == (1 if "true" in verdicts else 0)


def test_a_letter_is_the_default_event_even_of_a_node_with_another() -> None:
    result = run("monitor", PRUNED, "--word", "ev1 ev1")
    assert result.exit_code == 0
    assert result.stderr == (
        "rvaft: warning: the letter ev1 is its default event, but the node ev1 has the event move(Waypoint, _)\n"
    )


@pytest.mark.parametrize(
    ("options", "status"), [(["--branch", "3"], 1), (["--branch", "1"], 0), (["--kind", "fault"], 0)]
)
def test_a_monitor_for_a_branch_or_a_kind(attack: Path, options: list[str], status: int) -> None:
    assert run("monitor", PRUNED, attack, *options).exit_code == status
    assert run("monitor", PRUNED, attack, "--kind", "attack").exit_code == 1


def test_a_verdict_of_false_is_nothing_found() -> None:
    result = run("monitor", SAND, "--word", "b a")
    assert result.exit_code == 0
    assert result.stdout.startswith("event 1: false\n  branch 1 waited for a\nverdict false after 2 events\n")
    first = json.loads(run("monitor", SAND, "--word", "b a", "--format", "jsonl").stdout.splitlines()[0])
    assert first == {
        "event": 1,
        "verdict": "false",
        "expected": [{"branch": 1, "awaited": [{"node": "a", "event": "a"}], "variables": {}}],
    }


def test_a_malformed_line_ends_its_trace_after_the_verdicts_before_it(tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    torn.write_text(lines(ATTACK) + "\n" + '{"topic": ')
    result = run("monitor", PRUNED, torn, "--format", "jsonl")
    failed(result, f"{torn}:7: ")
    assert [json.loads(line)["verdict"] for line in result.stdout.splitlines()] == ["unknown"] * 4 + ["true"]
    result = run("monitor", PRUNED, torn)
    failed(result, f"{torn}:7: ")
    assert result.stdout.startswith("event 5: true\n")
    assert "verdict" not in result.stdout


def test_the_table_of_a_malformed_trace_has_the_events_before_it(tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    torn.write_text(lines([{"event": "a"}, {"event": "c"}]) + "[]")
    result = run("monitor", SAND, torn, "--format", "table")
    failed(result, f"{torn}:3: ")
    rows = [line.split()[-1] for line in result.stdout.splitlines()[:3]]
    assert rows == ["φ", "?", "⊥"]
    torn.write_text("[]")
    result = run("monitor", SAND, torn, "--format", "table")
    failed(result, f"{torn}:1: ")
    assert result.stdout == ""


def test_the_other_traces_are_still_read_after_a_malformed_one(attack: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    torn.write_text("{")
    result = run("monitor", PRUNED, torn, tmp_path / "missing", attack, "--format", "jsonl")
    assert result.exit_code == 2
    first, second = result.stderr.splitlines()
    assert f"{torn}:1: " in first
    assert str(tmp_path / "missing") in second
    assert len(result.stdout.splitlines()) == 5


def test_the_end_warns_of_types_never_seen_and_of_near_misses(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text(
        lines(
            [
                {"topic": "command", "name": "move", "waypoint": 1, "time": 1},
                {"topic": "/command", "name": "inspect", "way_point": 1},
                {"topic": "/command", "name": "inspect"},
                {"topic": "/move_base/result", "waypoint": 1, "result": "failure"},
                {"topic": "/else"},
            ]
        )
    )
    result = run("monitor", PRUNED, log)
    assert result.exit_code == 0
    near = "warning: near miss:"
    assert result.stdout.splitlines()[-8:] == [
        "events read: 5; relevant: move 0, result 0, inspect 0, radiation 0, goal 0",
        "warning: no event of type move",
        "warning: no event of type inspect",
        "warning: no event of type radiation",
        "warning: no event of type goal",
        f'{near} 1 event would be move but for the field topic, which is "command", not "/command" (first: event 1)',
        f"{near} 2 events would be inspect but for the field waypoint, which is missing (first: event 2)",
        f'{near} 1 event would be result but for the field result, which is "failure", not "success" (first: event 4)',
    ]


def test_values_cannot_steer_the_terminal(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text(
        lines([{**event, "waypoint": "\x9b31m\u202e"} if "waypoint" in event else event for event in ATTACK[:2]])
    )
    tree = tmp_path / "tree.rvaft"
    tree.write_text("event move(w) = { waypoint: w };\ntoplevel a;\na and b;\nb on move(W);\n")
    result = run("monitor", tree, log)
    assert result.exit_code == 1
    assert all(line.isprintable() for line in result.stdout.splitlines())


needs_spot = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]


@pytest.mark.parametrize("backend", ["rml", *(pytest.param(name, marks=needs_spot) for name in ("ltlf", "automaton"))])
def test_a_backend_gives_the_same_verdicts_without_an_explanation(backend: str) -> None:
    expected = run("monitor", SAND, "--word", "a b c", "--format", "jsonl").stdout
    result = run("monitor", SAND, "--word", "a b c", "--backend", backend, "--format", "jsonl")
    assert result.exit_code == 1
    said = [json.loads(line) for line in result.stdout.splitlines()]
    assert said == [{key: json.loads(line)[key] for key in ("event", "verdict")} for line in expected.splitlines()]


def test_a_tree_of_very_many_event_types_is_summed_up(tmp_path: Path) -> None:
    tree = tmp_path / "wide.rvaft"
    tree.write_text("toplevel t; t or " + " ".join(f"b{n}" for n in range(500)) + ";")
    lines = run("monitor", tree, "--word", "x b7").stdout.splitlines()
    assert "events read: 2; relevant: b7 1, 499 other types 0" in lines
    assert lines[-1] == "warning: 479 other types never seen"
    assert len(lines) < 30


def test_letters_that_no_node_observes_are_named(tmp_path: Path) -> None:
    result = run("monitor", SAND, "--word", "a q b z c q")
    assert result.exit_code == 1
    assert result.stderr == "rvaft: warning: no node has the default event q or z\n"
    assert run("monitor", SAND, "--word", "a b c").stderr == ""
    tree = tmp_path / "tree.rvaft"
    tree.write_text("event named(x) = { event: x };\ntoplevel a;\na on named(X);\n")
    assert run("monitor", tree, "--word", "q").stderr == ""
