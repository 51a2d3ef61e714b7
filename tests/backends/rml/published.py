"""The published RML compiler and monitor, for tests: `RML_COMPILER` names the jar, `RML_MONITOR` a
checkout of the monitor.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pytest

_HERE: Final = Path(__file__).parent
_COMPILER: Final = os.environ.get("RML_COMPILER", "")
_MONITOR: Final = os.environ.get("RML_MONITOR", "")
_SECONDS: Final = 600


def _missing() -> str:
    if not (_COMPILER and Path(_COMPILER).is_file()):
        return "RML_COMPILER does not name the published compiler's jar"
    if not (_MONITOR and (Path(_MONITOR) / "trace_expressions_semantics.pl").is_file()):
        return "RML_MONITOR does not name a checkout of the published monitor"
    return next((f"{tool} is not on the path" for tool in ("java", "swipl") if shutil.which(tool) is None), "")


needs_published = pytest.mark.skipif(bool(_missing()), reason=_missing() or "available")


def compiled(texts: Sequence[str], directory: Path) -> list[Path | str]:
    """For each RML text the file with its Prolog form, or the first line of what the compiler had against it."""
    pairs = [(directory / f"{i}.rml", directory / f"{i}.pl") for i in range(len(texts))]
    for (source, _), text in zip(pairs, texts, strict=True):
        source.write_text(text, encoding="utf-8")
    lines = _run(["java", "-cp", _COMPILER, str(_HERE / "Compile.java")], "".join(f"{a}\t{b}\n" for a, b in pairs))
    return [target if line == "ok" else line for (_, target), line in zip(pairs, lines, strict=True)]


def verdicts(jobs: Sequence[tuple[Path, Sequence[Sequence[Any]]]]) -> list[list[str]]:
    """For each specification (in Prolog) and each of its traces one letter per prefix from the empty one on.

    T: the state may halt, or could before. F: no rule applied. E: an exception. ?: none of these.
    """
    lines = _run(
        ["swipl", "-O", "-p", f"monitor={_MONITOR}", str(_HERE / "driver.pl")],
        "".join(json.dumps({"spec": str(spec), "traces": traces}) + "\n" for spec, traces in jobs),
    )
    assert len(lines) == sum(len(traces) for _, traces in jobs), [line for line in lines if line.startswith("died")]
    found = iter(lines)
    return [[next(found) for _ in traces] for _, traces in jobs]


def _run(command: list[str], given: str) -> list[str]:
    done = subprocess.run(
        command, input=given, capture_output=True, text=True, encoding="utf-8", timeout=_SECONDS, check=True
    )
    return done.stdout.splitlines()
