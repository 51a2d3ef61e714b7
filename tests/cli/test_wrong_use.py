"""Whatever is wrong with what a user gives: one line that says what, where and what to do; status
2; nothing half-written.
"""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from rvaft.cli import main
from tests.cli.runs import PRUNED, SAND, failed, process, run, words, written
from tests.readers.test_json_lines import BAD, STRICT
from tests.tables import rows

READERS = {"check": "", "show": "", "branches": "", "emit": "--to rml", "monitor": "--word a"}
WRITERS = {"show": ["show", SAND], "emit": ["emit", SAND, "--to", "rml"]}


@pytest.mark.parametrize("row", rows(__file__, "wrong_uses.txt"), ids=lambda row: row[0])
def test_wrong_use(row: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*words(row[0]), data="")
    failed(result, *row[1:])
    assert result.stdout == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (None, ["No such file"]),
        (b"", [":1:1"]),
        (b"  // nothing\n", ["no statement"]),
        (bytes(range(256)), [":"]),
        (b"\x7fELF\x02\x01\x01\x00", ["binary"]),
        (b"toplevel a; a and \xff;", ["UTF-8"]),
        (b"x" * 1_000_000, [":1:"]),
        (b'"' * 1_000_001, [":1:"]),
    ],
)
def test_no_tree(command: str, content: bytes | None, parts: list[str], tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    if content is not None:
        tree.write_bytes(content)
    result = run(command, tree, *READERS[command].split())
    assert (result.exit_code, result.stdout) == (2, "")
    first, *caret = result.stderr.splitlines()
    assert first.startswith(f"rvaft: error: {tree}:")
    assert len(caret) in (0, 2)
    assert all(len(line) < 1000 for line in (first, *caret))
    assert all(part in first for part in parts)


@pytest.mark.parametrize("command", READERS)
def test_a_path_that_is_no_tree(command: str, tmp_path: Path) -> None:
    more = READERS[command].split()
    failed(run(command, tmp_path, *more), str(tmp_path), "Is a directory")
    failed(run(command, "no\nsuch\x1b[31m\tfile", *more), r"no\nsuch\x1b[31m\tfile")
    tree = written(tmp_path / "tree.rvaft", "a;")
    tree.chmod(0)
    if not os.access(tree, os.R_OK):  # as for everybody but root
        failed(run(command, tree, *more), str(tree), "Permission denied")


@pytest.mark.parametrize("case", [case for case in (*BAD, *STRICT) if not case.startswith("for a tree")])
def test_a_malformed_line_of_a_trace(case: str, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_bytes(b'{"event": "a"}\n' + (BAD | STRICT)[case].split(b"\n")[0] + b"\n")
    strictly = ["--strict-json"] if case in STRICT else []
    if strictly:
        failed(run("coverage", SAND, log, *strictly), f"{log}:2: ")
    result = run("monitor", SAND, log, "--format", "jsonl", *strictly)
    failed(result, f"{log}:2: ")
    assert result.stdout == '{"event": 1, "verdict": "unknown"}\n'


def test_a_line_of_a_hundred_megabytes(tmp_path: Path) -> None:
    failed(run("monitor", SAND, written(tmp_path / "log.jsonl", "x" * 100_000_000)), "log.jsonl:1: ")


def test_a_limit_that_no_option_raises_is_only_named(tmp_path: Path) -> None:
    choices = "".join(f"p{i} or s a{i};" for i in range(1001))
    tree = written(tmp_path / "kinds.rvaft", f"top and {' '.join(f'p{i}' for i in range(1001))}; s fault; {choices}")
    result = run("emit", tree, "--to", "rml", "--kind", "fault")
    failed(result, "too large: ways to have the kind fault below top (limit 1000)")
    assert "--limit" not in result.stderr


def test_a_defect_is_reported_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> Callable[[], None]:
        raise RecursionError("maximum recursion depth exceeded")

    assert run("show", SAND).exit_code == 0
    monkeypatch.setattr("rvaft.cli.show.draw", explode)
    failed(run("show", SAND), "defect in rvaft", "RecursionError", "test_wrong_use")


def test_the_command_returns_its_status_where_it_is_called_from_python() -> None:
    assert main(["check", str(PRUNED), "--format", "json"], standalone_mode=False) == 0
    assert main(["explain", "nothing"], standalone_mode=False) == 2


@pytest.mark.parametrize("writer", WRITERS)
def test_an_output_that_cannot_be_written(writer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = written(tmp_path / "file", "kept")
    for target in (tmp_path / "missing" / "file", tmp_path, kept / "below"):
        failed(run(*WRITERS[writer], "-o", target), str(target), "cannot write")
    if Path("/dev/full").exists():
        failed(run(*WRITERS[writer], "-o", "/dev/full"), "/dev/full", "No space left")
    words = ["show", SAND] if writer == "show" else ["emit", SAND, "--to", "dot"]
    written(tmp_path / "a.svg", "old")
    automaton = run("emit", SAND, "--to", "dot", "-o", tmp_path / "a.svg", env={"PATH": ""})
    failed(automaton, "dot is not installed: install Graphviz (apt-get install gr")

    def refused(*_: object, **__: object) -> None:  # root may write everywhere, so the refusal is played
        raise PermissionError(13, "Permission denied", str(tmp_path))

    monkeypatch.setattr("rvaft.support.files.tempfile.mkstemp", refused)
    failed(run(*words, "-o", tmp_path / "tree.dot"), "tree.dot: cannot write: Permission denied")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"file": "kept", "a.svg": "old"}


@pytest.mark.parametrize("target", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc")
def test_an_open_pipe_is_written_to(target: str) -> None:
    result = process("show", SAND, "-o", target)
    assert (result.returncode, result.stderr, result.stdout) == (0, "", run("show", SAND).stdout)


def test_an_open_file_and_a_named_pipe_are_written_to_and_not_replaced(tmp_path: Path) -> None:
    target, pipe, drawn = tmp_path / "out", tmp_path / "pipe", run("show", SAND).stdout
    with target.open("wb") as stream:
        stream.write(b"before\n")
        stream.flush()
        assert process("show", SAND, "-o", "/dev/stdout", stdout=stream).returncode == 0
    assert target.read_text(encoding="utf-8") == "before\n" + drawn
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE, encoding="utf-8") as reader:
        assert run("show", SAND, "-o", pipe).exit_code == 0
        assert reader.communicate(timeout=60)[0] == drawn
    assert pipe.is_fifo()
    assert sorted(tmp_path.iterdir()) == [target, pipe]


def test_too_many_events_to_count(tmp_path: Path) -> None:
    (tree := tmp_path / "t.rvaft").write_text("semantics scattered; top sand a b; a times 20000; b;")
    failed(result := run("monitor", str(tree), "-", data=""), "events that a counts, 20,000 (limit 10000)")
    assert result.stderr.endswith("; count fewer events\n")
