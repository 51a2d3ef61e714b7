"""MonPoly and VeriMon as judges: a text and traces become a signature, a formula and logs, and the program says where the formula holds first."""

import re
import subprocess
import tempfile
from collections.abc import Sequence
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
    """For each trace the number of the event, from 1, at which the formula holds first; `verified` asks VeriMon.

    Raises `LanguageError` for a text without a header, `ToolMissing` where the path is no program, `ToolFailed` where it does not take the text,
    and `TimeoutExpired` of `subprocess` after so many seconds for one trace.
    """
    header, found = MfotlHeader.read(text), list[int | None]()
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        names = [Path(folder) / name for name in ("signature", "formula", "log")]
        names[0].write_text(header.signature(), encoding="utf-8")
        names[1].write_text(text, encoding="utf-8")
        options = ["-sig", str(names[0]), "-formula", str(names[1]), "-log", str(names[2]), "-stop_at_first_viol"]
        for trace in traces:
            lines = (" ".join((f"@{n}", *header.facts(event, n))) for n, event in enumerate(trace))
            names[2].write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
            try:
                ran = subprocess.run(  # noqa: S603 (the program that the user names)
                    [program.resolve(), *options, *(["-verified"] if verified else [])],
                    capture_output=True,
                    encoding="utf-8",
                    errors="replace",
                    timeout=timeout,
                    check=False,
                )
            except OSError as error:
                remedy = f"name the program that its build makes ({error.strerror}: {program})"
                raise ToolMissing("MonPoly", remedy=remedy) from error
            at = _FOUND.search(ran.stdout)
            said = " ".join(f"{ran.stderr} {ran.stdout if at is None else ''}".split())
            if ran.returncode or (at is None and _REFUSED.search(said)):
                raise ToolFailed("MonPoly", reason=said[:300] or f"exit status {ran.returncode}")
            found.append(None if at is None else int(at[1]) + 1)
    return found
