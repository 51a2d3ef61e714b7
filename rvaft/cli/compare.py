"""`rvaft compare`: sizes and speeds of the same trees in every specification language."""

import os
from collections.abc import Iterable, Sequence
from contextlib import closing
from errno import EACCES, EISDIR, ENOTDIR
from pathlib import Path

import click

from cross_check.benchmark.measurement import (
    MAX_ARITY,
    Cell,
    Measurement,
    Settings,
    Subject,
    cells_of,
    default_languages,
    gate_subjects,
    measured,
    unmeasured,
)
from cross_check.benchmark.plots import figures, library, write_plots
from cross_check.benchmark.tables import KeptMeasurements, Width, headline, latex_text, pandas, text_lines
from rvaft.api import load, narrowed
from rvaft.backend import backend
from rvaft.cli import FAILED, FOUND, INTERRUPTED, Failures, Stopped, options, report
from rvaft.cli.cross_check import progress
from rvaft.errors import OptionError
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from rvaft.support.files import deliver


@click.command("compare")
@click.argument("trees", nargs=-1, metavar="[TREE]...")
@click.option(
    "--gates", callback=options.some_gates, metavar="and,or,...", help="These gates; without a TREE all are compared."
)
@click.option(
    "--max-arity",
    type=click.IntRange(min=1),
    default=MAX_ARITY,
    show_default=True,
    metavar="N",
    help="Gates with 1 to N children, VOT with every threshold.",
)
@click.option("--semantics", callback=options.some_semantics, metavar="S,...|all", help="Default: projected.")
@click.option("--languages", metavar="A,B", help="These backends.  [default: rml-paper and all faithful ones]")
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Of translations, in the language's own unit.")
@options.timeout_option("Of the processor, for one tree in one language.", default=Settings().timeout)
@click.option(
    "--memory",
    type=click.IntRange(min=1, max=2**40),
    default=Settings().memory,
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
    if resume and csv in (None, "-"):
        raise click.UsageError("--resume goes on with a file: name it with --csv")
    if width is not None and latex is None and plots is None:
        raise click.UsageError("--width is that of tables and figures: ask for some with --latex or --plots")
    failures = Failures()
    subjects = list(failures.collect(_subject, dict.fromkeys(trees)))
    subjects += gate_subjects(gates if gates is not None else () if trees else tuple(Gate), max_arity)
    if failures.met and not subjects:
        return FAILED
    try:
        _check_outputs(trees, csv, latex, plots)
        spoken = options.some_backends(languages)
        spoken = default_languages() if spoken is None else spoken
        cells = cells_of(subjects, semantics or (Semantics.PROJECTED,), spoken)
    except OptionError as error:
        raise click.UsageError(str(error)) from error
    rows = _measured(cells, Settings(limit, timeout, seed, memory), KeptMeasurements(csv, resume=resume), jobs)
    if "-" not in (csv, latex):
        click.echo("\n".join([*text_lines(rows), headline(rows)]))
    if len(rows) < len(cells):
        again = "" if csv is None else "; go on with --resume"
        click.echo(f"interrupted after {len(rows)} of {len(cells)} measurements{again}", err=True)
        raise Stopped(INTERRUPTED)
    chosen = Width(width or Width.PAGE)
    if latex is not None:
        deliver(latex_text(rows, chosen).encode(errors="backslashreplace"), latex)
    if plots is not None and any(figures(rows)):
        write_plots(rows, Path(plots), chosen)
    elif plots is not None:
        report(click.ClickException("no figures: nothing that was compared has a size or a speed"))
        failures.met = True
    if failures.met or any(one is not None and one.broken for row in rows for one in (row.result, row.run)):
        return FAILED
    return (
        FOUND if any(backend(language).faithful for language in {row.language for row in rows if row.differing}) else 0
    )


def _subject(path: str) -> Subject:
    tree = load(path)
    narrowed(tree)  # refuses what breaks a rule
    return Subject(click.format_filename(path), tree)


def _measured(cells: Sequence[Cell], settings: Settings, kept: KeptMeasurements, jobs: int) -> list[Measurement]:
    """The measurements in the order of the cells; fewer where the run was interrupted."""
    rows = {cell: row for cell in cells if (row := kept.known(unmeasured(cell, settings))) is not None}
    missing = [cell for cell in cells if cell not in rows]
    try:
        with progress(len(missing)) as advance, closing(measured(missing, settings, jobs=jobs)) as running:
            for cell, row in running:
                kept.add(row)
                rows[cell] = row
                advance()
    except KeyboardInterrupt:
        pass  # told by the caller, after all that is known is written
    found = [rows[cell] for cell in cells if cell in rows]
    kept.finish(found)
    return found


def _check_outputs(trees: Iterable[str], csv: str | None, latex: str | None, plots: str | None) -> None:
    """Refuse what cannot be written at the end, or would cost what is there, before anything runs.

    Raises `OptionError` for two reports in one place or one over a tree, `OSError` for what cannot be written, `ToolMissing`.
    """
    taken = {Path(tree).resolve() for tree in trees}
    places = {file: Path(file).resolve() for file in (csv, latex) if file is not None and file != "-"}
    if csv is not None and latex is not None and (csv == latex or len({*places.values()}) < len(places)):
        raise OptionError("two reports go to one file")
    for file, place in places.items():
        if place in taken:
            raise OptionError(f"{file} would be written over, but it is one of the trees: name another file")
        if place.is_dir():
            raise IsADirectoryError(EISDIR, "cannot write: it is a folder; name a file", file)
        if place.is_file() or not place.exists():  # a pipe or a device is written to where it is
            _check_folder(place.parent, file)
    if latex is not None:
        pandas()
    if plots is not None:
        library()
        folder = Path(plots).resolve()
        _check_folder(next(there for there in (folder, *folder.parents) if there.exists()), plots)


def _check_folder(folder: Path, output: str) -> None:
    if not folder.is_dir():
        raise NotADirectoryError(ENOTDIR, f"cannot write: {folder} is no folder", output)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(EACCES, f"cannot write: no permission for {folder}", output)
