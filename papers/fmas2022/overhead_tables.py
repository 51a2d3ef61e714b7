"""The overhead as CSV (runs, cells) and LaTeX (nominal missions, missions with a detection)."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, fields
from io import StringIO
from typing import Final

from papers.fmas2022 import tex
from papers.fmas2022.mission import Mode
from papers.fmas2022.overhead_cells import Cell, Spread
from papers.fmas2022.overhead_runs import NONE, Run
from rvaft.model.verdict import Verdict

COLUMNS: Final = (
    *("mode", "waypoints", "setup", "monitors", "repetitions", "events", "mission_s", "verdicts"),
    *("made_ms_q1", "made_ms_median", "made_ms_q3"),
    *("cpu_ms_q1", "cpu_ms_median", "cpu_ms_q3"),
    *("wall_ms_q1", "wall_ms_median", "wall_ms_q3"),
    *("ratio_q1", "ratio_median", "ratio_q3"),
    *("us_per_event_q1", "us_per_event_median", "us_per_event_q3"),
    "ppm_of_mission",
    *("dearest_ms_q1", "dearest_ms_median", "dearest_ms_q3", "dearest_event", "dearest_on", "detected"),
)
"""Milliseconds, microseconds, and millionths of the mission time."""


def runs_csv(runs: Iterable[Run]) -> str:
    """Return every run in order; times in seconds."""
    return _csv([field.name for field in fields(Run)], map(astuple, runs))


def cells_csv(cells: Iterable[Cell]) -> str:
    """Return the cells, under `COLUMNS`."""
    return _csv(COLUMNS, map(_row, cells))


def _row(cell: Cell) -> Sequence[object]:
    spreads = (_times(1e3, cell.made), _times(1e3, cell.cpu), _times(1e3, cell.wall), cell.ratio, cell.per_event)
    return (
        *(
            cell.mode,
            cell.waypoints,
            cell.setup,
            cell.monitors,
            cell.repetitions,
            cell.events,
            cell.mission,
            cell.verdicts,
        ),
        *(f"{quartile:.4f}" for spread in spreads for quartile in spread),
        f"{1e6 * cell.share:.3f}",
        *(f"{quartile:.4f}" for quartile in _times(1e3, cell.dearest)),
        *(cell.dearest_event, cell.dearest_on, cell.detected),
    )


def _times(factor: float, spread: Spread) -> Spread:
    return Spread(*(factor * one for one in spread))


def _csv(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heading)
    writer.writerows(rows)
    return text.getvalue()


_MEASURED: Final = "Medians with their quartiles. Dearest: the one event that costs the monitors most."
"""The note of both tables."""


def nominal_tex(cells: Iterable[Cell]) -> str:
    """Return a table with a row per setup and nominal mission."""
    return tex.table(
        "rrlrrrr",
        ["Waypoints", "Events", "Monitors", "CPU (ms)", "Ratio", r"$\mu$s/event", "Dearest (ms)"],
        [r"\midrule", *_rows(cell for cell in cells if cell.mode is Mode.NOMINAL)],
        caption="What monitoring costs a mission in which nothing happens.",
        label="tab:overhead",
        notes=[_MEASURED],
        size=r"\scriptsize",
    )


def _rows(cells: Iterable[Cell]) -> Iterator[str]:
    waypoints = 0
    for cell in cells:
        if waypoints and cell.waypoints != waypoints:
            yield r"\addlinespace"
        size = ["", ""] if cell.waypoints == waypoints else [f"{cell.waypoints}", f"{cell.events}"]
        costs = ["", "", ""] if cell.setup == NONE else _added(cell)
        yield tex.row([*size, _monitors(cell), _with_quartiles(_times(1e3, cell.cpu), 2), *costs])
        waypoints = cell.waypoints


def detected_tex(cells: Sequence[Cell]) -> str:
    """Return a table of the smallest and largest mission of each mode with a detection."""
    sizes = {min(cell.waypoints for cell in cells), max(cell.waypoints for cell in cells)}
    shown = [cell for cell in cells if cell.setup != NONE and cell.waypoints in sizes]
    return tex.table(
        "rlrrrrrr",
        ["Waypoints", "Monitors", "Detect", "At event", "Ratio", r"$\mu$s/event", "Dearest (ms)", "Its event"],
        [row for mode in Mode if mode is not Mode.NOMINAL for row in _detected(mode, shown)],
        caption="What monitoring costs a mission with a fault, and one with an attacker.",
        label="tab:detected",
        notes=[
            _MEASURED,
            "Detect: how many of the monitors do, the first of them at the event with that number, of so many.",
        ],
        size=r"\scriptsize",
    )


def _detected(mode: Mode, cells: Iterable[Cell]) -> Iterator[str]:
    yield tex.heading(mode.capitalize(), 8)
    for cell in cells:
        if cell.mode is mode:
            found = f"{cell.verdicts.count(Verdict.TRUE.symbol)} of {cell.monitors}"
            at = f"{cell.detected} of {cell.events}" if cell.detected else "--"
            yield tex.row([f"{cell.waypoints}", _monitors(cell), found, at, *_added(cell), f"{cell.dearest_event}"])


def _monitors(cell: Cell) -> str:
    match cell.monitors:
        case 0:
            return "none"
        case 1:
            return "1, tree"
        case several:
            return f"{several}, per {cell.setup}"


def _added(cell: Cell) -> tuple[str, ...]:
    dearest = _with_quartiles(_times(1e3, cell.dearest), 2)
    return _with_quartiles(cell.ratio, 1), _with_quartiles(cell.per_event, 1), dearest


def _with_quartiles(spread: Spread, digits: int) -> str:
    return f"{spread.median:.{digits}f} [{spread.low:.{digits}f}, {spread.high:.{digits}f}]"
