"""The overhead of monitoring in a mission: section 4.5 of the paper, without its robot.

Run `python -m papers.fmas2022.overhead [--quick] [FOLDER]`.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import rvaft
from papers.fmas2022.command import ended
from papers.fmas2022.mission import Mode
from papers.fmas2022.overhead_cells import Cell, cells
from papers.fmas2022.overhead_figure import draw
from papers.fmas2022.overhead_runs import runs
from papers.fmas2022.overhead_statement import statement
from papers.fmas2022.overhead_tables import cells_csv, detected_tex, nominal_tex, runs_csv
from papers.fmas2022.places import OUT, PRUNED
from papers.languages.plots import library

WAYPOINTS: Final = (5, 10, 20, 40, 80)
REPETITIONS: Final = 15


@dataclass(frozen=True, slots=True)
class Overhead:
    """The written files, a statement (Markdown without a heading), and the numbers."""

    files: tuple[Path, ...]
    statement: str
    cells: tuple[Cell, ...]


def overhead(folder: Path, *, quick: bool = False) -> Overhead:
    """Measure, and write two CSV files, two LaTeX tables, a text and a figure in two formats.

    The folder is created if necessary. `quick` runs two small missions twice, for tests. Raises
    `ToolMissing` and `OSError`.
    """
    library()  # report a missing tool before measuring
    folder.mkdir(parents=True, exist_ok=True)
    sizes, times = ((2, 4), 2) if quick else (WAYPOINTS, REPETITIONS)
    watched = rvaft.load(PRUNED)
    measured = tuple(run for mode in Mode for run in runs(watched, sizes, times, mode=mode))
    found = cells(measured)
    overview = statement(found)
    texts = {
        "overhead_runs.csv": runs_csv(measured),
        "overhead.csv": cells_csv(found),
        "overhead.tex": nominal_tex(found),
        "overhead_detected.tex": detected_tex(found),
        "overhead.md": overview,
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return Overhead((*(folder / name for name in texts), *draw(found, folder)), overview, found)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write, and print the statement; return 2 on an error."""
    parser = ArgumentParser(prog="python -m papers.fmas2022.overhead", description="what monitoring costs a mission")
    parser.add_argument("folder", type=Path, nargs="?", default=OUT, metavar="FOLDER", help="default: out/")
    parser.add_argument("--quick", action="store_true", help="two small missions, twice")
    options = parser.parse_args(arguments)
    return ended("overhead", lambda: sys.stdout.writelines([overhead(options.folder, quick=options.quick).statement]))


if __name__ == "__main__":
    sys.exit(main())
