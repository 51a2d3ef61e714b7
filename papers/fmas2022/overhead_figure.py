"""The overhead figure: CPU time of a mission, time per event, and the slowest event."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from papers.fmas2022.mission import Mode
from papers.fmas2022.overhead_cells import Cell, Spread
from papers.fmas2022.overhead_runs import NONE, SETUPS
from papers.languages.plots import saved, style
from rvaft.stream.monitor_set import Per

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLES: Final[Mapping[str, str]] = {
    NONE: "no monitor",
    Per.TREE: "one for the tree",
    Per.KIND: "one per kind",
    Per.BRANCH: "one per branch",
}
LINES: Final[tuple[Mapping[str, Any], ...]] = tuple(
    {"color": colour, "linestyle": line, "marker": marker, "fillstyle": fill, "markersize": size}
    for colour, line, marker, fill, size in (
        ("#000000", "-", "o", "full", 3.5),
        ("#0072B2", "--", "s", "none", 5.5),
        ("#D55E00", "-.", "^", "full", 3.5),
        ("#56B4E9", ":", "D", "none", 5.5),
    )
)
"""The styles of setups: colours of Okabe and Ito (Color Universal Design, 2008), lines and markers.

Every second marker is open and larger, so that coinciding lines remain visible.
"""
STYLE: Final[Mapping[str, Any]] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 7.0),
    "legend.frameon": False,
    "legend.handlelength": 3.0,  # shows the dashes
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.1,
    "lines.markeredgewidth": 1.0,
    "errorbar.capsize": 2.0,
}


def draw(cells: Sequence[Cell], folder: Path) -> tuple[Path, ...]:
    """Write the figure as PDF and PNG, and return the files; raises `ToolMissing`, `OSError`."""
    with style(**STYLE) as matplotlib:
        figure = matplotlib.figure.Figure(figsize=(8.5 / 2.54, 16.0 / 2.54), layout="constrained")
        whole, each, calm, attacked = figure.subplots(4, 1, sharex=True)
        attacked.sharey(calm)
        for line, setup in zip(LINES, SETUPS, strict=True):
            mine = [cell for cell in cells if cell.setup == setup]
            quiet = [cell for cell in mine if cell.mode is Mode.NOMINAL]
            _spreads(whole, quiet, lambda cell: _milliseconds(cell.cpu), line)
            if setup != NONE:
                _spreads(each, quiet, lambda cell: cell.per_event, line)
                _spreads(calm, quiet, lambda cell: _milliseconds(cell.dearest), line)
                hit = [cell for cell in mine if cell.mode is Mode.ATTACK]
                _spreads(attacked, hit, lambda cell: _milliseconds(cell.dearest), line)
        whole.set_ylabel("CPU time of\na mission (ms)")
        each.set_ylabel("added to\nan event (µs)")
        calm.set_ylabel("slowest event (ms)")
        attacked.set_ylabel("slowest event (ms),\nattacked")
        attacked.set_xlabel("waypoints")
        attacked.set_xticks(sorted({cell.waypoints for cell in cells}))
        for axes in (whole, each):
            axes.set_ylim(bottom=0)
        calm.set_yscale("log")
        for axes in (calm, attacked):
            axes.yaxis.set_major_formatter("{x:g}")
        whole.legend(loc="upper left")
        files = {folder / f"overhead.{form}": data for form, data in saved(figure)}
    for file, data in files.items():
        file.write_bytes(data)
    return tuple(files)


def _milliseconds(seconds: Spread) -> Spread:
    return Spread(*(1e3 * one for one in seconds))


def _spreads(axes: "Axes", cells: Sequence[Cell], value: Callable[[Cell], Spread], line: Mapping[str, Any]) -> None:
    spreads = [value(cell) for cell in cells]
    medians = [one.median for one in spreads]
    bars = [[one.median - one.low for one in spreads], [one.high - one.median for one in spreads]]
    sizes = [cell.waypoints for cell in cells]
    axes.errorbar(sizes, medians, yerr=bars, label=TITLES[cells[0].setup] if cells else None, **line)
