"""What runs come to: for each number of waypoints and each setup the median and the quartiles over the repetitions."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import linear_regression, mode, quantiles
from typing import NamedTuple

from papers.fmas2022.mission import Mode
from papers.fmas2022.overhead_runs import SETUPS, Run


class Spread(NamedTuple):
    """The quartiles of the repetitions."""

    low: float
    median: float
    high: float


@dataclass(frozen=True, slots=True)
class Cell:
    """A setup on missions of one mode and size.

    `made`, `cpu`, `wall` and `dearest` are in seconds, as in `Run`; `dearest_event` and
    `dearest_on` are those of most repetitions. What is compared with the run without monitors is
    compared with the one of the same repetition: `extra` is what the monitors add to `cpu`, in
    seconds, and `ratio` how many times as long the loop takes.
    """

    mode: Mode
    waypoints: int
    setup: str
    monitors: int
    repetitions: int
    events: int
    mission: float
    made: Spread
    cpu: Spread
    wall: Spread
    extra: Spread
    ratio: Spread
    verdicts: str
    dearest: Spread
    dearest_event: int
    dearest_on: str
    detected: int

    @property
    def per_event(self) -> Spread:
        """Microseconds that the monitors add to an event."""
        return Spread(*(1e6 * seconds / self.events for seconds in self.extra))

    @property
    def share(self) -> float:
        """Of the time that the mission takes the rover, the part that the monitors compute: the
        median, as a fraction.
        """
        return self.extra.median / self.mission


def cells(runs: Iterable[Run]) -> tuple[Cell, ...]:
    """A cell for each mode, in it for each number of waypoints, and in that for each setup, in
    their orders; two repetitions or more.
    """
    every = sorted(runs, key=lambda run: (*_place(run), run.repetition))
    grouped = {place: list(group) for place, group in groupby(every, key=_place)}
    return tuple(_cell(group, grouped[modes, waypoints, 0]) for (modes, waypoints, _), group in grouped.items())


def _place(run: Run) -> tuple[int, int, int]:
    """Mode, number of waypoints, and setup: that without monitors is the first."""
    return list(Mode).index(run.mode), run.waypoints, SETUPS.index(run.setup)


def _cell(runs: Sequence[Run], bare: Sequence[Run]) -> Cell:
    pairs = list(zip(runs, bare, strict=True))
    one = runs[0]
    dearest_event, dearest_on = mode((run.dearest_event, run.dearest_on) for run in runs)
    return Cell(
        mode=one.mode,
        waypoints=one.waypoints,
        setup=one.setup,
        monitors=one.monitors,
        repetitions=len(runs),
        events=one.events,
        mission=one.mission,
        made=_spread(run.made for run in runs),
        cpu=_spread(run.cpu for run in runs),
        wall=_spread(run.wall for run in runs),
        extra=_spread(run.cpu - without.cpu for run, without in pairs),
        ratio=_spread(run.cpu / without.cpu for run, without in pairs),
        verdicts=one.verdicts,
        dearest=_spread(run.dearest for run in runs),
        dearest_event=dearest_event,
        dearest_on=dearest_on,
        detected=one.detected,
    )


def _spread(values: Iterable[float]) -> Spread:
    return Spread(*quantiles(values, n=4, method="inclusive"))


class Growth(NamedTuple):
    """What monitors add, as a line through the medians: so many seconds once, and so many for each event."""

    once: float
    each: float


def growth(cells: Sequence[Cell]) -> Growth:
    """The line of least squares through the medians of one setup; missions of two sizes or more."""
    line = linear_regression([cell.events for cell in cells], [cell.extra.median for cell in cells])
    return Growth(line.intercept, line.slope)
