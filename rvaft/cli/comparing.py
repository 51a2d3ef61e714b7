"""Comparisons while they run: what differs is shown and saved, what fails is reported, an interrupt leaves what there is."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import click

from cross_check.bogus import keep
from cross_check.cases import case_folders
from cross_check.cases import load as load_case
from cross_check.replaying import replay
from cross_check.results import Result, Status, exit_status
from cross_check.roster import Roster
from cross_check.runs import Task, run
from rvaft.cli.failure import FAILED, INTERRUPTED, Stopped, report
from rvaft.cli.reports import Reports, Watched
from rvaft.errors import RvaftError
from rvaft.printable import columns, visible
from rvaft.verdict import Verdict

S = TypeVar("S")
T = TypeVar("T")


@dataclass(slots=True)
class Failures:
    """Reports what fails, so that the rest still runs."""

    met: bool = False

    def collect(self, make: Callable[[S], T], given: Iterable[S]) -> Iterator[T]:
        """What can be made of these."""
        for one in given:
            try:
                yield make(one)
            except (RvaftError, OSError) as error:
                report(error)
                self.met = True


@dataclass(frozen=True, slots=True)
class Watching:
    """Where the results of a run go."""

    reports: Reports
    failures: Failures
    stop_on_error: bool
    bogus: Path | None

    def run(self, tasks: Iterable[Task], count: int, jobs: int) -> None:
        """Run so many comparisons, and report at the end; an interrupt ends the program after the report."""
        done, interrupted = 0, False
        with Watched(count) as watched, closing(run(tasks, jobs=jobs)) as running:
            try:
                for task, results in running:
                    watched.advance()
                    done += 1
                    differing = self._take(task, results)
                    if differing and self.stop_on_error:
                        break
            except KeyboardInterrupt:
                interrupted = True
        if interrupted:
            self.reports.note = f"interrupted after {done} of {count} comparisons"
        self.reports.finish()
        if interrupted:
            raise Stopped(INTERRUPTED)

    def _take(self, task: Task, results: list[Result]) -> list[Result]:
        """Report one comparison, and return those who differ in it."""
        self.reports.add(results)
        differing = [result for result in results if result.status is Status.DIFFERS]
        if self.bogus is not None:
            for case in self.failures.collect(partial(keep, task, folder=self.bogus), differing):
                click.echo(f"saved {visible(str(case))}")
        return differing


def replayed(folder: Path, roster: Roster, reports: Reports) -> int:
    """Run saved cases again, one table each."""
    failures = Failures()
    for case in failures.collect(load_case, case_folders(folder)):
        click.echo(visible(f"{case.name}: {case.semantics}"))
        rows = [("PARTICIPANT", "BEFORE", "NOW", "RESULT")]
        for one in replay(case, roster):
            reports.results.append(one.result)
            rows.append((one.result.participant, _symbols(one.before), _symbols(one.now), one.result.text))
        click.echo("\n".join(f"  {line}" for line in columns(rows)))
    reports.write()
    return FAILED if failures.met else exit_status(reports.results)


def _symbols(verdicts: tuple[Verdict, ...] | None) -> str:
    return "-" if verdicts is None else "".join(verdict.symbol for verdict in verdicts)
