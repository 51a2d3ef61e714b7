"""What runs come to: for each number of waypoints and each setup the median and the quartiles over the repetitions."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import linear_regression, quantiles
from typing import NamedTuple

from papers.fmas2022.overhead_runs import NONE, SETUPS, Run


class Spread(NamedTuple):
    """The quartiles of the repetitions."""

    low: float
    median: float
    high: float


@dataclass(frozen=True, slots=True)
class Cell:
    """A setup on missions of one size.

    `made`, `cpu` and `wall` are in seconds, as in `Run`. What is compared with the run without monitors is compared with the one of the same
    repetition: `extra` is what the monitors add to `cpu`, in seconds, and `ratio` how many times as long the loop takes.
    """

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

    @property
    def per_event(self) -> Spread:
        """Microseconds that the monitors add to an event."""
        return Spread(*(1e6 * seconds / self.events for seconds in self.extra))

    @property
    def share(self) -> float:
        """Of the time that the mission takes the rover, the part that the monitors compute: the median, as a fraction."""
        return self.extra.median / self.mission


def cells(runs: Iterable[Run]) -> tuple[Cell, ...]:
    """A cell for each number of waypoints, and in it for each setup, in the order of `SETUPS`; two repetitions or more."""
    every = sorted(runs, key=lambda run: (run.waypoints, SETUPS.index(run.setup), run.repetition))
    grouped = {key: list(group) for key, group in groupby(every, key=lambda run: (run.waypoints, run.setup))}
    return tuple(_cell(group, grouped[waypoints, NONE]) for (waypoints, _), group in grouped.items())


def _cell(runs: Sequence[Run], bare: Sequence[Run]) -> Cell:
    pairs = list(zip(runs, bare, strict=True))
    one = runs[0]
    return Cell(
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
