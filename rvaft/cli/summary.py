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
    verdicts = [column.title for column in shape.columns] if len(shape.columns) > 1 else ["VERDICT", "EVENT"]
    table = [(*headings, "EVENTS", *verdicts, "BRANCH", "KINDS", "")]
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
    if len(shape.columns) > 1:
        for place, verdict in enumerate(row.verdicts):
            yield f"{verdict} {row.since[place]}" if place in row.since else str(verdict)
    else:
        yield str(row.verdicts[0])
        yield str(row.since.get(0, "-"))
    yield "-" if row.branch is None else str(row.branch)
    yield ", ".join(row.kinds) or "-"
    yield "error" if row.failed else ""


def _rest(rows: Sequence[Row], shown: Sequence[Row]) -> str:
    known = {id(row) for row in shown}
    hidden = [row.verdicts[0] for row in rows if id(row) not in known]
    counts = ((verdict, hidden.count(verdict)) for verdict in Verdict)
    return ", ".join(f"{count} {verdict}" for verdict, count in counts if count)
