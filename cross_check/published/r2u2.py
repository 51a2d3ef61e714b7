"""First detections in R2U2: its compiler C2PO reads the text, and each event is a row of inputs."""

import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from backends.mtl.reader import definitions, fits
from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.values import Json

_SMALL: Final = "if the text exceeds the bounds of the monitor, build it with larger ones (`c2po.py --write-bounds`)"
_COMPILER: Final = Path("compiler", "c2po.py")
_DEFINITION: Final = re.compile(r"^-- (\w+ := .*\n)", re.MULTILINE)
_VERDICT: Final = re.compile(r"^0:(\d+),([TF])", re.MULTILINE)


def first_detections(
    program: Path, text: str, traces: Sequence[Sequence[Json]], *, timeout: float | None = None
) -> list[int | None]:
    """Return per trace the number of the first event, from 1, at which the formula holds, or None.

    Raises `ToolMissing` if the path is not a program or no parent folder has the compiler,
    `ToolFailed` if a tool fails or is built too small for the text, and `subprocess.TimeoutExpired`
    after `timeout` seconds for one run.
    """
    first = list[int | None]()
    propositions = definitions(f"/* rvaft\n{''.join(_DEFINITION.findall(text))}*/")
    compilers = (folder / _COMPILER for folder in program.resolve().parents)
    compiler = next((one for one in compilers if one.is_file()), None)
    if compiler is None:
        remedy = f"give the path of the monitor in a checkout of R2U2, with {_COMPILER} in a parent folder ({program})"
        raise ToolMissing("C2PO, the compiler of R2U2,", remedy=remedy)
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        names = ("formula.c2po", "signals.map", "formula.bin", "trace.csv")
        formula, signals, binary, rows = (Path(folder) / name for name in names)
        formula.write_text(text, encoding="utf-8")
        signals.write_text("".join(f"{name}:{number}\n" for number, name in enumerate(propositions)), encoding="utf-8")
        _output(timeout, "C2PO", sys.executable, compiler, "--spec", formula, "--map", signals, "-o", binary)
        for trace in traces:
            values = (",".join(str(int(fits(one, event))) for one in propositions.values()) for event in trace)
            rows.write_text("".join(f"{row}\n" for row in (f"# {','.join(propositions)}", *values)), encoding="utf-8")
            verdicts = _VERDICT.findall(_output(timeout, "R2U2", program.resolve(), binary, rows)) if trace else []
            ends = [0, *(int(number) + 1 for number, _ in verdicts)]
            if ends[-1] < len(trace):
                raise ToolFailed("R2U2", reason=f"it gives no verdict from event {ends[-1] + 1} on; {_SMALL}")
            first.append(next((end + 1 for end, (_, truth) in zip(ends, verdicts, strict=False) if truth == "T"), None))
    return first


def _output(timeout: float | None, tool: str, *command: str | Path) -> str:
    try:
        ran = subprocess.run(  # noqa: S603 (what the user names)
            command, capture_output=True, encoding="utf-8", errors="replace", timeout=timeout, check=False
        )
    except OSError as error:
        raise ToolMissing(tool, remedy=f"give the path of the program ({error.strerror}: {command[0]})") from error
    if ran.returncode:
        complaint = " ".join(f"{ran.stderr} {ran.stdout}".split())
        raise ToolFailed(tool, reason=complaint[:300] or f"exit status {ran.returncode}; {_SMALL}")
    return ran.stdout
