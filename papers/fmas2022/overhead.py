"""What monitoring costs a mission: the paper's section 4.5, with what can be measured without its robot.

Run as `python -m papers.fmas2022.overhead [--quick] FOLDER`.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import rvaft
from papers import plots
from papers.fmas2022.overhead_cells import Cell, cells
from papers.fmas2022.overhead_figure import draw
from papers.fmas2022.overhead_runs import runs
from papers.fmas2022.overhead_statement import statement
from papers.fmas2022.overhead_tables import cells_csv, latex, runs_csv
from rvaft.errors import RvaftError

TREE: Final = Path(__file__).parents[2] / "trees" / "remote_inspection" / "pruned.rvaft"
WAYPOINTS: Final = (5, 10, 20, 40, 80)
REPETITIONS: Final = 31


@dataclass(frozen=True, slots=True)
class Overhead:
    """What was written, what it says in words (Markdown, without a heading), and the numbers."""

    files: tuple[Path, ...]
    statement: str
    cells: tuple[Cell, ...]


def overhead(
    folder: Path,
    *,
    quick: bool = False,
    tree: Path = TREE,
    waypoints: Sequence[int] | None = None,
    repetitions: int | None = None,
) -> Overhead:
    """Measure, and write into a folder, which is made where it is not there: two CSV files, a LaTeX table, a text, and the figure twice.

    `quick` is for tests: two small missions, three times. Raises `ToolMissing`, and `OSError` where the folder cannot be written.
    """
    with plots.style():  # what is missing is said before anything is measured
        folder.mkdir(parents=True, exist_ok=True)
    sizes = waypoints or (WAYPOINTS[:2] if quick else WAYPOINTS)
    measured = tuple(runs(rvaft.load(tree), sizes, repetitions or (3 if quick else REPETITIONS)))
    found = cells(measured)
    said = statement(found)
    texts = {
        "overhead_runs.csv": runs_csv(measured),
        "overhead.csv": cells_csv(found),
        "overhead.tex": latex(found),
        "overhead.md": said,
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return Overhead((*(folder / name for name in texts), *draw(found, folder)), said, found)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write, and say in words what was found; 2 where that cannot be done."""
    parser = ArgumentParser(prog="python -m papers.fmas2022.overhead", description="what monitoring costs a mission")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where to write")
    parser.add_argument("--quick", action="store_true", help="two small missions, three times")
    options = parser.parse_args(arguments)
    try:
        done = overhead(options.folder, quick=options.quick)
    except RvaftError as error:
        sys.stderr.write(f"overhead: {error}\n")
        return 2
    except OSError as error:
        sys.stderr.write(f"overhead: {error.filename}: {error.strerror}\n")
        return 2
    sys.stdout.write(done.statement)
    return 0


if __name__ == "__main__":
    sys.exit(main())
