"""`python -m papers.fmas2022`: write every table, formula, listing, figure and finding of the paper anew.

The exit status is 0 when all was written and every finding still holds, 1 when a finding does not, 2 when something could not be made.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from papers.fmas2022.making import make
from rvaft.errors import RvaftError

OUT: Final = Path(__file__).parent / "out"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what is asked for, and say what was written."""
    parser = ArgumentParser(prog="python -m papers.fmas2022", description="the tables and figures of the paper, anew")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="where to write (default: out/)")
    parser.add_argument("--texts", action="store_true", help="LaTeX and Markdown only: no figures, no measurements")
    options = parser.parse_args(arguments)
    try:
        made = make(options.out, texts=options.texts)
    except (RvaftError, OSError) as error:
        where = f"{error.filename or options.out}: {error.strerror}" if isinstance(error, OSError) else str(error)
        sys.stderr.write(f"papers.fmas2022: error: {where}\n")
        return 2
    for file in made.files:
        sys.stdout.write(f"{file}\n")
    for reason in made.not_run:
        sys.stderr.write(f"papers.fmas2022: not run: {reason}\n")
    for title in made.unconfirmed:
        sys.stderr.write(f"papers.fmas2022: not confirmed: {title}\n")
    return 2 if made.not_run else 1 if made.unconfirmed else 0


if __name__ == "__main__":
    sys.exit(main())
