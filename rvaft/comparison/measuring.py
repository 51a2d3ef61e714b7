"""The measurement of one cell, step by step, in the process that this is called in and in forks of it.

Times are those of the processor in the thread that does it: what others do while this one waits is not counted. (While a timer bounds the
whole process, the system counts the time of that only in steps of some milliseconds.)
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from statistics import median
from time import thread_time
from typing import Final, NamedTuple

from rvaft.backend import Specification, backend
from rvaft.comparison.apart import apart
from rvaft.comparison.bounds import free_memory
from rvaft.comparison.collecting import no_collection
from rvaft.comparison.plan import Cell, Settings
from rvaft.comparison.rows import Outcome, Row, empty_row, outcome_of
from rvaft.comparison.walks import Walk
from rvaft.comparison.warming import warm_up

ROUNDS: Final = 5
"""How often whatever is timed is done, at most."""
PATIENCE: Final = 0.4
"""Seconds after which it is not done again."""
READERS: Final = 12
"""How many readers that know nothing run a trace each, at most."""
_FORK: Final = 0.01
"""Seconds that such a reader takes beside reading, about."""
_DIGITS: Final = 4
"""Significant digits of times; more would only look exact."""


class Ran(NamedTuple):
    """One reading of a text and one run of some walks.

    The seconds of the reading, the events and seconds of each walk up to its final verdict, and how many walks got other verdicts than the
    tree demands.
    """

    reading: float
    runs: tuple[tuple[int, float], ...]
    differing: int

    @property
    def events(self) -> int:
        """Of all walks."""
        return sum(events for events, _ in self.runs)

    @property
    def seconds(self) -> float:
        """Of all walks."""
        return sum(seconds for _, seconds in self.runs)


def stages(cell: Cell, settings: Settings, trodden: Sequence[Walk]) -> Iterator[Row]:
    """What is known of a cell after each step; whatever a backend raises ends it and is part of the row.

    The walks are those to run. Raises `Died` where the backend ended the process that reads and runs its text.
    """
    row = empty_row(cell, settings)
    try:
        specification, seconds = _translated(cell, settings)
        row = _sized(row, specification, seconds)
        yield row
        times = _repeated(seconds, lambda: _translated(cell, settings)[1])
        row = replace(row, seconds=_rounded(median(times)))
        yield row
    except Exception as error:  # noqa: BLE001 (a backend of somebody else may fail in any way; the other cells still count)
        yield ended_by(error, row, settings)
    else:
        yield _run(cell, settings, row, specification, trodden)


def ended_by(error: Exception, row: Row, settings: Settings) -> Row:
    """The row where this was raised; from here on memory is not bounded any more."""
    if isinstance(error, MemoryError):
        free_memory()
        return row.ended(Outcome.TOO_LARGE, f"megabytes of memory (limit {settings.memory})")
    return row.ended(*outcome_of(error))


def _translated(cell: Cell, settings: Settings) -> tuple[Specification, float]:
    """The specification and the seconds it took."""
    tree = copy(cell.subject.tree)  # a fresh one: nothing that a tree remembers of itself saves time
    language = backend(cell.language)
    start = thread_time()
    specification = language.translate(tree, cell.semantics, limit=settings.limit)
    return specification, thread_time() - start


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


def _run(cell: Cell, settings: Settings, row: Row, specification: Specification, trodden: Sequence[Walk]) -> Row:
    """The row with what comes of reading and running the text.

    Readers are free to remember what they have met for as long as the process lives, so each that is to know nothing has a fork of this
    process, which itself reads nothing.
    """
    row, first = apart(partial(_known, cell, settings, row, specification, trodden))
    if first is None or not first.runs:
        return row
    readers = min(READERS, len(trodden), 1 + int(PATIENCE / (first.reading + _FORK)))
    step = -(-len(trodden) // readers)
    fresh = [first.runs[0]]  # what that reader has run before anything else
    for walk in trodden[step::step]:
        fresh += apart(partial(_ran_first, cell, specification, walk)).runs
    events, seconds = (sum(column) for column in zip(*fresh, strict=True))
    return replace(row, first_events=events, events_per_second=_speed(events, seconds))


def _known(
    cell: Cell, settings: Settings, row: Row, specification: Specification, trodden: Sequence[Walk]
) -> tuple[Row, Ran | None]:
    """The row with all but the first time, and the first run of all walks by one reader; None where that failed."""
    warm_up(cell.language, cell.semantics)
    try:
        first = _ran(specification, trodden)
        later = _repeated(first.seconds, lambda: _ran(specification, trodden).seconds, least=2)[1:]
    except Exception as error:  # noqa: BLE001 (as above)
        return ended_by(error, row, settings), None
    known = replace(
        row,
        run=Outcome.OK,
        run_reason="" if trodden else "no events: the tree is too much for the engine, which is to find them",
        read_seconds=_rounded(first.reading),
        events=first.events,
        first_events=0,
        again_per_second=_speed(first.events, median(later)),
        walks=len(trodden),
        differing=first.differing,
    )
    return known, first


def _ran_first(cell: Cell, specification: Specification, walk: Walk) -> Ran:
    warm_up(cell.language, cell.semantics)
    return _ran(specification, [walk])


def _ran(specification: Specification, trodden: Sequence[Walk]) -> Ran:
    """Read the text and run the walks, each from the start; what a reader remembers of one helps it in the next."""
    start = thread_time()
    reader = specification.monitor()
    reading, runs, differing = thread_time() - start, [], 0
    for walk in trodden:
        monitor, got = reader.fork(), []
        with no_collection():
            start = thread_time()
            for event in walk.events:
                got.append(monitor.step(event))
                if monitor.verdict.final:  # what follows costs nothing and says nothing
                    break
            runs.append((len(got), thread_time() - start))
        differing += tuple(got) != walk.verdicts
    return Ran(reading, tuple(runs), differing)


def _speed(events: int, seconds: float) -> float | None:
    return _rounded(events / seconds) if events and seconds else None


def _rounded(number: float) -> float:
    return float(f"{number:.{_DIGITS}g}")
