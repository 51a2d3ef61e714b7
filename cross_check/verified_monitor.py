"""The participant `verified`: the monitor that is extracted from the Coq proofs (`proofs/`).

No part of rvaft computes its verdicts.
"""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cross_check.participants import Answer, Outside, absent_on_error
from rvaft.errors import NotExpressible, ToolFailed
from rvaft.export.certificates import part_options, run
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict

NAME: Final = "verified"
_SIGNS: Final = {"T": Verdict.TRUE, "F": Verdict.FALSE, "?": Verdict.UNKNOWN}


@absent_on_error
def verified_of(
    tree: RVAFT, semantics: Semantics, program: Path, *, branch: int | None, kind: Kind | None, timeout: float
) -> Outside:
    """Return the verified monitor of a tree, or the error as `Absent`.

    A construct that the program does not support makes `NotExpressible`.
    """
    options = ["--traces", *part_options(tree, semantics, branch, kind)]
    _, _, refused = run(program, tree, options, timeout=timeout)
    if refused:
        raise NotExpressible(refused, backend=NAME, semantics=semantics)

    def answers(traces: Sequence[Sequence[Json]]) -> list[Answer]:
        given = "".join(f"{json.dumps(list(trace))}\n" for trace in traces)
        try:
            _, lines, why = run(program, tree, options, given=given, timeout=timeout)
        except subprocess.TimeoutExpired:
            return [Answer(error=f"timeout: no answer within {timeout:g} s", expired=True)] * len(traces)
        if why or len(lines) != len(traces):
            raise ToolFailed(NAME, reason=why or f"{len(lines)} answers to {len(traces)} traces")
        return [Answer(tuple(_SIGNS[sign] for sign in line)) for line in lines]

    return Outside(NAME, answers)
