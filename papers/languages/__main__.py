"""`python -m papers.languages`: measure everything anew, and write tables, figures and what is seen in them.

One run takes some minutes; one that was interrupted goes on with `--resume`. The exit status is 0 when all was written and every
finding holds, 1 when one does not, 2 when something could not be made, 130 when it was interrupted.
"""

import io
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Final

from cross_check.benchmark.tables import latex_text, read_rows
from papers.languages.findings import missed
from papers.languages.note import note, short
from rvaft.cli import main as rvaft

FOLDER: Final = Path(__file__).parent
LANGUAGES: Final = "automaton,ltlf,rml,rml-paper"
"""Those that say of every trace whether it is hopeless, too: the formulas of the note are about these."""
TIMEOUT: Final = 30
"""Seconds for one tree in one language: several times what the slowest needs, but for automata of tens of thousands of states."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; the result is the exit status."""
    parser = ArgumentParser(prog="python -m papers.languages", description="the comparison of languages, anew")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help="where to write (default: here)")
    parser.add_argument(
        "--max-arity", type=int, default=12, metavar="N", help="gates with 1 to N children (default: 12)"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes at a time (default: 1)")
    parser.add_argument("--texts", action="store_true", help="tables and the note only: no figures")
    parser.add_argument("--resume", action="store_true", help="go on with what languages.csv has")
    options = parser.parse_args(arguments)
    out: Path = options.out
    table = out / "languages.csv"
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        sys.stderr.write(f"papers.languages: error: {out}: cannot write: {error.strerror}\n")
        return 2
    files = ["--csv", str(table), "--latex", str(out / "languages.tex")]
    files += [] if options.texts else ["--plots", str(out / "figures")]
    sizes = ["--max-arity", str(options.max_arity), "--timeout", str(TIMEOUT), "--jobs", str(options.jobs)]
    wanted = ["--semantics", "all", "--languages", LANGUAGES, *sizes, *files, *(["--resume"] if options.resume else [])]
    with redirect_stdout(io.StringIO()) as said:  # the table is in the file
        status: int = rvaft(["compare", *wanted], standalone_mode=False)
    sys.stdout.write("".join(said.getvalue().splitlines(keepends=True)[-1:]))
    if status > 1:
        return status
    rows = list(read_rows(table.read_text(encoding="utf-8"), str(table)))
    (out / "short.tex").write_text(latex_text(short(rows)), encoding="utf-8")
    (out / "README.md").write_text(note(rows), encoding="utf-8")
    for title in missed(rows):
        sys.stderr.write(f"papers.languages: not confirmed: {title}\n")
    return 1 if missed(rows) else status


if __name__ == "__main__":
    sys.exit(main())
