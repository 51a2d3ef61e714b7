"""What the paper prints in Tables 2 and 3, as far as computed cells are held against it.

Every table has four traces. The cells of φ and of the branch with the trace's number run ?, ?, ?,
and end with one sign; the other cells are empty.
"""

from collections.abc import Mapping
from typing import Final

from rvaft.model.verdict import Verdict

LAST: Final[Mapping[int, Verdict]] = {2: Verdict.TRUE, 3: Verdict.FALSE}
"""Table -> the verdict that each of its traces ends with."""

LEFT_OUT: Final[Mapping[int, int]] = {3: 4, 4: 4}
"""Trace -> the number of the event that the print leaves out, from 1; without it no branch can be completed."""

TRACES: Final = range(1, 5)


def cell(table: int, trace: int, branch: int | None, event: int, length: int) -> Verdict | None:
    """The printed verdict after an event of a trace of that length, or None where the cell is empty or not there.

    `branch` is None for φ.
    """
    if branch not in (None, trace) or event == LEFT_OUT.get(trace):
        return None
    return LAST[table] if event == length else Verdict.UNKNOWN
