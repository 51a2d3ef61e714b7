"""Running the command: inside this process for speed, or as a process of its own where that is the point."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from click.testing import CliRunner, Result

from rvaft.cli import main

TREES: Final = Path(__file__).parents[2] / "trees"
PRUNED: Final = TREES / "remote_inspection" / "pruned.rvaft"
COMMAND: Final = (sys.executable, "-c", "from rvaft.cli import main; main()")


def run(*args: object, data: bytes | str | None = None, env: Mapping[str, str] | None = None) -> Result:
    """Run the command here; nothing that it does may leak an exception."""
    result = CliRunner().invoke(main, [str(arg) for arg in args], input=data, env=env)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def process(*args: object, **options: object) -> "subprocess.CompletedProcess[str]":
    """Run the command as a process of its own."""
    words: Sequence[str] = [*COMMAND, *map(str, args)]
    return subprocess.run(words, text=True, capture_output=True, check=False, timeout=60, **options)  # type: ignore[call-overload, no-any-return]


def failed(result: Result, *parts: str) -> None:
    """Assert that a run ended with status 2 and one line of error in which these parts occur."""
    assert result.exit_code == 2, result.output
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("rvaft: error: ")
    assert len(lines[0]) < 400
    for part in parts:
        assert part in lines[0], lines[0]
