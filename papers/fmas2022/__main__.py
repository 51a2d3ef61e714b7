"""`python -m papers.fmas2022`: regenerate all tables, formulas, listings, figures and findings.

The exit status is 0 if everything was written and no finding is contradicted, 1 if a finding is
contradicted, 2 if something could not be generated. A finding whose command lacks a tool is
reported and does not change the status.
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
    """Write the outputs, and list the written files."""
    parser = ArgumentParser(
        prog="python -m papers.fmas2022", description="regenerate the tables and figures of the paper"
    )
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
