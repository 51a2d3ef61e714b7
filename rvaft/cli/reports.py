"""What `rvaft cross-check` prints while it runs and at the end, and the files it writes."""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from errno import ENOTDIR
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

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
from cross_check.results import Result, Status
from rvaft.cli.output import deliver
from rvaft.printable import visible

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


@dataclass(slots=True)
class Reports:
    """Collects results; `every` says whether each is listed or only counted."""

    files: dict[str, str]
    every: bool
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
