"""Rows as a table for people."""

from collections import Counter
from collections.abc import Sequence
from typing import Final

from rvaft.comparison.rows import Outcome, Row
from rvaft.printable import columns, visible

_HEADINGS: Final = ("TREE", "SEMANTICS", "LANGUAGE")
_OTHER: Final = "with other verdicts"
_NUMBERS: Final = ("SYMBOLS", "SUBFORMULAS", "STATES", "EDGES", "MS", "EVENTS/S", "AGAIN/S")


def text_lines(rows: Sequence[Row]) -> list[str]:
    """A line for each row: numbers to the right, how it ended last."""
    numbers = [_NUMBERS, *(_numbers(row) for row in rows)]
    widths = [max(len(cell) for cell in column) for column in zip(*numbers, strict=True)]
    aligned = [[cell.rjust(width) for cell, width in zip(line, widths, strict=True)] for line in numbers]
    named = [_HEADINGS, *((visible(row.tree), row.semantics, row.language) for row in rows)]
    said = ["RESULT", *(ended(row) for row in rows)]
    return columns([*name, *line, end] for name, line, end in zip(named, aligned, said, strict=True))


def ended(row: Row) -> str:
    """How a cell ended, in a few words."""
    if row.result is not Outcome.OK:
        return _because(row.result, row.reason)
    if row.run is not Outcome.OK:
        return f"run: {_because(row.run, row.run_reason)}"
    if row.differing:
        return f"{row.differing} of {row.walks} traces get other verdicts"
    return _because(row.result, row.run_reason)


def headline(rows: Sequence[Row]) -> str:
    """How many measurements ended how; a text that says something else than the tree is none that is ok."""
    counts = Counter(_word(row) for row in rows)
    words = [Outcome.OK, _OTHER, *(outcome for outcome in Outcome if outcome is not Outcome.OK)]
    said = ", ".join(f"{counts[word]} {word}" for word in words if counts[word])
    return f"{len(rows)} measurement{'' if len(rows) == 1 else 's'}: {said or 'none'}"


def _word(row: Row) -> str | None:
    if row.differing:
        return _OTHER
    return row.result if row.result is not Outcome.OK else row.run


def milliseconds(seconds: float) -> str:
    """A time with three significant digits."""
    return f"{1000 * seconds:.3g}" if seconds < 0.9995 else f"{1000 * seconds:.0f}"


def _numbers(row: Row) -> tuple[str, ...]:
    sizes = (row.symbols, row.subformulas, row.states, row.edges)
    time = "" if row.seconds is None else milliseconds(row.seconds)
    speeds = ("" if speed is None else f"{speed:.0f}" for speed in (row.events_per_second, row.again_per_second))
    return (*("" if size is None else str(size) for size in sizes), time, *speeds)


def _because(outcome: Outcome | None, reason: str) -> str:
    return f"{outcome}: {reason}" if reason else f"{outcome}"
