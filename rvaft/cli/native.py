"""`rvaft monitor --native`: a compiled monitor finds the verdicts, and the engine explains them.

A program reads plain files by itself if JSON Lines are wanted, one for each event or detection. For other
output, logs and options a run reads the events (see `native_run`).
"""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, BinaryIO, Final

from rvaft.cli import options, warn
from rvaft.cli.native_run import MatchedLine, MatchExplainer, compiling, refused
from rvaft.errors import ToolFailed, TraceError
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.stream import detection

ALONE: Final = frozenset(
    {"semantics", "traces", "form", "detections", "repeat", "repeat_by", "native", "log_format", "per", "jobs"}
)
"""The options of `rvaft monitor` that a program honours by itself, and those that are checked elsewhere."""
WORKS_WITH: Final = ALONE | {
    *("key", "max_keys", "template", "explain", "cooldown", "execute", "exec_fault", "exec_attack", "strict_json"),
}
"""The options that a native monitor honours."""
_CHUNK: Final = 1 << 18
_ERROR: Final = re.compile(r"(?P<file>.*?)(?::(?P<line>\d+))?: error: (?P<reason>.*)", re.DOTALL)


def check(given: Mapping[str, Any]) -> None:
    """Refuse the options that a native monitor does not honour."""
    refuse = options.refuse
    for name in sorted(given.keys() - WORKS_WITH):
        refuse(_is_given(given[name]), f"--native does not take --{name.replace('_', '-')}")
    refuse(str(given["per"]) != "tree", "--native monitors the tree: omit --per")
    refuse(given["jobs"] > 1, "--native needs a single process: omit --jobs")


def works_alone(given: Mapping[str, Any]) -> bool:
    """Whether a program gives the output for plain files."""
    return given["form"] == "jsonl" and not any(_is_given(given[name]) for name in given.keys() - ALONE)


def _is_given(value: object) -> bool:
    return value not in (None, False, (), "")


def run(
    part: RVAFT, semantics: Semantics, files: Sequence[str], *, repeat: bool, by: str | None, detections: bool
) -> int:
    """Run a native monitor over files of JSON Lines, and return the exit status.

    It repeats each value of the variable `by` for itself. Raises `TraceError`, and the errors of `translate` and of
    the compiler.
    """
    language = compiling()
    with options.suggesting():
        text = (language if by is None else language.repeating(by)).translate(part, semantics).text
    chosen = [*(["--repeat"] if repeat or by is not None else []), *(["--detections"] if detections else [])]
    explained = _Explained(part)
    output = sys.stdout.buffer
    with language.program(text, warn) as program:
        command = [str(program), *chosen, "--", *files]
        started = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # noqa: S603
    with ExitStack() as logs, started as process:

        @lru_cache(maxsize=1)
        def log(file: str) -> BinaryIO:
            logs.close()
            return logs.enter_context(Path(file).open("rb"))

        assert process.stdout is not None
        assert process.stderr is not None
        for block in _blocks(process.stdout):
            if b'"places"' not in block:
                output.write(block)
                continue
            for line in block.splitlines(keepends=True):
                output.write(explained.line(line, log, files) if b'"places"' in line else line)
        output.flush()
        error = process.stderr.read().decode(errors="replace").strip()
    if process.returncode in (0, 1):
        return process.returncode
    found = _ERROR.fullmatch(error)
    if found is None:
        raise ToolFailed("the native monitor", reason=error or f"exit status {process.returncode}")
    failure = TraceError(found["reason"], file=found["file"], line=int(found["line"]) if found["line"] else None)
    if failure.line is not None:
        with suppress(OSError), Path(failure.file).open("rb") as stream:
            failure = refused(failure, stream)
    raise failure


def _blocks(stream: IO[bytes]) -> Iterator[bytes]:
    """Yield whole lines, many at a time."""
    rest = b""
    while chunk := stream.read(_CHUNK):
        lines, newline, rest_ = (rest + chunk).rpartition(b"\n")
        rest = rest_
        yield lines + newline
    yield rest


class _Explained:
    """Adds explanations to the records of detections."""

    def __init__(self, part: RVAFT) -> None:
        self._explainer = MatchExplainer(part)
        self._tree = part if part.part_of is None else part.part_of.tree
        self._fields = detection.identifying_fields(self._tree)

    def line(self, line: bytes, log: Callable[[str], BinaryIO], files: Sequence[str]) -> bytes:
        """Return the record of a detection with branch, kinds, matched events and variables."""
        record = json.loads(line)
        places = [MatchedLine(*one) for one in record.pop("places")]
        explanation, events = self._explainer.explained(log(record.get("trace", files[0])), places)
        lines = {number: at for number, at, _ in places}
        found = detection.explained(explanation, self._tree, events, self._fields, lines)
        return f"{json.dumps(record | found)}\n".encode()
