"""Summaries of runs: medians and quartiles per number of waypoints and setup."""

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
    `dearest_on` are the most frequent ones. Comparisons are with the run without monitors of the
    same repetition: `extra` is the additional `cpu` in seconds, and `ratio` the quotient.
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
        """Microseconds that the monitors add per event."""
        return Spread(*(1e6 * seconds / self.events for seconds in self.extra))

    @property
    def share(self) -> float:
        """The median of `extra`, as a fraction of the mission time."""
        return self.extra.median / self.mission


def cells(runs: Iterable[Run]) -> tuple[Cell, ...]:
    """Return a cell per mode, number of waypoints and setup, in these orders; needs two
    repetitions.
    """
    every = sorted(runs, key=lambda run: (*_place(run), run.repetition))
    grouped = {place: list(group) for place, group in groupby(every, key=_place)}
    return tuple(_cell(group, grouped[modes, waypoints, 0]) for (modes, waypoints, _), group in grouped.items())


def _place(run: Run) -> tuple[int, int, int]:
    """Return mode, number of waypoints and setup as sort key; no monitors come first."""
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
    """A linear fit of the added time: seconds once, and seconds per event."""

    once: float
    each: float


def growth(cells: Sequence[Cell]) -> Growth:
    """Return the least-squares line through the medians of one setup; needs two sizes."""
    line = linear_regression([cell.events for cell in cells], [cell.extra.median for cell in cells])
    return Growth(line.intercept, line.slope)
