"""The published RML monitor as the participant `rml-published`, run from a checkout.

One process runs many traces. The monitor's `monitor.pl` is not used: after an exception it enters
Prolog's toplevel and exits with status 0, as if the trace were accepted. `driver.pl` in this folder
calls the transition predicate and catches every exception.
"""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

from backends.rml.prolog import prolog
from cross_check.participants import Answer, Outside, absent_on_error
from cross_check.published.rml_deviations import touching
from rvaft.backend import backend
from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.support.terminal import cut

NAME: Final = "rml-published"
_SEMANTICS: Final = "trace_expressions_semantics.pl"
_SWIPL: Final = (
    "install SWI-Prolog 9 (Debian and Ubuntu: `apt install swi-prolog-nox`), and see that `swipl` is on the PATH"
)
_CHECKOUT: Final = "clone https://github.com/RMLatDIBRIS/monitor and name that folder"
_ERROR_LENGTH: Final = 300


@absent_on_error
def published_of(part: RVAFT, semantics: Semantics, monitor: Path, *, timeout: float) -> Outside:
    """Return the published monitor with the RML text of a tree, or the error as `Absent`."""
    _swipl(monitor)
    specification = backend("rml").translate(part, semantics)
    return Outside(NAME, lambda traces: run(specification.text, traces, monitor, timeout=timeout), specification)


def run(text: str, traces: Sequence[Sequence[Json]], monitor: Path, *, timeout: float) -> list[Answer]:
    """Return one result per trace for an RML text, which the monitor gets as Prolog.

    `timeout` is in seconds for all traces together; traces not reached get an error. Raises
    `LanguageError`, `ToolMissing`, and `ToolFailed` if the text cannot be loaded.
    """
    deviations = [tuple(one.title for one in touching(text, trace)) for trace in traces]
    lines, ending, expired = _answers(prolog(text), traces, monitor, timeout)
    loading, *answers = [_answer(line) for line in lines] or [{"error": ending}]
    if "error" in loading:
        raise ToolFailed(NAME, reason=f"it cannot load the specification: {_short(loading['error'])}")
    found = []
    for answer, known in zip(answers, deviations, strict=False):
        verdicts = answer.get("verdicts")
        wrong = _short(answer["error"]) if verdicts is None else ""
        found.append(Answer(None if verdicts is None else tuple(map(Verdict, verdicts)), wrong, known))
    return [*found, *(Answer(None, ending, known, expired=expired) for known in deviations[len(answers) :])]


def _answer(line: str) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(line)
    except ValueError:
        return {"error": f"its output is not JSON: {line}"}
    return found


def _answers(text: str, traces: Sequence[Sequence[Json]], monitor: Path, timeout: float) -> tuple[list[str], str, bool]:
    """Return the complete output lines, the reason for their end, and whether time ran out."""
    swipl = _swipl(monitor)
    expired = False
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder, as_file(files(__package__) / "driver.pl") as script:
        specification = Path(folder) / "specification.pl"
        specification.write_text(text, encoding="utf-8")
        options = ["--stack-limit=256m", "-O", "-f", "none", str(script), "--", str(monitor.resolve())]
        with subprocess.Popen(  # noqa: S603
            [swipl, *options, str(specification)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
        ) as process:
            try:
                given = "".join(f"{json.dumps(list(trace))}\n" for trace in traces)
                output, complaints = process.communicate(given, timeout=timeout)
                lines = complaints.strip().splitlines() or [f"exit status {process.returncode}"]
                ending = f"the monitor ended early: {_short(lines[0])}"
            except subprocess.TimeoutExpired:
                process.kill()
                output, _ = process.communicate()
                ending, expired = f"timeout: no answer within {timeout:g} s", True
    return output.split("\n")[:-1], ending, expired


def _swipl(monitor: Path) -> str:
    if not (monitor / _SEMANTICS).is_file():
        remedy = f"{monitor} is not a checkout of it (it has no {_SEMANTICS}); {_CHECKOUT}"
        raise ToolMissing("the published RML monitor", remedy=remedy)
    swipl = shutil.which("swipl")
    if swipl is None:
        raise ToolMissing("swipl", remedy=_SWIPL)
    return swipl


def _short(message: str) -> str:
    return cut(" ".join(message.split()), _ERROR_LENGTH)
