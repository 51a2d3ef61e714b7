"""First detections in MonPoly and VeriMon."""

import re
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Final

from backends.mfotl.predicates import MfotlHeader
from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.values import Json

_FOUND: Final = re.compile(r"^@\S+ \(time point (\d+)\):", re.MULTILINE)
_REFUSED: Final = re.compile(r"not monitorable|fail|error|exception|invalid", re.IGNORECASE)


def first_detections(
    program: Path, text: str, traces: Sequence[Sequence[Json]], *, verified: bool = False, timeout: float | None = None
) -> list[int | None]:
    """Return per trace the number of the first event, from 1, at which the formula holds, or None.

    `verified` runs VeriMon. Raises `LanguageError` for a text without a header, `OverflowError` for
    inexact numbers, `ToolMissing` if the path is not MonPoly, `ToolFailed` on its errors, and
    `subprocess.TimeoutExpired` after `timeout` seconds for one trace.
    """
    header, first = MfotlHeader.read(text), list[int | None]()
    _require(program)
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        names = [Path(folder) / name for name in ("signature", "formula", "log")]
        names[0].write_text(header.signature(), encoding="utf-8")
        names[1].write_text(text, encoding="utf-8")
        options = ["-sig", str(names[0]), "-formula", str(names[1]), "-log", str(names[2]), "-stop_at_first_viol"]
        for trace in traces:
            lines = (" ".join((f"@{n}", *header.facts(event, n))) for n, event in enumerate(trace))
            names[2].write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
            ran = _run(program, *options, *(["-verified"] if verified else []), timeout=timeout)
            at = _FOUND.search(ran.stdout)
            complaint = " ".join(f"{ran.stderr} {ran.stdout if at is None else ''}".split())
            if ran.returncode or (at is None and _REFUSED.search(complaint)):
                raise ToolFailed("MonPoly", reason=complaint[:300] or f"exit status {ran.returncode}")
            first.append(None if at is None else int(at[1]) + 1)
    return first


@cache
def _require(program: Path) -> None:
    """Raise `ToolMissing` unless the program identifies itself as MonPoly.

    A program without output would otherwise count as one that detects nothing.
    """
    if "MonPoly" not in _run(program, "-version", timeout=10).stdout:
        raise ToolMissing("MonPoly", remedy=f"give the path of the monpoly program ({program} is another program)")


def _run(program: Path, *options: str, timeout: float | None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(  # noqa: S603 (the program that the user names)
            [program.resolve(), *options],
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=timeout,
            check=False,
        )
    except OSError as error:
        remedy = f"give the path of the monpoly program ({error.strerror}: {program})"
        raise ToolMissing("MonPoly", remedy=remedy) from error
