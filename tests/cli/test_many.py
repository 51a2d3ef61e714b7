"""`rvaft monitor` over many: a monitor for each branch or kind, several logs, keys, processes, and
the table at the end.
"""

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from rvaft import Semantics
from tests.cli.runs import LOGS, PRUNED, ROW1, SAND, TREES, children, jsonl, lines, run, started, written
from tests.trees import shipped

NAMED = {"tree": "φ", "1": "φ1", "2": "φ2", "3": "φ3", "4": "φ4"}


@pytest.mark.parametrize("trace", dict(shipped.traces("remote_inspection/pruned")))
def test_the_table_has_the_verdicts_stored_beside_the_tree(trace: str) -> None:
    log = LOGS / f"{trace}.jsonl"
    stored = shipped.expected("remote_inspection/pruned")[trace][Semantics.PROJECTED]
    table = run("monitor", PRUNED, log, "--per", "branch", "--format", "table").stdout.splitlines()
    events = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    head, *rows = (row.rpartition("}") for row in table[: len(events) + 1])
    assert head[2].split() == ["EVENT", *NAMED.values()]
    assert [json.loads(event + "}") for event, _, _ in rows] == events
    cells = [cells.split() for _, _, cells in rows]
    assert ["".join(column) for column in zip(*cells, strict=True)] == [stored[label] for label in NAMED]


def test_a_long_table_leaves_out_events_that_change_nothing(tmp_path: Path) -> None:
    events = [{"event": name} for name in ("x",) * 2000 + ("a", "b", "c", "x")]
    log = written(tmp_path / "log.jsonl", lines(events))
    rows = run("monitor", SAND, log, "--format", "table").stdout.splitlines()
    assert len(rows) < 1020
    assert rows[1001].strip() == "(1002 more)"
    assert rows[1002].split() == ['{"event":', '"c"}', "⊤"]
    assert rows[1003].strip() == "(1 more)"


@pytest.mark.parametrize(
    ("pattern", "files"),
    [
        ("*.jsonl", ["x.jsonl"]),
        ("**/*.jsonl", ["a/b/z.jsonl", "a/y.jsonl", "x.jsonl"]),
        ("a/[xy].jsonl", ["a/y.jsonl"]),
        ("a/?/z.jsonl", ["a/b/z.jsonl"]),
    ],
)
def test_a_pattern_stands_for_the_files_that_match_it(pattern: str, files: list[str], tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "w.jsonl").mkdir()
    for place in ("x.jsonl", "a/y.jsonl", "a/b/z.jsonl"):
        written(tmp_path / place, '{"event": "a"}\n')
    said = jsonl(SAND, tmp_path / pattern, tmp_path / "x.jsonl")
    assert [str(Path(one["trace"]).relative_to(tmp_path)) for one in said][:-1] == files


def ends(branches: int, *logs: str) -> list[str]:
    """The last lines for logs in this folder, whose names are short: the headings, and a row for each log."""
    tree = written(Path("tree.rvaft"), f"top or {' '.join(f'a{n}' for n in range(1, branches + 1))};")
    for number, words in enumerate(logs):
        written(Path(f"{number}.log"), lines([{"event": word} for word in words.split()]))
    said = run("monitor", tree, "*.log", "--per", "branch", "--semantics", "scattered").stdout.splitlines()
    return said[-len(logs) - 1 :]


def test_of_many_monitors_those_of_a_detection_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said = ends(60, "noise a7 a60", "noise", " ".join(f"a{n}" for n in range(20, 30)))
    assert max(map(len, said)) <= 80
    head, *rows = (line.split() for line in said)
    assert head == ["TRACE", "EVENTS", "VERDICT", "EVENT", "BRANCH", "KINDS", "DETECTED"]
    assert [row[1:] for row in rows] == [
        ["3", "true", "2", "7", "-", "φ7", "2,", "φ60", "3"],
        ["1", "unknown", "-", "-", "-", "-"],
        ["10", "true", "1", "20", "-", "φ20", "1,", "φ21", "2,", "φ22", "3", "and", "7", "more"],
    ]
    for branches, columns in ((7, 8), (8, 2)):  # few monitors have a column each
        head = ends(branches, "a1", "a2", "a3")[0].split()
        assert len(head) == len(["TRACE", "EVENTS", "BRANCH", "KINDS"]) + columns + (branches > 7)
        assert ("φ7" in head) == (branches == 7)


def test_a_tree_of_very_many_event_types_is_summed_up(tmp_path: Path) -> None:
    tree = written(tmp_path / "wide.rvaft", f"toplevel t; t or {' '.join(f'b{n}' for n in range(500))};")
    said = run("monitor", tree, "--word", "x b7").stdout.splitlines()
    assert "events read: 2; relevant: b7 1, 499 other types 0" in said
    assert said[-2:] == ["warning: 479 other types never seen", 'note: other events of the log have event "x"']
    assert len(said) < 30


@pytest.mark.parametrize(("form", "per"), [("text", "tree"), ("jsonl", "branch"), ("table", "branch")])
def test_several_processes_print_what_one_prints(form: str, per: str, tmp_path: Path) -> None:
    torn = written(tmp_path / "torn.jsonl", '{"topic": "command", "name": "inspect", "waypoint": 1}\n{')
    args = ["monitor", PRUNED, torn, LOGS / "*.jsonl", tmp_path / "missing", ROW1, "--format", form, "--per", per]
    alone, together = run(*args), run(*args, "--jobs", 3)
    assert (together.stdout, together.stderr) == (alone.stdout, alone.stderr)
    assert len(alone.stderr.splitlines()) >= 2
    assert together.exit_code == alone.exit_code == 2


def test_an_interrupt_ends_all_processes(tmp_path: Path) -> None:
    pipes = [tmp_path / name for name in ("one", "two")]
    for pipe in pipes:
        os.mkfifo(pipe)
    with started("monitor", SAND, *pipes, "--jobs", "2") as running:
        streams = [pipe.open("w") for pipe in pipes]  # each returns once it is being read
        workers = children(running)
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == 130
        assert running.stderr.read() == ""
        for stream in streams:
            stream.close()
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)


@pytest.mark.parametrize("per", ["tree", "branch"])
def test_only_detections_are_told(per: str) -> None:
    traces = LOGS / "table[23]_row*.jsonl"
    every, told = (jsonl(PRUNED, traces, "--per", per, *option) for option in ([], ["--detections"]))
    assert told == [one for one in every if any("matched" in c for c in (one, *one.get("columns", {}).values()))]
    assert 0 < len(told) < len(every)


def test_very_many_keys_are_summed_up(tmp_path: Path) -> None:
    last = [("b", 7), ("c", 7), ("b", 3), ("a", 3)]
    events = [{"event": name, "id": key} for name, key in (*(("a", key) for key in range(300)), *last)]
    said = run("monitor", SAND, written(tmp_path / "l", lines(events)), "--key", "id").stdout.splitlines()
    assert said[-2].split() == ["7", "3", "true", "302", "1", "-"]
    assert said[-1] == "and 299 more: 1 false, 298 unknown"
    log = written(tmp_path / "l", lines([{"event": "c", "id": key} for key in range(1001)]))
    said = run("monitor", TREES / "gates" / "or.rvaft", log, "--key", "id").stdout.splitlines()
    assert (said[-2].split()[0], said[-1]) == ("999", "and 1 more: 1 true")
    dead = run("monitor", SAND, log, "--key", "id")
    more = "1000 keys can no longer match: missing events are not listed for further keys"
    assert (dead.stderr, dead.stdout.count("waited for")) == (f"rvaft: warning: {more}\n", 1000)


def test_of_very_many_traces_those_with_an_error_have_a_row(tmp_path: Path) -> None:
    log, torn = written(tmp_path / "log.jsonl", '{"event": "a"}\n'), written(tmp_path / "torn.jsonl", "{")
    said = run("monitor", SAND, *[log] * 100, torn).stdout.splitlines()
    assert (said[-2].split()[0], said[-1]) == (str(torn), "and 100 more: 100 unknown")


def test_a_terminal_is_told_what_is_waited_for() -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    with started("monitor", SAND, stdin=theirs) as running:
        os.close(theirs)
        os.write(ours, b'{"event": "a"}\n\x04')
        out, err = running.communicate(timeout=30)
    os.close(ours)
    assert err == "rvaft: reading events from standard input, one JSON object per line (Ctrl-D ends)\n"
    assert "events read: 1;" in out
    assert run("monitor", SAND, data="").stderr == ""


def test_a_bar_is_drawn_on_a_terminal_and_never_elsewhere(tmp_path: Path) -> None:
    pty = pytest.importorskip("pty")
    log = written(tmp_path / "log.jsonl", lines([{"event": "x", "pad": "y" * 200}]) * 5_000 + '{"event": "b"}\n')
    ours, theirs = pty.openpty()
    patience = "import rvaft.support.terminal as t; t._PATIENCE = 0; from rvaft.cli import main; main()"
    with started(args=[sys.executable, "-c", patience, "monitor", str(SAND), str(log)], stderr=theirs) as running:
        os.close(theirs)
        drawn = b""
        try:
            while block := os.read(ours, 1 << 16):
                drawn += block
        except OSError:  # the other end is closed
            pass
        said = running.stdout.read()
    os.close(ours)
    assert b"monitoring" in drawn
    assert b"MB" in drawn
    alone = run("monitor", SAND, log)
    assert (said, alone.stderr) == (alone.stdout, "")


def test_the_summary_says_that_each_log_is_monitored_afresh(tmp_path: Path) -> None:
    """Only where it matters: with several logs, one of which may go on in another."""
    first, second = (
        written(tmp_path / f"{name}.jsonl", lines([{"event": word, "k": 1} for word in name])) for name in ("a", "bc")
    )
    whole = written(tmp_path / "abc.jsonl", lines([{"event": word} for word in "abc"]))
    said = "each log is monitored afresh, so a match that begins in one and ends in another is not found"
    for words in ([], ["--jobs", 2], ["--key", "k"], ["--repeat"], ["--semantics", "scattered"]):
        result = run("monitor", SAND, first, second, *words)
        assert (result.exit_code, result.stderr) == (0, "")
        assert f"note: {said}" in result.stdout
    assert "(1 of 3 end unknown)" in run("monitor", SAND, tmp_path / "*.jsonl").stdout  # ⊥ is none
    for words in (["--format", "jsonl"], ["--format", "ecs"], ["--template", "{event}"]):
        assert run("monitor", SAND, first, second, *words).stderr.startswith(f"rvaft: warning: {said}")
    assert said in run("report", SAND, first, second, "-o", tmp_path / "page.html").stderr
    for traces in ([first], [whole, whole]):
        result = run("monitor", SAND, *traces)
        assert "afresh" not in result.stdout + result.stderr
    joined = first.read_text() + second.read_text()
    assert run("monitor", SAND, data=joined).exit_code == 1
