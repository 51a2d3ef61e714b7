"""Past MTL for R2U2: a file for its compiler C2PO, in which all operators have bounds.

Propositions are Boolean inputs, defined in a comment; each event is a row of inputs. The text uses
`true S` for `O`: C2PO 4.1 reserves memory proportional to the bound of `O`, but two slots for `S`.
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

from backends.mtl import MtlBackend, MtlCapabilities
from backends.mtl.reader import definitions, fits
from backends.mtl.translation import c2po, symbols, translation
from rvaft.backend import Metrics, SpecificationText
from rvaft.core.property import Part, Property, Within, Without
from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

HORIZON: Final = 2**30 - 1
"""Bound of operators in events: the largest that R2U2 4.1 can add to any event number in 31 bits.
"""
_SMALL: Final = "if the text exceeds the bounds of the monitor, build it with larger ones (`c2po.py --write-bounds`)"
_COMPILER: Final = Path("compiler", "c2po.py")
_DEFINITION: Final = re.compile(r"^-- (\w+ := .*\n)", re.MULTILINE)
_VERDICT: Final = re.compile(r"^0:(\d+),([TF])", re.MULTILINE)


class MtlR2u2Backend(MtlCapabilities):
    """The formulas of `mtl` for R2U2, faithful only for the first 1,073,741,824 events.

    >>> from rvaft import loads
    >>> print(MtlR2u2Backend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    -- rvaft: the first time that the formula holds is the detection; it misses what comes after 1073741824 events
    -- p1 := { event: "break_in" }
    -- p2 := { event: "alarm" }
    INPUT
        p1, p2: bool;
    PTSPEC
        detection: p2 && (true S[1,1073741823] (p1));
    """

    name: ClassVar[str] = "mtl-r2u2"
    language: ClassVar[str] = "c2po"
    suffix: ClassVar[str] = ".c2po"
    remark: ClassVar[str] = "-- {}\n"
    faithful: ClassVar[bool] = False
    form_of: ClassVar[str] = MtlBackend.name
    readable: ClassVar[bool] = False
    says: ClassVar[frozenset[type[Part]]] = MtlCapabilities.says - {Within, Without}

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the file for C2PO."""
        mtl = MtlBackend()
        chains = translation(prop, semantics, limit)
        formula = chains.formula(c2po(HORIZON))
        header = "".join(f"-- {name} := {definition}\n" for name, definition in chains.definitions)
        text = (
            "-- rvaft: the first time that the formula holds is the detection; "
            f"it misses what comes after {HORIZON + 1} events\n{header}"
            f"INPUT\n    {', '.join(chains.propositions)}: bool;\nPTSPEC\n    detection: {formula};\n"
        )
        return SpecificationText(
            text, Metrics(symbols(formula)), lambda _: mtl.read(mtl.write(prop, semantics, limit).text)
        )


def first_detections(
    program: Path, text: str, traces: Sequence[Sequence[Json]], *, timeout: float | None = None
) -> list[int | None]:
    """Return per trace the number of the first event, from 1, at which the formula holds, or None.

    Raises `ToolMissing` if the path is not a program or no parent folder has the compiler,
    `ToolFailed` if a tool fails or is built too small for the text, and `subprocess.TimeoutExpired`
    after `timeout` seconds for one run.
    """
    found = list[int | None]()
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
            found.append(next((end + 1 for end, (_, truth) in zip(ends, verdicts, strict=False) if truth == "T"), None))
    return found


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
