"""The overhead figure: what a mission's loop takes with and without monitors, and what monitors add to an event."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from papers import plots
from papers.fmas2022.overhead_cells import Cell, Spread
from papers.fmas2022.overhead_runs import NONE, SETUPS
from rvaft.monitoring.columns import Per

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLES: Final[Mapping[str, str]] = {
    NONE: "no monitor",
    Per.TREE: "one for the tree",
    Per.KIND: "one per kind",
    Per.BRANCH: "one per branch",
}
NAME: Final = "overhead"


def draw(cells: Sequence[Cell], folder: Path) -> tuple[Path, ...]:
    """Write the figure as PDF and PNG, and return the files; raises `ToolMissing`, `OSError`."""
    with plots.style():
        figure = plots.figure(height=10.0)
        above, below = figure.subplots(2, 1, sharex=True)
        for line, setup in zip(plots.LINES, SETUPS, strict=False):
            mine = [cell for cell in cells if cell.setup == setup]
            sizes = [cell.waypoints for cell in mine]
            _spreads(above, sizes, [Spread(*(1e3 * one for one in cell.cpu)) for cell in mine], setup, line)
            if setup != NONE:
                _spreads(below, sizes, [cell.per_event for cell in mine], setup, line)
        above.set_ylabel("CPU time of a mission (ms)")
        below.set_ylabel("added to an event (µs)")
        below.set_xlabel("waypoints")
        below.set_xticks(sorted({cell.waypoints for cell in cells}))
        for axes in (above, below):
            axes.set_ylim(bottom=0)
        above.legend(loc="upper left")
        return plots.write(figure, folder, NAME)


def _spreads(
    axes: "Axes", sizes: Sequence[int], spreads: Sequence[Spread], setup: str, line: Mapping[str, Any]
) -> None:
    """Medians joined by a line, with bars from the lower to the upper quartile."""
    medians = [one.median for one in spreads]
    bars = [[one.median - one.low for one in spreads], [one.high - one.median for one in spreads]]
    axes.errorbar(sizes, medians, yerr=bars, label=TITLES[setup], **line)
