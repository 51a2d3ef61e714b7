"""`rvaft compare`: sizes and speeds of the same trees in specification languages."""

from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, Final

import click

from cross_check.commands.cross_check import progress
from papers.languages import plots as drawing
from papers.languages.measurement import (
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
from papers.languages.tables import Width, csv_text, headline, latex_text, pandas, read_rows, text_lines
from rvaft.backend import backend
from rvaft.cli import FAILED, FOUND, INTERRUPTED, Failures, Stopped, options, report
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from rvaft.rules.validity import valid_part
from rvaft.support.files import deliver, write_whole

_GATES: Final = "Compare these gates.  [default: all, without a TREE]"
_MEMORY: Final = "Memory for one tree in one language; beyond it the result is `too large`."
_SEMANTICS: Final = "Default: what each tree states, or projected."
_WIDTH: Final = "Width of tables and figures, with --latex or --plots.  [default: page]"


@click.command("compare")
@click.argument("trees", nargs=-1, metavar="[TREE]...")
@click.option("--gates", callback=options.some(Gate), metavar="and,or,...", help=_GATES)
@options.reading_options
@options.number("--max-arity", default=MAX_ARITY, text="Compare gates with 1 to N children, VOT with every threshold.")
@click.option("--semantics", callback=options.some(Semantics), metavar="S,...|all", help=_SEMANTICS)
@click.option(
    "--languages", metavar="A,B", help="Compare these backends.  [default: rml-paper and one form of each faithful one]"
)
@options.number("--limit", text="Limit of translations, in the unit of the backend.")
@options.timeout_option("CPU seconds for one tree in one language.", default=Settings().timeout)
@options.number("--memory", most=2**40, default=Settings().memory, metavar="MB", text=_MEMORY)
@click.option("--csv", metavar="FILE", help="Write each measurement to this file as it is made.")
@click.option("--resume", is_flag=True, help="Continue from the CSV file.")
@click.option("--latex", metavar="FILE", help="Write the measurements as LaTeX tables.")
@click.option("--plots", metavar="DIR", help="Write figures, each as PDF and PNG (needs Matplotlib).")
@options.choice("--width", words=Width, text=_WIDTH)
@options.number("--jobs", default=1, text="Number of processes; more than one disturb each other's times.")
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="Seed of the events.")
def compare_command(
    *,
    trees: tuple[str, ...],
    csv: str | None,
    resume: bool,
    latex: str | None,
    plots: str | None,
    width: Width | None,
    **given: Any,
) -> int:
    """Compare specification languages: the size of each TREE in each, and the times of translation
    and monitoring.

    Without a TREE, all gates are compared, each with 1 to N children.
    """
    options.refuse(resume and csv in (None, "-"), "--resume needs a file: name it with --csv")
    nothing = width is not None and latex is None and plots is None
    options.refuse(nothing, "--width needs --latex or --plots")
    failures = Failures()
    subject = lambda path: Subject(click.format_filename(path), valid_part(options.load_tree(path)))  # noqa: E731
    subjects = list(failures.collect(subject, dict.fromkeys(trees)))
    gates = (() if trees else tuple(Gate)) if given["gates"] is None else given["gates"]
    subjects += gate_subjects(gates, given["max_arity"])
    if failures.met and not subjects:
        return FAILED
    options.require_writable([one for one in (csv, latex) if one is not None], trees, plots)
    if latex is not None:
        pandas()
    if plots is not None:
        drawing.library(", or leave --plots out")
    spoken = options.some_backends(given["languages"])
    spoken = default_languages() if spoken is None else spoken
    cells = cells_of(subjects, given["semantics"], spoken)
    settings = Settings(given["limit"], given["timeout"], given["seed"], given["memory"])
    rows = _measured(cells, settings, csv, resume=resume, jobs=given["jobs"])
    if "-" not in (csv, latex):
        click.echo("\n".join([*text_lines(rows), headline(rows)]))
    if len(rows) < len(cells):
        again = "" if csv is None else "; go on with --resume"
        click.echo(f"interrupted after {len(rows)} of {len(cells)} measurements{again}", err=True)
        raise Stopped(INTERRUPTED)
    chosen = width or Width.PAGE
    if latex is not None:
        deliver(latex_text(rows, chosen).encode(errors="backslashreplace"), latex)
    if plots is not None:
        files = dict(drawing.plots(rows, chosen))
        for name, data in files.items():
            Path(plots).mkdir(parents=True, exist_ok=True)
            write_whole(Path(plots, name), data, follow=False)
        if not files:
            report(click.ClickException("no figures: no measurement has a size or a speed"))
            failures.met = True
    if failures.met or any(row.broken for row in rows):
        return FAILED
    return FOUND if any(row.differing and backend(row.language).faithful for row in rows) else 0


def _measured(
    cells: Sequence[Cell], settings: Settings, csv: str | None, *, resume: bool, jobs: int
) -> list[Measurement]:
    """Return the measurements in the order of the cells; an interrupt leaves some out.

    Each measurement goes to the CSV file at once. With `resume`, measurements in the file are
    reused, and others in it are kept at its end. Special files are written only at the end. Raises
    `OSError`, and `LanguageError` for an existing file with other content.
    """

    def data(rows: Iterable[Measurement], *, heading: bool = True) -> bytes:
        return csv_text(rows, heading=heading).encode(errors="surrogateescape")  # file names need not be UTF-8

    path = None if csv in (None, "-") else Path(csv or "")
    path = path if path is not None and (path.is_file() or not path.exists()) else None
    before: dict[tuple[object, ...], Measurement] = {}
    if path is not None:
        text = path.read_text("utf-8", "surrogateescape") if path.exists() else ""
        found = {row.key: row for row in read_rows(text, str(path))}
        before = found if resume else {}
        write_whole(path, data(before.values()))  # removes an incomplete last line
    wanted = {cell: unmeasured(cell, settings) for cell in cells}
    rows = {cell: row for cell, one in wanted.items() if (row := before.get(one.key)) is not None and row.serves(one)}
    missing = [cell for cell in cells if cell not in rows]
    with (
        suppress(KeyboardInterrupt),  # the caller reports the interrupt after writing
        progress(len(missing)) as advance,
        closing(measured(missing, settings, jobs=jobs)) as running,
    ):
        for cell, row in running:
            rows[cell] = row
            if path is not None:
                with path.open("ab") as stream:
                    stream.write(data([row], heading=False))
            advance()
    known = {rows[cell].key: rows[cell] for cell in cells if cell in rows}
    if path is not None:
        write_whole(path, data((known | before | known).values()))  # in the order of the cells, then the others
    elif csv is not None:
        deliver(data(known.values()), csv)
    return list(known.values())
