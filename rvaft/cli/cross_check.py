"""`rvaft cross-check`: whether the specifications of a tree say the same thing."""

import os
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import click

from cross_check.against import handwritten, is_specification
from cross_check.campaign import MAX_NODES, campaign
from cross_check.catalogue import EFFORT, Entry, catalogue
from cross_check.effort import Effort
from cross_check.results import Job, exit_status
from cross_check.roster import PATIENCE, Roster
from cross_check.runs import Task
from rvaft.api import narrowed
from rvaft.cli.comparing import Failures, Watching, replayed
from rvaft.cli.failure import FAILED
from rvaft.cli.lists import finite, some_backends, some_semantics
from rvaft.cli.options import exclusive, part_options
from rvaft.cli.reports import Reports, report_options
from rvaft.language import load
from rvaft.model import Kind
from rvaft.verdict import Semantics

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
def command(
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
    failures = Failures()
    roster = Roster(
        some_backends(backends),
        tuple(failures.collect(handwritten, texts)),
        rml_monitor=None if rml_monitor is None else Path(rml_monitor),
        mona=mona,
        patience=timeout or PATIENCE,
        limit=SMALL_TEXT if limit is None and random is not None else limit,
    )
    if replay_folder is not None:
        return replayed(Path(replay_folder), roster, reports)
    entries: Iterable[Entry]
    if trees:
        part = partial(_entry, branch=branch, kind=None if kind is None else Kind(kind))
        found = list(failures.collect(part, trees))
        entries, count, effort = (
            found,
            len(found),
            Effort(states=states, traces=MOST_TRACES if against else MANY_TRACES),
        )
    elif random is not None:
        entries, count = campaign(random, seed, max_nodes), random
        effort = Effort(states=min(states, SMALL_PROOF), words=0)
    else:
        gates = list(catalogue())
        entries, count, effort = gates, len(gates), replace(EFFORT, states=states)
    if against and not roster.against:  # nothing that could be read is left to compare
        entries, count = (), 0
    effort = replace(effort, length=length, seconds=timeout, seed=str(seed))
    effort = effort if traces is None else replace(effort, traces=traces)
    chosen = semantics or ((Semantics.PROJECTED,) if against else tuple(Semantics))
    tasks = (Task(e.tree, Job(e.name, s, e.branch, e.kind), roster, effort) for e in entries for s in chosen)
    watching = Watching(reports, failures, stop_on_error, None if save_bogus is None else Path(save_bogus))
    watching.run(tasks, count * len(chosen), jobs or os.cpu_count() or 1)
    status = exit_status(
        reports.results,
        fail_on_not_expressible=fail_on_not_expressible,
        fail_on_too_large=fail_on_too_large,
        fail_on_timeout=fail_on_timeout,
    )
    return FAILED if failures.met else status


def _sorted_out(against: tuple[str, ...], trees: tuple[str, ...]) -> tuple[list[str], tuple[str, ...]]:
    """The specifications and the trees: what follows the first FILE of --against is a specification too, where its name says so."""
    texts = [tree for tree in trees if is_specification(tree)] if against else []
    return [*against, *texts], tuple(dict.fromkeys(tree for tree in trees if tree not in texts))


def _entry(path: str, branch: int | None, kind: Kind | None) -> Entry:
    tree = load(path)
    narrowed(tree, branch, kind)  # refuses what breaks a rule, and a part that is not there
    return Entry(click.format_filename(path), tree, branch, kind)
