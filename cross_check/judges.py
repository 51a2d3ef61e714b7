"""Participants that judge whole traces by texts that nothing here reads: MonPoly with its verified kernel VeriMon, and Apache Flink."""

import subprocess
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias

from backends.event_columns import EventColumns
from backends.match_recognize import flink
from backends.match_recognize.flink import RowHeader
from backends.mfotl import monpoly
from backends.mfotl.monpoly import MfotlHeader
from cross_check.participants import Answer, Outside, absent_on_error, detected
from rvaft.backend import Specification, backend
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

MONPOLY: Final = "mfotl-monpoly"
VERIMON: Final = "mfotl-verimon"
FLINK: Final = "match-recognize-flink"

Traces: TypeAlias = Sequence[Sequence[Json]]


@absent_on_error
def monpoly_of(part: RVAFT, semantics: Semantics, program: Path, name: str, *, timeout: float) -> Outside:
    """MonPoly, or VeriMon, with the MFOTL text of a tree; absent where that cannot be said, or the path is no program."""
    made = backend("mfotl").translate(part, semantics)
    ask = partial(monpoly.first_detections, program, made.text, verified=name == VERIMON, timeout=timeout)
    return _judge(name, made, MfotlHeader.read(made.text), ask)


@absent_on_error
def flink_of(part: RVAFT, semantics: Semantics) -> Outside:
    """Apache Flink with the MATCH_RECOGNIZE text of a tree; absent where that cannot be said, or PyFlink is not installed."""
    flink.tables()
    made = backend("match-recognize").translate(part, semantics)
    return _judge(
        FLINK, made, RowHeader.read(made.text), lambda traces: flink.first_detections([(made.text, traces)])[0]
    )


def _judge(
    name: str, made: Specification, header: EventColumns, ask: Callable[[Traces], Sequence[int | None]]
) -> Outside:
    """Who says where the text first detects something; traces with numbers that its columns do not hold are masked."""

    def answers(traces: Traces) -> list[Answer]:
        whys = [header.left_open(trace) for trace in traces]
        try:
            found = iter(ask([trace for trace, why in zip(traces, whys, strict=True) if not why]))
        except subprocess.TimeoutExpired as error:
            return [Answer(error=f"no answer within {error.timeout:g} s", expired=True)] * len(traces)
        told = zip(traces, whys, strict=True)
        return [Answer(deviations=(why,)) if why else Answer(detected(trace, next(found))) for trace, why in told]

    return Outside(name, answers, made, detections_only=True)
