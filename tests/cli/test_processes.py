"""The command as a process: pipes, signals, streams, and what it imports."""

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.cli.runs import COMMAND, PRUNED, SAND, process, run, started, words, written

HEAVY: Final = ("sympy", "spot", "rich", "hypothesis")


def test_a_stream_is_answered_line_by_line() -> None:
    with started("monitor", SAND, "--format", "jsonl") as running:
        for number, letter in enumerate("abc", 1):
            running.stdin.write(f'{{"event": "{letter}"}}\n')
            running.stdin.flush()
            said = json.loads(running.stdout.readline())
            assert (said["event"], said["verdict"]) == (number, "true" if letter == "c" else "unknown")
        running.stdin.close()
        assert running.wait(timeout=30) == 1


@pytest.mark.parametrize("form", ["text", "jsonl"])
def test_an_interrupt_ends_without_a_traceback(form: str) -> None:
    with started("monitor", SAND, "--format", form, "--semantics", "strict") as running:
        running.stdin.write('{"event": "b"}\n')
        running.stdin.flush()
        assert "false" in running.stdout.readline()
        running.send_signal(signal.SIGINT)
        assert (running.wait(timeout=30), running.stderr.read()) == (130, "")


def test_a_closed_pipe_ends_without_a_traceback(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", '{"event": "a"}\n' * 50_000)
    with started("monitor", SAND, log, "--format", "jsonl") as running:
        assert running.stdout.readline().startswith('{"event": 1')
        running.stdout.close()
        assert (running.wait(timeout=60), running.stderr.read()) == (141, "")


@pytest.mark.parametrize("args", [["--help"], ["show", SAND], ["check", "--help"], ["--version"]])
def test_output_that_nobody_reads(args: list[object]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = process(*args, stdout=writing)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize(
    ("redirection", "said"),
    [(">&-", "standard output is closed"), ("<&-", "standard input is closed"), ("</dev/null >&- 2>&-", "")],
)
def test_a_stream_that_is_closed(redirection: str, said: str) -> None:
    words = shlex.join([*COMMAND, "monitor", str(SAND)])
    done = subprocess.run(["/bin/sh", "-c", f"{words} {redirection}"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) <= 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_device_is_an_error() -> None:
    with Path("/dev/full").open("w") as full:
        done = process("show", SAND, stdout=full)
    assert done.returncode == 2
    assert done.stderr == "rvaft: error: standard output: cannot write: No space left on device\n"


def test_drawings_are_utf_8_whatever_the_locale() -> None:
    done = process("show", PRUNED, env={**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}, encoding="utf-8")
    assert "├─ ev1 AND" in done.stdout


def test_an_output_file_is_whole_and_has_the_usual_permissions(tmp_path: Path) -> None:
    target, link = tmp_path / "tree.json", tmp_path / "link.json"
    link.symlink_to(target)
    assert process("show", SAND, "-o", link, umask=0o027).returncode == 0
    assert target.stat().st_mode & 0o777 == 0o640
    assert link.is_symlink()
    assert target.read_text(encoding="utf-8").startswith('{\n  "format": "rvaft"')
    target.chmod(0o600)
    assert run("show", SAND, "-o", target).exit_code == 0
    assert target.stat().st_mode & 0o777 == 0o600
    assert sorted(tmp_path.iterdir()) == [link, target]
    assert run("show", SAND, "-o", "/dev/null").exit_code == 0
    assert not Path("/dev/null").is_file()


def test_a_binary_picture_is_refused_by_a_terminal() -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    done = process("show", SAND, "--format", "png", stdout=theirs)
    os.close(ours)
    os.close(theirs)
    assert done.returncode == 2
    assert "binary" in done.stderr


def test_what_starts_often_imports_nothing_heavy() -> None:
    often = ["--help", "check $PRUNED", "monitor $PRUNED /dev/null --branch 1", "show $PRUNED", "branches $PRUNED"]
    program = (
        "import sys\nfrom rvaft.cli import main\n"
        f"for words in {[words(command) for command in often]}:\n"
        "    assert main(words, standalone_mode=False) in (0, None)\n"
        "    print('imported', *sorted({name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    imported = [set(line.split()) for line in done.stdout.splitlines() if line.startswith("imported ")]
    assert len(imported) == len(often)
    assert "click" in imported[0]
    assert not any("networkx" in names for names in imported)
    assert not any(names & set(HEAVY) for names in imported)
