"""The report of a coverage: a table, or JSON.

Schema, version 1 (fields are only ever added)::

{"format": "rvaft-coverage", "version": 1, "semantics": "projected", "logs": 3, "branches":
[{"branch": 1, "kinds": ["fault"], "needed": 5, "reached": 3, "detected": 0, "log": NAME | null,
"event": NUMBER | null, "waits_for": [{"node": NAME, "event": TEXT}]}], "infeasible": [NUMBER],
"unseen": [{"node": NAME, "event": TEXT}], "data_warnings": [{"reason": TEXT, "about": GUARD
or DURATION or "", "count": NUMBER, "first": TEXT, "example": TEXT}], "totals": {"branches": 4,
"exercised": 1, "nodes": 7, "seen": 5}}
"""

import json
from dataclasses import asdict
from typing import Final

from rvaft.coverage.measure import BranchCoverage, CoverageReport
from rvaft.support.terminal import rendered, visible

VERSION: Final = 1
_LISTED: Final = 20
"""The maximum number of listed nodes."""


def json_text(report: CoverageReport) -> str:
    """Return the report as one JSON object."""
    branches = [
        {
            "branch": branch.number,
            "kinds": _kinds(branch),
            **{name: getattr(branch, name) for name in ("needed", "reached", "detected", "log", "event")},
            "waits_for": [asdict(event) for event in branch.awaited],
        }
        for branch in report.branches
    ]
    totals = {"branches": len(branches), **{name: getattr(report, name) for name in ("exercised", "nodes", "seen")}}
    value = {
        "format": "rvaft-coverage",
        "version": VERSION,
        "semantics": report.semantics.value,
        "logs": report.logs,
        "branches": branches,
        "infeasible": list(report.infeasible),
        "unseen": [asdict(event) for event in report.unseen],
        "data_warnings": [asdict(warning) for warning in report.data_warnings],
        "totals": totals,
    }
    return json.dumps(value, indent=2) + "\n"


def table_text(report: CoverageReport, *, width: int | None = None) -> str:
    """Return the report as a table with unseen nodes and totals; one line if there is no log.

    Long texts are wrapped to `width` columns, if given.
    """
    if not report.logs:
        return f"no log could be used; branches: {len(report.branches)}, nodes: {report.nodes}\n"
    from rich.table import Table  # noqa: PLC0415 -- imported on use
    from rich.text import Text  # noqa: PLC0415 -- imported on use

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    table.add_column("branch", justify="right", no_wrap=True)
    for name in ("kinds", "reached", "logs", "where"):
        folds = name in ("kinds", "where")
        table.add_column(name, overflow="fold" if folds else "ellipsis", no_wrap=not folds)
    for branch in report.branches:
        numbers = f"{branch.reached} of {branch.needed}", f"{branch.detected} of {report.logs}"
        cells = str(branch.number), ", ".join(_kinds(branch)) or "-", *numbers, _where(branch)
        table.add_row(*(Text(visible(cell)) for cell in cells))
    below = [""]
    if report.logs > 1 and any(branch.reached and not branch.detected for branch in report.branches):
        below.append("note: each log is read afresh, so a match that begins in one and ends in another is not found")
    if report.infeasible:
        listed = ", ".join(map(str, report.infeasible[:_LISTED]))
        below.append(f"no feasible scenario: branch {listed}{', …' if len(report.infeasible) > _LISTED else ''}")
    if report.unseen:
        names, others = ", ".join(event.node for event in report.unseen[:_LISTED]), len(report.unseen) - _LISTED
        below.append(f"nodes never seen: {names}{f' and {others} others' if others > 0 else ''}")
    below += [f"warning: {line}" for line in report.warnings]
    percent = 100 * report.exercised // len(report.branches)  # 100 only if all are exercised
    exercised = f"branches exercised {report.exercised} of {len(report.branches)} ({percent}%)"
    below.append(f"{exercised}; nodes seen {report.seen} of {report.nodes}")
    return "".join(f"{line}\n" for line in rendered([table, *(Text(visible(line)) for line in below)], width))


def _kinds(branch: BranchCoverage) -> list[str]:
    return sorted(kind.value for kind in branch.kinds)


def _where(branch: BranchCoverage) -> str:
    place = "" if branch.log is None else f"{branch.log}, event {branch.event}"
    if branch.detected:
        return f"detected: {place}"
    awaited = " or ".join(
        event.node if event.event == event.node else f"{event.node} {event.event}" for event in branch.awaited[:_LISTED]
    )
    others = len(branch.awaited) - _LISTED
    waits = f"waits for {awaited}{f' or {others} others' if others > 0 else ''}"
    return f"{place}; {waits}" if place else waits
