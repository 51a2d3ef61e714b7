"""`python -m papers.fmas2022`: write every table, formula, listing, figure and finding of the paper anew.

The exit status is 0 when all was written and no finding is contradicted, 1 when one is, 2 when something could not be made. A finding
of which a command lacks a tool is told, and leaves the status as it is.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from papers.fmas2022.command import ended
from papers.fmas2022.findings import State
from papers.fmas2022.making import make
from papers.fmas2022.places import OUT


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what is asked for, and say what was written."""
    parser = ArgumentParser(prog="python -m papers.fmas2022", description="the tables and figures of the paper, anew")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="where to write (default: out/)")
    parser.add_argument("--texts", action="store_true", help="LaTeX and Markdown only: no figures, no measurements")
    options = parser.parse_args(arguments)
    return ended("papers.fmas2022", lambda: _made(options.out, texts=options.texts))


def _made(out: Path, *, texts: bool) -> int:
    made = make(out, texts=texts)
    for file in made.files:
        sys.stdout.write(f"{file}\n")
    for reason in made.not_run:
        sys.stderr.write(f"papers.fmas2022: not run: {reason}\n")
    for state in (State.PARTLY, State.UNCONFIRMED):
        for title in made.page.having(state):
            sys.stderr.write(f"papers.fmas2022: {state}: {title}\n")
    return 2 if made.not_run else 1 if made.page.having(State.UNCONFIRMED) else 0


if __name__ == "__main__":
    sys.exit(main())
