"""The participant `verified`: the monitor that is extracted from the Coq proofs (`proofs/`).

It reads the tree as JSON, and no part of rvaft computes its verdicts. `make verified` builds it.
"""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cross_check.participants import Answer, Outside, absent_on_error
from rvaft.core.branches import branch as numbered
from rvaft.errors import NotExpressible, ToolFailed, ToolMissing
from rvaft.export.interchange import json_text
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict

NAME: Final = "verified"
PROGRAM: Final = "rvaft-verified"
_SIGNS: Final = {"T": Verdict.TRUE, "F": Verdict.FALSE, "?": Verdict.UNKNOWN}


def on_path() -> Path | None:
    """Return the program if it is on the PATH."""
    found = shutil.which(PROGRAM)
    return None if found is None else Path(found)


@absent_on_error
def verified_of(
    tree: RVAFT, semantics: Semantics, program: Path, *, branch: int | None, kind: Kind | None, timeout: float
) -> Outside:
    """Return the verified monitor of a tree, or the error as `Absent`.

    A construct that the program does not support makes `NotExpressible`.
    """
    choices = {} if branch is None else numbered(tree, branch).choices
    narrowed = [word for node, child in choices.items() for word in ("--choose", f"{node}={child}")]
    options = ["--semantics", semantics, *narrowed, *([] if kind is None else ["--kind", kind])]
    _, refused = _run(program, tree, options, "", timeout)
    if refused:
        raise NotExpressible(refused, backend=NAME, semantics=semantics)

    def answers(traces: Sequence[Sequence[Json]]) -> list[Answer]:
        given = "".join(f"{json.dumps(list(trace))}\n" for trace in traces)
        try:
            lines, why = _run(program, tree, options, given, timeout)
        except subprocess.TimeoutExpired:
            return [Answer(error=f"timeout: no answer within {timeout:g} s", expired=True)] * len(traces)
        if why or len(lines) != len(traces):
            raise ToolFailed(NAME, reason=why or f"{len(lines)} answers to {len(traces)} traces")
        return [Answer(tuple(_SIGNS[sign] for sign in line)) for line in lines]

    return Outside(NAME, answers)


def _run(program: Path, tree: RVAFT, options: Sequence[str], given: str, timeout: float) -> tuple[list[str], str]:
    """Return the lines of output, and the message of an error."""
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        (file := Path(folder) / "tree.json").write_text(json_text(tree), encoding="utf-8")
        command = [str(program), str(file), "--traces", *options]
        try:
            done = subprocess.run(  # noqa: S603
                command, input=given, capture_output=True, encoding="utf-8", timeout=timeout, check=False
            )
        except OSError:
            remedy = f"{program} cannot be run; build it by `make verified`, which needs Coq and OCaml"
            raise ToolMissing("the verified monitor", remedy=remedy) from None
    if done.returncode in (0, 1):
        return done.stdout.split("\n")[:-1], ""
    if done.returncode == 2:
        return [], done.stderr.strip().replace(f"{file}: ", "").removeprefix(f"{PROGRAM}: ")
    raise ToolFailed(NAME, reason=f"exit status {done.returncode}")
