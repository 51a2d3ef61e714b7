"""Participants that run in external programs: MONA, MonPoly with VeriMon, R2U2, Apache Flink, and the
verified monitor, which is extracted from the Coq proofs (`proofs/`) and reads the tree itself.
"""

import json
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias

from backends.mfotl.predicates import MfotlHeader
from cross_check.participants import Absent, Answer, Outside, Participant, absent_on_error, detected, translated
from cross_check.published import flink, monpoly, r2u2
from cross_check.published.flink import RowHeader
from cross_check.published.mona import MonaMonitor
from rvaft.backend import Specification, backend
from rvaft.errors import NotExpressible, ToolFailed, unwritten
from rvaft.export.certificates import part_options, run
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import LeftOpen

MONA: Final = "ltlf-mona"
MONPOLY: Final = "mfotl-monpoly"
VERIMON: Final = "mfotl-verimon"
R2U2: Final = "mtl-r2u2"
FLINK: Final = "match-recognize-flink"
VERIFIED: Final = "verified"
FLINK_LIMIT: Final = 200
"""Maximum number of events of a text for Flink, which takes minutes beyond it."""

_SIGNS: Final = {"T": Verdict.TRUE, "F": Verdict.FALSE, "?": Verdict.UNKNOWN}

Traces: TypeAlias = Sequence[Sequence[Json]]


@absent_on_error
def mona_of(part: RVAFT, semantics: Semantics) -> Participant | Absent:
    """Return MONA with the LTLf text of a tree, or the error as `Absent`."""
    read = translated("ltlf", part, semantics)
    if isinstance(read, Absent):
        return read
    assert read.specification is not None
    first = MonaMonitor(read.specification.text)
    return replace(read, name=MONA, start=first.fork, matches=None, left_open=first.left_open)


@absent_on_error
def monpoly_of(part: RVAFT, semantics: Semantics, program: Path, name: str, *, timeout: float) -> Outside:
    """Return MonPoly or VeriMon with the MFOTL text of a tree, or the error as `Absent`."""
    made = backend("mfotl").translate(part, semantics)
    ask = partial(monpoly.first_detections, program, made.text, verified=name == VERIMON, timeout=timeout)
    return _judge(name, made, MfotlHeader.read(made.text).left_open, ask)


@absent_on_error
def r2u2_of(part: RVAFT, semantics: Semantics, program: Path, *, timeout: float) -> Outside:
    """Return R2U2 with the bounded formula of a tree, or the error as `Absent`."""
    made = backend("mtl-r2u2").translate(part, semantics)
    ask = partial(r2u2.first_detections, program, made.text, timeout=timeout)
    return _judge(R2U2, made, lambda _: "", ask)


@absent_on_error
def flink_of(part: RVAFT, semantics: Semantics) -> Outside:
    """Return Apache Flink with the MATCH_RECOGNIZE text of a tree, or the error as `Absent`."""
    flink.tables()
    made = backend("match-recognize").translate(part, semantics, limit=FLINK_LIMIT)
    return _judge(
        FLINK,
        made,
        RowHeader.read(made.text).left_open,
        lambda traces: flink.first_detections([(made.text, traces)])[0],
    )


@absent_on_error
def verified_of(
    tree: RVAFT, semantics: Semantics, program: Path, *, branch: int | None, kind: Kind | None, timeout: float
) -> Outside:
    """Return the verified monitor of a tree, or the error as `Absent`.

    A construct that the program does not support makes `NotExpressible`.
    """
    whole, part = part_options(tree, semantics, branch, kind)
    options = ["--traces", *part]
    _, _, refused = run(program, whole, options, timeout=timeout)
    if refused:
        raise NotExpressible(unwritten(refused), backend=VERIFIED, semantics=semantics)

    def answers(traces: Sequence[Sequence[Json]]) -> list[Answer]:
        given = "".join(f"{json.dumps(list(trace))}\n" for trace in traces)
        try:
            _, lines, why = run(program, whole, options, given=given, timeout=timeout)
        except subprocess.TimeoutExpired:
            return [Answer(error=f"timeout: no answer within {timeout:g} s", expired=True)] * len(traces)
        if why or len(lines) != len(traces):
            raise ToolFailed(VERIFIED, reason=why or f"{len(lines)} answers to {len(traces)} traces")
        return [Answer(tuple(_SIGNS[sign] for sign in line)) for line in lines]

    return Outside(VERIFIED, answers)


def _judge(
    name: str, made: Specification, left_open: LeftOpen, ask: Callable[[Traces], Sequence[int | None]]
) -> Outside:

    def answers(traces: Traces) -> list[Answer]:
        whys = [left_open(trace) for trace in traces]
        try:
            found = iter(ask([trace for trace, why in zip(traces, whys, strict=True) if not why]))
        except subprocess.TimeoutExpired as error:
            return [Answer(error=f"no answer within {error.timeout:g} s", expired=True)] * len(traces)
        pairs = zip(traces, whys, strict=True)
        return [Answer(deviations=(why,)) if why else Answer(detected(trace, next(found))) for trace, why in pairs]

    return Outside(name, answers, made, detections_only=True)
