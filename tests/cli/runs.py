"""Running the command: inside this process for speed, or as a process of its own where that is the point."""

import json
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from click.testing import CliRunner, Result

from rvaft.cli import main

TREES: Final = Path(__file__).parents[2] / "trees"
PRUNED: Final = TREES / "remote_inspection" / "pruned.rvaft"
FULL: Final = PRUNED.with_name("full.rvaft")
UNBOUND: Final = PRUNED.with_name("listing.rvaft")
"""The tree of the paper that breaks a rule."""
SAND: Final = TREES / "gates" / "sand.rvaft"
LOGS: Final = PRUNED.with_suffix(".traces")
ROW1: Final = LOGS / "table2_row1.jsonl"
FILES: Final = {
    "TREES": TREES,
    "PRUNED": PRUNED,
    "FULL": FULL,
    "UNBOUND": UNBOUND,
    "SAND": SAND,
    "LOGS": LOGS,
    "LOG": ROW1,
}
COMMAND: Final = (sys.executable, "-c", "from rvaft.cli import main; main()")


def run(*args: object, data: bytes | str | None = None, env: Mapping[str, str] | None = None) -> Result:
    """Run the command here; nothing that it does may leak an exception."""
    result = CliRunner().invoke(main, [str(arg) for arg in args], input=data, env=env)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def words(command: str) -> list[str]:
    """The words of a command in a table, where `$NAME` is one of our files."""
    return [re.sub(r"\$([A-Z]+)", lambda name: str(FILES[name[1]]), word) for word in shlex.split(command)]


def jsonl(*args: object, **options: Any) -> list[dict[str, Any]]:
    """What `rvaft monitor` says in JSON."""
    return [json.loads(line) for line in run("monitor", *args, "--format", "jsonl", **options).stdout.splitlines()]


def process(*args: object, **options: Any) -> "subprocess.CompletedProcess[str]":
    """Run the command as a process of its own."""
    words: Sequence[str] = [*COMMAND, *map(str, args)]
    pipe = subprocess.PIPE
    given = {"stdout": pipe, "stderr": pipe, "text": True, "timeout": 60, **options}
    done: subprocess.CompletedProcess[str] = subprocess.run(words, check=False, **given)
    return done


@contextmanager
def started(*args: object, **options: Any) -> Iterator[Any]:
    """The command as a process that does not outlive the test; its streams are pipes."""
    pipe = subprocess.PIPE
    words = [*COMMAND, *map(str, args)]
    given = {"args": words, "stdin": pipe, "stdout": pipe, "stderr": pipe, "text": True, "bufsize": 1, **options}
    with subprocess.Popen(**given) as running:
        try:
            yield running
        finally:
            running.kill()


def children(running: Any) -> list[str]:
    """The numbers of the processes that a process has started, where the system tells."""
    path = Path(f"/proc/{running.pid}/task/{running.pid}/children")
    return path.read_text().split() if path.exists() else []


def failed(result: Result, *parts: str) -> None:
    """Assert that a run ended with status 2 and one line of error in which these parts occur."""
    assert result.exit_code == 2, result.output
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("rvaft: error: ")
    assert len(lines[0]) < 400
    for part in parts:
        assert part in lines[0], lines[0]


def written(path: Path, text: str) -> Path:
    """A file with this text."""
    path.write_text(text, encoding="utf-8")
    return path


def lines(events: list[dict[str, Any]]) -> str:
    """Events as JSON Lines."""
    return "".join(json.dumps(event) + "\n" for event in events)


def soon(what: Callable[[], bool]) -> bool:
    """Whether something comes true within the next seconds."""
    until = time.monotonic() + 20
    while not what() and time.monotonic() < until:
        time.sleep(0.02)
    return what()


def row1() -> list[dict[str, Any]]:
    """The events of a trace that the pruned tree detects."""
    return [json.loads(line) for line in ROW1.read_text(encoding="utf-8").splitlines()]
