"""The CSV file of a comparison: every row is in it as soon as it is known, so that an interrupted run can go on."""

import stat
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

from rvaft.cli.output import deliver, write_whole
from rvaft.comparison.rows import Row
from rvaft.comparison.table_file import csv_text, read_rows

_ERRORS = "surrogateescape"
"""Names of files need not be UTF-8."""


class KeptRows:
    """The rows that the file has from before, with `resume`, and those that are added; None is no file.

    What is no regular file is only written to at the end. Raises `OSError`, and `LanguageError` for a file to resume that is
    no comparison.
    """

    def __init__(self, file: str | None, *, resume: bool = False) -> None:
        self._file = file
        self._appended: TextIO | None = None
        path = None if file is None or file == "-" else Path(file)
        self._path = None if path is not None and path.exists() and not stat.S_ISREG(path.stat().st_mode) else path
        self._before: list[Row] = []
        if resume and self._path is not None and self._path.exists():
            text = self._path.read_bytes().decode(errors=_ERRORS)
            self._before = list(read_rows(text, str(self._path)))

    def __enter__(self) -> Self:
        if self._path is not None:
            write_whole(self._path, _encoded(self._before))  # without a last line that was only begun
            self._appended = self._path.open("a", encoding="utf-8", errors=_ERRORS)
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._appended is not None:
            self._appended.close()

    def known(self, wanted: Row) -> Row | None:
        """The row from before that answers for one, if there is one; the last where there are several."""
        return next((row for row in reversed(self._before) if row.serves(wanted)), None)

    def add(self, row: Row) -> None:
        """Keep a row, whatever happens next."""
        if self._appended is not None:
            self._appended.write(csv_text([row], heading=False))
            self._appended.flush()

    def finish(self, rows: Iterable[Row]) -> None:
        """Write these rows in this order, and behind them those from before that no other stands for."""
        every = list(rows)
        if self._path is not None:
            fresh = {row.key for row in every}
            write_whole(self._path, _encoded([*every, *(row for row in self._before if row.key not in fresh)]))
        elif self._file is not None:
            deliver(_encoded(every), self._file)


def _encoded(rows: Iterable[Row]) -> bytes:
    return csv_text(rows).encode(errors=_ERRORS)
