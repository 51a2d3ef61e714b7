"""Many traces through the published monitor in one process.

Its own `monitor.pl` is not used: it drops into Prolog's toplevel at an exception and then exits with status 0, as if the trace had
been accepted. `driver.pl` beside this module calls the monitor's transition predicate itself and catches every exception.
"""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

from backends.rml.prolog import prolog
from cross_check.participants import Absent, Answer, Outside
from rvaft.backend import backend
from rvaft.errors import RvaftError, ToolFailed, ToolMissing
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict

NAME: Final = "rml-published"
_SEMANTICS: Final = "trace_expressions_semantics.pl"
_SWIPL: Final = (
    "install SWI-Prolog 9 (Debian and Ubuntu: `apt install swi-prolog-nox`), and see that `swipl` is on the PATH"
)
_CHECKOUT: Final = "clone https://github.com/RMLatDIBRIS/monitor and name that folder"
_ERROR_LENGTH: Final = 300
_TIMEOUT: Final = "timeout: "


def published_of(part: RVAFT, semantics: Semantics, monitor: Path, *, timeout: float) -> Outside | Absent:
    """The published monitor with the RML text of a tree; absent where that cannot be said, or the folder is no checkout."""
    try:
        _swipl(monitor)
        specification = backend("rml").translate(part, semantics)
    except RvaftError as error:
        return Absent(NAME, error)
    return Outside(NAME, lambda traces: run(specification.text, traces, monitor, timeout=timeout), specification)


def run(text: str, traces: Sequence[Sequence[Json]], monitor: Path, *, timeout: float) -> list[Answer]:
    """One result for each trace, for an RML text, which the checkout `monitor` gets as Prolog.

    `timeout` is in seconds and for all traces together; those that are not reached have an error. Raises `LanguageError` for
    what is no RML, `ToolMissing` without SWI-Prolog or where the folder is no checkout, `ToolFailed` where the text cannot be loaded.
    """
    masked = backend("rml").masked
    deviations = [masked(text, trace) for trace in traces]
    found = zip(_outcomes(prolog(text), traces, monitor, timeout), deviations, strict=True)
    return [Answer(*outcome, deviations=known, expired=outcome[1].startswith(_TIMEOUT)) for outcome, known in found]


def _outcomes(
    text: str, traces: Sequence[Sequence[Json]], monitor: Path, timeout: float
) -> Iterator[tuple[tuple[Verdict, ...] | None, str]]:
    """Verdicts or an error for each trace."""
    lines, ending = _answers(text, "".join(f"{json.dumps(list(trace))}\n" for trace in traces), monitor, timeout)
    loading, *answers = [_answer(line) for line in lines] or [{"error": ending}]
    if "error" in loading:
        raise ToolFailed(NAME, reason=f"it cannot load the specification: {_short(loading['error'])}")
    for answer in answers:
        verdicts = answer.get("verdicts")
        yield (None, _short(answer["error"])) if verdicts is None else (tuple(map(Verdict, verdicts)), "")
    for _ in traces[len(answers) :]:
        yield None, ending


def _answer(line: str) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(line)
    except ValueError:
        return {"error": f"it does not answer in JSON: {line}"}
    return found


def _answers(text: str, given: str, monitor: Path, timeout: float) -> tuple[list[str], str]:
    """The complete lines that came out, and why there are no more."""
    swipl = _swipl(monitor)
    driver = files(__package__).joinpath("driver.pl")
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder, as_file(driver) as script:
        specification = Path(folder) / "specification.pl"
        specification.write_text(text, encoding="utf-8")
        command = [
            swipl,
            "--stack-limit=256m",
            "-O",
            "-f",
            "none",
            str(script),
            "--",
            str(monitor.resolve()),
            str(specification),
        ]
        with subprocess.Popen(  # noqa: S603
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
        ) as process:
            try:
                output, complaints = process.communicate(given, timeout=timeout)
                said = complaints.strip().splitlines() or [f"exit status {process.returncode}"]
                ending = f"the monitor ended early: {_short(said[0])}"
            except subprocess.TimeoutExpired:
                process.kill()
                output, _ = process.communicate()
                ending = f"{_TIMEOUT}no answer within {timeout:g} s"
    return output.split("\n")[:-1], ending


def _swipl(monitor: Path) -> str:
    """The program, once it is clear that there is something for it to run."""
    if not (monitor / _SEMANTICS).is_file():
        remedy = f"{monitor} is no checkout of it (it has no {_SEMANTICS}); {_CHECKOUT}"
        raise ToolMissing("the published RML monitor", remedy=remedy)
    swipl = shutil.which("swipl")
    if swipl is None:
        raise ToolMissing("swipl", remedy=_SWIPL)
    return swipl


def _short(message: str) -> str:
    """One line, not too long."""
    line = " ".join(message.split())
    return line if len(line) <= _ERROR_LENGTH else f"{line[:_ERROR_LENGTH]}…"


# The participant `rml-published`: the published monitor of RML, run by SWI-Prolog from a checkout that the user names.

__all__ = ["NAME", "published_of", "run"]
