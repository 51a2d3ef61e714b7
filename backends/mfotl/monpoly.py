"""First detections in MonPoly and VeriMon: the signature of a text, and the facts of events.

The arguments of a predicate are its columns and the position of the event. A null column becomes
`""` or 0.
"""

import json
import re
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import ClassVar, Final, TypeAlias
from urllib.parse import quote

from backends.event_columns import EventColumns
from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.guards import Guard
from rvaft.model.values import Json

Column: TypeAlias = tuple[Guard, str]
"""A variable or an expression over one event, and an aspect of it."""

_TYPES: Final = {"text": "string", "kind": "string", "number": "float", "string": "string", "time": "int"}
"""Type of each aspect in a signature."""
_NULLS: Final = {"string": '""', "float": "0.0", "int": "0"}
_FOUND: Final = re.compile(r"^@\S+ \(time point (\d+)\):", re.MULTILINE)
_REFUSED: Final = re.compile(r"not monitorable|fail|error|exception|invalid", re.IGNORECASE)


class MfotlHeader(EventColumns):
    """The predicates of a text by name, in order."""

    comment: ClassVar[tuple[str, str]] = ("(*", "*)")

    def signature(self) -> str:
        """Return the predicates with argument types, in the format of the tools."""
        lines = []
        for name in self.fitting:
            arguments = [f"{column}: {_TYPES[one.aspect]}" for column, one in self.values.get(name, {}).items()]
            lines.append(f"{name}({', '.join([*arguments, 'position: int'])})\n")
        return "".join(lines)

    def facts(self, event: Json, position: int) -> Iterator[str]:
        """Yield the facts of an event at a position; raises `OverflowError` for inexact numbers."""
        for name, cells in self.cells(event).items():
            if cells is not None:
                aspects = (one.aspect for one in self.values.get(name, {}).values())
                arguments = map(argument, aspects, cells.values())
                yield f"{name}({','.join([*arguments, str(position)])})"


def argument(aspect: str, cell: Json) -> str:
    """Return a column value as logs and formulas write it.

    >>> argument("text", '"a b"'), argument("text", "1"), argument("number", -2.5e-7), argument("time", None)
    ('"a%20b"', '"1"', '-0.00000025', '0')
    """
    if cell is None:
        return _NULLS[_TYPES[aspect]]
    match aspect:
        case "text":
            text = json.loads(cell) if cell[0] == '"' else cell
            mark = "%22" if cell[0] == '"' and (not text or text[0] in '"-0123456789{[nft') else ""
            return f'"{mark}{quote(text, safe="", errors="surrogatepass")}"'
        case "number":
            digits = f"{Decimal(repr(float(cell))):f}"
            return digits if "." in digits else f"{digits}.0"
        case "time":
            return str(cell)
        case _:
            return f'"{cell}"'


def first_detections(
    program: Path, text: str, traces: Sequence[Sequence[Json]], *, verified: bool = False, timeout: float | None = None
) -> list[int | None]:
    """Return per trace the number of the first event, from 1, at which the formula holds, or None.

    `verified` runs VeriMon. Raises `LanguageError` for a text without a header, `OverflowError` for
    inexact numbers, `ToolMissing` if the path is not MonPoly, `ToolFailed` on its errors, and
    `subprocess.TimeoutExpired` after `timeout` seconds for one trace.
    """
    header, found = MfotlHeader.read(text), list[int | None]()
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
            found.append(None if at is None else int(at[1]) + 1)
    return found


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
