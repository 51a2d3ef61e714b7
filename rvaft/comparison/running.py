"""Cells in processes of their own: one that takes too long or too much is ended, and keeps what was known of it.

Every process starts from this one, with everything imported, so that no cell gains from what another left in memory.
"""

import gc
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Generator, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from typing import Final, NoReturn

from rvaft.comparison.apart import Died, apart
from rvaft.comparison.bounds import LATE, SLACK, STUCK, bound_memory, bound_time, end_if_late
from rvaft.comparison.measuring import ended_by, stages
from rvaft.comparison.plan import Cell, Settings
from rvaft.comparison.rows import Outcome, Row, empty_row
from rvaft.comparison.walks import Walk, walks
from rvaft.comparison.warming import prepare
from rvaft.verdict import Semantics

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
