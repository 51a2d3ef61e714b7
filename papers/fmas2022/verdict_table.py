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
from cross_check.results import Job
from cross_check.roster import Roster
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

TREE = Path(__file__).parents[2] / "trees" / "remote_inspection" / "pruned.rvaft"
MONITORS = {"φ": None, "φ₁": 1, "φ₂": 2, "φ₃": 3, "φ₄": 4}


def rows(tree: RVAFT, folder: Path) -> Iterator[tuple[str, str, dict[str, str]]]:
    """For each trace of the two tables and each monitor: the verdicts of each participant, or why it gives none."""
    jobs = {sign: Job(sign, Semantics.PROJECTED, branch=number) for sign, number in MONITORS.items()}
    enlisted = {sign: [(name, make()) for name, make in Roster().candidates(tree, job)] for sign, job in jobs.items()}
    for path in sorted(folder.glob("table[23]_row?.jsonl")):
        events = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        for sign, participants in enlisted.items():
            yield path.stem, sign, {name: _cell(one, events) for name, one in participants}


def _cell(participant: Participant | Outside | Absent, events: list[object]) -> str:
    if isinstance(participant, Absent):
        return f"({participant.status})"
    assert isinstance(participant, Participant), "nobody asked for a program of others"
    return "".join(verdict.symbol for verdict in participant.start().run(events))


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
