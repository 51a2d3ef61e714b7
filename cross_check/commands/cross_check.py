"""`rvaft cross-check`: compare the specifications of trees."""

import os
import sys
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import cycle, repeat
from pathlib import Path
from typing import Any, Final

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from backends.c.library import compiles_at_once
from cross_check import results as reports
from cross_check.campaign import MAX_NODES, Entry, Task, campaign, catalogue, in_turn, parts_of_language, run
from cross_check.comparison import Roster
from cross_check.counterexamples import case_folders, replay, save, shrunk
from cross_check.counterexamples import load as load_case
from cross_check.participants import PATIENCE, faithful_backends, handwritten, is_specification, missing_extras
from cross_check.results import Job, Result, Status, exit_status
from cross_check.traces import AGAINST, CATALOGUE, ONE_TREE, RANDOM, Effort
from rvaft.cli import FAILED, INTERRUPTED, Failures, Stopped, options
from rvaft.export.certificates import PROGRAM, on_path
from rvaft.model.nodes import Kind
from rvaft.model.tree import resolve_semantics
from rvaft.model.verdict import Semantics, Verdict
from rvaft.rules.validity import valid_part
from rvaft.support.files import deliver
from rvaft.support.terminal import columns, inert, visible

_FORMATS: Final[dict[str, Callable[[Iterable[Result], str], str]]] = {
    "json": reports.json_text,
    "csv": reports.csv_text,
    "junit": reports.junit_text,
    "markdown": reports.markdown_text,
}
_SHOWN: Final = 20
SMALL_TEXT: Final = 5_000
"""Limit of translations in a random campaign."""
ONE_IN: Final = 13
"""Without arguments and without a quick compiler, C takes part in one of so many comparisons."""


@contextmanager
def progress(total: int, work: str = "comparing") -> Iterator[Callable[[], None]]:
    """Show a progress bar on terminals; the yielded function advances it."""
    shown = (TextColumn(work), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*shown, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("", total=total)
        yield lambda: bar.advance(task)


@dataclass(slots=True)
class Reports:
    """Collects results and prints disagreements; `every` prints all results instead of counts."""

    files: dict[str, str]
    every: bool
    failures: Failures = field(default_factory=Failures)
    results: list[Result] = field(default_factory=list)
    parts: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def compare(
        self, running: Generator[tuple[Task, list[Result]], None, None], count: int, *, bogus: str | None, stop: bool
    ) -> None:
        """Collect the results of `count` comparisons and print the report.

        An interrupt ends the program after the report.
        """
        done, every, note = 0, 0, ""
        with progress(count) as advance, closing(running):
            try:
                for task, results in running:
                    advance()
                    done += 1
                    self.results += results
                    self.parts[task.job.title] = tuple(parts_of_language(task.tree))
                    differing = [result for result in results if result.status is Status.DIFFERS]
                    every += len(differing)
                    for result in differing if every <= _SHOWN else ():
                        baseline = "the others" if result.difference is None else result.difference.baseline
                        where = f"{result.participant} differs from {baseline}: {_job(result)}"
                        shown = [f"  {visible(line)}" for line in reports.difference_lines(result)]
                        click.echo(inert("\n".join([visible(where), *shown, ""])))
                    for result in results:
                        for first, *shown in reports.remarks(result):
                            where = f"{result.participant}: {_job(result)}: {first}"
                            click.echo(inert("\n".join([visible(where), *(f"  {visible(one)}" for one in shown), ""])))
                    if bogus is not None:
                        for case in self.failures.collect(partial(shrunk, task), differing):
                            for folder in self.failures.collect(partial(save, folder=bogus), [case]):
                                click.echo(inert(f"saved {visible(str(folder))}"))
                    if differing and stop:
                        break
            except KeyboardInterrupt:
                note = f"interrupted after {done} of {count} comparisons"
        totals = reports.ComparisonTotals(self.results)
        if self.results:
            lines = reports.result_lines(self.results) if self.every else reports.summary_lines(totals)
            click.echo(inert("\n".join(lines)))
        if not self.every:
            for lines in (reports.part_lines(self.results, self.parts), reports.unable_lines(totals.unable)):
                if lines:
                    click.echo(inert("\n".join(["", *lines])))
            click.echo()
        click.echo("; ".join(filter(None, [totals.headline, note])))
        self.write(note)
        if note:
            raise Stopped(INTERRUPTED)

    def replay(self, folder: str, roster: Roster) -> None:
        """Replay saved cases, with a table for each."""
        for case in self.failures.collect(load_case, case_folders(folder)):
            click.echo(inert(visible(f"{case.name}: {case.semantics}")))
            rows = [("PARTICIPANT", "BEFORE", "NOW", "RESULT")]
            for one in replay(case, roster):
                self.results.append(one.result)
                rows.append((one.result.participant, _symbols(one.before), _symbols(one.now), one.result.text))
            click.echo(inert("\n".join(f"  {line}" for line in columns(rows))))
        self.write("")

    def write(self, note: str) -> None:
        """Write the report files; raises the first `OSError` after trying all."""
        failed: OSError | None = None
        for form, path in self.files.items():
            try:
                deliver(_FORMATS[form](self.results, note).encode(errors="backslashreplace"), path)
            except OSError as error:
                failed = failed or error
        if failed is not None:
            raise failed


def _job(result: Result) -> str:
    return f"{result.job.title} under {result.job.semantics}"


def _symbols(verdicts: tuple[Verdict, ...] | None) -> str:
    return "-" if verdicts is None else "".join(verdict.symbol for verdict in verdicts)


def _report_options(function: Callable[..., int]) -> Callable[..., int]:
    for form in reversed(_FORMATS):
        function = click.option(f"--{form}", metavar="FILE", help=f"Write the results as {form}.")(function)
    return function


_TRACES: Final = (
    f"Number of random traces.  [default: {ONE_TREE.traces}; with --against {AGAINST.traces}, "
    f"with --random {RANDOM.traces}, without TREE {CATALOGUE.traces}]"
)
_STATES: Final = f"State limit of a proof.  [default: {ONE_TREE.states}; with --random {RANDOM.states}]"
_SEMANTICS: Final = (
    "Default: all; with --against, what each tree states, or projected; without TREE, one for each tree in turn."
)
_VERIFIED: Final = f"Also run this build of the verified monitor.  [default: {PROGRAM}, if it is on the PATH]"
_PUBLISHED: Final = "Also run RML in the published monitor; DIR is a checkout of it."


@click.command("cross-check")
@click.argument("trees", nargs=-1, metavar="[TREE]...")
@click.option("--against", multiple=True, metavar="[LANG:]FILE", help="Compare this specification with each TREE.")
@click.option("--run-c", is_flag=True, help="Compile and run texts in C, of --against and saved cases, confined.")
@click.option("--backends", metavar="A,B", help="Compare these backends instead of all faithful ones.")
@click.option("--semantics", callback=options.some(Semantics), metavar="S,...|all", help=_SEMANTICS)
@options.reading_options
@options.part_options
@options.number("--random", text="Compare N random trees.")
@click.option(
    "--seed", type=int, default=0, show_default=True, metavar="S", help="The seed of random trees and traces."
)
@options.number("--max-nodes", least=2, default=MAX_NODES, metavar="M", text="Maximum number of nodes of random trees.")
@options.number("--traces", least=0, text=_TRACES)
@options.number("--length", metavar="L", text="Maximum length of traces.  [default: enough for a detection]")
@options.number("--states", least=0, text=_STATES)
@options.number("--limit", text="Limit of translations, in the unit of the backend.")
@options.number("--jobs", text="Number of processes.  [default: one per processor]")
@options.timeout_option(
    f"Seconds for each step of a comparison.  [default: none; with --against {AGAINST.seconds:g}; "
    "60 for an answer of a text or program]"
)
@click.option("--stop-on-error", is_flag=True, help="Stop after the first comparison with a disagreement.")
@click.option("--save-bogus", metavar="DIR", help="Shrink each disagreement and save it as a case below DIR.")
@click.option("--replay", metavar="DIR", help="Run saved cases again.")
@click.option("--rml-monitor", metavar="DIR", help=_PUBLISHED)
@click.option(
    "--monpoly", metavar="PROGRAM", help="Also run MFOTL in this build of MonPoly and in its verified kernel."
)
@click.option("--r2u2", metavar="PROGRAM", help="Also run past MTL in this build of R2U2, in its checkout.")
@click.option("--verified", metavar="PROGRAM", help=_VERIFIED)
@click.option("--flink", is_flag=True, help="Also run MATCH_RECOGNIZE in Apache Flink, which must be installed.")
@click.option("--mona", is_flag=True, help="Also run LTLf in MONA (small trees without variables).")
@_report_options
@click.option("--fail-on-not-expressible", is_flag=True, help="Exit with 2 if a language cannot express a tree.")
@click.option("--fail-on-too-large", is_flag=True, help="Exit with 2 if a limit was exceeded.")
@click.option("--fail-on-vacuous", is_flag=True, help="Exit with 2 if a comparison has no detection.")
@click.option("--fail-on-timeout", is_flag=True, help="Exit with 2 after a timeout.")
def cross_check_command(
    *,
    trees: tuple[str, ...],
    against: tuple[str, ...],
    random: int | None,
    **given: Any,
) -> int:
    """Compare the reference, the engine and all faithful backends: on each TREE, or on a catalogue
    of trees. Of the catalogue, each tree is compared under one semantics; `--semantics all` takes all.

    Agreement is proved on all traces if possible, otherwise tested; the output states which. A
    comparison without any detection is vacuous and no agreement. The exit status is 1 for
    disagreements, 2 if something could not be read or run, or nothing was compared.
    """
    cases, limit, semantics, timeout = (given[name] for name in ("replay", "limit", "semantics", "timeout"))
    part = {name: given[name] for name in ("branch", "kind")}
    narrow = any(one is not None for one in part.values())
    options.exclusive(random=random, replay=cases)
    # Specifications after the first FILE of --against are recognised by their names.
    texts = [tree for tree in trees if is_specification(tree)] if against else []
    trees = tuple(dict.fromkeys(tree for tree in trees if tree not in texts))
    files = {form: given[form] for form in _FORMATS if given[form] is not None}
    alone = random is not None or cases is not None
    options.refuse(alone and (trees or narrow), "--random and --replay bring their own trees")
    options.refuse(narrow and not trees, "--branch and --kind need a TREE")
    options.refuse(against and not trees, "--against needs a TREE to compare with")
    options.refuse(cases and semantics, "a saved case has its semantics: leave --semantics out with --replay")
    options.require_writable(files.values(), trees)
    collected = Reports(files, every=bool(trees))
    failures = collected.failures
    patience, run_c = timeout or PATIENCE, given["run_c"]
    read = partial(handwritten, seconds=patience, run_c=run_c, confined=options.is_confined())
    roster = Roster(
        options.some_backends(given["backends"]),
        tuple(failures.collect(read, [*against, *texts])),
        rml_monitor=None if given["rml_monitor"] is None else Path(given["rml_monitor"]),
        mona=given["mona"],
        monpoly=None if given["monpoly"] is None else Path(given["monpoly"]),
        r2u2=None if given["r2u2"] is None else Path(given["r2u2"]),
        flink=given["flink"],
        verified=on_path() if given["verified"] is None else Path(given["verified"]),
        patience=patience,
        run_c=run_c,
        limit=SMALL_TEXT if limit is None and random is not None else limit,
    )
    if roster.backends is None and not against:
        for name, error in missing_extras().items():
            click.echo(inert(visible(f"{name} takes no part: {error}")), err=True)
    if cases is not None:
        collected.replay(cases, roster)
        return FAILED if failures.met else exit_status(collected.results)
    if roster.backends is None and not roster.against:
        roster = replace(roster, backends=faithful_backends())  # once for all comparisons
    entries: Iterable[Entry]
    if random is not None:
        entries, count = campaign(random, given["seed"], given["max_nodes"]), random
        effort = RANDOM
    elif trees:
        entries = found = list(failures.collect(partial(_entry, **part), trees))
        if not found and not failures.met:
            click.echo("nothing to compare: these files only declare what trees import")
            return 0
        count, effort = len(found), AGAINST if against else ONE_TREE
    else:
        entries = found = list(catalogue())
        count, effort = len(found), CATALOGUE
    if against and not roster.against:  # no readable specification is left
        entries, count = [], 0
    chosen_effort = {name: given[name] for name in ("traces", "states", "length") if given[name] is not None}
    effort = replace(effort, seed=str(given["seed"]), seconds=timeout or effort.seconds, **chosen_effort)
    turns = not (trees or against or random or semantics)
    chosen = semantics or (() if against or turns else tuple(Semantics))
    tasks = _tasks(
        in_turn(entries) if turns else _pairs(entries, chosen),
        _rosters(roster, named=given["backends"] is not None) if turns else repeat(roster),
        effort,
    )
    every = len(chosen) or 1
    jobs = given["jobs"] or (1 if roster.flink else os.cpu_count() or 1)  # Flink starts slowly
    running = run(tasks, jobs=jobs, together=1 if trees else every)
    collected.compare(running, count * every, bogus=given["save_bogus"], stop=given["stop_on_error"])
    fails = (Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT, Status.VACUOUS)
    failing_statuses = {status for status in fails if given[f"fail_on_{status.name.lower()}"]}
    return (
        FAILED if failures.met else exit_status(collected.results, failing=failing_statuses, vacuous=random is not None)
    )


def _pairs(entries: Iterable[Entry], chosen: Collection[Semantics]) -> Iterator[tuple[Entry, Semantics]]:
    """Yield each tree with the chosen semantics, or with its own."""
    return ((entry, one) for entry in entries for one in chosen or [resolve_semantics(entry.tree)])


def _tasks(pairs: Iterable[tuple[Entry, Semantics]], rosters: Iterable[Roster], effort: Effort) -> Iterator[Task]:
    for (entry, semantics), roster in zip(pairs, rosters, strict=False):
        yield Task(entry.tree, Job(entry.name, semantics, entry.branch, entry.kind), roster, effort)


def _rosters(roster: Roster, *, named: bool) -> Iterator[Roster]:
    """Return the participants of each comparison in turn; `named` backends are in all of them.

    C takes part in few if compiling its texts would take longer than all else; a line says so.
    """
    backends = roster.backends or ()
    if named or "c" not in backends or compiles_at_once():
        return repeat(roster)
    click.echo(f"c takes part in one of {ONE_IN} comparisons: without tcc, to compile takes long", err=True)
    without = replace(roster, backends=tuple(name for name in backends if name != "c"))
    return cycle([roster, *repeat(without, ONE_IN - 1)])


def _entry(path: str, branch: int | None, kind: Kind | None) -> Entry:
    tree = options.load_tree(path)
    valid_part(tree, branch, kind)  # raises for invalid trees and parts
    return Entry(click.format_filename(path), tree, branch, kind)
