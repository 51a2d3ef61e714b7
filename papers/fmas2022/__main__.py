"""`python -m papers.fmas2022`: write every table, formula, listing, figure and finding of the paper anew.

The exit status is 0 when all was written and no finding is contradicted, 1 when one is, 2 when
something could not be made. A finding of which a command lacks a tool is told, and leaves the
status as it is.
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

    def made() -> int:
        folder, page = make(options.out, texts=options.texts)
        sys.stdout.writelines(f"{file}\n" for file in folder.files)
        sys.stderr.writelines(f"papers.fmas2022: not run: {reason}\n" for reason in folder.not_run)
        for state in (State.PARTLY, State.UNCONFIRMED):
            sys.stderr.writelines(f"papers.fmas2022: {state}: {title}\n" for title in page.having(state))
        return 2 if folder.not_run else 1 if page.having(State.UNCONFIRMED) else 0

    return ended("papers.fmas2022", made)


if __name__ == "__main__":
    sys.exit(main())
