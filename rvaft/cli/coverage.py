"""`rvaft coverage`: the branches that logs exercise, and the progress in the other branches."""

import shutil
import sys
from typing import Any, BinaryIO, Final, cast

import click

from rvaft.cli import FAILED, FOUND, Failures, log_options, options, warn
from rvaft.core.fields_to_read import TreeReads
from rvaft.coverage import DEFAULT_BRANCHES, Coverage, json_text, table_text
from rvaft.monitors import DEFAULT_LIMIT
from rvaft.readers.json_lines import JsonLinesReader
from rvaft.readers.log import Interest, Log, expanded
from rvaft.stream.detection import identifying_fields

_NARROWEST: Final = 60
_CONFIGURATIONS: Final = "Maximum number of partial matches per branch."


@click.command("coverage")
@options.tree_argument
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@options.semantics_option
@options.part_options
@options.number("--limit", default=DEFAULT_BRANCHES, text="Maximum number of branches.")
@click.option(
    "--fail-under",
    type=click.FloatRange(0, 100),
    callback=options.finite,
    metavar="PERCENT",
    help="Exit with status 1 if a smaller share of the branches is exercised.",
)
@options.number("--max-configurations", "configurations", default=DEFAULT_LIMIT, text=_CONFIGURATIONS)
@log_options.log_format
@log_options.strict_json
@options.output_format("text", "json")
def coverage_command(
    *,
    tree: str,
    logs: tuple[str, ...],
    fail_under: float | None,
    log_format: log_options.LogFormat,
    strict_json: bool,
    form: str,
    **chosen: Any,
) -> int:
    """Report which branches of a tree the LOGs detect, and how far they progress in the others.

    Each LOG is a file in JSON Lines or the format given by its suffix or --input. Use - for
    standard input; quote a pattern such as 'runs/*.jsonl' to read all matching files.
    """
    whole = options.load_tree(tree)
    coverage = Coverage(whole, **chosen)
    failures = Failures()
    files = [file for some in failures.collect(expanded, logs) for file in some]
    for file, reader in zip(files, log_format.readers(files), strict=True):
        with failures.reported(), log_options.opened(reader, file) as (source, name):
            if isinstance(reader, JsonLinesReader):
                coverage.add(name, cast("BinaryIO", source), strict_json=strict_json)
                continue
            reads = TreeReads(whole)
            log = Log(reader, source, name, reads, strict_json, interest=Interest.of(reads, identifying_fields(whole)))
            coverage.add(name, (event for event in log.events() if event is not None))
            if log.is_malformed(log.given) and log.fault is not None:
                raise log.fault
            if log.fault is not None:
                warn(str(log.fault))
    found = coverage.report()
    # fit the table to the terminal; do not cut piped output
    width = max(shutil.get_terminal_size((80, 24)).columns, _NARROWEST) if sys.stdout.isatty() else None
    sys.stdout.write(json_text(found) if form == "json" else table_text(found, width=width))
    low = fail_under is not None and 100 * found.exercised < fail_under * len(found.branches)
    return FAILED if failures.met else FOUND if low else 0
