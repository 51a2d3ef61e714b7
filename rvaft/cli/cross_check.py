"""`rvaft cross-check`: whether the specifications of a tree say the same thing."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from errno import ENOTDIR
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from cross_check.campaign import EFFORT, MAX_NODES, Entry, Task, campaign, catalogue, run
from cross_check.comparison import PATIENCE, Roster
from cross_check.counterexamples import case_folders, replay, save, shrunk
from cross_check.counterexamples import load as load_case
from cross_check.participants import handwritten, is_specification
from cross_check.reports import (
    Totals,
    csv_text,
    difference_lines,
    json_text,
    junit_text,
    markdown_text,
    result_lines,
    summary_lines,
)
from cross_check.results import Job, Result, Status, exit_status
from cross_check.traces import Effort
from rvaft.api import load, narrowed
from rvaft.cli.failure import FAILED, INTERRUPTED, Stopped, report
from rvaft.cli.options import exclusive, finite, part_options, some_backends, some_semantics
from rvaft.errors import RvaftError
from rvaft.language.parser import NoTree
from rvaft.model.nodes import Kind
from rvaft.model.verdict import Semantics, Verdict
from rvaft.support.files import deliver
from rvaft.support.terminal import columns, visible

# What `rvaft cross-check` prints while it runs and at the end, and the files it writes.

F = TypeVar("F", bound=Callable[..., Any])

_FORMATS: dict[str, Callable[[Iterable[Result], str], str]] = {
    "json": json_text,
    "csv": csv_text,
    "junit": junit_text,
    "markdown": markdown_text,
}
_SHOWN = 20
"""Disagreements of which the trace is printed."""


def report_options(function: F) -> F:
    """`--json FILE` and the others; the files are written at the end, also of an interrupted run."""
    for form in reversed(_FORMATS):
        function = click.option(f"--{form}", metavar="FILE", help=f"Write the results as {form}.")(function)
    return function


S = TypeVar("S")
T = TypeVar("T")


@dataclass(slots=True)
class Failures:
    """Reports what fails, so that the rest still runs; files that only declare what trees import are left out."""

    met: bool = False

    def collect(self, make: Callable[[S], T], given: Iterable[S]) -> Iterator[T]:
        """What can be made of these."""
        for one in given:
            try:
                yield make(one)
            except (RvaftError, OSError) as error:
                if not (isinstance(error, NoTree) and error.is_part):
                    report(error)
                    self.met = True


@dataclass(slots=True)
class Reports:
    """Collects results; `every` says whether each is listed or only counted."""

    files: dict[str, str]
    every: bool
    failures: Failures = field(default_factory=Failures)
    results: list[Result] = field(default_factory=list)
    note: str = ""
    """What the reader of a report has to know, such as that the run was interrupted."""

    def add(self, results: list[Result]) -> None:
        """Take the results of one comparison, and print what differs."""
        self.results += results
        for result in results:
            if result.status is Status.DIFFERS and self._differing() <= _SHOWN:
                difference = result.difference
                baseline = "the others" if difference is None else difference.baseline
                job = result.job
                where = f"{result.participant} differs from {baseline}: {job.title} under {job.semantics}"
                click.echo("\n".join([visible(where), *(f"  {line}" for line in difference_lines(result)), ""]))

    def _differing(self) -> int:
        return sum(result.status is Status.DIFFERS for result in self.results)

    def check(self) -> None:
        """Raise `OSError` now for a file that cannot be written at the end."""
        for path in self.files.values():
            if not (folder := Path(path).absolute().parent).is_dir():
                raise NotADirectoryError(ENOTDIR, f"cannot write: {folder} is no folder", path)

    def finish(self) -> None:
        """Print the table and the totals, and write the files."""
        totals = Totals.of(self.results)
        if self.results:
            click.echo("\n".join(result_lines(self.results) if self.every else summary_lines(totals)))
        if not self.every:
            for result in totals.unable[:_SHOWN]:
                where = f"{result.participant} on {result.job.title} under {result.job.semantics}"
                click.echo(visible(f"{where}: {result.text}"))
            if len(totals.unable) > _SHOWN:
                click.echo(f"and {len(totals.unable) - _SHOWN} more that were not compared")
        click.echo("; ".join(filter(None, [totals.headline, self.note])))
        self.write()

    def write(self) -> None:
        """Write the files, all that can be written; raises `OSError` for the first that cannot."""
        failed: OSError | None = None
        for form, path in self.files.items():
            try:
                deliver(_FORMATS[form](self.results, self.note).encode(errors="backslashreplace"), path)
            except OSError as error:
                failed = failed or error
        if failed is not None:
            raise failed


class Watched:
    """A progress bar on a terminal, and nothing elsewhere."""

    def __init__(self, total: int) -> None:
        shown = (TextColumn("comparing"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        console = Console(stderr=True)
        self._progress = Progress(*shown, console=console, transient=True, disable=not sys.stderr.isatty())
        self._task: TaskID = self._progress.add_task("", total=total)

    def __enter__(self) -> "Watched":
        self._progress.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._progress.stop()

    def advance(self) -> None:
        """One more is done."""
        self._progress.advance(self._task)


# Comparisons while they run: what differs is shown and saved, what fails is reported, an interrupt leaves what there is.


def compared(tasks: Iterable[Task], count: int, jobs: int, reports: Reports, *, bogus: str | None, stop: bool) -> None:
    """Run so many comparisons, and report at the end; an interrupt ends the program after the report."""
    done, interrupted = 0, False
    with Watched(count) as watched, closing(run(tasks, jobs=jobs)) as running:
        try:
            for task, results in running:
                watched.advance()
                done += 1
                reports.add(results)
                differing = [result for result in results if result.status is Status.DIFFERS]
                if bogus is not None:
                    for case in reports.failures.collect(partial(shrunk, task), differing):
                        for folder in reports.failures.collect(partial(save, folder=bogus), [case]):
                            click.echo(f"saved {visible(str(folder))}")
                if differing and stop:
                    break
        except KeyboardInterrupt:
            interrupted = True
    if interrupted:
        reports.note = f"interrupted after {done} of {count} comparisons"
    reports.finish()
    if interrupted:
        raise Stopped(INTERRUPTED)


def replayed(folder: str, roster: Roster, reports: Reports) -> None:
    """Run saved cases again, one table each."""
    for case in reports.failures.collect(load_case, case_folders(folder)):
        click.echo(visible(f"{case.name}: {case.semantics}"))
        rows = [("PARTICIPANT", "BEFORE", "NOW", "RESULT")]
        for one in replay(case, roster):
            reports.results.append(one.result)
            rows.append((one.result.participant, _symbols(one.before), _symbols(one.now), one.result.text))
        click.echo("\n".join(f"  {line}" for line in columns(rows)))
    reports.write()


def _symbols(verdicts: tuple[Verdict, ...] | None) -> str:
    return "-" if verdicts is None else "".join(verdict.symbol for verdict in verdicts)


SMALL_PROOF: Final = 300
"""Combinations of states of a proof in a random campaign, where many trees say more than one."""
MANY_TRACES: Final = 200
"""Random traces for a tree that somebody named."""
MOST_TRACES: Final = 1_000
"""And with a text of somebody else beside it: finding one condition that was forgotten takes many."""
SMALL_TEXT: Final = 5_000
"""The limit of translations there."""


@click.command("cross-check")
@click.argument("trees", nargs=-1, metavar="[TREE]...")
@click.option("--against", multiple=True, metavar="[LANG:]FILE", help="A specification to hold against each TREE.")
@click.option("--backends", metavar="A,B", help="These backends instead of all faithful ones.")
@click.option(
    "--semantics", callback=some_semantics, metavar="S,...|all", help="Default: all; with --against, projected."
)
@part_options
@click.option("--random", type=click.IntRange(min=1), metavar="N", help="Compare N random trees.")
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="The seed of everything random.")
@click.option(
    "--max-nodes",
    type=click.IntRange(min=2),
    default=MAX_NODES,
    show_default=True,
    metavar="M",
    help="Of random trees.",
)
@click.option(
    "--traces",
    type=click.IntRange(min=0),
    metavar="N",
    help="Random traces.  [default: 200; with --against 1000, with --random 20]",
)
@click.option("--length", type=click.IntRange(min=1), metavar="L", help="Of traces.  [default: enough for a detection]")
@click.option(
    "--states", type=click.IntRange(min=0), default=20_000, show_default=True, metavar="N", help="Of a proof."
)
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Of translations, in the language's own unit.")
@click.option(
    "--jobs", type=click.IntRange(min=1), default=None, metavar="N", help="Processes.  [default: one per processor]"
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, max=1_000_000, min_open=True),
    callback=finite,
    metavar="SECONDS",
    help="For each step of a case.",
)
@click.option("--stop-on-error", is_flag=True, help="Stop after the first comparison with a disagreement.")
@click.option("--save-bogus", metavar="DIR", help="Shrink each disagreement and save it as a case below DIR.")
@click.option("--replay", "replay_folder", metavar="DIR", help="Run saved cases again.")
@click.option("--rml-monitor", metavar="DIR", help="Also run RML by the published monitor, of which DIR is a checkout.")
@click.option("--mona", is_flag=True, help="Also run LTLf by MONA (small trees without variables).")
@report_options
@click.option("--fail-on-not-expressible", is_flag=True, help="Exit with 2 where a language cannot say a tree.")
@click.option("--fail-on-too-large", is_flag=True, help="Exit with 2 where something was larger than a limit.")
@click.option("--fail-on-timeout", is_flag=True, help="Exit with 2 where the time was too short.")
def cross_check_command(
    *,
    trees: tuple[str, ...],
    against: tuple[str, ...],
    backends: str | None,
    semantics: tuple[Semantics, ...] | None,
    branch: int | None,
    kind: str | None,
    random: int | None,
    seed: int,
    max_nodes: int,
    traces: int | None,
    length: int | None,
    states: int,
    limit: int | None,
    jobs: int | None,
    timeout: float | None,
    stop_on_error: bool,
    save_bogus: str | None,
    replay_folder: str | None,
    rml_monitor: str | None,
    mona: bool,
    fail_on_not_expressible: bool,
    fail_on_too_large: bool,
    fail_on_timeout: bool,
    **files: str | None,
) -> int:
    """Compare the reference, the engine and all faithful backends: on each TREE, or without one on every gate.

    Proves agreement on all traces where it can, tests it otherwise, and says which. The exit status is 1 when some differ, 2 when
    something could not be read or run.
    """
    exclusive(branch=branch, kind=kind)
    exclusive(random=random, replay=replay_folder)
    texts, trees = _sorted_out(against, trees)
    context = click.get_current_context()
    if (random is not None or replay_folder is not None) and (trees or branch is not None or kind is not None):
        raise click.UsageError("--random and --replay bring their own trees", context)
    if (branch is not None or kind is not None) and not trees:
        raise click.UsageError("--branch and --kind need a TREE", context)
    if against and not trees:
        raise click.UsageError("--against needs a TREE to compare with", context)
    if replay_folder is not None and semantics is not None:
        raise click.UsageError("a saved case has its semantics: leave --semantics out with --replay", context)
    if len(set(given := [path for path in files.values() if path is not None])) < len(given):
        raise click.UsageError("two reports go to one file", context)
    reports = Reports({form: path for form, path in files.items() if path is not None}, every=bool(trees))
    reports.check()
    roster = Roster(
        some_backends(backends),
        tuple(reports.failures.collect(handwritten, texts)),
        rml_monitor=None if rml_monitor is None else Path(rml_monitor),
        mona=mona,
        patience=timeout or PATIENCE,
        limit=SMALL_TEXT if limit is None and random is not None else limit,
    )
    if replay_folder is not None:
        replayed(replay_folder, roster, reports)
        return FAILED if reports.failures.met else exit_status(reports.results)
    entries: list[Entry] | Iterator[Entry]
    if random is not None:
        entries, count, effort = campaign(random, seed, max_nodes), random, Effort(states=SMALL_PROOF, words=0)
    elif trees:
        part = partial(_entry, branch=branch, kind=None if kind is None else Kind(kind))
        entries = list(reports.failures.collect(part, trees))
        if not entries and not reports.failures.met:
            click.echo("nothing to compare: these files only declare what trees import")
            return 0
        count, effort = len(entries), Effort(traces=MOST_TRACES if against else MANY_TRACES)
    else:
        entries = list(catalogue())
        count, effort = len(entries), EFFORT
    if against and not roster.against:  # nothing that could be read is left to compare
        entries, count = [], 0
    effort = replace(effort, states=min(states, effort.states) if random else states, length=length, seconds=timeout)
    effort = replace(effort, seed=str(seed), traces=effort.traces if traces is None else traces)
    chosen = semantics or ((Semantics.PROJECTED,) if against else tuple(Semantics))
    tasks = (Task(e.tree, Job(e.name, s, e.branch, e.kind), roster, effort) for e in entries for s in chosen)
    compared(tasks, count * len(chosen), jobs or os.cpu_count() or 1, reports, bogus=save_bogus, stop=stop_on_error)
    fails = {"not_expressible": fail_on_not_expressible, "too_large": fail_on_too_large, "timeout": fail_on_timeout}
    asked = {Status[name.upper()] for name, wanted in fails.items() if wanted}
    return FAILED if reports.failures.met else exit_status(reports.results, failing=asked)


def _sorted_out(against: tuple[str, ...], trees: tuple[str, ...]) -> tuple[list[str], tuple[str, ...]]:
    """The specifications and the trees: what follows the first FILE of --against is a specification too, where its name says so."""
    texts = [tree for tree in trees if is_specification(tree)] if against else []
    return [*against, *texts], tuple(dict.fromkeys(tree for tree in trees if tree not in texts))


def _entry(path: str, branch: int | None, kind: Kind | None) -> Entry:
    tree = load(path)
    narrowed(tree, branch, kind)  # refuses what breaks a rule, and a part that is not there
    return Entry(click.format_filename(path), tree, branch, kind)
