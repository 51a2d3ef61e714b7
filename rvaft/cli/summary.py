"""Tables of `rvaft monitor`: how each monitor, each trace and each key ended."""

import json
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Final

from rvaft.cli.verdicts import Row, Shape
from rvaft.monitoring.bank import Bank
from rvaft.monitoring.columns import Column
from rvaft.printable import columns as aligned
from rvaft.verdict import Verdict

_ALL: Final = 100
"""Rows up to which all are shown; beyond it those of a detection or an error."""
_MOST: Final = 1_000
"""Rows of a table."""
_WIDE: Final = 8
"""Columns up to which each has one in the table; beyond it those of a detection are listed."""
_LISTED: Final = 3
"""How many are listed."""


def columns_table(columns: Sequence[Column], bank: Bank) -> list[str]:
    """The verdict of each column, and the event that made it final."""
    rows = [("MONITOR", "VERDICT", "EVENT")]
    for place, (column, verdict) in enumerate(zip(columns, bank.verdicts, strict=True)):
        rows.append((column.title, str(verdict), str(bank.since.get(place, "-"))))
    return aligned(rows)


def summary(shape: Shape, rows: Sequence[Row]) -> Iterator[str]:
    """How each trace and each key ended, a row for each; where there are very many, for those worth a look."""
    worth = [row for row in rows if len(rows) <= _ALL or row.failed or Verdict.TRUE in row.verdicts]
    shown = list(islice(worth, _MOST))
    headings = [*(["TRACE"] if shape.several else []), *([shape.key] if shape.key is not None else [])]
    verdicts = [column.title for column in shape.columns] if 1 < len(shape.columns) <= _WIDE else ["VERDICT", "EVENT"]
    detected = ["DETECTED"] if len(shape.columns) > _WIDE else []
    table = [(*headings, "EVENTS", *verdicts, "BRANCH", "KINDS", *detected, "")]
    table += [tuple(_cells(shape, row)) for row in shown]
    yield from aligned(table)
    if len(shown) < len(rows):
        yield f"and {len(rows) - len(shown)} more: {_rest(rows, shown)}"


def _cells(shape: Shape, row: Row) -> Iterator[str]:
    if shape.several:
        yield row.trace
    if shape.key is not None:
        yield "" if row.key is None else json.dumps(row.key[0], ensure_ascii=False)
    yield str(row.events)
    if 1 < len(shape.columns) <= _WIDE:
        for place, verdict in enumerate(row.verdicts):
            yield f"{verdict} {row.since[place]}" if place in row.since else str(verdict)
    else:
        yield str(row.verdicts[0])
        yield str(row.since.get(0, "-"))
    yield "-" if row.branch is None else str(row.branch)
    yield ", ".join(row.kinds) or "-"
    if len(shape.columns) > _WIDE:
        yield _detected(shape, row)
    yield "error" if row.failed else ""


def _detected(shape: Shape, row: Row) -> str:
    """The columns beside the first that were detected, each with its event."""
    found = [place for place, verdict in enumerate(row.verdicts) if place and verdict is Verdict.TRUE]
    first = ", ".join(f"{shape.columns[place].title} {row.since[place]}" for place in found[:_LISTED])
    others = len(found) - _LISTED
    return f"{first} and {others} more" if others > 0 else first or "-"


def _rest(rows: Sequence[Row], shown: Sequence[Row]) -> str:
    known = {id(row) for row in shown}
    hidden = [row.verdicts[0] for row in rows if id(row) not in known]
    counts = ((verdict, hidden.count(verdict)) for verdict in Verdict)
    return ", ".join(f"{count} {verdict}" for verdict, count in counts if count)
