"""Shell commands of the findings, and the tools that they need."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from papers.fmas2022.places import ROOT
from rvaft.errors import ToolFailed

TIMEOUT: Final = 300.0
"""Seconds until a command is stopped."""
_FOLDERS: Final = ("RML_COMPILER", "RML_MONITOR", "OUT")


@dataclass(frozen=True, slots=True)
class Need:
    """A program on the PATH, or a file below the path in an environment variable; `remedy` is
    advice to get it.
    """

    remedy: str
    program: str = ""
    variable: str = ""
    inside: str = ""

    @property
    def missing(self) -> bool:
        """Whether it is not available."""
        if self.program:
            return shutil.which(self.program) is None
        named = os.environ.get(self.variable, "")
        return not (named and (Path(named) / self.inside).is_file())


COMPILER: Final = (
    Need("install Java (`apt install default-jre-headless`)", program="java"),
    Need(
        "set RML_COMPILER to the jar of the published compiler (https://github.com/RMLatDIBRIS/compiler)",
        variable="RML_COMPILER",
    ),
)
MONITOR: Final = (
    Need("install SWI-Prolog (`apt install swi-prolog-nox`)", program="swipl"),
    Need(
        "set RML_MONITOR to a checkout of the published monitor (https://github.com/RMLatDIBRIS/monitor)",
        variable="RML_MONITOR",
        inside="monitor.pl",
    ),
)


@dataclass(frozen=True, slots=True)
class Ran:
    """Output of a command, including errors, and its exit status."""

    output: str
    status: int


def run(command: str, scratch: Path) -> Ran:
    """Run a command with `sh` in the folder of the project, with $OUT as its output folder.

    Machine-dependent folders in the output are replaced by variables. Raises `ToolFailed`.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    environment = {**os.environ, "PATH": path, "OUT": str(scratch), "LC_ALL": "C.UTF-8", "NO_COLOR": "1"}
    try:
        done = subprocess.run(  # noqa: S603 (the commands stand in this package)
            ["/bin/sh", "-c", command],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ToolFailed("a command of the findings", reason=f"no end within {TIMEOUT:g} s: {command}") from None
    output = done.stdout.replace(f"{ROOT}{os.sep}", "")
    for name in _FOLDERS:
        if environment.get(name):
            output = output.replace(environment[name], f"${name}")
    return Ran(output.rstrip(), done.returncode)
