"""Pictures through Graphviz's program `dot`."""

import re
import shutil
import subprocess
from typing import Final

from rvaft.errors import ToolFailed, ToolMissing

TIMEOUT = 300.0
"""Seconds after which a layout is given up."""

_CREATED: Final = re.compile(rb"/CreationDate \(D:\d{14}")
"""When a PDF was made: `dot` has no option that leaves it out."""


def picture(dot: str, form: str, *, timeout: float = TIMEOUT) -> bytes:
    """A graph in the DOT language as `svg`, `pdf` or `png`, the same bytes every time; raises `ToolMissing`, `ToolFailed`."""
    program = shutil.which("dot")
    if program is None:
        raise ToolMissing(
            "dot", remedy="install Graphviz (apt-get install graphviz), or write a .dot file, which needs none"
        )
    command = [program, f"-T{form}", *(["-Gdpi=144"] if form == "png" else [])]
    try:
        done = subprocess.run(command, input=dot.encode(), capture_output=True, timeout=timeout, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        raise ToolFailed(
            "dot", reason=f"no layout after {timeout:g} s; write a .dot file and try another layout"
        ) from None
    except OSError as error:
        raise ToolFailed("dot", reason=error.strerror or type(error).__name__) from error
    if done.returncode != 0 or not done.stdout:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise ToolFailed("dot", reason=said[0] if said else f"exit status {done.returncode}")
    return _CREATED.sub(b"/CreationDate (D:19700101000000", done.stdout) if form == "pdf" else done.stdout
