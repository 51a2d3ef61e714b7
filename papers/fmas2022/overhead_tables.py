"""The overhead as numbers: every run and every cell as CSV, the cells as a LaTeX table."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import astuple, fields
from io import StringIO
from typing import Final

from papers.fmas2022.overhead_cells import Cell, Spread
from papers.fmas2022.overhead_runs import NONE, Run

COLUMNS: Final = (
    *("waypoints", "setup", "monitors", "repetitions", "events", "mission_s", "verdicts"),
    *("made_ms_q1", "made_ms_median", "made_ms_q3"),
    *("cpu_ms_q1", "cpu_ms_median", "cpu_ms_q3"),
    *("wall_ms_q1", "wall_ms_median", "wall_ms_q3"),
    *("ratio_q1", "ratio_median", "ratio_q3"),
    *("us_per_event_q1", "us_per_event_median", "us_per_event_q3"),
    "ppm_of_mission",
)
"""Milliseconds, microseconds, and millionths of the time that the mission takes the rover."""


def runs_csv(runs: Iterable[Run]) -> str:
    """Every run, in the order in which they were made; times in seconds."""
    return _csv([field.name for field in fields(Run)], map(astuple, runs))


def cells_csv(cells: Iterable[Cell]) -> str:
    """The cells, under `COLUMNS`."""
    return _csv(COLUMNS, map(_row, cells))


def _row(cell: Cell) -> Sequence[object]:
    spreads = (_times(1e3, cell.made), _times(1e3, cell.cpu), _times(1e3, cell.wall), cell.ratio, cell.per_event)
    return (
        *(cell.waypoints, cell.setup, cell.monitors, cell.repetitions, cell.events, cell.mission, cell.verdicts),
        *(f"{quartile:.4f}" for spread in spreads for quartile in spread),
        f"{1e6 * cell.share:.3f}",
    )


def _times(factor: float, spread: Spread) -> Spread:
    return Spread(*(factor * one for one in spread))


def _csv(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heading)
    writer.writerows(rows)
    return text.getvalue()


def latex(cells: Sequence[Cell]) -> str:
    """A `tabular` that needs no package: a row for each cell, a rule between missions; medians with their quartiles."""
    lines = [
        r"\begin{tabular}{rrrlrrrr}",
        r"\hline",
        r"waypoints & events & mission (s) & monitors & CPU (ms) & ratio & $\mu$s/event & of mission \\",
    ]
    for number, cell in enumerate(cells):
        first = number == 0 or cells[number - 1].waypoints != cell.waypoints
        if first:
            lines.append(r"\hline")
        mission = f"{cell.waypoints} & {cell.events} & {cell.mission:.0f}" if first else " & &"
        lines.append(rf"{mission} & {_monitors(cell)} \\")
    return "\n".join([*lines, r"\hline", r"\end{tabular}", ""])


def _monitors(cell: Cell) -> str:
    cpu = _with_quartiles(_times(1e3, cell.cpu), 2)
    if cell.setup == NONE:
        return f"none & {cpu} & & &"
    named = "1, tree" if cell.monitors == 1 else f"{cell.monitors}, per {cell.setup}"
    added = f"{_with_quartiles(cell.ratio, 1)} & {_with_quartiles(cell.per_event, 1)}"
    return rf"{named} & {cpu} & {added} & {1e6 * cell.share:.1f}$\cdot 10^{{-6}}$"


def _with_quartiles(spread: Spread, digits: int) -> str:
    return f"{spread.median:.{digits}f} [{spread.low:.{digits}f}, {spread.high:.{digits}f}]"
