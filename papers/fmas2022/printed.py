"""The cells of Tables 2 and 3 as printed in the paper.

Each table has four traces. The cells of φ and of the branch with the trace's number are ?, ?, ?,
and then a final verdict; other cells are empty.
"""

from collections.abc import Mapping
from typing import Final

from rvaft.model.verdict import Verdict

LAST: Final[Mapping[int, Verdict]] = {2: Verdict.TRUE, 3: Verdict.FALSE}
"""Table -> final verdict of its traces."""

LEFT_OUT: Final[Mapping[int, int]] = {3: 4, 4: 4}
"""Trace -> number of the event missing in print, from 1; without it no branch can be completed."""

TRACES: Final = range(1, 5)


def cell(table: int, trace: int, branch: int | None, event: int, length: int) -> Verdict | None:
    """Return the printed verdict after an event of a trace, or None for an empty cell.

    `branch` is None for φ.
    """
    if branch not in (None, trace) or event == LEFT_OUT.get(trace):
        return None
    return LAST[table] if event == length else Verdict.UNKNOWN
