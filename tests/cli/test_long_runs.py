"""`rvaft monitor` on streams and on detection: growing files, order, checkpoints, commands, drawings."""

import json
import shutil
import signal
import time
from pathlib import Path

import pytest

from tests.cli.runs import LOGS, PRUNED, ROW1, SAND, TREES, failed, lines, row1, run, soon, started, written

# -- order ------------------------------------------------------------------------------------------------------------


def test_time_that_goes_back_is_a_warning_and_order_mends_it(tmp_path: Path) -> None:
    first, second, third, fourth = row1()
    log = written(tmp_path / "log.jsonl", lines([second, first, fourth, third]))
    result = run("monitor", PRUNED, log)
    back = "the field time goes back at 2 events (first: event 2); put them in order with --order-by time"
    assert (result.exit_code, result.stderr) == (0, f"rvaft: warning: {back}\n")
    mended = run("monitor", PRUNED, log, "--order-by", "time")
    assert (mended.exit_code, mended.stderr, mended.stdout) == (1, "", run("monitor", PRUNED, ROW1).stdout)
    assert run("monitor", PRUNED, log, "--order-by", "time", "--window", 1, "--format", "jsonl").exit_code == 1
    written(log, lines([third, second, first, fourth]))
    late = run("monitor", PRUNED, log, "--order-by", "time", "--window", 1)
    assert late.exit_code == 0
    assert "1 event by the field time too late for a window of 1" in late.stderr
    assert "first: event 3 as read" in late.stderr


def test_events_that_are_held_back_come_before_the_error(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", lines(row1()[::-1]) + "{")
    result = run("monitor", PRUNED, log, "--order-by", "time", "--format", "jsonl")
    failed(result, f"{log}:5: ")
    assert [json.loads(line)["verdict"] for line in result.stdout.splitlines()] == ["unknown"] * 3 + ["true"]


# -- a growing file ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_growing_file_is_followed_until_it_is_interrupted(number: signal.Signals, tmp_path: Path) -> None:
    events = row1()
    log = written(tmp_path / "log.jsonl", lines(events[:2]))
    with started("monitor", PRUNED, log, "--follow") as running:
        time.sleep(0.5)
        with log.open("a") as stream:
            stream.write(lines(events[2:]))
        assert running.stdout.readline() == "event 4: true\n"
        running.send_signal(number)
        said = running.stdout.read()
        assert (running.wait(timeout=30), running.stderr.read()) == (1, "")
    assert "verdict true after 4 events" in said
    assert said.endswith("warning: no event of type goal\n")


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
        lost = f"{log}: the last line has no end yet and is not read ({len(torn)} bytes)"
        assert ("was replaced" if replaced else f"rvaft: warning: {lost}\n") in running.stderr.read()


# -- checkpoints ------------------------------------------------------------------------------------------------------


def changes(text: str) -> list[str]:
    """What is said of changes of verdict, by a run in text."""
    return [line for line in text.splitlines() if line.startswith(("event", "  "))]


def kept_events(state: Path) -> int:
    """How many events a checkpoint knows."""
    return int(json.loads(state.read_bytes().split(b"\n")[2])["events"]) if state.exists() else 0


@pytest.mark.parametrize("option", ["--per branch", "--key robot --order-by time --window 3"])
def test_a_run_that_was_killed_goes_on_with_the_same_verdicts(option: str, tmp_path: Path) -> None:
    options, state, part = option.split(), tmp_path / "state", tmp_path / "part.jsonl"
    events = [{"topic": "/clock", "time": number / 1000, "robot": "r"} for number in range(500)]
    for place, event in zip((20, 130, 300, 480), row1(), strict=True):
        events[place] = {**event, "robot": "r", "time": event["time"] + 1}
    if "--order-by" in options:
        for place, event in enumerate(events):
            event["time"] = place
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


def test_errors_after_a_restart_name_the_line_of_the_file(tmp_path: Path) -> None:
    log, state = written(tmp_path / "log.jsonl", '{"event": "x"}\n\n{"event": "a"}\n'), tmp_path / "state"
    assert run("monitor", SAND, log, "--checkpoint", state).exit_code == 0
    written(log, log.read_text() + '{"event": "b"}\n{')
    failed(run("monitor", SAND, log, "--checkpoint", state), f"{log}:5: ")


@pytest.mark.parametrize(
    ("tree", "options", "said"),
    [
        (TREES / "gates" / "and.rvaft", "", "another tree"),
        (SAND, "--semantics strict", "--semantics"),
        (SAND, "--per branch", "other monitors"),
        (SAND, "--key robot", "--key robot"),
        (SAND, "--branch 1", "another part"),
        (SAND, "--semantics strict --format table", "--semantics"),
    ],
)
def test_a_checkpoint_of_something_else_is_refused(tree: Path, options: str, said: str, tmp_path: Path) -> None:
    log, state = written(tmp_path / "log.jsonl", '{"event": "a"}\n'), tmp_path / "state"
    failed(run("monitor", tree, log, "--checkpoint", tmp_path / "no" / "state"), "state", "cannot write")
    assert run("monitor", SAND, log, "--checkpoint", state).exit_code == 0
    failed(run("monitor", tree, log, "--checkpoint", state, *options.split()), str(state), said)


def test_what_a_run_that_was_killed_has_told_is_told_as_such(tmp_path: Path) -> None:
    log, state, told = written(tmp_path / "log.jsonl", lines(row1())), tmp_path / "state", tmp_path / "told"
    words = ["monitor", PRUNED, log, "--checkpoint", state]
    with started(*words, "--follow") as running:
        assert running.stdout.readline() == "event 4: true\n"
        soon((tmp_path / ".state.told").exists)
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert run(*words).stdout.splitlines()[0] == "event 4: true (told before)"
    for form in ([], ["--detections"]):
        for name, data in kept.items():
            (tmp_path / name).write_bytes(data)
        said = run(*words, "--format", "jsonl", *form, "--exec", f"cat > {told}").stdout.splitlines()
        assert [json.loads(line).get("again") for line in said][-1] is True
        assert json.loads(told.read_text())["again"] is True
    assert "event 4" not in run(*words).stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.jsonl", "state", "told"]


@pytest.mark.parametrize("options", [[], ["--key", "robot"]])
@pytest.mark.parametrize("ended", [False, True])
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


# -- commands ---------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(("options", "expected"), [("--per kind", "AF"), ("--kind attack", "AF"), ("", "F")])
def test_the_monitor_of_a_kind_detects_that_kind(options: str, expected: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "mixed.rvaft", "toplevel top; top 1of2 a b; a attack; b fault;")
    told = written(tmp_path / "told", "")
    hooks = [f"--exec-fault=printf F >> {told}", f"--exec-attack=printf A >> {told}"]
    assert run("monitor", tree, "--word", "b", *options.split(), *hooks).exit_code == 1
    assert "".join(sorted(told.read_text())) == expected


def test_with_a_monitor_for_each_kind_the_second_kind_is_told_too(tmp_path: Path) -> None:
    tree, told = written(tmp_path / "tree.rvaft", "toplevel t; t or a b; a fault; b attack;"), tmp_path / "told"
    args = ["monitor", tree, "--word", "a b", "--semantics", "scattered", f"--exec-attack=cat >> {told}"]
    assert run(*args).exit_code == 1
    assert not told.exists()
    assert run(*args, "--per", "kind").exit_code == 1
    assert json.loads(told.read_text())["kinds"] == ["attack"]


def test_a_failing_command_is_reported_and_stops_nothing() -> None:
    args = ["monitor", PRUNED, ROW1, LOGS / "table2_row2.jsonl"]
    result = run(*args, "--exec", "exit 3", "--exec-fault", "/no/such/program")
    assert (result.exit_code, result.stdout) == (1, run(*args).stdout)
    for status in (3, 127):
        assert sum(f"ended with status {status}" in line for line in result.stderr.splitlines()) == 2


# -- drawings ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "start"), [("a.dot", b"digraph"), ("a.svg", b"<?xml"), ("a.txt", "●".encode())])
def test_a_detection_is_drawn_to_a_file(name: str, start: bytes, tmp_path: Path) -> None:
    target = tmp_path / name
    if name == "a.svg":
        result = run("monitor", PRUNED, ROW1, "--explain", target, env={"PATH": ""})
        failed(result, "dot is not installed")  # before the logs are read
        assert result.stdout == ""
        if shutil.which("dot") is None:
            pytest.skip("needs Graphviz")
    result = run("monitor", PRUNED, "--explain", target, ROW1)
    assert (result.exit_code, result.stderr, result.stdout) == (1, "", run("monitor", PRUNED, ROW1).stdout)
    assert target.read_bytes().startswith(start)


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
    assert result.stdout == run("monitor", PRUNED, logs).stdout
    target.unlink()
    result = run("monitor", PRUNED, LOGS / "table3_row1.jsonl", "--explain", target, "--jobs", jobs)
    assert (result.exit_code, target.exists()) == (0, False)
    assert result.stderr == f"rvaft: warning: {target} is not written: nothing was detected\n"
