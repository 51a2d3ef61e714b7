"""The traces of Tables 2 and 3, completed, with the verdicts of every participant after every
event.

Run `python -m papers.fmas2022.verdict_table`; it exits with 1 if two participants disagree. Absent
participants are listed last.
"""

import json
import sys

from rich.console import Console
from rich.table import Table

import rvaft
from cross_check.participants import Absent, Outside, Participant
from papers.fmas2022.command import ended
from papers.fmas2022.places import PRUNED
from papers.fmas2022.verdicts import absent, enlist, listed, present, symbols, verdicts_after
from rvaft.model.values import Json


def _cell(participant: Participant | Outside | Absent, events: list[Json]) -> str:
    return (
        f"({participant.status})"
        if isinstance(participant, Absent)
        else symbols(verdicts_after(participant, events) or ())
    )


def printed() -> int:
    """Print the table, the agreeing and the absent participants; return 1 for a disagreement."""
    enlisted = enlist(rvaft.load(PRUNED))
    names, missing = present(enlisted), absent(enlisted)
    table = Table("trace", "monitor", *names, *missing, title="Verdicts after every event, projected semantics")
    for column in table.columns:
        column.no_wrap = True
    differ = False
    for path in sorted(PRUNED.with_suffix(".traces").glob("table[23]_row?.jsonl")):
        events = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        for sign, everybody in enlisted.items():
            words = [_cell(everybody[name], events) for name in (*names, *missing)]
            agree = len(set(words[: len(names)])) == 1
            differ |= not agree
            table.add_row(path.stem, sign, *words, style=None if agree else "bold red", end_section=sign == "φ₄")
    Console(width=100).print(table)
    sys.stdout.write("the rows in red differ\n" if differ else f"{listed(names)} agree\n")
    for name, reason in missing.items():
        sys.stdout.write(f"not run: {name}: {reason}\n")
    return 1 if differ else 0


def main() -> int:
    """Print the table."""
    return ended("verdict_table", printed)


if __name__ == "__main__":
    sys.exit(main())
