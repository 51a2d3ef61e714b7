"""`rvaft monitor` on streams and on detection: growing files, order, checkpoints, commands, drawings."""

import json
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import LOGS, PRUNED, ROW1, SAND, TREES, failed, lines, row1, run, soon, started, written


def test_a_growing_file_is_followed_until_it_is_interrupted(tmp_path: Path) -> None:
    events = row1()
    log = written(tmp_path / "log.jsonl", lines(events[:3]) + '{"')
    with started("monitor", PRUNED, log, "--follow") as running:
        time.sleep(0.5)
        with log.open("a") as stream:
            stream.write(lines(events[3:])[2:])
        assert running.stdout.readline() == "event 4: true\n"
        running.send_signal(signal.SIGTERM)
        said = running.stdout.read()
        assert (running.wait(timeout=30), running.stderr.read()) == (1, "")
    assert "verdict true after 4 events" in said
    assert said.endswith("warning: no event of type goal\n")


@pytest.mark.ci
@pytest.mark.parametrize("replaced", [False, True])
def test_a_last_line_without_an_end_and_a_file_that_is_replaced_are_said(replaced: bool, tmp_path: Path) -> None:
    events = row1()
    torn, log = json.dumps(events[3]), tmp_path / "log.jsonl"
    written(log, lines(events[:3]) + ("" if replaced else torn))
    with started("monitor", PRUNED, log, "--follow", "--format", "jsonl") as running:
        for _ in range(3):
            running.stdout.readline()
        if replaced:
            written(tmp_path / "new", lines(events[3:])).replace(log)
            assert json.loads(running.stdout.readline())["verdict"] == "true"
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == replaced
        lost = f"{log}: the last line is incomplete and was not read ({len(torn)} bytes)"
        assert ("was replaced" if replaced else f"rvaft: warning: {lost}\n") in running.stderr.read()


def changes(text: str) -> list[str]:
    """What is said of changes of verdict, by a run in text with the key robot."""
    return [line for line in text.splitlines() if line.startswith(("robot=", "  "))]


def kept_events(state: Path) -> int:
    """How many events a checkpoint knows."""
    return int(json.loads(state.read_bytes().split(b"\n")[2])["events"]) if state.exists() else 0


@pytest.mark.ci
def test_a_run_that_was_killed_goes_on_with_the_same_verdicts(tmp_path: Path) -> None:
    state, part = tmp_path / "state", tmp_path / "part.jsonl"
    options = ["--per", "branch", "--key", "robot", "--order-by", "time", "--window", "3"]
    events: list[dict[str, Any]] = [{"topic": "/clock", "robot": "r"} for _ in range(500)]
    for place, event in zip((20, 130, 300, 480), row1(), strict=True):
        events[place] = {**event, "robot": "r"}
    events = [{**event, "time": place} for place, event in enumerate(events)]
    events[130], events[131] = events[131], events[130]
    log = written(tmp_path / "log.jsonl", lines(events))
    whole = run("monitor", PRUNED, log, *options)
    assert whole.exit_code == 1
    for size in (40, 400):
        written(part, lines(events[:size]))
        words = ["monitor", PRUNED, part, "--follow", "--checkpoint", state, "--checkpoint-every", 7, *options]
        with started(*words):
            soon(lambda size=size: kept_events(state) >= size - 20)  # type: ignore[misc]
        assert size - 20 <= kept_events(state) <= size
    resumed = run("monitor", PRUNED, log, "--checkpoint", state, *options)
    said = changes(resumed.stdout)
    assert (resumed.exit_code, resumed.stderr) == (1, whole.stderr)
    assert said == changes(whole.stdout)[-len(said) :]
    assert resumed.stdout.splitlines()[-3:] == whole.stdout.splitlines()[-3:]
    again = run("monitor", PRUNED, log, "--checkpoint", state, *options)
    assert again.exit_code == 1
    assert "event 481: " not in again.stdout


def test_a_restart_knows_the_lines_of_the_file_and_refuses_another_run(tmp_path: Path) -> None:
    log, state = written(tmp_path / "log.jsonl", '{"event": "x"}\n\n{"event": "a"}\n'), tmp_path / "state"
    failed(run("monitor", SAND, log, "--checkpoint", tmp_path / "no" / "state"), "state", "cannot write")
    assert run("monitor", SAND, log, "--checkpoint", state).exit_code == 0
    for tree, options, said in (
        (TREES / "gates" / "and.rvaft", "", "another tree"),
        (SAND, "--semantics strict", "--semantics"),
        (SAND, "--per branch", "with --per tree, not with --per branch"),
        (SAND, "--key robot", "--key robot"),
        (SAND, "--branch 1", "another part"),
        (SAND, "--semantics strict --format table", "--semantics"),
    ):
        failed(run("monitor", tree, log, "--checkpoint", state, *options.split()), str(state), said)
    written(log, log.read_text() + '{"event": "b"}\n{')
    failed(run("monitor", SAND, log, "--checkpoint", state), f"{log}:5: ")


def test_what_a_run_that_was_killed_has_told_is_told_as_such(tmp_path: Path) -> None:
    log, state, told = written(tmp_path / "log.jsonl", lines(row1())), tmp_path / "state", tmp_path / "told"
    words = ["monitor", PRUNED, log, "--checkpoint", state]
    with started(*words, "--follow") as running:
        assert running.stdout.readline() == "event 4: true\n"
        soon((tmp_path / ".state.told").exists)
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert run(*words).stdout.splitlines()[0] == "event 4: true (reported before)"
    for form in ([], ["--detections"]):
        for name, data in kept.items():
            (tmp_path / name).write_bytes(data)
        said = run(*words, "--format", "jsonl", *form, "--exec", f"cat > {told}").stdout.splitlines()
        assert [json.loads(line).get("again") for line in said][-1] is True
        assert json.loads(told.read_text())["again"] is True
    assert "event 4" not in run(*words).stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.jsonl", "state", "told"]


@pytest.mark.parametrize(("options", "ended"), [([], True), (["--key", "robot"], True), (["--key", "robot"], False)])
def test_what_waits_for_its_turn_belongs_in_the_checkpoint(options: list[str], ended: bool, tmp_path: Path) -> None:
    """Also at the end of the log, which may go on: a late event has the place that it has without a stop."""
    log, state = tmp_path / "log.jsonl", tmp_path / "state"
    events = [{"event": "x", "time": number, "robot": 1} for number in range(60)]
    for place, (name, late) in {10: ("a", 0), 39: ("b", 0), 45: ("c", 25)}.items():
        events[place] |= {"event": name, "time": place - late}
    words = ["monitor", SAND, log, "--order-by", "time", "--window", 30, *options, "--format", "jsonl"]
    words += ["--semantics", "scattered"]
    written(log, lines(events))
    whole = run(*words)
    written(log, lines(events[:42]))
    words += ["--checkpoint", state, "--checkpoint-every", 5]
    if ended:
        assert run(*words).exit_code == 0
    else:
        with started(*words, "--follow"):
            soon(lambda: kept_events(state) >= 10)
    written(log, lines(events))
    went_on = run(*words)
    said = went_on.stdout.splitlines()
    assert (went_on.exit_code, went_on.stderr) == (whole.exit_code, whole.stderr)
    assert said == whole.stdout.splitlines()[-len(said) :]
    assert json.loads(said[0])["event"] <= 13


def test_commands_get_the_detection_as_json(tmp_path: Path) -> None:
    told = {name: tmp_path / name for name in ("exec", "exec-fault", "exec-attack")}
    result = run("monitor", PRUNED, ROW1, *(f"--{name}=cat >> {file}" for name, file in told.items()))
    assert (result.exit_code, result.stderr, result.stdout) == (1, "", run("monitor", PRUNED, ROW1).stdout)
    assert not told["exec-attack"].exists()
    assert told["exec"].read_text() == told["exec-fault"].read_text()
    (line,) = told["exec"].read_text().splitlines()
    found = json.loads(line)
    assert [found[name] for name in ("branch", "event", "trace", "tree")] == [1, 4, str(ROW1), str(PRUNED)]
    assert [one["event"] for one in found["matched"]] == [1, 2, 3, 4]
    assert list(found["events"].values()) == row1()


@pytest.mark.parametrize(
    ("nodes", "word", "options", "expected"),
    [
        ("a attack; b fault;", "b", "--per kind", "AF"),
        ("a attack; b fault;", "b", "--kind attack", "AF"),
        ("a attack; b fault;", "b", "", "F"),
        ("a fault; b attack;", "a b", "--semantics scattered", "F"),  # the first detection alone
        ("a fault; b attack;", "a b", "--semantics scattered --per kind", "AF"),
    ],
)
def test_the_monitor_of_a_kind_detects_that_kind(
    nodes: str, word: str, options: str, expected: str, tmp_path: Path
) -> None:
    tree = written(tmp_path / "mixed.rvaft", f"toplevel top; top {'1of2' if word == 'b' else 'or'} a b; {nodes}")
    told = written(tmp_path / "told", "")
    hooks = [f"--exec-fault=printf F >> {told}", f"--exec-attack=printf A >> {told}"]
    assert run("monitor", tree, "--word", word, *options.split(), *hooks).exit_code == 1
    assert "".join(sorted(told.read_text())) == expected


def test_a_failing_command_is_reported_and_stops_nothing() -> None:
    args = ["monitor", PRUNED, ROW1, LOGS / "table2_row2.jsonl"]
    result = run(*args, "--exec", "exit 3", "--exec-fault", "/no/such/program")
    assert (result.exit_code, result.stdout) == (1, run(*args).stdout)
    for status in (3, 127):
        assert sum(f"ended with status {status}" in line for line in result.stderr.splitlines()) == 2


@pytest.mark.parametrize(("name", "start"), [("a.dot", b"digraph"), ("a.svg", b"<?xml"), ("a.txt", "●".encode())])
def test_a_detection_is_drawn_to_a_file(name: str, start: bytes, tmp_path: Path) -> None:
    target = tmp_path / name
    result = run("monitor", PRUNED, "--explain", target, ROW1)
    assert (result.exit_code, result.stderr, result.stdout) == (1, "", run("monitor", PRUNED, ROW1).stdout)
    assert target.read_bytes().startswith(start)


def test_a_picture_that_cannot_be_made_is_refused_before_the_logs_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cairosvg", None)
    result = run("monitor", PRUNED, ROW1, "--explain", tmp_path / "a.pdf")
    failed(result, "cairosvg is not installed: pip install '.[pictures]'")
    assert result.stdout == ""


@pytest.mark.parametrize("jobs", [1, 2])
def test_of_several_detections_the_first_is_drawn(jobs: int, tmp_path: Path) -> None:
    target, alone, logs = tmp_path / "fired.dot", tmp_path / "alone.dot", LOGS / "table[23]_row?.jsonl"
    result = run("monitor", PRUNED, logs, "--explain", target, "--jobs", jobs)
    assert result.exit_code == 1
    assert result.stderr == f"rvaft: warning: {target} shows the first of 4 detections\n"
    run("monitor", PRUNED, ROW1, "--explain", alone)
    assert target.read_text() == alone.read_text()
    result = run("monitor", PRUNED, logs, "--jobs", jobs, "--explain", tmp_path / "no" / "fired.dot")
    failed(result, "cannot write")
    assert result.stdout == ""  # the log is not read in vain
    target.unlink()
    result = run("monitor", PRUNED, LOGS / "table3_row1.jsonl", "--explain", target, "--jobs", jobs)
    assert (result.exit_code, target.exists()) == (0, False)
    assert result.stderr == f"rvaft: warning: {target} is not written: nothing was detected\n"
