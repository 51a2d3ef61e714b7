"""The measurement of one cell, step by step, in the process that this is called in and in forks of it.

Times are those of the processor in the thread that does it: what others do while this one waits is not counted. (While a timer bounds the
whole process, the system counts the time of that only in steps of some milliseconds.)
"""

import gc
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, partial
from importlib.metadata import version
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from statistics import median
from time import thread_time
from typing import Final, NamedTuple, NoReturn, Self

from cross_check.benchmark.plan import Cell, Settings, Walk, walks
from rvaft.backend import Specification, backend
from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.processes import (
    LATE,
    SLACK,
    STUCK,
    Died,
    apart,
    bound_memory,
    bound_time,
    end_if_late,
    free_memory,
    no_collection,
)

# What is known of one cell.


class Outcome(StrEnum):
    """How it ended. These words are never blurred: what a language cannot say is not what was too much, or took too long."""

    OK = "ok"
    NOT_EXPRESSIBLE = "not expressible"
    """The language cannot say the tree under this semantics."""
    TOO_LARGE = "too large"
    """It could, but not within the limit, or not in the memory."""
    TIMEOUT = "timeout"
    """The time for the cell was up."""
    TOOL_MISSING = "tool missing"
    FAILED = "could not run"

    @property
    def broken(self) -> bool:
        """Whether it says nothing about the language, only about what is installed here."""
        return self in (Outcome.TOOL_MISSING, Outcome.FAILED)


def outcome_of(error: Exception) -> tuple[Outcome, str]:
    """What an error of a backend means, and why, in one line."""
    match error:
        case NotExpressible():
            return Outcome.NOT_EXPRESSIBLE, error.reason
        case TooLarge():
            return Outcome.TOO_LARGE, f"{error.what} (limit {error.limit})"
        case ToolMissing():
            return Outcome.TOOL_MISSING, str(error)
        case RvaftError():
            return Outcome.FAILED, str(error).splitlines()[0]
        case _:
            return Outcome.FAILED, " ".join(f"{type(error).__name__}: {error}".split())


@dataclass(frozen=True, slots=True)
class Row:
    """One cell and what was measured; the columns of the CSV file are these fields.

    `tree` is a gate with its children (`and 3`, `vot 2/3`) or the path of a tree; `gate`, `children` and `threshold` are those of a
    gate over leaves. `result` says how the translation ended, and `reason` why; it is None while that is not over. The sizes are those
    of `Metrics`; `characters` is the length of the text, header and all; `seconds` the median time of a translation.

    `run` and `run_reason` say the same of reading the text and running events by the language's own reader: `read_seconds` is the time to
    read it, `events` how many were run, in `walks` traces, and `differing` how many of the traces got other verdicts than the tree demands.
    `events_per_second` is the speed of readers that have met nothing: each reads the text and runs one trace, in a process of its own, and
    `first_events` is how many events these are, of some of the traces. `again_per_second` is the median speed when one reader runs all the traces
    again and knows them.
    """

    tree: str
    gate: Gate | None
    children: int | None
    threshold: int | None
    semantics: Semantics
    language: str
    result: Outcome | None = None
    reason: str = ""
    symbols: int | None = None
    subformulas: int | None = None
    states: int | None = None
    edges: int | None = None
    characters: int | None = None
    seconds: float | None = None
    run: Outcome | None = None
    run_reason: str = ""
    read_seconds: float | None = None
    events: int | None = None
    events_per_second: float | None = None
    again_per_second: float | None = None
    walks: int | None = None
    differing: int | None = None
    limit: int | None = None
    timeout: float = 0.0
    seed: int = 0
    digest: str = ""
    version: str = ""
    first_events: int | None = None
    memory: int | None = None

    @property
    def key(self) -> tuple[object, ...]:
        """What two measurements share that may stand for each other, but for the time and memory that they may take."""
        named = (self.tree, self.digest, self.semantics, self.language)
        return (*named, self.limit, self.seed, self.version)

    @property
    def over(self) -> bool:
        """Whether there is nothing left to measure."""
        return self.result is not None and (self.result is not Outcome.OK or self.run is not None)

    def ended(self, outcome: Outcome, reason: str) -> Self:
        """The row where what was under way ended like this."""
        reason = " ".join(reason.split())
        if self.result is None:
            return replace(self, result=outcome, reason=reason)
        return self if self.over else replace(self, run=outcome, run_reason=reason)

    def serves(self, wanted: "Row") -> bool:
        """Whether this row answers for another of the same key: nothing was missing, neither tools nor what the other has more of."""
        ends = [outcome for outcome in (self.result, self.run) if outcome is not None]
        if self.key != wanted.key or not self.over or any(outcome.broken for outcome in ends):
            return False
        if self.memory is None or (Outcome.OK in ends[1:] and self.first_events is None):
            return False  # of a file that lacks columns
        late = Outcome.TIMEOUT in ends and self.timeout < wanted.timeout
        large = Outcome.TOO_LARGE in ends and self.memory < (wanted.memory or 0)
        return not (late or large)


def empty_row(cell: Cell, settings: Settings) -> Row:
    """The row of a cell before anything is measured."""
    subject = cell.subject
    return Row(
        subject.name,
        subject.gate,
        subject.children,
        subject.threshold,
        cell.semantics,
        cell.language,
        limit=settings.limit,
        timeout=settings.timeout,
        seed=settings.seed,
        digest=subject.digest,
        version=version("rvaft"),
        memory=settings.memory,
    )


# What is no part of any time: to import a backend, and to touch for the first time what a fork shares with its parent.
#
# A fork copies each page of memory that it writes to first, and Python writes to whatever it looks at. So a process that is to be timed first runs
# something else in the same language, which has all gates but knows nothing of what is measured.

_SMALLEST: Final = RVAFT("a", [Node("a")])
_OTHER: Final = RVAFT(
    "top",
    [
        Node("top", Gate.OR, ("all", "one after the other", "some")),
        Node("all", Gate.AND, ("a", "b")),
        Node("one after the other", Gate.SAND, ("c", "d", "e")),
        Node("some", Gate.VOT, ("f", "g", "h"), 2),
        *(Node(name) for name in "abcdefgh"),
    ],
)
_EVENTS: Final = "cfadgb"


def prepare(language: str, semantics: Semantics) -> None:
    """Import everything that a translation and a run need; for the process from which those that measure are forked."""
    with suppress(Exception):  # whatever is wrong with a backend shows in its rows
        backend(language).translate(_SMALLEST, semantics).monitor().step({"event": "a"})
        _other(language, semantics)


def warm_up(language: str, semantics: Semantics) -> None:
    """Read and run the other tree; for a fork."""
    with suppress(Exception):
        reader = _other(language, semantics).monitor()
        for start in range(len(_EVENTS)):
            monitor = reader.fork()
            for name in _EVENTS[start:]:
                monitor.step({"event": name})


@cache
def _other(language: str, semantics: Semantics) -> Specification:
    return backend(language).translate(_OTHER, semantics)


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


# Cells in processes of their own: one that takes too long or too much is ended, and keeps what was known of it.
#
# Every process starts from this one, with everything imported, so that no cell gains from what another left in memory.

GRACE: Final = 5.0
"""Seconds by the clock that a cell may take beside."""
WALKING: Final = 30.0
"""Seconds for finding the events of a tree; they are the engine's, and no language pays for them."""


@dataclass(slots=True)
class _Measurement:
    """A cell that is being measured; `row` is the last that was heard of it."""

    cell: Cell
    process: ForkProcess
    heard: Connection
    row: Row

    def listen(self) -> bool:
        """Take what the process has to say; False where it has ended."""
        try:
            self.row = self.heard.recv()
        except (EOFError, OSError):
            return False
        return True

    def end(self) -> int:
        """End the process and its forks, if they have not ended; how it ended."""
        self.process.kill()
        assert self.process.pid is not None
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.join()
        code = self.process.exitcode or 0
        self.process.close()
        self.heard.close()
        return code


def measured(cells: Sequence[Cell], settings: Settings, *, jobs: int = 1) -> Generator[tuple[Cell, Row], None, None]:
    """The rows of cells, each as soon as it is known; close the iterator to stop early.

    With more than one of `jobs` processes at a time their times disturb each other.
    """
    for language in dict.fromkeys(cell.language for cell in cells):
        for semantics in Semantics:
            prepare(language, semantics)
    waiting, running = deque(cells), list[_Measurement]()
    events = _Events(settings)
    clock = SLACK * jobs * settings.timeout + GRACE
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                cell = waiting.popleft()
                running.append(_started(cell, settings, events.of(cell), clock))
            for one in _heard(running):
                running.remove(one)
                yield one.cell, _last(one, settings, clock)
    finally:
        for one in running:
            one.end()


class _Events:
    """The walks of the tree that was asked for last: all of its languages run the same ones."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._of: tuple[object, ...] = ()
        self._walks: tuple[Walk, ...] = ()

    def of(self, cell: Cell) -> tuple[Walk, ...]:
        """Found in a process of its own; none where the engine cannot."""
        if self._of != (asked := (cell.subject.digest, cell.semantics)):
            self._of = asked
            try:
                self._walks = apart(partial(_found, cell, self._settings), seconds=2 * WALKING)
            except Died:
                self._walks = ()
        return self._walks


def _found(cell: Cell, settings: Settings) -> tuple[Walk, ...]:
    bound_memory(settings.memory)
    return walks(cell.subject.tree, cell.semantics, settings.seed, seconds=WALKING)


def _started(cell: Cell, settings: Settings, trodden: Sequence[Walk], clock: float) -> _Measurement:
    context = multiprocessing.get_context("fork")
    heard, said = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(cell, settings, trodden, clock, said), daemon=True)
    process.start()
    said.close()  # the process has its own; when that is closed, it has ended
    return _Measurement(cell, process, heard, empty_row(cell, settings))


def _measure(cell: Cell, settings: Settings, trodden: Sequence[Walk], clock: float, said: Connection) -> None:
    os.setpgrp()  # so that its forks end with it; an interrupt is for the parent to handle
    bound_time(settings.timeout, clock=clock)
    bound_memory(settings.memory)
    gc.freeze()  # what is there from before is never looked at: a collection would copy all of it, in the middle of a run
    row = empty_row(cell, settings)
    try:
        for row in stages(cell, settings, trodden):
            end_if_late(settings.timeout)
            said.send(row)
    except MemoryError as error:  # there was just enough of it
        said.send(ended_by(error, row, settings))
    except Died as died:
        _die(died.code)
    except OSError:
        pass  # nobody listens any more


def _die(code: int) -> NoReturn:
    """End as a fork has ended."""
    if code < 0:
        signal.raise_signal(-code)
    os._exit(code)


def _heard(running: Iterable[_Measurement]) -> list[_Measurement]:
    """Wait for something to happen, and return those that are over."""
    ready = wait([one.heard for one in running])
    return [one for one in running if one.heard in ready and (not one.listen() or one.row.over)]


def _last(one: _Measurement, settings: Settings, clock: float) -> Row:
    """The row of a process that is over; it says how where the process did not."""
    code = one.end()
    if one.row.over:
        return one.row
    if code == -LATE:
        return one.row.ended(Outcome.TIMEOUT, f"not within {settings.timeout:g} s")
    if code == -STUCK:
        return one.row.ended(Outcome.TIMEOUT, f"not within {clock:g} s by the clock")
    how = signal.Signals(-code).name if -code in set(signal.Signals) else f"exit status {code}"
    return one.row.ended(Outcome.FAILED, f"the process that measured it was killed ({how})")
