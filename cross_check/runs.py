"""Many comparisons, one after the other or in several processes, always reported in the order they were given."""

import multiprocessing
import signal
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from typing import Final, TypeAlias

from cross_check.comparison import Comparison, raised
from cross_check.effort import Effort
from cross_check.results import Job, Result, Status
from cross_check.roster import Roster
from rvaft.tree import RVAFT

AHEAD: Final = 8
"""Comparisons that wait for each process; trees are made as they are needed."""


@dataclass(frozen=True, slots=True)
class Task:
    """One comparison to make: of what, by whom, how hard."""

    tree: RVAFT
    job: Job
    roster: Roster
    effort: Effort

    def run(self) -> list[Result]:
        """Compare; a tree that has no such part is a result too."""
        try:
            return Comparison(self.tree, self.job, self.effort).run(self.roster.candidates(self.tree, self.job))
        except Exception as error:  # noqa: BLE001 (whatever it is, the other comparisons go on)
            return [Result(self.job, "tree", Status.COULD_NOT_RUN, why=str(raised(error)))]


Done: TypeAlias = tuple[Task, list[Result]]
"""A comparison and what it has found."""


def run(tasks: Iterable[Task], *, jobs: int = 1) -> Generator[Done, None, None]:
    """The results of each comparison, in order; close the iterator to stop early."""
    if jobs == 1:
        yield from ((task, task.run()) for task in tasks)
    else:
        yield from _parallel(iter(tasks), jobs)


def _parallel(tasks: Iterator[Task], jobs: int) -> Generator[Done, None, None]:
    # Processes that are forked have all modules and all patches of this one.
    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_leave_interrupts)
    finished = False
    waiting = deque[tuple[Task, Future[list[Result]]]]()
    try:
        waiting.extend((task, _submitted(pool, task)) for task in islice(tasks, jobs * AHEAD))
        while waiting:
            task, future = waiting.popleft()
            yield task, _results(task, future)
            waiting.extend((task, _submitted(pool, task)) for task in islice(tasks, 1))
        finished = True
    finally:
        if not finished:  # nobody wants the rest
            for process in multiprocessing.active_children():
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


def _submitted(pool: ProcessPoolExecutor, task: Task) -> Future[list[Result]]:
    try:
        return pool.submit(task.run)
    except BrokenProcessPool as broken:
        lost = Future[list[Result]]()
        lost.set_exception(broken)
        return lost


def _results(task: Task, future: Future[list[Result]]) -> list[Result]:
    try:
        return future.result()
    except BrokenProcessPool:
        return [Result(task.job, "tree", Status.COULD_NOT_RUN, why="a process that compares was killed")]


def _leave_interrupts() -> None:
    """An interrupt is for the parent to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
