"""`rvaft monitor` on one log: verdicts, explanations, and what the traces held."""

import json
from pathlib import Path

import pytest

from tests.cli.runs import LOGS, PRUNED, ROW1, failed, jsonl, lines, row1, run, written

ATTACK = LOGS / "table2_row3.jsonl"
"""README has what is said of it."""


def test_a_log_may_come_by_standard_input() -> None:
    told = run("monitor", PRUNED, ATTACK)
    assert told.exit_code == 1
    for words in ([], ["-"]):
        result = run("monitor", PRUNED, *words, data=ATTACK.read_text(encoding="utf-8"))
        assert (result.exit_code, result.output) == (1, told.output)


def test_jsonl_is_one_object_per_event_and_nothing_else() -> None:
    *before, last = jsonl(PRUNED, ATTACK)
    assert before == [{"event": number, "verdict": "unknown"} for number in range(1, 5)]
    events = [json.loads(line) for line in ATTACK.read_text(encoding="utf-8").splitlines()]
    places = [{name: event[name] for name in ("time", "topic") if name in event} for event in events]
    nodes = ("ev1", "ev3", "ev4", "ev6", "ev9")
    assert last == {
        "event": 5,
        "verdict": "true",
        "line": 5,
        "branch": 3,
        "kinds": ["attack"],
        "matched": [
            {"node": node, "occurrence": 1, "event": i + 1, "line": i + 1, **places[i]} for i, node in enumerate(nodes)
        ],
        "variables": {"Waypoint": 0, "Value": 257.0, "T1": 14.1, "NewWp": 1, "T2": 20.2, "MBGoal": 2},
    }


def test_a_malformed_line_ends_its_trace_after_the_verdicts_before_it(tmp_path: Path) -> None:
    torn = written(tmp_path / "torn.jsonl", lines(row1()) + "\n" + '{"topic": ')
    for form, start in (("text", "event 4: true\n"), ("jsonl", '{"event": 1, "verdict": "unknown"}\n')):
        result = run("monitor", PRUNED, torn, "--format", form)
        failed(result, f"{torn}:6: ")
        assert result.stdout.startswith(start)
        assert (": 4" in result.stdout) == (form == "jsonl")
        assert "verdict true" not in result.stdout


def test_values_cannot_steer_the_terminal(tmp_path: Path) -> None:
    events = [{**event, "waypoint": "\x9b31m\u202e"} for event in row1()[:2]]
    tree = written(tmp_path / "tree.rvaft", "event move(w) = { waypoint: w };\ntoplevel a;\na and b;\nb on move(W);\n")
    result = run("monitor", tree, written(tmp_path / "log.jsonl", lines(events)))
    assert result.exit_code == 1
    assert all(line.isprintable() for line in result.stdout.splitlines())


def test_events_of_a_stream_that_are_forgotten_are_not_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.stream.event_buffer.BOUND", 2)
    data = ROW1.read_text(encoding="utf-8")
    said = run("monitor", PRUNED, data=data).stdout
    assert "  event 1 (no longer stored) is ev1" in said
    assert "  event 4 at 30.241 on /command is ev6" in said
    last = jsonl(PRUNED, data=data)[-1]
    assert last["matched"][0] == {"node": "ev1", "occurrence": 1, "event": 1, "line": None}
    sixth = {"node": "ev6", "occurrence": 1, "event": 4, "line": 4, "time": 30.241, "topic": "/command"}
    assert last["matched"][3] == sixth
    assert "no longer stored" not in run("monitor", PRUNED, ROW1).stdout


@pytest.mark.parametrize(("late", "status"), [("", 2), (" late 0 s", 0)])
@pytest.mark.parametrize("condition", ["top sand a b within 10 s;", "top sand a b g; g when at(b) - at(a) <= 10 s;"])
def test_partial_matches_expire_with_late_as_the_message_says(
    late: str, status: int, condition: str, tmp_path: Path
) -> None:
    event = 'event a(u) = { e: "a", u: u }; event b(u) = { e: "b", u: u };'
    text = f"time t as s{late}; {event} semantics scattered; {condition} a on a(U); b on b(U);"
    log = written(tmp_path / "log.jsonl", lines([{"t": number, "e": "a", "u": number} for number in range(100)]))
    result = run("monitor", written(tmp_path / "t.rvaft", text), log, "--max-configurations", 40)
    assert result.exit_code == status, result.output
    assert ("`late 0 s` after the format of `time`" in result.stderr) is bool(status)


def test_a_limit_of_partial_matches_ends_the_run(tmp_path: Path) -> None:
    put, get = ('event put(x) = { event: "put", x: x };', 'event get(x) = { event: "get", x: x };')
    tree = written(tmp_path / "tree.rvaft", f"{put}{get} toplevel t; t sand a b c; a on put(X); b on get(X); c;")
    log = written(tmp_path / "log.jsonl", lines([{"event": "put", "x": number} for number in range(50)]))
    assert run("monitor", tree, log, "--semantics", "scattered", "--max-configurations", 60).exit_code == 0
    result = run("monitor", tree, log, "--semantics", "scattered", "--max-configurations", 20)
    failed(result, "too large", "X", "limit 20", str(log), "event 2")
