"""`rvaft monitor` over many: a monitor for each branch or kind, several logs, keys, processes."""

import gzip
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rvaft import Semantics
from tests.cli.runs import COMMAND, PRUNED, TREES, failed, process, run
from tests.trees import shipped

LOGS = PRUNED.with_suffix(".traces")
ROW1 = LOGS / "table2_row1.jsonl"
SAND = TREES / "gates" / "sand.rvaft"
NAMED = {"tree": "φ", "1": "φ1", "2": "φ2", "3": "φ3", "4": "φ4"}


def lines(events: list[dict[str, Any]]) -> str:
    return "".join(json.dumps(event) + "\n" for event in events)


def jsonl(*args: object, **options: Any) -> list[dict[str, Any]]:
    return [json.loads(line) for line in run("monitor", *args, "--format", "jsonl", **options).stdout.splitlines()]


# -- a monitor for each branch or kind --------------------------------------------------------------------------------


@pytest.mark.parametrize("trace", dict(shipped.traces("remote_inspection/pruned")))
def test_the_table_has_the_verdicts_stored_beside_the_tree(trace: str) -> None:
    log = LOGS / f"{trace}.jsonl"
    stored = shipped.expected("remote_inspection/pruned")[trace][Semantics.PROJECTED]
    table = run("monitor", PRUNED, log, "--per", "branch", "--format", "table").stdout.splitlines()
    events = log.read_text(encoding="utf-8").splitlines()
    head, rows = table[0], table[1 : len(events) + 1]
    assert head.split() == ["EVENT", *NAMED.values()]
    for event, row in zip(events, rows, strict=True):
        assert json.loads(row[: row.rindex("}") + 1]) == json.loads(event)
    cells = [row[row.rindex("}") + 1 :].split() for row in rows]
    assert ["".join(column) for column in zip(*cells, strict=True)] == [stored[label] for label in NAMED]


def test_each_branch_has_its_verdict_and_its_explanation() -> None:
    said = jsonl(PRUNED, ROW1, "--per", "branch")
    assert said[0]["verdict"] == "unknown"
    assert said[0]["verdicts"] == {"tree": "unknown", "1": "unknown", "2": "false", "3": "unknown", "4": "false"}
    assert set(said[0]["columns"]) == {"2", "4"}
    expected = [{"branch": 2, "awaited": [{"node": "ev2", "event": 'result(Waypoint, "success")'}], "variables": {}}]
    assert said[0]["columns"]["2"] == {"expected": expected}
    assert said[3]["columns"]["1"] == {name: said[3][name] for name in ("branch", "kinds", "matched", "variables")}
    text = run("monitor", PRUNED, ROW1, "--per", "branch").stdout.splitlines()
    assert text[:5] == [
        "event 1: φ2 false, φ4 false",
        '  φ2: branch 2 waited for result(Waypoint, "success") (ev2)',
        '  φ4: branch 4 waited for result(Waypoint, "success") (ev2)',
        "event 4: φ true, φ1 true",
        "  φ, φ1: branch 1: fault",
    ]
    table = text[text.index("verdict true after 4 events") + 1 :]
    assert [line.split() for line in table[:6]] == [
        ["MONITOR", "VERDICT", "EVENT"],
        ["φ", "true", "4"],
        ["φ1", "true", "4"],
        ["φ2", "false", "1"],
        ["φ3", "unknown", "-"],
        ["φ4", "false", "1"],
    ]


def test_each_kind_has_its_verdict() -> None:
    said = jsonl(PRUNED, LOGS / "table2_row3.jsonl", "--per", "kind")
    assert said[-1]["verdicts"] == {"tree": "true", "fault": "false", "attack": "true"}
    assert said[-1]["columns"]["attack"]["branch"] == 3
    assert said[3]["columns"]["fault"]["expected"][0]["branch"] == 1


def test_a_long_table_leaves_out_events_that_change_nothing(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text('{"event": "x"}\n' * 2000 + '{"event": "a"}\n{"event": "b"}\n{"event": "c"}\n{"event": "x"}\n')
    rows = run("monitor", SAND, log, "--format", "table").stdout.splitlines()
    assert len(rows) < 1020
    assert rows[1001].strip() == "(1002 more)"
    assert rows[1002].split() == ['{"event":', '"c"}', "⊤"]
    assert rows[1003].strip() == "(1 more)"


def test_a_limit_of_partial_matches_ends_the_run(tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    tree.write_text(
        'event put(x) = { event: "put", x: x };\nevent get(x) = { event: "get", x: x };\n'
        "toplevel t; t sand a b c; a on put(X); b on get(X); c;"
    )
    log = tmp_path / "log.jsonl"
    log.write_text(lines([{"event": "put", "x": number} for number in range(50)]))
    assert run("monitor", tree, log, "--semantics", "scattered", "--max-configurations", 60).exit_code == 0
    result = run("monitor", tree, log, "--semantics", "scattered", "--max-configurations", 20)
    failed(result, "too large", "X", "limit 20", str(log), "event 2")


# -- several logs -----------------------------------------------------------------------------------------------------


def test_a_pattern_stands_for_the_files_that_match_it(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    for place in ("x.jsonl", "a/y.jsonl", "a/b/z.jsonl"):
        (tmp_path / place).write_text('{"event": "a"}\n')
    (tmp_path / "a" / "w.jsonl").mkdir()

    def traces(pattern: str) -> list[str]:
        said = jsonl(SAND, tmp_path / pattern, tmp_path / "x.jsonl")
        return [str(Path(one["trace"]).relative_to(tmp_path)) for one in said][:-1]

    assert traces("*.jsonl") == ["x.jsonl"]
    assert traces("**/*.jsonl") == ["a/b/z.jsonl", "a/y.jsonl", "x.jsonl"]
    assert traces("a/[xy].jsonl") == ["a/y.jsonl"]
    assert traces("a/?/z.jsonl") == ["a/b/z.jsonl"]


def test_a_pattern_without_a_file_is_an_error_and_the_others_are_read() -> None:
    failed(run("monitor", SAND, "no/such/*.jsonl"), "no/such/*.jsonl", "no file matches")
    result = run("monitor", PRUNED, "no/such/*.jsonl", ROW1)
    assert result.exit_code == 2
    assert f"{ROW1}: event 4: true" in result.stdout


def test_a_folder_is_refused_with_a_hint(tmp_path: Path) -> None:
    failed(run("monitor", SAND, tmp_path), "Is a directory", f"{tmp_path}/*.jsonl")


def test_the_summary_has_a_row_for_each_trace(tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    torn.write_text('{"event": "a"}\n{')
    packed = tmp_path / "packed.jsonl.gz"
    packed.write_bytes(gzip.compress(ROW1.read_bytes()))
    result = run("monitor", PRUNED, LOGS / "table3_row1.jsonl", torn, packed)
    assert result.exit_code == 2
    rows = [line.split() for line in result.stdout.splitlines()[-4:]]
    assert rows == [
        ["TRACE", "EVENTS", "VERDICT", "EVENT", "BRANCH", "KINDS"],
        [str(LOGS / "table3_row1.jsonl"), "4", "unknown", "-", "-", "-"],
        [str(torn), "1", "unknown", "-", "-", "-", "error"],
        [str(packed), "4", "true", "4", "1", "fault"],
    ]


# -- processes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("form", "per"), [("text", "tree"), ("jsonl", "branch"), ("table", "branch")])
def test_several_processes_print_what_one_prints(form: str, per: str, tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    torn.write_text('{"topic": "command", "name": "inspect", "waypoint": 1}\n{')
    args = ["monitor", PRUNED, torn, LOGS / "*.jsonl", tmp_path / "missing", ROW1, "--format", form, "--per", per]
    alone, together = process(*args), process(*args, "--jobs", 3)
    assert together.stdout == alone.stdout
    assert together.stderr == alone.stderr
    assert len(alone.stderr.splitlines()) >= 2
    assert together.returncode == alone.returncode == 2


def test_an_interrupt_ends_all_processes(tmp_path: Path) -> None:
    pipes = [tmp_path / name for name in ("one", "two")]
    for pipe in pipes:
        os.mkfifo(pipe)
    with subprocess.Popen(
        [*COMMAND, "monitor", SAND, *pipes, "--jobs", "2"], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as running:
        ends = [pipe.open("w") for pipe in pipes]  # each returns once it is being read
        children = Path(f"/proc/{running.pid}/task/{running.pid}/children")
        workers = children.read_text().split() if children.exists() else []
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == 130
        assert running.stderr is not None
        assert running.stderr.read() == ""
        for end in ends:
            end.close()
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)


# -- keys -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def robots(tmp_path: Path) -> Path:
    """Two robots, one of which does what the tree describes, and an event of none."""
    events = [json.loads(line) for line in ROW1.read_text(encoding="utf-8").splitlines()]
    log = tmp_path / "robots.jsonl"
    mixed = [{**event, "robot": {"id": robot}} for event in events[:3] for robot in ("r1", "r2")]
    log.write_text(lines([*mixed, {"topic": "/clock"}, {**events[3], "robot": {"id": "r2"}}]))
    return log


def test_each_key_is_monitored_by_itself(robots: Path) -> None:
    result = run("monitor", PRUNED, robots, "--key", "robot.id")
    assert result.exit_code == 1
    said = result.stdout.splitlines()
    assert said[0] == 'robot.id="r2": event 8: true'
    assert "  event 2 at 10.4 on /command is ev1 (Moving to an inspection waypoint)" in said
    assert said[-3:] == [
        "robot.id  EVENTS  VERDICT  EVENT  BRANCH  KINDS",
        '"r1"      3       unknown  -      -       -',
        '"r2"      4       true     8      1       fault',
    ]
    assert "events read: 8;" in result.stdout
    lacking = "1 event without the field robot.id, given to no monitor (first: event 7)"
    assert result.stderr == f"rvaft: warning: {lacking}\n"
    assert run("monitor", PRUNED, robots).exit_code == 0


def test_json_lines_name_the_key(robots: Path) -> None:
    said = jsonl(PRUNED, robots, "--key", "robot.id")
    assert [(one["key"], one["event"]) for one in said] == [
        *((f"r{1 + (number + 1) % 2}", number) for number in range(1, 7)),
        ("r2", 8),
    ]
    assert said[-1]["verdict"] == "true"
    assert [one["event"] for one in said[-1]["matched"]] == [2, 4, 6, 8]
    assert said[-1]["matched"][0] == {"node": "ev1", "event": 2, "time": 10.4, "topic": "/command"}


def test_several_fields_are_one_key(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    events = [("bob", 1, "a"), ("bob", 2, "b"), ("eve", 1, "a"), ("bob", 1, "b"), ("eve", 1, "b"), ("bob", 1, "c")]
    log.write_text(lines([{"user": user, "src": src, "event": name} for user, src, name in events] + [{"user": "x"}]))
    result = run("monitor", SAND, log, "--key", "user", "--key", "src")
    assert result.exit_code == 1
    said = result.stdout.splitlines()
    assert [line for line in said if ": event " in line] == [
        'user="bob", src=2: event 2: false',
        'user="bob", src=1: event 6: true',
    ]
    assert [line.split() for line in said[-4:]] == [
        ["user", "src", "EVENTS", "VERDICT", "EVENT", "BRANCH", "KINDS"],
        ['"bob"', "1", "3", "true", "6", "1", "-"],
        ['"bob"', "2", "1", "false", "2", "-", "-"],
        ['"eve"', "1", "2", "unknown", "-", "-", "-"],
    ]
    assert result.stderr == (
        "rvaft: warning: 1 event without the field user or src, given to no monitor (first: event 7)\n"
    )
    told = jsonl(SAND, log, "--key", "user", "--key", "src", "--detections")
    assert [(one["key"], one["event"], one["verdict"]) for one in told] == [({"user": "bob", "src": 1}, 6, "true")]


@pytest.mark.parametrize("per", ["tree", "branch"])
def test_only_detections_are_told(per: str) -> None:
    traces = LOGS / "table[23]_row*.jsonl"
    every = jsonl(PRUNED, traces, "--per", per)
    told = jsonl(PRUNED, traces, "--per", per, "--detections")
    assert told == [
        one for one in every if "matched" in one or any("matched" in c for c in one.get("columns", {}).values())
    ]
    assert 0 < len(told) < len(every)


def test_what_tells_an_event_apart_is_told(tmp_path: Path) -> None:
    tree, log = tmp_path / "t.rvaft", tmp_path / "log.jsonl"
    tree.write_text('event e(x) = { kind: "k", x: x };\ntoplevel t; t sand a b c; a on e(1); b on e(_); c;')
    log.write_text(lines([{"kind": "k", "x": 1, "time": 3}, {"kind": "k", "x": 2}, {"event": "c"}]))
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


def test_a_terminal_is_told_what_is_waited_for() -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    words = [*COMMAND, "monitor", str(SAND)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=theirs, stdout=pipe, stderr=pipe, text=True) as running:
        os.close(theirs)
        os.write(ours, b'{"event": "a"}\n\x04')
        out, err = running.communicate(timeout=30)
    os.close(ours)
    assert err == "rvaft: reading events from standard input, one JSON object per line (Ctrl-D ends)\n"
    assert "events read: 1;" in out
    assert run("monitor", SAND, data="").stderr == ""


def test_too_many_keys_are_an_error(robots: Path) -> None:
    result = run("monitor", PRUNED, robots, "--key", "robot.id", "--max-keys", 1, "--format", "jsonl")
    failed(result, "too large", "different values of robot.id", "limit 1", "--max-keys N", "event 2", str(robots))
    assert len(result.stdout.splitlines()) == 1


def test_very_many_keys_are_summed_up(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text(
        "".join(f'{{"event": "a", "id": {number}}}\n' for number in range(300)) + '{"event": "b", "id": 7}\n'
    )
    log.write_text(log.read_text() + '{"event": "c", "id": 7}\n{"event": "b", "id": 3}\n{"event": "a", "id": 3}\n')
    said = run("monitor", SAND, log, "--key", "id").stdout.splitlines()
    assert said[-2].split() == ["7", "3", "true", "302", "1", "-"]
    assert said[-1] == "and 299 more: 1 false, 298 unknown"


# -- what does not go together ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--per", "branch", "--branch", 1], ["--branch and --per"]),
        (["--max-keys", 3], ["--max-keys needs --key"]),
        (["--window", 3], ["--window needs --order-by"]),
        (["--checkpoint-every", 3], ["--checkpoint-every needs --checkpoint"]),
        (["--key", "a..b"], ["'a..b' is no field"]),
        (["--order-by", ""], ["is no field"]),
        (["--key", "k", "--format", "table"], ["--format table"]),
        (["--detections"], ["--detections needs --format jsonl"]),
        (["--key", "a", "--key", "b..c"], ["'b..c' is no field"]),
        (["--explain", "--format", "jsonl"], ["--explain", "FILE"]),
        (["--explain=log.jpg"], ["'log.jpg'", ".svg"]),
        (["--backend", "rml", "--explain"], ["--explain needs the engine"]),
        (["--backend", "rml", "--checkpoint", "c"], ["--checkpoint needs the engine"]),
        (["--backend", "rml", "--max-configurations", 5], ["--max-configurations needs the engine"]),
        (["--backend", "rml", "--exec-fault", "true"], ["--exec-fault needs the engine"]),
        (["--backend", "rml", "--exec-attack", "true"], ["--exec-attack needs the engine"]),
        (["--follow", LOGS / "*.jsonl"], ["--follow needs one TRACE"]),
        (["--checkpoint", "c", LOGS / "*.jsonl"], ["--checkpoint needs one TRACE"]),
        (["--jobs", 2, "-"], ["--jobs is for files"]),
        (["--jobs", 0], ["0"]),
        (["--max-configurations", 0], ["0"]),
    ],
    ids=str,
)
def test_options_that_do_not_go_together(options: list[object], parts: list[str]) -> None:
    failed(run("monitor", SAND, ROW1, *options), *parts)


@pytest.mark.parametrize("option", [["--follow"], ["--checkpoint", "c"]])
@pytest.mark.parametrize("trace", [[], ["-"], ["--word", "a"]])
def test_what_needs_a_file(option: list[str], trace: list[str]) -> None:
    failed(run("monitor", SAND, *trace, *option, data=""), f"{option[0]} needs one TRACE, a file")


# -- the progress bar -------------------------------------------------------------------------------------------------


def test_a_bar_is_drawn_on_a_terminal_and_never_elsewhere(tmp_path: Path) -> None:
    pty = pytest.importorskip("pty")
    log = tmp_path / "log.jsonl"
    log.write_text('{"event": "x", "pad": "' + "y" * 200 + '"}\n' * 1)
    log.write_text(log.read_text() * 60_000 + '{"event": "b"}\n')
    ours, theirs = pty.openpty()
    program = "import rvaft.support.terminal as t; t._PATIENCE = 0; from rvaft.cli import main; main()"
    words = [sys.executable, "-c", program, "monitor", str(SAND), str(log)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=theirs, text=True) as running:
        os.close(theirs)
        drawn = b""
        while True:
            try:
                block = os.read(ours, 1 << 16)
            except OSError:  # the other end is closed
                break
            if not block:
                break
            drawn += block
        assert running.stdout is not None
        said = running.stdout.read()
    os.close(ours)
    assert b"monitoring" in drawn
    assert b"MB" in drawn
    assert said == process("monitor", SAND, log).stdout
    assert process("monitor", SAND, log).stderr == ""


def test_a_limit_that_is_too_low_to_begin_says_so() -> None:
    failed(run("monitor", PRUNED, ROW1, "--max-configurations", "1"), "too large", "--max-configurations allows more")
