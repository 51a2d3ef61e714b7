"""`rvaft monitor` on streams and on detection: growing files, order, checkpoints, commands, drawings."""

import json
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import COMMAND, PRUNED, TREES, failed, process, run

LOGS = PRUNED.with_suffix(".traces")
ROW1 = LOGS / "table2_row1.jsonl"
SAND = TREES / "gates" / "sand.rvaft"


def row1() -> list[dict[str, Any]]:
    return [json.loads(line) for line in ROW1.read_text(encoding="utf-8").splitlines()]


def lines(events: list[dict[str, Any]]) -> str:
    return "".join(json.dumps(event) + "\n" for event in events)


@contextmanager
def started(*args: object) -> Iterator["subprocess.Popen[str]"]:
    """The command as a process that does not outlive the test."""
    pipe = subprocess.PIPE
    with subprocess.Popen([*COMMAND, *map(str, args)], stdout=pipe, stderr=pipe, text=True) as running:
        try:
            yield running
        finally:
            running.kill()


# -- order ------------------------------------------------------------------------------------------------------------


def test_time_that_goes_back_is_a_warning_and_order_mends_it(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    first, second, third, fourth = row1()
    log.write_text(lines([second, first, fourth, third]))
    result = run("monitor", PRUNED, log)
    assert result.exit_code == 0
    assert result.stderr == (
        "rvaft: warning: the field time goes back at 2 events (first: event 2); "
        "put them in order with --order-by time\n"
    )
    mended = run("monitor", PRUNED, log, "--order-by", "time")
    assert (mended.exit_code, mended.stderr) == (1, "")
    assert mended.stdout == run("monitor", PRUNED, ROW1).stdout
    late = run("monitor", PRUNED, log, "--order-by", "time", "--window", 1, "--format", "jsonl")
    assert late.exit_code == 1
    log.write_text(lines([third, second, first, fourth]))
    late = run("monitor", PRUNED, log, "--order-by", "time", "--window", 1)
    assert late.exit_code == 0
    assert "1 event by the field time too late for a window of 1" in late.stderr
    assert "first: event 3 as read" in late.stderr


def test_events_that_are_held_back_come_before_the_error(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text(lines(row1()[::-1]) + "{")
    result = run("monitor", PRUNED, log, "--order-by", "time", "--format", "jsonl")
    failed(result, f"{log}:5: ")
    assert [json.loads(line)["verdict"] for line in result.stdout.splitlines()] == ["unknown"] * 3 + ["true"]


# -- a growing file ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_growing_file_is_followed_until_it_is_interrupted(number: signal.Signals, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    events = row1()
    log.write_text(lines(events[:2]))
    with started("monitor", PRUNED, log, "--follow") as running:
        assert running.stdout is not None
        assert running.stderr is not None
        time.sleep(0.5)
        with log.open("a") as stream:
            stream.write(lines(events[2:]))
        assert running.stdout.readline() == "event 4: true\n"
        running.send_signal(number)
        said = running.stdout.read()
        assert running.wait(timeout=30) == 1
        assert running.stderr.read() == ""
    assert "verdict true after 4 events" in said
    assert said.endswith("warning: no event of type goal\n")


def test_a_last_line_without_an_end_is_not_read_and_said(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    events = row1()
    log.write_text(lines(events[:3]) + json.dumps(events[3]))
    with started("monitor", PRUNED, log, "--follow", "--format", "jsonl") as running:
        assert running.stdout is not None
        assert running.stderr is not None
        for _ in range(3):
            running.stdout.readline()
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == 0
        size = len(json.dumps(events[3]))
        assert running.stderr.read() == (
            f"rvaft: warning: {log}: the last line has no end yet and is not read ({size} bytes)\n"
        )


def test_a_file_that_is_replaced_is_read_on_and_said(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    events = row1()
    log.write_text(lines(events[:3]))
    with started("monitor", PRUNED, log, "--follow", "--format", "jsonl") as running:
        assert running.stdout is not None
        assert running.stderr is not None
        for _ in range(3):
            running.stdout.readline()
        new = tmp_path / "new"
        new.write_text(lines(events[3:]))
        new.replace(log)
        assert json.loads(running.stdout.readline())["verdict"] == "true"
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == 1
        assert "was replaced" in running.stderr.read()


# -- checkpoints ------------------------------------------------------------------------------------------------------


def changes(text: str) -> list[str]:
    """What is said of changes of verdict, by a run in text."""
    return [line for line in text.splitlines() if line.startswith(("event", "  "))]


def kept_events(state: Path) -> int:
    """How many events a checkpoint knows."""
    return int(json.loads(state.read_bytes().split(b"\n")[2])["events"]) if state.exists() else 0


@pytest.mark.parametrize(
    "options", [[], ["--per", "branch"], ["--key", "robot"], ["--order-by", "time", "--window", "3"]]
)
def test_a_run_that_was_killed_goes_on_with_the_same_verdicts(options: list[str], tmp_path: Path) -> None:
    log, state = tmp_path / "log.jsonl", tmp_path / "state"
    events = [{"topic": "/clock", "time": number / 1000, "robot": "r"} for number in range(500)]
    for place, event in zip((20, 130, 300, 480), row1(), strict=True):
        events[place] = {**event, "robot": "r", "time": event["time"] + 1}
    if options[:1] == ["--order-by"]:
        for place, event in enumerate(events):
            event["time"] = place
        events[130], events[131] = events[131], events[130]
    log.write_text(lines(events))
    whole = process("monitor", PRUNED, log, *options)
    assert whole.returncode == 1
    part = tmp_path / "part.jsonl"
    words = [*COMMAND, "monitor", str(PRUNED), str(part), "--follow", "--checkpoint", str(state)]
    for size in (40, 400):
        part.write_text(lines(events[:size]))
        with subprocess.Popen([*words, "--checkpoint-every", "7", *options], stdout=subprocess.DEVNULL) as running:
            until = time.monotonic() + 30
            while kept_events(state) < size - 20 and time.monotonic() < until:
                time.sleep(0.02)
            running.kill()
        assert size - 20 <= kept_events(state) <= size
    resumed = process("monitor", PRUNED, log, "--checkpoint", state, *options)
    assert resumed.returncode == 1
    assert changes(resumed.stdout) == changes(whole.stdout)[-len(changes(resumed.stdout)) :]
    assert resumed.stdout.splitlines()[-3:] == whole.stdout.splitlines()[-3:]
    assert resumed.stderr == whole.stderr
    again = process("monitor", PRUNED, log, "--checkpoint", state, *options)
    assert again.returncode == 1
    assert "event 481: " not in again.stdout


def test_errors_after_a_restart_name_the_line_of_the_file(tmp_path: Path) -> None:
    log, state = tmp_path / "log.jsonl", tmp_path / "state"
    log.write_text('{"event": "x"}\n\n{"event": "a"}\n')
    assert run("monitor", SAND, log, "--checkpoint", state).exit_code == 0
    log.write_text(log.read_text() + '{"event": "b"}\n{')
    failed(run("monitor", SAND, log, "--checkpoint", state), f"{log}:5: ")


@pytest.mark.parametrize(
    ("tree", "options", "said"),
    [
        (TREES / "gates" / "and.rvaft", [], "another tree"),
        (SAND, ["--semantics", "strict"], "--semantics"),
        (SAND, ["--per", "branch"], "other monitors"),
        (SAND, ["--key", "robot"], "--key robot"),
        (SAND, ["--branch", "1"], "another part"),
    ],
)
def test_a_checkpoint_of_something_else_is_refused(tree: Path, options: list[str], said: str, tmp_path: Path) -> None:
    log, state = tmp_path / "log.jsonl", tmp_path / "state"
    log.write_text('{"event": "a"}\n')
    assert run("monitor", SAND, log, "--checkpoint", state).exit_code == 0
    failed(run("monitor", tree, log, "--checkpoint", state, *options), str(state), said)


def test_a_checkpoint_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text('{"event": "a"}\n')
    failed(run("monitor", SAND, log, "--checkpoint", tmp_path / "no" / "state"), "state", "cannot write")


def test_what_a_run_that_was_killed_has_told_is_told_as_such(tmp_path: Path) -> None:
    log, state = tmp_path / "log.jsonl", tmp_path / "state"
    log.write_text(lines(row1()))
    words = ["monitor", PRUNED, log, "--checkpoint", state]
    with started(*words, "--follow") as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "event 4: true\n"
        until = time.monotonic() + 30
        while not (tmp_path / ".state.told").exists() and time.monotonic() < until:
            time.sleep(0.02)
        running.kill()
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert run(*words).stdout.splitlines()[0] == "event 4: true (told before)"
    for form in ([], ["--detections"]):
        for name, data in kept.items():
            (tmp_path / name).write_bytes(data)
        told = tmp_path / "told"
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
    words = ["monitor", SAND, log, "--order-by", "time", "--window", 30, *options]
    log.write_text(lines(events))
    whole = run(*words, "--format", "jsonl", "--semantics", "scattered")
    log.write_text(lines(events[:42]))
    words += ["--checkpoint", state, "--checkpoint-every", 5, "--format", "jsonl", "--semantics", "scattered"]
    if ended:
        assert run(*words).exit_code == 0
    else:
        with started(*words, "--follow") as running:
            until = time.monotonic() + 30
            while kept_events(state) < 10 and time.monotonic() < until:
                time.sleep(0.02)
            running.kill()
    log.write_text(lines(events))
    went_on = run(*words)
    assert (went_on.exit_code, went_on.stderr) == (whole.exit_code, whole.stderr)
    numbers = [json.loads(line)["event"] for line in went_on.stdout.splitlines()]
    assert went_on.stdout.splitlines() == whole.stdout.splitlines()[-len(numbers) :]
    assert numbers[0] <= 13


def test_checkpoints_after_every_event_take_no_longer_than_the_events(tmp_path: Path) -> None:
    log, state = tmp_path / "log.jsonl", tmp_path / "state"
    log.write_text(lines([{"event": "a", "time": number} for number in range(4000)]))
    words = [SAND, log, "--order-by", "time", "--window", 1, "--semantics", "strict"]
    begun = time.monotonic()
    kept = run("monitor", *words, "--checkpoint", state, "--checkpoint-every", 1)
    assert time.monotonic() - begun < 15
    assert kept.stdout == run("monitor", *words).stdout


# -- commands ---------------------------------------------------------------------------------------------------------


def test_commands_get_the_detection_as_json(tmp_path: Path) -> None:
    told = {name: tmp_path / name for name in ("all", "fault", "attack")}
    commands = [
        f"--exec=cat >> {told['all']}",
        f"--exec-fault=cat >> {told['fault']}",
        f"--exec-attack=cat >> {told['attack']}",
    ]
    result = run("monitor", PRUNED, ROW1, *commands)
    assert (result.exit_code, result.stderr) == (1, "")
    assert result.stdout == run("monitor", PRUNED, ROW1).stdout
    assert not told["attack"].exists()
    assert told["all"].read_text() == told["fault"].read_text()
    (line,) = told["all"].read_text().splitlines()
    found = json.loads(line)
    assert found["branch"] == 1
    assert found["event"] == 4
    assert found["trace"] == str(ROW1)
    assert found["tree"] == str(PRUNED)
    assert [one["event"] for one in found["matched"]] == [1, 2, 3, 4]
    assert list(found["events"].values()) == row1()


@pytest.mark.parametrize(("options", "expected"), [(["--per", "kind"], "FA"), (["--kind", "attack"], "FA"), ([], "F")])
def test_the_monitor_of_a_kind_detects_that_kind(options: list[str], expected: str, tmp_path: Path) -> None:
    tree = tmp_path / "mixed.rvaft"
    tree.write_text("toplevel top; top 1of2 a b; a attack; b fault;")
    told = tmp_path / "told"
    told.touch()
    hooks = [f"--exec-fault=printf F >> {told}", f"--exec-attack=printf A >> {told}"]
    assert run("monitor", tree, "--word", "b", *options, *hooks).exit_code == 1
    assert told.read_text() in ({expected, "AF"} if expected == "FA" else {expected})


def test_with_a_monitor_for_each_kind_the_second_kind_is_told_too(tmp_path: Path) -> None:
    tree, told = tmp_path / "tree.rvaft", tmp_path / "told"
    tree.write_text("toplevel t; t or a b; a fault; b attack;")
    args = ["monitor", tree, "--word", "a b", "--semantics", "scattered", f"--exec-attack=cat >> {told}"]
    assert run(*args).exit_code == 1
    assert not told.exists()
    assert run(*args, "--per", "kind").exit_code == 1
    assert json.loads(told.read_text())["kinds"] == ["attack"]


def test_a_failing_command_is_reported_and_stops_nothing(tmp_path: Path) -> None:
    args = ["monitor", PRUNED, ROW1, LOGS / "table2_row2.jsonl"]
    result = run(*args, "--exec", "exit 3", "--exec-fault", "/no/such/program")
    assert result.exit_code == 1
    assert result.stdout == run(*args).stdout
    said = result.stderr.splitlines()
    assert len([line for line in said if "ended with status 3" in line]) == 2
    assert len([line for line in said if "ended with status 127" in line]) == 2


# -- drawings ---------------------------------------------------------------------------------------------------------


def test_the_tree_is_drawn_in_place_of_the_list_of_events() -> None:
    result = run("monitor", PRUNED, "--explain", ROW1)
    assert result.exit_code == 1
    assert result.stdout.startswith("event 4: true\n")
    assert "ev1" in result.stdout
    assert "event 1, time 10.4, topic /command" in result.stdout
    assert run("monitor", PRUNED, ROW1, "--explain").stdout == result.stdout


@pytest.mark.parametrize(
    ("name", "start"), [("fired.dot", b"digraph"), ("fired.svg", b"<?xml"), ("fired.pdf", b"%PDF")]
)
def test_a_detection_is_drawn_to_a_file(name: str, start: bytes, tmp_path: Path) -> None:
    if not name.endswith(".dot") and shutil.which("dot") is None:
        pytest.skip("needs Graphviz")
    target = tmp_path / name
    result = run("monitor", PRUNED, "--explain", target, ROW1)
    assert (result.exit_code, result.stderr) == (1, "")
    assert target.read_bytes().startswith(start)
    assert result.stdout == run("monitor", PRUNED, ROW1).stdout


@pytest.mark.parametrize("jobs", [1, 2])
def test_of_several_detections_the_first_is_drawn(jobs: int, tmp_path: Path) -> None:
    target = tmp_path / "fired.dot"
    result = run("monitor", PRUNED, LOGS / "table[23]_row?.jsonl", "--explain", target, "--jobs", jobs)
    assert result.exit_code == 1
    assert result.stderr == f"rvaft: warning: {target} shows the first of 4 detections\n"
    alone = tmp_path / "alone.dot"
    run("monitor", PRUNED, ROW1, "--explain", alone)
    assert target.read_text() == alone.read_text()


def test_without_a_detection_nothing_is_drawn(tmp_path: Path) -> None:
    target = tmp_path / "fired.dot"
    result = run("monitor", PRUNED, LOGS / "table3_row1.jsonl", "--explain", target)
    assert result.exit_code == 0
    assert result.stderr == f"rvaft: warning: {target} is not written: nothing was detected\n"
    assert not target.exists()


def test_a_missing_tool_is_said_before_the_logs_are_read(tmp_path: Path) -> None:
    result = run("monitor", PRUNED, ROW1, "--explain", tmp_path / "fired.svg", env={"PATH": ""})
    failed(result, "dot is not installed")
    assert result.stdout == ""


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_drawing_that_cannot_be_written_stops_nothing(jobs: int, tmp_path: Path) -> None:
    logs = LOGS / "table2_row[13].jsonl"
    result = run("monitor", PRUNED, logs, "--jobs", jobs, "--explain", tmp_path / "no" / "fired.dot")
    failed(result, "cannot write")
    assert result.stdout == run("monitor", PRUNED, logs).stdout


# -- what a stream no longer knows -------------------------------------------------------------------------------------


def test_events_of_a_stream_that_are_forgotten_are_not_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    from rvaft.monitoring.run import EventBuffer

    monkeypatch.setattr(EventBuffer.__init__, "__kwdefaults__", {"reads": None, "bound": 2})
    data = ROW1.read_text(encoding="utf-8")
    said = run("monitor", PRUNED, data=data).stdout
    assert "  event 1 (no longer known) is ev1" in said
    assert "  event 4 at 30.241 on /command is ev6" in said
    last = json.loads(run("monitor", PRUNED, "--format", "jsonl", data=data).stdout.splitlines()[-1])
    assert last["matched"][0] == {"node": "ev1", "event": 1}
    assert last["matched"][3] == {"node": "ev6", "event": 4, "time": 30.241, "topic": "/command"}
    assert "no longer known" not in run("monitor", PRUNED, ROW1).stdout
