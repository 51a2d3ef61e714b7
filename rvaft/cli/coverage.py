"""`rvaft coverage`: which branches some logs exercise, and how far they come in the others."""

import math
import shutil
import sys
from collections.abc import Iterator

import click

from rvaft.analysis.pattern_index import TreeReads
from rvaft.api import load
from rvaft.cli.failure import FAILED, FOUND, report
from rvaft.cli.options import exclusive, part_options, semantics_option, standard_input, tree_argument
from rvaft.coverage import DEFAULT_BRANCHES, Coverage, json_text, table_text
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import RvaftError
from rvaft.model.tree import RVAFT
from rvaft.monitoring.reader import expanded, read

_NARROWEST = 60
"""Columns below which the table is not made narrower."""


def _number(_context: click.Context, _parameter: click.Parameter, value: float | None) -> float | None:
    """Refuse NaN, which is in every range, since no comparison with it holds."""
    if value is not None and math.isnan(value):
        raise click.BadParameter(f"{value} is no percentage")
    return value


@click.command("coverage")
@tree_argument
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@semantics_option
@part_options
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    default=DEFAULT_BRANCHES,
    show_default=True,
    metavar="N",
    help="The most branches to look at.",
)
@click.option(
    "--fail-under",
    type=click.FloatRange(0, 100),
    callback=_number,
    metavar="PERCENT",
    help="Exit with 1 if fewer of the branches are exercised.",
)
@click.option(
    "--max-configurations",
    type=click.IntRange(min=1),
    default=DEFAULT_LIMIT,
    show_default=True,
    metavar="N",
    help="Partial matches that are followed in each branch.",
)
@click.option(
    "--format", "form", type=click.Choice(["text", "json"]), default="text", show_default=True, help="What to print."
)
def coverage_command(
    *,
    tree: str,
    logs: tuple[str, ...],
    semantics: str,
    branch: int | None,
    kind: str | None,
    limit: int,
    fail_under: float | None,
    max_configurations: int,
    form: str,
) -> int:
    """Say which branches of a tree some LOG detects, and how far the logs came in the others.

    A LOG is as for `monitor`: JSON Lines, compressed or not; - is standard input, and a pattern such as 'runs/*.jsonl' stands for the
    files that match it.
    """
    exclusive(branch=branch, kind=kind)
    whole = load(tree)
    coverage = Coverage(whole, semantics, branch=branch, kind=kind, limit=limit, configurations=max_configurations)
    status = max([_add(coverage, whole, log) for log in _names(logs)], default=0)
    found = coverage.report()
    sys.stdout.write(json_text(found) if form == "json" else table_text(found, width=_width()))
    low = fail_under is not None and 100 * found.exercised < fail_under * len(found.branches)
    return max(status, FOUND if low else 0)


def _names(logs: tuple[str, ...]) -> Iterator[str | OSError]:
    """The names of all logs in turn; for a pattern that stands for nothing the error."""
    for log in logs:
        try:
            yield from expanded(log)
        except OSError as error:
            yield error


def _add(coverage: Coverage, tree: RVAFT, log: str | OSError) -> int:
    """Count one log; one that cannot be read is reported and left out."""
    try:
        if isinstance(log, OSError):
            raise log
        if log == "-":
            coverage.add("<stdin>", read(standard_input("LOG"), name="<stdin>", reads=TreeReads(tree)))
        else:
            coverage.add(click.format_filename(log), read(log, reads=TreeReads(tree)))
    except (RvaftError, OSError) as error:
        report(error)
        return FAILED
    return 0


def _width() -> int | None:
    """The columns of a terminal; what is piped keeps whole lines."""
    return max(shutil.get_terminal_size((80, 24)).columns, _NARROWEST) if sys.stdout.isatty() else None
