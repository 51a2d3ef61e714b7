"""Results as CSV and JSON."""

import csv
import io
import json
from collections.abc import Iterable
from importlib.metadata import version
from typing import Final

from cross_check.reports.totals import Totals
from cross_check.results import Difference, Result
from rvaft.values import Json

COLUMNS: Final = (
    "tree",
    "semantics",
    "participant",
    "exit_status",
    "seconds",
    "symbols",
    "states",
    "verdicts",
    "result",
)
"""The columns of the CSV report, as those of Spot's `ltlcross` where they mean the same."""


def csv_text(results: Iterable[Result], note: str = "") -> str:  # noqa: ARG001 (a table has no room for it)
    """One row per participant and comparison."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for result in results:
        sizes = ("" if size is None else size for size in (result.symbols, result.states))
        row = (result.job.title, result.job.semantics, result.participant, exit_status(result), f"{result.seconds:.6f}")
        writer.writerow([*row, *sizes, result.verdicts, result.text])
    return stream.getvalue()


def json_text(results: Iterable[Result], note: str = "") -> str:
    """The totals and every result, with the traces that show differences; `note` is what else there is to say."""
    every = list(results)
    totals = Totals.of(every)
    counts = {
        "trees": totals.trees,
        "comparisons": totals.comparisons,
        "verdicts": totals.verdicts,
        "proofs": totals.proofs,
        "disagreements": len(totals.differing),
    }
    found = {"version": version("rvaft"), "note": note, "totals": counts, "results": [_object(one) for one in every]}
    return json.dumps(found, indent=1) + "\n"


def exit_status(result: Result) -> str:
    """How it ended, whatever the verdicts were: `ok` for everybody who gave verdicts to the end."""
    return str(result.status) if result in Totals.of([result]).unable else "ok"


def _object(result: Result) -> dict[str, Json]:
    return {
        "tree": result.job.name,
        "branch": result.job.branch,
        "kind": result.job.kind,
        "semantics": result.job.semantics,
        "participant": result.participant,
        "status": result.status,
        "exit_status": exit_status(result),
        "seconds": round(result.seconds, 6),
        "symbols": result.symbols,
        "states": result.states,
        "verdicts": result.verdicts,
        "traces": result.traces,
        "longest": result.longest,
        "masked": result.masked,
        "masks": list(result.masks),
        "result": result.text,
        "difference": None if result.difference is None else _difference(result.difference),
    }


def _difference(found: Difference) -> dict[str, Json]:
    return {
        "trace": list(found.trace),
        "baseline": found.baseline,
        "expected": [verdict.value for verdict in found.expected],
        "got": [verdict.value for verdict in found.got],
    }
