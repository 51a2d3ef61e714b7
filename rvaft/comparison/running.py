"""Cells in processes of their own: one that takes too long or too much is ended, and keeps what was known of it.

Every process starts from this one, with everything imported, so that no cell gains from what another left in memory.
"""

import gc
import multiprocessing
import signal
from collections import deque
from collections.abc import Generator, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from time import monotonic
from typing import Final

from rvaft.backend import backend
from rvaft.comparison.measuring import stages
from rvaft.comparison.plan import Cell, Settings
from rvaft.comparison.rows import Outcome, Row, empty_row
from rvaft.model import Node
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

_GRACE: Final = 5.0
"""Seconds after its deadline when a process ends by itself, in case that nobody is left to end it."""


@dataclass(slots=True)
class _Measurement:
    """A cell that is being measured; `row` is the last that was heard of it."""

    cell: Cell
    process: ForkProcess
    heard: Connection
    deadline: float
    row: Row

    def listen(self) -> bool:
        """Take what the process has to say; False where it has ended."""
        try:
            self.row = self.heard.recv()
        except (EOFError, OSError):
            return False
        return True

    def end(self) -> None:
        """End the process, if it has not ended."""
        self.process.kill()
        self.process.join()
        self.process.close()
        self.heard.close()


def measured(cells: Sequence[Cell], settings: Settings, *, jobs: int = 1) -> Generator[tuple[Cell, Row], None, None]:
    """The rows of cells, each as soon as it is known; close the iterator to stop early.

    With more than one of `jobs` processes at a time their times disturb each other.
    """
    _warm({cell.language for cell in cells})
    waiting, running = deque(cells), list[_Measurement]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                running.append(_started(waiting.popleft(), settings))
            for one in _finished(running, settings.timeout):
                running.remove(one)
                one.end()
                yield one.cell, one.row
    finally:
        for one in running:
            one.end()


def _started(cell: Cell, settings: Settings) -> _Measurement:
    context = multiprocessing.get_context("fork")
    heard, said = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(cell, settings, said), daemon=True)
    process.start()
    said.close()  # the process has its own; when that is closed, it has ended
    return _Measurement(cell, process, heard, monotonic() + settings.timeout, empty_row(cell, settings))


def _measure(cell: Cell, settings: Settings, said: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the parent to handle
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, settings.timeout + _GRACE)
    gc.freeze()  # what is there from before is never looked at: a collection would copy all of it, in the middle of a run
    with suppress(OSError):  # nobody listens any more
        for row in stages(cell, settings):
            said.send(row)


def _finished(running: Iterable[_Measurement], timeout: float) -> list[_Measurement]:
    """Wait for something to happen, and return those that are over; their rows say how."""
    patience = min(one.deadline for one in running) - monotonic()
    ready = wait([one.heard for one in running], max(patience, 0))
    finished = []
    for one in running:
        if one.heard in ready:
            if not one.listen() or one.row.over:
                one.row = one.row.ended(Outcome.FAILED, "the process that measured it was killed")
                finished.append(one)
        elif one.deadline <= monotonic():
            one.row = one.row.ended(Outcome.TIMEOUT, f"not within {timeout:g} s")
            finished.append(one)
    return finished


def _warm(languages: Iterable[str]) -> None:
    """Import everything that a translation and a run need: that is no part of their times."""
    smallest = RVAFT("a", [Node("a")])
    for language in languages:
        for semantics in Semantics:
            with suppress(Exception):  # whatever is wrong with a backend shows in its rows
                backend(language).translate(smallest, semantics).monitor().step({"event": "a"})
