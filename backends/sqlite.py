"""SQLite in memory, for the texts of backends: a text can read the tables of events, and nothing else."""

import sqlite3
from typing import Any, Final

_LONGEST: Final = 1 << 28
"""Bytes of a value or statement."""
_READING: Final = frozenset(
    {sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_RECURSIVE}
)
_NEVER: Final = frozenset(
    {sqlite3.SQLITE_ATTACH, sqlite3.SQLITE_DETACH, sqlite3.SQLITE_PRAGMA, sqlite3.SQLITE_CREATE_VTABLE}
)
_FUNCTIONS: Final = frozenset({"edit", "fts3_tokenizer", "load_extension", "readfile", "writefile"})
_INTERNAL: Final = ("bytecode", "dbstat", "fsdir", "pragma_", "sqlite_", "tables_used")
"""How the names of tables start that describe the database or files."""


class SqliteConnection(sqlite3.Connection):
    """A database in memory; `ask` runs one SELECT.

    Other statements are those of a backend: they may change tables, but open no other database.

    >>> connection = SqliteConnection()
    >>> connection.ask("SELECT 1 AS one")
    (['one'], [(1,)])
    """

    def __init__(self, *, cached_statements: int = 128) -> None:
        super().__init__(":memory:", check_same_thread=False, isolation_level=None, cached_statements=cached_statements)
        self._asking = False
        self.execute("PRAGMA temp_store = MEMORY")
        self.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        self.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
        self.setlimit(sqlite3.SQLITE_LIMIT_WORKER_THREADS, 0)
        self.execute("SELECT 1 FROM json_each('[]'), json_tree('[]')")  # tables that exist from their first use on
        self.set_authorizer(self._authorized)

    def _authorized(self, action: int, name: str | None, other: str | None, *_: str | None) -> int:
        allowed = action in _READING if self._asking else action not in _NEVER
        match action:
            case sqlite3.SQLITE_READ if self._asking:
                allowed = not (name or "").lower().startswith(_INTERNAL)
            case sqlite3.SQLITE_FUNCTION:
                allowed = (other or "").lower() not in _FUNCTIONS
        return sqlite3.SQLITE_OK if allowed else sqlite3.SQLITE_DENY

    def ask(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Return the column names and rows of a SELECT; raises `sqlite3.Error` and `sqlite3.Warning`."""
        self._asking = True
        try:
            found = self.execute(query)
            return [column[0] for column in found.description or ()], found.fetchall()
        except MemoryError:
            message = "it needs more memory than there is"
            raise sqlite3.OperationalError(message) from None
        finally:
            self._asking = False

    def check(self, query: str) -> None:
        """Raise `sqlite3.Error` or `sqlite3.Warning` unless a text is one SELECT."""
        self.ask(f"EXPLAIN {query}")
