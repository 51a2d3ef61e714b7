"""`rvaft coverage`: which branches some logs exercise, and how far they come in the others."""

import shutil
import sys
from typing import Final

import click

from rvaft.analysis.pattern_index import TreeReads
from rvaft.api import load
from rvaft.cli import FAILED, FOUND, options, report
from rvaft.coverage import DEFAULT_BRANCHES, Coverage, json_text, table_text
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import RvaftError
from rvaft.monitoring.reader import expanded, read

_NARROWEST: Final = 60
"""Columns below which the table is not made narrower."""


@click.command("coverage")
@options.tree_argument
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@options.semantics_option
@options.part_options
@options.number("--limit", default=DEFAULT_BRANCHES, text="The most branches to look at.")
@click.option(
    "--fail-under",
    type=click.FloatRange(0, 100),
    callback=options.finite("percentage"),
    metavar="PERCENT",
    help="Exit with 1 if fewer of the branches are exercised.",
)
@options.number("--max-configurations", default=DEFAULT_LIMIT, text="Partial matches that are followed in each branch.")
@options.output_format("text", "json")
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
    whole = load(tree)
    coverage = Coverage(whole, semantics, branch=branch, kind=kind, limit=limit, configurations=max_configurations)
    status = 0
    for pattern in logs:
        try:
            files = list(expanded(pattern))
        except OSError as error:
            report(error)
            status = FAILED
            continue
        for log in files:  # what cannot be read is reported and left out
            try:
                source, name = (
                    (options.standard_input("LOG"), "<stdin>") if log == "-" else (log, click.format_filename(log))
                )
                coverage.add(name, read(source, name=name if log == "-" else None, reads=TreeReads(whole)))
            except (RvaftError, OSError) as error:
                report(error)
                status = FAILED
    found = coverage.report()
    # A terminal has so many columns; what is piped keeps whole lines.
    width = max(shutil.get_terminal_size((80, 24)).columns, _NARROWEST) if sys.stdout.isatty() else None
    sys.stdout.write(json_text(found) if form == "json" else table_text(found, width=width))
    low = fail_under is not None and 100 * found.exercised < fail_under * len(found.branches)
    return max(status, FOUND if low else 0)
