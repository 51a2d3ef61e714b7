"""Whatever is wrong with what a user gives: one line that says what, where and what to do; status 2; nothing half-written."""

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from rvaft.cli import main
from tests.cli.runs import COMMAND, PRUNED, TREES, failed, process, run
from tests.monitoring.test_reader import BAD

SAND = TREES / "gates" / "sand.rvaft"
READERS = ("check", "show", "branches", "emit", "monitor")


def arguments(command: str, tree: object) -> list[object]:
    more: dict[str, list[object]] = {"emit": ["--to", "rml"], "monitor": ["--word", "a"]}
    return [command, tree, *more.get(command, [])]


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
    result = run(*arguments(command, tree))
    assert result.exit_code == 2
    assert result.stdout == ""
    first, *caret = result.stderr.splitlines()
    assert first.startswith(f"rvaft: error: {tree}:")
    assert len(caret) in (0, 2)
    assert all(len(line) < 1000 for line in (first, *caret))
    assert all(part in first for part in parts)


@pytest.mark.parametrize("command", READERS)
def test_a_folder_is_no_tree(command: str, tmp_path: Path) -> None:
    failed(run(*arguments(command, tmp_path)), str(tmp_path), "Is a directory")


@pytest.mark.parametrize("command", READERS)
def test_an_unreadable_tree(command: str, tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    tree.write_text("a;")
    tree.chmod(0)
    if os.access(tree, os.R_OK):
        pytest.skip("this user may read everything")
    failed(run(*arguments(command, tree)), str(tree), "Permission denied")


@pytest.mark.parametrize("command", READERS)
def test_the_path_in_an_error_stays_on_its_line(command: str) -> None:
    failed(run(*arguments(command, "no\nsuch\x1b[31m\tfile")), r"no\nsuch\x1b[31m\tfile")


WRONG_USE: dict[str, tuple[list[object], list[str]]] = {
    "unknown command": (["draw"], ["'draw'", "check, show"]),
    "unknown option": (["--fast"], ["--fast"]),
    "unknown option of a command": (["check", SAND, "--fast"], ["--fast", "rvaft check --help"]),
    "no tree": (["check"], ["TREE"]),
    "two trees to show": (["show", SAND, SAND], ["sand.rvaft"]),
    "unknown format": (["show", SAND, "--format", "gif"], ["'gif'", "svg"]),
    "unknown format of findings": (["check", SAND, "--format", "xml"], ["'xml'", "json"]),
    "no language": (["emit", SAND], ["--to"]),
    "unknown language": (["emit", SAND, "--to", "klingon"], ["klingon", "known: ", "rml"]),
    "unknown semantics": (["emit", SAND, "--to", "rml", "--semantics", "weak"], ["'weak'", "scattered"]),
    "limit 0": (["emit", SAND, "--to", "rml", "--limit", "0"], ["0"]),
    "unknown backend": (["monitor", SAND, "--word", "a", "--backend", "klingon"], ["klingon", "known: "]),
    "branch 0": (["monitor", SAND, "--word", "a", "--branch", "0"], ["branch 0"]),
    "branch -1": (["monitor", SAND, "--word", "a", "--branch", "-1"], ["branch -1"]),
    "branch too high": (["monitor", PRUNED, "--word", "a", "--branch", "5"], ["branch 5", "4"]),
    "branch no number": (["monitor", SAND, "--word", "a", "--branch", "one"], ["'one'"]),
    "unknown kind": (["monitor", SAND, "--word", "a", "--kind", "error"], ["'error'", "attack"]),
    "kind that no branch has": (["monitor", SAND, "--word", "a", "--kind", "fault"], ["fault"]),
    "branch and kind": (["emit", PRUNED, "--to", "rml", "--branch", 1, "--kind", "fault"], ["--branch and --kind"]),
    "word and trace": (["monitor", SAND, "trace.jsonl", "--word", "a"], ["--word and TRACE"]),
    "unknown code": (["explain", "cycl"], ["cycl", "did you mean cycle"]),
}


@pytest.mark.parametrize("case", WRONG_USE)
def test_wrong_use(case: str) -> None:
    words, parts = WRONG_USE[case]
    failed(run(*words), *parts)


@pytest.mark.parametrize("command", ["emit", "monitor"])
def test_a_tree_that_breaks_a_rule_is_not_run(command: str) -> None:
    failed(run(*arguments(command, TREES / "remote_inspection" / "listing.rvaft")), "NewWp", "[unbound-variable]")


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("form", ["text", "jsonl"])
def test_a_malformed_line_of_a_trace(case: str, form: str, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_bytes(b'{"event": "a"}\n' + BAD[case].split(b"\n")[0] + b"\n")
    result = run("monitor", SAND, log, "--format", form)
    failed(result, f"{log}:2: ")
    assert result.stdout == ('{"event": 1, "verdict": "unknown"}\n' if form == "jsonl" else "")


def test_a_line_of_a_hundred_megabytes(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_bytes(b"x" * 100_000_000)
    failed(run("monitor", SAND, log), f"{log}:1: ")


@pytest.mark.parametrize("trace", ["missing", "."])
def test_no_trace(trace: str, tmp_path: Path) -> None:
    failed(run("monitor", SAND, tmp_path / trace), str(tmp_path / trace))


# -- output files ---------------------------------------------------------------------------------------------------


WRITERS: dict[str, list[object]] = {"show": ["show", SAND], "emit": ["emit", SAND, "--to", "rml"]}


@pytest.mark.parametrize("writer", WRITERS)
def test_an_output_that_cannot_be_written(writer: str, tmp_path: Path) -> None:
    target = tmp_path / "missing" / "file"
    failed(run(*WRITERS[writer], "-o", target), str(target), "cannot write")
    failed(run(*WRITERS[writer], "-o", tmp_path), str(tmp_path), "cannot write")
    (tmp_path / "file").write_text("kept")
    failed(run(*WRITERS[writer], "-o", tmp_path / "file" / "below"), "cannot write")
    assert sorted(tmp_path.iterdir()) == [tmp_path / "file"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_device_is_named() -> None:
    failed(run(*WRITERS["show"], "-o", "/dev/full"), "/dev/full", "No space left")


def test_a_failure_leaves_the_old_file_as_it_was(tmp_path: Path) -> None:
    target = tmp_path / "out.svg"
    target.write_text("old")
    failed(run("show", SAND, "-o", target, env={"PATH": ""}), "dot is not installed", "apt-get install graphviz")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_defect_is_reported_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> Callable[[], None]:
        raise RecursionError("maximum recursion depth exceeded")

    assert run("show", SAND).exit_code == 0
    monkeypatch.setattr("rvaft.cli.show.draw", explode)
    failed(run("show", SAND), "defect in rvaft", "RecursionError", "test_wrong_input")


def test_the_command_returns_its_status_where_it_is_called_from_python() -> None:
    assert main(["check", str(PRUNED), "--format", "json"], standalone_mode=False) == 0
    assert main(["explain", "nothing"], standalone_mode=False) == 2


def test_json_lines_stay_json_whatever_the_words() -> None:
    result = run("monitor", SAND, "-", "-", data='{"event": "a"}', env={"PYTHONIOENCODING": "ascii"})
    assert result.exit_code == 0
    said = run("monitor", SAND, "-", "-", "--format", "jsonl", data='{"event": "\u2028\x9f"}').stdout
    assert [json.loads(line)["trace"] for line in said.splitlines()] == ["<stdin>"]


# -- what was probably meant --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "meant"), [("hoa", "automaton"), ("HOA", "automaton"), ("LTL", "ltlf"), ("rml-papr", "rml-paper")]
)
def test_a_backend_of_that_language_or_a_close_name_is_suggested(wanted: str, meant: str) -> None:
    failed(run("emit", SAND, "--to", wanted), wanted, "known: ", f"did you mean {meant}?")
    failed(run("monitor", SAND, "--word", "a", "--backend", wanted), f"did you mean {meant}?")


def test_an_unknown_suffix_is_no_format(tmp_path: Path) -> None:
    target = tmp_path / "x.jpg"
    failed(run("show", SAND, "-o", target), ".jpg", ".svg", ".rvaft", "--format")
    assert list(tmp_path.iterdir()) == []
    assert run("show", SAND, "--format", "dot", "-o", target).exit_code == 0
    assert target.read_text().startswith("digraph")


@pytest.mark.parametrize("line", ["[1]", "1", "null", "a: 1", "", '{"a":'])
def test_a_line_that_is_no_object_is_told_what_a_trace_is(line: str) -> None:
    data = line.encode() or b"\xff"
    failed(run("monitor", SAND, data=data), "<stdin>:1: not ", "a trace has one JSON object per line")


@pytest.mark.parametrize(("tree", "shown"), [("", "''"), ("nowhere.rvaft", "nowhere.rvaft")])
def test_a_file_that_cannot_be_read_has_no_line(tree: str, shown: str) -> None:
    result = run("check", tree)
    failed(result)
    assert result.stderr.startswith(f"rvaft: error: {shown}: cannot read the file: ")


def test_a_code_in_capitals_is_suggested_in_small_letters() -> None:
    failed(run("explain", "CYCLE"), "there is no rule CYCLE; did you mean cycle?")


@pytest.mark.parametrize("language", ["rml", "ltlf", "automaton"])
def test_what_is_too_large_names_the_option_that_raises_the_limit(language: str) -> None:
    failed(run("emit", PRUNED, "--to", language, "--limit", 1), "too large: ", "(limit 1); raise it with --limit N")


def test_a_limit_that_no_option_raises_is_only_named(tmp_path: Path) -> None:
    tree = tmp_path / "kinds.rvaft"
    tree.write_text(
        "toplevel top; top and "
        + " ".join(f"p{i}" for i in range(1001))
        + "; s fault;"
        + " ".join(f"p{i} or s a{i}; a{i};" for i in range(1001))
    )
    result = run("emit", tree, "--to", "rml", "--kind", "fault")
    failed(result, "too large: ways to have the kind fault below top (limit 1000)")
    assert "--limit" not in result.stderr


# -- outputs that are no regular files ------------------------------------------------------------------------------


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("target", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc")
def test_an_open_pipe_is_written_to(writer: str, target: str) -> None:
    result = process(*WRITERS[writer], "-o", target)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == run(*WRITERS[writer]).stdout


def test_an_open_file_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with target.open("wb") as stream:
        stream.write(b"before\n")
        stream.flush()
        subprocess.run([*COMMAND, "show", str(SAND), "-o", "/dev/stdout"], stdout=stream, check=True, timeout=60)
    assert target.read_text(encoding="utf-8") == "before\n" + run("show", SAND).stdout
    assert list(tmp_path.iterdir()) == [target]


def test_a_named_pipe_is_written_to(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE, encoding="utf-8") as reader:
        assert run("show", SAND, "-o", pipe).exit_code == 0
        assert reader.communicate(timeout=60)[0] == run("show", SAND).stdout
    assert pipe.is_fifo()
