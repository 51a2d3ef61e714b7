"""Many comparisons, one after the other or in several processes, always reported in the order they were given."""

from collections.abc import Generator, Iterable
from contextlib import closing
from dataclasses import dataclass
from typing import TypeAlias

from cross_check.comparison import Comparison, raised
from cross_check.effort import Effort
from cross_check.results import Job, Result, Status
from cross_check.roster import Roster
from rvaft.parallel import Killed, in_processes
from rvaft.tree import RVAFT


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
        return
    with closing(in_processes(lambda task: task.run(), tasks, jobs=jobs)) as running:
        for task, found in running:
            killed = Result(task.job, "tree", Status.COULD_NOT_RUN, why="a process that compares was killed")
            yield task, [killed] if isinstance(found, Killed) else found
