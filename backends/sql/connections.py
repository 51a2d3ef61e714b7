"""DuckDB in memory: it reads the files that are named, writes to a private temporary folder only, and
reaches no network.

Statements run in a thread of their own, so that signals and time limits interrupt them.
"""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from threading import Event, Thread
from time import monotonic
from typing import Any, Final, Self, TypeVar

from backends.sql.dialects import literal
from rvaft.errors import installed

T = TypeVar("T")

MEMORY: Final = "1GiB"
"""Memory of a connection; a log beyond it goes to the temporary folder."""
SPILLED: Final = "16GiB"
"""Maximum size of the temporary folder."""
THREADS: Final = 4
SETTINGS: Final[Mapping[str, str]] = {
    "allow_community_extensions": "false",
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "memory_limit": MEMORY,
    "preserve_insertion_order": "true",
    "python_enable_replacements": "false",
}
DESCRIPTORS: Final = "/proc/self/fd"
_PLAIN: Final = re.compile("[A-Za-z0-9/._+-]+")
_STOPPED: Final = 1.0
"""Seconds in which an interrupted statement should end."""
_ROWS: Final = 10_000


def duckdb() -> Any:
    """Return the package; raises `ToolMissing`."""
    return installed("duckdb", "DuckDB", "pip install '.[duckdb]' in a checkout of rvaft")


def failures() -> tuple[type[Exception], ...]:
    """Return the exceptions of statements; raises `ToolMissing`."""
    return duckdb().Error, MemoryError


class DuckDbConnection:
    """A database in memory that can read `files`; their names have no character that DuckDB interprets.

    With `spills`, it has several threads and a temporary folder, which `close` removes. Raises
    `OSError` without a temporary folder.
    """

    def __init__(self, files: Sequence[str] = (), *, spills: bool = False) -> None:
        own = {"threads": "1", "temp_directory": ""}
        self._folder: TemporaryDirectory[str] | None = None
        if spills:
            self._folder = TemporaryDirectory(prefix="rvaft-", ignore_cleanup_errors=True)
            threads = str(min(THREADS, os.cpu_count() or 1))
            own = {"threads": threads, "temp_directory": self._folder.name, "max_temp_directory_size": SPILLED}
        self._busy: Event | None = None
        """Set when the statement that was interrupted has ended."""
        self._program = duckdb().connect(config={**SETTINGS, **own})
        self._program.execute(f"SET allowed_paths = [{', '.join(map(literal, files))}]")
        self._program.execute("SET enable_external_access = false")
        self._program.execute("SET lock_configuration = true")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the database, and remove the temporary folder."""
        if self._busy is None or self._busy.is_set():  # otherwise it would wait for the statement
            self._program.close()
        if self._folder is not None:
            self._folder.cleanup()

    def ask(
        self, query: str, values: Sequence[Any] = (), *, seconds: float | None = None
    ) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Return the column names and rows of a statement; raises `TimeoutError` after `seconds`."""

        def call() -> tuple[list[str], list[tuple[Any, ...]]]:
            found = self._program.execute(query, values) if values else self._program.execute(query)
            return [column[0] for column in found.description or ()], found.fetchall()

        return self._run(self._program, call, seconds)

    def rows(self, query: str) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query, a batch at a time."""
        cursor = self._program.cursor()
        self._run(cursor, lambda: cursor.execute(query))
        while rows := self._run(cursor, lambda: cursor.fetchmany(_ROWS)):
            yield from rows

    def check(self, query: str) -> None:
        """Raise `duckdb.Error` unless a text is one SELECT."""
        statements = self._run(self._program, lambda: self._program.extract_statements(query))
        if len(statements) != 1 or statements[0].type != duckdb().StatementType.SELECT:
            message = "more than one statement" if len(statements) > 1 else "the statement is not SELECT"
            raise duckdb().InvalidInputException(message)

    def _run(self, program: Any, call: Callable[[], T], seconds: float | None = None) -> T:
        """Return the result of a call in a thread; an exception of this thread interrupts the call."""
        while self._busy is not None and not self._busy.wait(_STOPPED):
            program.interrupt()
        ended, found, failed = Event(), list[T](), list[BaseException]()

        def work() -> None:
            try:
                found.append(call())
            except BaseException as error:  # noqa: BLE001 -- raised in the calling thread
                failed.append(error)
            finally:
                ended.set()

        until = inf if seconds is None else monotonic() + seconds
        self._busy = ended
        try:
            Thread(target=work, name="DuckDB", daemon=True).start()
            while not ended.wait(min(_STOPPED, until - monotonic())):
                _check(until)
        except BaseException:
            last = monotonic() + _STOPPED
            while not ended.is_set() and monotonic() < last:
                program.interrupt()
                ended.wait(0.02)
            raise
        if failed:
            raise failed[0]
        return found[0]


def _check(until: float) -> None:
    if monotonic() >= until:
        raise TimeoutError


class NamedFile:
    """A regular file under a `name` that DuckDB does not interpret, whatever its path is.

    The name is that of an open descriptor or, on systems without such names, of a link in a private
    folder. Raises `OSError`, also for other files, which are not opened.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():  # opening a pipe would wait for its writer
            message = "it is not a regular file"
            raise OSError(message)
        with ExitStack() as opened:
            stream = opened.enter_context(path.open("rb"))
            self.name = f"{DESCRIPTORS}/{stream.fileno()}"
            if not Path(self.name).is_file():
                folder = opened.enter_context(TemporaryDirectory(prefix="rvaft-"))
                self.name = f"{folder}/log"
                if not _PLAIN.fullmatch(self.name):
                    message = f"DuckDB interprets the name of the folder for temporary files: {gettempdir()}"
                    raise OSError(message)
                Path(self.name).symlink_to(path.absolute())
            self._opened = opened.pop_all()
        self._path = path

    def by_path(self, message: str) -> str:
        """Return a message of DuckDB with the path in place of the name."""
        return re.sub(rf"{re.escape(self.name)}(?![\w/])", lambda _: str(self._path), message)

    def close(self) -> None:
        """Close the file."""
        self._opened.close()
