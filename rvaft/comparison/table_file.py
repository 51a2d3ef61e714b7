"""Rows as CSV, and back: how a comparison is kept, and how one that was interrupted goes on."""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from typing import Any, Final

from rvaft.comparison.rows import Outcome, Row
from rvaft.errors import LanguageError
from rvaft.model import Gate
from rvaft.verdict import Semantics

COLUMNS: Final = tuple(field.name for field in fields(Row))
"""The columns, named as the fields of `Row`; what is not known is empty."""

_KINDS: Final[dict[Callable[[str], Any], tuple[str, ...]]] = {
    Gate: ("gate",),
    Semantics: ("semantics",),
    Outcome: ("result", "run"),
    int: (
        *("children", "threshold", "symbols", "subformulas", "states", "edges", "characters"),
        *("events", "first_events", "walks", "differing", "limit", "seed", "memory"),
    ),
    float: ("seconds", "read_seconds", "events_per_second", "again_per_second", "timeout"),
    str: ("tree", "language", "reason", "run_reason", "digest", "version"),
}
_READ: Final = {column: kind for kind, columns in _KINDS.items() for column in columns}
_REQUIRED: Final = frozenset({"tree", "semantics", "language", "result", "timeout", "seed"})
_HEADING: Final = ",".join(COLUMNS)
assert set(_READ) == set(COLUMNS), "every column is read back"


def csv_text(rows: Iterable[Row], *, heading: bool = True) -> str:
    """The rows, below the names of the columns."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    if heading:
        writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow([_written(getattr(row, column)) for column in COLUMNS])
    return stream.getvalue()


def read_rows(text: str, file: str = "<csv>") -> Iterator[Row]:
    """The rows of such a text; a last line that was only begun is left out, as an interrupted run leaves it.

    A column that the text does not have is empty. Raises `LanguageError` for what is no comparison.
    """
    whole = text[: text.rfind("\n") + 1]
    if not whole and _HEADING.startswith(text):
        return
    reader = csv.reader(io.StringIO(whole))
    try:
        heading = next(reader, [])
        if not _REQUIRED <= set(heading) <= set(COLUMNS) or len(heading) > len(set(heading)):
            raise LanguageError("no comparison of languages: its first line should name the columns", file=file)
        for cells in reader:
            yield _row(heading, cells, file, reader.line_num)
    except csv.Error as error:
        raise LanguageError(f"no CSV: {error}", file=file, line=reader.line_num) from error


def _written(value: object) -> str:
    match value:
        case None:
            return ""
        case float():
            return repr(value)
        case _:
            return str(value)


def _row(heading: Sequence[str], cells: Sequence[str], file: str, line: int) -> Row:
    if len(cells) != len(heading):
        raise LanguageError(f"{len(cells)} columns instead of {len(heading)}", file=file, line=line)
    found: dict[str, Any] = {"gate": None, "children": None, "threshold": None}
    for column, cell in zip(heading, cells, strict=True):
        if not cell and column in _REQUIRED:
            raise LanguageError(f"column {column} is empty", file=file, line=line)
        try:
            found[column] = _READ[column](cell) if cell or _READ[column] is str else None
        except ValueError:
            raise LanguageError(f"column {column}: {cell!r} is not what belongs there", file=file, line=line) from None
    return Row(**found)
