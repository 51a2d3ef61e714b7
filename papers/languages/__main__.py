"""`python -m papers.languages`: repeat all measurements, and write tables, figures and the page.

A run takes minutes; `--resume` continues an interrupted run. The exit status is 0 if everything was
written and every finding holds, 1 if a finding does not hold, 2 if something could not be
generated, and 130 after an interrupt.
"""

import io
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Final

from papers.languages.findings import missed
from papers.languages.measurement import Measurement
from papers.languages.note import FOLDER, TREES, capabilities_tex, expressible, expressible_tex, languages, note, short
from papers.languages.plots import plots
from papers.languages.tables import csv_text, headline, latex_text, read_rows
from rvaft.backend import backend
from rvaft.cli import main as rvaft
from rvaft.errors import Cause
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

STATES: Final = 20_000
"""The limit of automata: the default limit takes minutes per automaton."""
GROUPS: Final = (
    ("automaton", "--limit", str(STATES)),
    ("ltlf,rml,rml-paper,sql,stix,sigma,eql,mfotl,mtl,mtl-r2u2,match-recognize",),
)
"""Languages measured with common options."""
LANGUAGES: Final = tuple(name for names, *_ in GROUPS for name in names.split(","))
ROOT: Final = FOLDER.parents[1]
PAGES: Final = ROOT / "docs" / "reference" / "languages"
TIMEOUT: Final = 60
"""Seconds per tree and language: many times the slowest, so that slow machines get equal sizes."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; return the exit status."""
    parser = ArgumentParser(prog="python -m papers.languages", description="repeat the comparison of languages")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help="where to write (default: here)")
    parser.add_argument("--max-arity", type=int, default=8, metavar="N", help="gates with 1 to N children (default: 8)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes at a time (default: 1)")
    parser.add_argument("--texts", action="store_true", help="tables and the note only: no figures")
    parser.add_argument(
        "--claims", action="store_true", help="list what a language cannot express, and where the argument is"
    )
    parser.add_argument("--resume", action="store_true", help="continue from languages.csv")
    options = parser.parse_args(arguments)
    out = Path(options.out).resolve()
    table = out / "languages.csv"
    if options.claims:
        return claims(list(read_rows(table.read_text(encoding="utf-8"), str(table))))
    try:
        out.mkdir(parents=True, exist_ok=True)
        if not options.resume:
            table.unlink(missing_ok=True)
    except OSError as error:
        sys.stderr.write(f"papers.languages: error: {out}: cannot write: {error.strerror}\n")
        return 2
    wanted = [*(f"trees/{name}.rvaft" for name in TREES), "--gates", ",".join(Gate), "--semantics", "all"]
    wanted += ["--max-arity", str(options.max_arity), "--timeout", str(TIMEOUT), "--jobs", str(options.jobs)]
    for group, *limit in GROUPS:
        with chdir(FOLDER), redirect_stdout(io.StringIO()):  # the table is in the file
            words = ["compare", *wanted, "--languages", group, *limit, "--csv", str(table), "--resume"]
            status: int = rvaft(words, standalone_mode=False)
        if status > 1:
            return status
    rows = in_order(list(read_rows(table.read_text(encoding="utf-8"), str(table))))
    table.write_text(csv_text(rows), encoding="utf-8")
    sys.stdout.write(f"{headline(rows)}\n")
    for name, text in texts(rows).items():
        (out / name).write_text(text, encoding="utf-8")
    if not options.texts:
        (out / "figures").mkdir(exist_ok=True)
        for name, data in plots([row for row in rows if row.gate is not None]):
            (out / "figures" / name).write_bytes(data)
    for title in missed(rows):
        sys.stderr.write(f"papers.languages: not confirmed: {title}\n")
    return 1 if missed(rows) else 0


def claims(rows: Sequence[Measurement]) -> int:
    """Print each claim that a language cannot express a construct; return 1 if its page has no argument.

    The claims are those of the measurements and of the capabilities of the backends. The page of a
    language has an argument in an item of a list that begins with the claim in bold.
    """
    found: dict[tuple[str, str], int] = {}
    for row in rows:
        if row.cause is Cause.LANGUAGE:
            found[row.language, row.reason] = found.get((row.language, row.reason), 0) + 1
    for name in LANGUAGES:
        for reason in backend(name).reasons.values():
            if reason.cause is Cause.LANGUAGE and not any(n == name and r.startswith(reason.text) for n, r in found):
                found[name, reason.text] = 0
    missing = 0
    for (name, claim), cells in sorted(found.items()):
        page = PAGES / f"{backend(name).form_of or name}.md"
        begins = [line.split("**")[1] for line in page.read_text("utf-8").splitlines() if line.startswith("- **")]
        argued = any(claim.startswith(begin.rstrip(":.")) for begin in begins)
        missing += not argued
        sys.stdout.write(f"{name}: {claim} ({cells} cells): {page.relative_to(ROOT) if argued else 'NO ARGUMENT'}\n")
    return 1 if missing else 0


def in_order(rows: Sequence[Measurement]) -> list[Measurement]:
    """Return the rows with trees before gates, and languages in the order of `GROUPS`."""
    gates, semantics = [None, *Gate], [*Semantics]

    def place(row: Measurement) -> tuple[object, ...]:
        tree = TREES.index(Path(row.tree).stem) if row.gate is None else 0
        size = (row.children or 0, row.threshold or 0)
        return gates.index(row.gate), tree, *size, semantics.index(row.semantics), LANGUAGES.index(row.language)

    return sorted(rows, key=place)


def texts(rows: Sequence[Measurement]) -> dict[str, str]:
    """Return the written texts by file name, without figures."""
    return {
        "README.md": note(rows, STATES),
        "expressible.tex": expressible_tex(*expressible(rows)),
        "capabilities.tex": capabilities_tex(languages(rows)),
        "languages.tex": latex_text([row for row in rows if row.gate is not None]),
        "short.tex": latex_text(short(rows)),
    }


if __name__ == "__main__":
    sys.exit(main())
