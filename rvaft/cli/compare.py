"""`rvaft compare`: sizes and speeds of the same trees in every specification language."""

import fcntl
import os
import stat
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from errno import EACCES, EISDIR, ENOTDIR, EWOULDBLOCK
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

import click

from cross_check.benchmark.measurement import Row, empty_row, measured
from cross_check.benchmark.plan import (
    MAX_ARITY,
    MEMORY,
    TIMEOUT,
    Cell,
    Settings,
    Subject,
    cells_of,
    default_languages,
    gate_subjects,
)
from cross_check.benchmark.plots import figures, library, write_plots
from cross_check.benchmark.tables import Width, csv_text, headline, latex_text, read_rows, text_lines
from rvaft.api import load, narrowed
from rvaft.backend import backend
from rvaft.cli.cross_check import Failures, Watched
from rvaft.cli.failure import FAILED, FOUND, INTERRUPTED, Stopped, report
from rvaft.cli.options import finite, some_backends, some_gates, some_semantics
from rvaft.errors import OptionError
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from rvaft.support.files import deliver, write_whole

# Where the reports of a comparison go: what cannot be written at the end, or would cost what is there, is refused before anything runs.


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files and the folder that were asked for; `-` is standard output."""

    csv: str | None
    latex: str | None
    plots: str | None

    @property
    def files(self) -> list[str]:
        """Those that are no standard output."""
        return [file for file in (self.csv, self.latex) if file not in (None, "-")]

    def check(self, trees: Iterable[str]) -> None:
        """Raise `OptionError` for two reports in one place or one over a tree, `OSError` for what cannot be written, `ToolMissing`."""
        taken = {Path(tree).resolve() for tree in trees}
        for file in self.files:
            if (place := Path(file).resolve()) in taken:
                raise OptionError(f"{file} would be written over, but it is one of the trees: name another file")
            if Path(file).is_dir():
                raise IsADirectoryError(EISDIR, "cannot write: it is a folder; name a file", file)
            if place.is_file() or not Path(file).exists():  # a pipe or a device is written to where it is
                _check_folder(place.parent, file)
        if self.csv is not None and self.latex is not None and _same(self.csv, self.latex):
            raise OptionError("two reports go to one file")
        if self.plots is not None:
            library()
            folder = Path(self.plots).resolve()
            _check_folder(next(there for there in (folder, *folder.parents) if there.exists()), self.plots)


def _same(first: str, second: str) -> bool:
    return first == second or ("-" not in (first, second) and Path(first).resolve() == Path(second).resolve())


def _check_folder(folder: Path, output: str) -> None:
    if not folder.is_dir():
        raise NotADirectoryError(ENOTDIR, f"cannot write: {folder} is no folder", output)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(EACCES, f"cannot write: no permission for {folder}", output)


# The CSV file of a comparison: every row is in it as soon as it is known, so that an interrupted run can go on.

_ERRORS = "surrogateescape"
"""Names of files need not be UTF-8."""


class KeptRows:
    """The rows that the file has from before, with `resume`, and those that are added; None is no file.

    What is no regular file is only written to at the end. Entering it raises `OSError`, also where another run is writing to the file, and
    `LanguageError` for a file with something else than a comparison in it, which nobody wants to lose.
    """

    def __init__(self, file: str | None, *, resume: bool = False) -> None:
        self._file = file
        self._resume = resume
        self._appended: TextIO | None = None
        path = None if file is None or file == "-" else Path(file)
        self._path = None if path is not None and path.exists() and not stat.S_ISREG(path.stat().st_mode) else path
        self._before: list[Row] = []
        self._of: dict[tuple[object, ...], list[Row]] = {}
        """Those from before by their keys."""

    def __enter__(self) -> Self:
        if self._path is not None:
            with _locked(self._path) as stream:
                found = list(read_rows(stream.read(), str(self._path)))
                self._before = found if self._resume else []
                for row in self._before:
                    self._of.setdefault(row.key, []).append(row)
                write_whole(self._path, _encoded(self._before))  # without a last line that was only begun
                self._appended = _locked(self._path)  # which is another file now, of the same name
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._appended is not None:
            self._appended.close()

    def known(self, wanted: Row) -> Row | None:
        """The row from before that answers for one, if there is one; the last where there are several."""
        return next((row for row in reversed(self._of.get(wanted.key, ())) if row.serves(wanted)), None)

    def add(self, row: Row) -> None:
        """Keep a row, whatever happens next."""
        if self._appended is not None:
            self._appended.write(csv_text([row], heading=False))
            self._appended.flush()

    def finish(self, rows: Iterable[Row]) -> None:
        """Write these rows in this order, and behind them those from before that no other stands for."""
        every = list(rows)
        if self._path is not None:
            fresh = {row.key for row in every}
            write_whole(self._path, _encoded([*every, *(row for row in self._before if row.key not in fresh)]))
        elif self._file is not None:
            deliver(_encoded(every), self._file)


def _encoded(rows: Iterable[Row]) -> bytes:
    return csv_text(rows).encode(errors=_ERRORS)


def _locked(path: Path) -> TextIO:
    """The file, open to be read from its start and appended to, and locked until it is closed."""
    try:
        stream = path.open("a+", encoding="utf-8", errors=_ERRORS, newline="")
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(path)) from error
    held = True
    with suppress(OSError):  # a file system that knows no locks
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            held = False
    if not held or not os.path.samestat(os.fstat(stream.fileno()), path.stat()):  # or it was replaced just now
        stream.close()
        raise BlockingIOError(EWOULDBLOCK, "cannot write: another run is writing to it; name another file", str(path))
    stream.seek(0)
    return stream


@click.command("compare")
@click.argument("trees", nargs=-1, metavar="[TREE]...")
@click.option(
    "--gates", callback=some_gates, metavar="and,or,...", help="These gates; without a TREE all are compared."
)
@click.option(
    "--max-arity",
    type=click.IntRange(min=1),
    default=MAX_ARITY,
    show_default=True,
    metavar="N",
    help="Gates with 1 to N children, VOT with every threshold.",
)
@click.option("--semantics", callback=some_semantics, metavar="S,...|all", help="Default: projected.")
@click.option("--languages", metavar="A,B", help="These backends.  [default: rml-paper and all faithful ones]")
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Of translations, in the language's own unit.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, max=1_000_000, min_open=True),
    callback=finite,
    default=TIMEOUT,
    show_default=True,
    metavar="SECONDS",
    help="Of the processor, for one tree in one language.",
)
@click.option(
    "--memory",
    type=click.IntRange(min=1, max=2**40),
    default=MEMORY,
    show_default=True,
    metavar="MB",
    help="For one tree in one language; needing more is `too large`.",
)
@click.option("--csv", metavar="FILE", help="Keep all measurements in this file while they are made.")
@click.option("--resume", is_flag=True, help="Go on with what the CSV file has.")
@click.option("--latex", metavar="FILE", help="Write the measurements as LaTeX tables.")
@click.option("--plots", metavar="DIR", help="Write figures, each as PDF and PNG (needs Matplotlib).")
@click.option(
    "--width",
    type=click.Choice([width.value for width in Width]),
    help="Of tables and figures; only with --latex or --plots.  [default: page]",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Processes at a time; more than one disturb each other's times.",
)
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="Of the events that are run.")
def compare_command(
    *,
    trees: tuple[str, ...],
    gates: tuple[Gate, ...] | None,
    max_arity: int,
    semantics: tuple[Semantics, ...] | None,
    languages: str | None,
    limit: int | None,
    timeout: float,
    memory: int,
    csv: str | None,
    resume: bool,
    latex: str | None,
    plots: str | None,
    width: str | None,
    jobs: int,
    seed: int,
) -> int:
    """Compare specification languages: how large the same TREE is in each, how long it takes to translate, how fast it runs.

    Without a TREE all gates are compared, each with 1 to N children.
    """
    context = click.get_current_context()
    if resume and csv in (None, "-"):
        raise click.UsageError("--resume goes on with a file: name it with --csv", context)
    if width is not None and latex is None and plots is None:
        raise click.UsageError("--width is that of tables and figures: ask for some with --latex or --plots", context)
    failures = Failures()
    subjects = list(failures.collect(_subject, dict.fromkeys(trees)))
    chosen = gates if gates is not None else () if trees else tuple(Gate)
    subjects += gate_subjects(chosen, max_arity)
    if failures.met and not subjects:
        return FAILED
    try:
        Outputs(csv, latex, plots).check(trees)
        spoken = some_backends(languages)
        cells = cells_of(
            subjects, semantics or (Semantics.PROJECTED,), default_languages() if spoken is None else spoken
        )
    except OptionError as error:
        raise click.UsageError(str(error), context) from error
    settings = Settings(limit, timeout, seed, memory)
    rows = _measured(cells, settings, KeptRows(csv, resume=resume), jobs)
    if "-" not in (csv, latex):
        click.echo("\n".join([*text_lines(rows), headline(rows)]))
    if len(rows) < len(cells):
        again = "" if csv is None else "; go on with --resume"
        click.echo(f"interrupted after {len(rows)} of {len(cells)} measurements{again}", err=True)
        raise Stopped(INTERRUPTED)
    if latex is not None:
        deliver(latex_text(rows, Width(width or Width.PAGE)).encode(errors="backslashreplace"), latex)
    if plots is not None:
        failures.met |= not _drawn(rows, Path(plots), Width(width or Width.PAGE))
    return FAILED if failures.met else _status(rows)


def _subject(path: str) -> Subject:
    tree = load(path)
    narrowed(tree)  # refuses what breaks a rule
    return Subject(click.format_filename(path), tree)


def _drawn(rows: Sequence[Row], folder: Path, width: Width) -> bool:
    """Draw the figures; False, and a line that says so, where there are none."""
    if any(True for _ in figures(rows)):
        write_plots(rows, folder, width)
        return True
    report(click.ClickException("no figures: nothing that was compared has a size or a speed"))
    return False


def _measured(cells: Sequence[Cell], settings: Settings, kept: KeptRows, jobs: int) -> list[Row]:
    """The rows in the order of the cells; fewer where the run was interrupted."""
    with kept:
        rows = {cell: row for cell in cells if (row := kept.known(empty_row(cell, settings))) is not None}
        missing = [cell for cell in cells if cell not in rows]
        try:
            with Watched(len(missing)) as watched, closing(measured(missing, settings, jobs=jobs)) as running:
                for cell, row in running:
                    kept.add(row)
                    rows[cell] = row
                    watched.advance()
        except KeyboardInterrupt:
            pass  # told by the caller, after all that is known is written
        found = [rows[cell] for cell in cells if cell in rows]
        kept.finish(found)
    return found


def _status(rows: Sequence[Row]) -> int:
    if any(outcome is not None and outcome.broken for row in rows for outcome in (row.result, row.run)):
        return FAILED
    differing = {row.language for row in rows if row.differing}
    return FOUND if any(backend(language).faithful for language in differing) else 0
