"""The traces of Tables 2 and 3, completed, with the verdicts that every participant gives after every event.

Run as `python -m papers.fmas2022.verdict_table`; exits 1 if two participants differ anywhere.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

import rvaft
from cross_check.participants import Absent, Outside, Participant
from papers.fmas2022.verdicts import enlist, monitors, said
from rvaft.tree import RVAFT
from rvaft.values import Json

TREE = Path(__file__).parents[2] / "trees" / "remote_inspection" / "pruned.rvaft"


def rows(tree: RVAFT, folder: Path) -> Iterator[tuple[str, str, dict[str, str]]]:
    """For each trace of the two tables and each monitor: the verdicts of each participant, or why it gives none."""
    enlisted = {sign: enlist(tree, number) for sign, number in monitors(tree).items()}
    for path in sorted(folder.glob("table[23]_row?.jsonl")):
        events = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        for sign, participants in enlisted.items():
            yield path.stem, sign, {name: _cell(one, events) for name, one in participants.items()}


def _cell(participant: Participant | Outside | Absent, events: list[Json]) -> str:
    if isinstance(participant, Absent):
        return f"({participant.status})"
    verdicts = said(participant, events)
    assert verdicts is not None, "nobody asked for a program of others"
    return "".join(verdict.symbol for verdict in verdicts)


def main() -> int:
    """Print the table."""
    tree = rvaft.load(TREE)
    table = Table(title="Verdicts after every event, projected semantics")
    differ = False
    absent: set[str] = set()
    for trace, sign, cells in rows(tree, TREE.with_suffix(".traces")):
        if not table.columns:
            for heading in ("trace", "monitor", *cells):
                table.add_column(heading, no_wrap=True)
        absent |= {name for name, cell in cells.items() if cell.startswith("(")}
        agree = len({cell for name, cell in cells.items() if name not in absent}) == 1
        differ |= not agree
        table.add_row(trace, sign, *cells.values(), style=None if agree else "bold red", end_section=sign == "φ₄")
    Console(width=100).print(table)
    for name in sorted(absent):
        sys.stdout.write(f"not run: {name}\n")
    sys.stdout.write("all participants that ran agree\n" if not differ else "the rows in red differ\n")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
