"""The CSV file of a comparison: every row is in it as soon as it is known, so that an interrupted run can go on."""

import fcntl
import os
import stat
from collections.abc import Iterable
from contextlib import suppress
from errno import EWOULDBLOCK
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

    What is no regular file is only written to at the end. Entering it raises `OSError`, also where another run is writing to the file, and
    `LanguageError` for a file with something else than a comparison in it, which nobody wants to lose.
    """

    def __init__(self, file: str | None, *, resume: bool = False) -> None:
        self._file = file
        self._resume = resume
        self._appended: TextIO | None = None
        path = None if file is None or file == "-" else Path(file)
        self._path = None if path is not None and path.exists() and not stat.S_ISREG(path.stat().st_mode) else path
        self._before: list[Row] = []
        self._of: dict[tuple[object, ...], list[Row]] = {}
        """Those from before by their keys."""

    def __enter__(self) -> Self:
        if self._path is not None:
            with _locked(self._path) as stream:
                found = list(read_rows(stream.read(), str(self._path)))
                self._before = found if self._resume else []
                for row in self._before:
                    self._of.setdefault(row.key, []).append(row)
                write_whole(self._path, _encoded(self._before))  # without a last line that was only begun
                self._appended = _locked(self._path)  # which is another file now, of the same name
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._appended is not None:
            self._appended.close()

    def known(self, wanted: Row) -> Row | None:
        """The row from before that answers for one, if there is one; the last where there are several."""
        return next((row for row in reversed(self._of.get(wanted.key, ())) if row.serves(wanted)), None)

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


def _locked(path: Path) -> TextIO:
    """The file, open to be read from its start and appended to, and locked until it is closed."""
    try:
        stream = path.open("a+", encoding="utf-8", errors=_ERRORS, newline="")
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(path)) from error
    held = True
    with suppress(OSError):  # a file system that knows no locks
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            held = False
    if not held or not os.path.samestat(os.fstat(stream.fileno()), path.stat()):  # or it was replaced just now
        stream.close()
        raise BlockingIOError(EWOULDBLOCK, "cannot write: another run is writing to it; name another file", str(path))
    stream.seek(0)
    return stream
