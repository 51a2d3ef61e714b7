"""Pictures through Graphviz's program `dot`."""

import shutil
import subprocess

from rvaft.errors import ToolFailed, ToolMissing

TIMEOUT = 300.0
"""Seconds after which a layout is given up."""


def picture(dot: str, form: str, *, timeout: float = TIMEOUT) -> bytes:
    """A graph in the DOT language as `svg`, `pdf` or `png`; raises `ToolMissing`, `ToolFailed`."""
    program = shutil.which("dot")
    if program is None:
        raise ToolMissing("dot", remedy="install Graphviz (apt-get install graphviz), or use --format dot or tikz")
    command = [program, f"-T{form}", *(["-Gdpi=144"] if form == "png" else [])]
    try:
        done = subprocess.run(command, input=dot.encode(), capture_output=True, timeout=timeout, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        raise ToolFailed("dot", reason=f"no layout after {timeout:g} s; use --format dot and another layout") from None
    except OSError as error:
        raise ToolFailed("dot", reason=error.strerror or type(error).__name__) from error
    if done.returncode != 0 or not done.stdout:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise ToolFailed("dot", reason=said[0] if said else f"exit status {done.returncode}")
    return done.stdout
