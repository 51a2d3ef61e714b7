"""The measurement of one cell, step by step, in the process that this is called in.

Times are those of the processor in this process, so that what else the machine does hardly counts.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from statistics import median
from time import process_time
from typing import Final, NamedTuple

from rvaft.backend import Specification, backend
from rvaft.comparison.plan import Cell, Settings
from rvaft.comparison.rows import Outcome, Row, empty_row, outcome_of
from rvaft.comparison.walks import Walk, walks

ROUNDS: Final = 5
"""How often whatever is timed is done, at most."""
PATIENCE: Final = 0.4
"""Seconds after which it is not done again."""
_DIGITS: Final = 4
"""Significant digits of times; more would only look exact."""


class Ran(NamedTuple):
    """One reading of a text and one run of all walks.

    The seconds of each, the events up to final verdicts, and how many walks got other verdicts than the tree demands.
    """

    reading: float
    running: float
    events: int
    differing: int


def stages(cell: Cell, settings: Settings) -> Iterator[Row]:
    """What is known of a cell after each step; whatever a backend raises ends it and is part of the row."""
    row = empty_row(cell, settings)
    try:
        specification, seconds = _translated(cell, settings)
        row = _sized(row, specification, seconds)
        yield row
        times = _repeated(seconds, lambda: _translated(cell, settings)[1])
        row = replace(row, seconds=_rounded(median(times)))
        yield row
        yield _run(cell, settings, row, specification)
    except Exception as error:  # noqa: BLE001 (a backend of somebody else may fail in any way; the other cells still count)
        yield row.ended(*outcome_of(error))


def _translated(cell: Cell, settings: Settings) -> tuple[Specification, float]:
    """The specification and the seconds it took."""
    tree = copy(cell.subject.tree)  # a fresh one: nothing that a tree remembers of itself saves time
    language = backend(cell.language)
    start = process_time()
    specification = language.translate(tree, cell.semantics, limit=settings.limit)
    return specification, process_time() - start


def _repeated(first: float, again: Callable[[], float], *, least: int = 1) -> list[float]:
    times = [first]
    while len(times) < least or (len(times) < ROUNDS and sum(times) < PATIENCE):
        times.append(again())
    return times


def _sized(row: Row, specification: Specification, seconds: float) -> Row:
    metrics = specification.metrics
    return replace(
        row,
        result=Outcome.OK,
        symbols=metrics.symbols,
        subformulas=metrics.subformulas,
        states=metrics.states,
        edges=metrics.edges,
        characters=len(specification.text),
        seconds=_rounded(seconds),
    )


def _run(cell: Cell, settings: Settings, row: Row, specification: Specification) -> Row:
    trodden = walks(copy(cell.subject.tree), cell.semantics, settings.seed)
    first = _ran(specification, trodden)
    later = _repeated(first.running, lambda: _ran(specification, trodden).running, least=2)[1:]
    return replace(
        row,
        run=Outcome.OK,
        read_seconds=_rounded(first.reading),
        events=first.events,
        events_per_second=_speed(first.events, first.running),
        again_per_second=_speed(first.events, median(later)),
        walks=len(trodden),
        differing=first.differing,
    )


def _ran(specification: Specification, trodden: Sequence[Walk]) -> Ran:
    """Read the text anew and run all walks, each from the start; what a reader remembers of one helps it in the next."""
    start = process_time()
    first = specification.monitor()
    reading, running, events, differing = process_time() - start, 0.0, 0, 0
    for walk in trodden:
        monitor, got = first.fork(), []
        start = process_time()
        for event in walk.events:
            got.append(monitor.step(event))
            if monitor.verdict.final:  # what follows costs nothing and says nothing
                break
        running += process_time() - start
        events += len(got)
        differing += tuple(got) != walk.verdicts
    return Ran(reading, running, events, differing)


def _speed(events: int, seconds: float) -> float | None:
    return _rounded(events / seconds) if events and seconds else None


def _rounded(number: float) -> float:
    return float(f"{number:.{_DIGITS}g}")
