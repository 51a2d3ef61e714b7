"""A reader for SQL: traces become rows of the table `events`, and result rows are detections.

The column `detected` of a query is the number of the event that completes a match. A query with a
column `trace` runs once for many traces, otherwise once per trace. The header of a text defines the
time of events.
"""

import atexit
import json
import os
import re
import signal
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from threading import Lock
from typing import Any, Final

from backends.sql.connections import DuckDbConnection, duckdb
from backends.sql.dialects import qualified
from backends.sql.rows import COLUMN_TYPES
from backends.sqlite import SqliteConnection
from backends.tables import ROWID, TableHeader, declared_time
from rvaft.backend import Match
from rvaft.errors import LanguageError, ToolFailed, TraceError
from rvaft.model.values import Json, has_larger
from rvaft.support.budget import Expired

_TABLE: Final = "CREATE TABLE events (trace INTEGER, pos INTEGER, event {}, time {})"
_SQLITE_TYPES: Final = {"TEXT": "TEXT", "BIGINT": "INTEGER", "DOUBLE PRECISION": "REAL", "BOOLEAN": "INTEGER"}
_NULL: Final = re.compile(r"(?<!\\)(?:\\\\)*\\u0000")
_HALF: Final = re.compile("[\ud800-\udfff]")
_JSON: Final = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
_LARGEST: Final = 2**62
_ONE_AT_A_TIME: Final = Lock()
"""Queries share a table."""
BITS: Final = 64
KEPT: Final = 2_000
"""Size of a query's cache: a monitor runs it for each prefix of a trace."""


class SqliteTable:
    """SQLite in memory."""

    def __init__(self) -> None:
        self.errors: tuple[type[Exception], ...] = (sqlite3.Error, sqlite3.Warning)
        self.connection = SqliteConnection()
        self.connection.execute(_TABLE.format("TEXT", "INTEGER"))
        self.connection.set_progress_handler(lambda: 0, 100_000)  # check for timeouts
        self.made = ""
        """The typed table of the last query."""

    def load(self, rows: Sequence[tuple[Any, ...]]) -> None:
        """Replace the rows of the table."""
        self.connection.execute("DELETE FROM events")
        self.connection.executemany("INSERT INTO events VALUES (?, ?, ?, ?)", rows)

    def load_table(self, table: str, columns: Mapping[str, str], rows: Sequence[tuple[Any, ...]]) -> int:
        """Replace a table with typed columns by these rows; return the first `rowid`."""
        typed = ", ".join(f"{name} {_SQLITE_TYPES.get(type_, 'INTEGER')}" for name, type_ in columns.items())
        if (made := f"{table} ({typed})") != self.made:
            self.connection.execute(f"DROP TABLE IF EXISTS {table}")
            self.connection.execute(f"CREATE TABLE {made}")
            self.made = made
        self.connection.execute(f"DELETE FROM {table}")
        self.connection.executemany(f"INSERT INTO {table} VALUES ({', '.join('?' * len(columns))})", rows)
        return 1

    def check(self, query: str) -> None:
        """Raise one of `errors` unless a text is one SELECT."""
        self.connection.check(query)

    def ask(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Return column names and rows of a query."""
        try:
            return self.connection.ask(query)
        except sqlite3.OperationalError as error:
            if str(error) != "interrupted":
                raise
            raise (Expired if callable(signal.getsignal(signal.SIGALRM)) else KeyboardInterrupt) from None


class DuckDb:
    """DuckDB in memory."""

    def __init__(self) -> None:
        self.errors: tuple[type[Exception], ...] = (duckdb().Error,)
        self.connection = DuckDbConnection()
        self.connection.ask(_TABLE.format("VARCHAR", "BIGINT"))

    def load(self, rows: Sequence[tuple[Any, ...]]) -> None:
        """Replace the rows of the table."""
        self.connection.ask("DELETE FROM events")
        columns = [[row[place] for row in rows] for place in range(4)]
        types = ("BIGINT[]", "BIGINT[]", "VARCHAR[]", "BIGINT[]")
        unnested = ", ".join(f"unnest(CAST(? AS {one}))" for one in types)
        self.connection.ask(f"INSERT INTO events SELECT {unnested}", columns)

    def load_table(self, table: str, columns: Mapping[str, str], rows: Sequence[tuple[Any, ...]]) -> int:
        """Replace a table with typed columns by these rows; return the first `rowid`."""
        self.connection.ask(
            f"CREATE OR REPLACE TABLE {table} ({', '.join(f'{name} {type_}' for name, type_ in columns.items())})"
        )
        if rows:
            values = [[row[place] for row in rows] for place in range(len(columns))]
            given = {"TIMESTAMP": "make_timestamp(unnest(CAST(? AS BIGINT[])))"}
            unnested = ", ".join(given.get(type_, f"unnest(CAST(? AS {type_}[]))") for type_ in columns.values())
            self.connection.ask(f"INSERT INTO {table} SELECT {unnested}", values)
        return 0

    def check(self, query: str) -> None:
        """Raise one of `errors` unless a text is one SELECT."""
        self.connection.check(query)

    def ask(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Return column names and rows of a query."""
        return self.connection.ask(query)


PROGRAMS: Final[Mapping[str, Callable[[], SqliteTable | DuckDb]]] = {"sqlite": SqliteTable, "duckdb": DuckDb}
"""The dialects that rvaft runs; they number their rows themselves."""


@cache
def _running(program: str, process: int, kind: str) -> SqliteTable | DuckDb:  # noqa: ARG001
    """Return the program of this process, with the table of a kind of query."""
    return PROGRAMS[program]()


class Query:
    """A query with the program that runs it; raises `LanguageError` for other texts."""

    def __init__(self, text: str, program: str) -> None:
        self._program = program
        self.every = bool(re.search(r"^-- .*: every match\.$", text, re.MULTILINE))
        self.time, self.table = declared_time(text), TableHeader.read(text)
        self.body = re.sub(r"(?:\s|;|^\s*--[^\n]*$)*\Z", "", text, flags=re.MULTILINE)
        self.many = True
        """Whether the query has a column `trace`."""
        self._known: dict[str, int | None] = {}
        self._places: dict[int, int] = {}
        if not self.body:
            raise LanguageError("the text has no query")
        if re.search("[\\ud800-\\udfff\0]", text):
            raise LanguageError("the query contains half of a surrogate pair, or the character NUL")
        if self.table is not None and "." in self.table.table:
            raise LanguageError("rvaft runs queries on tables without a schema")
        if self.table is not None and self.table.position in {
            self.table.time,
            *(one.name for one in self.table.columns),
        }:
            raise LanguageError("rvaft runs queries whose position is a column of its own")
        errors = self._running().errors
        try:
            self._check()
            try:
                self._ask(())
            except errors:
                columns, _ = self._ask((), "SELECT *", "LIMIT 0")
                if "detected" not in columns:
                    message = "the query has no column `detected`, the number of the event that completes a match"
                    raise LanguageError(message) from None
                self.many = False
                self._ask(())
        except errors as error:
            raise LanguageError(" ".join(str(error).split("\n\n", maxsplit=1)[0].split())) from None

    def _running(self) -> SqliteTable | DuckDb:
        return _running(self._program, os.getpid(), "JSON" if self.table is None else "columns")

    def _check(self) -> None:
        """Raise an error of the program unless the text is one SELECT, so that it ends where its subquery ends."""
        with _ONE_AT_A_TIME:
            if self.table is not None:
                _load_table(self._running(), self.table, ())
            self._running().check(self.body)

    def _ask(
        self, traces: Iterable[tuple[int, Sequence[Json]]], select: str = "", group: str = ""
    ) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Return columns and rows of a selection from the query (default: first detections)."""
        program, trace = self._running(), "trace" if self.many else "0 AS trace"
        select, group = (select, group) if select else (f"SELECT {trace}, min(detected)", "GROUP BY 1")
        with _ONE_AT_A_TIME:
            rows = [row for number, events in traces for row in self._loaded(number, events)]
            if self.table is None:
                program.load(rows)
            else:
                self._places = _load_table(program, self.table, rows)
            return program.ask(f"{select} FROM (\n{self.body}\n) AS found {group}")

    def _rows(self, traces: Sequence[Sequence[Json]], select: str = "") -> Iterator[tuple[int, Any]]:
        numbered = [*enumerate(traces)]
        try:
            if self.many:
                yield from self._ask(numbered, select)[1] if numbered else ()
                return
            for number, trace in numbered:
                yield from ((number, value) for _, value in self._ask([(0, trace)], select)[1])
        except self._running().errors as error:
            raise ToolFailed("the query", reason=" ".join(str(error).split())) from None

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """Return the minimum of `detected` per trace, or None."""
        names = [json.dumps(trace) for trace in traces]
        new = {name: trace for name, trace in zip(names, traces, strict=True) if name not in self._known}
        if len(self._known) + len(new) > KEPT:
            self._known.clear()
            new = dict(zip(names, traces, strict=True))
        found = {number: self._position(detected) for number, detected in self._rows([*new.values()])}
        for detected in found.values():
            if detected is not None and not isinstance(detected, int):
                raise ToolFailed("the query", reason=f"`detected` is {detected!r}, not the number of an event")
        self._known.update((name, found.get(number)) for number, name in enumerate(new))
        return [self._known[name] for name in names]

    def matches(self, traces: Sequence[Sequence[Json]]) -> list[frozenset[Match]]:
        """Return all matches per trace, for a query with a column `trace`."""
        found: list[set[Match]] = [set() for _ in traces]
        for number, nodes in self._rows(traces, "SELECT trace, nodes"):
            found[number].add(
                frozenset(
                    (node, self._position(position))
                    for node, positions in json.loads(nodes).items()
                    for position in (positions if isinstance(positions, list) else [positions])
                )
            )
        return [*map(frozenset, found)]

    def _position(self, found: Any) -> Any:
        """Return the number of the event at a position of the table that was loaded last."""
        return self._places[found] if self._places and found is not None else found

    def left_open(self, trace: Sequence[Json]) -> str:
        """Return why a table cannot hold a trace or the query overflows on it, or an empty text."""
        try:
            _ = [*self._loaded(0, trace)]
        except TraceError as error:
            return error.message
        if has_larger([*trace], BITS // 2, doubles=True):  # products may exceed a column
            try:
                self.first_detections([trace])
            except ToolFailed:
                return "the query calculates numbers of more than 64 bits"
        return ""

    def _loaded(self, number: int, trace: Sequence[Json]) -> Iterator[tuple[Any, ...]]:
        for position, event in enumerate(trace, 1):
            time = None if self.time is None else self.time.read(event)
            if time is not None and abs(time) >= _LARGEST:
                raise TraceError("a time of more than 62 bits of nanoseconds does not fit in a column", line=position)
            if self.table is None:
                yield number, position, _written(event, position), time
                continue
            try:
                yield number, position, *self.table.cells(event, time)
            except OverflowError as error:
                raise TraceError(f"{error}, which the table cannot hold", line=position) from None


def _load_table(program: SqliteTable | DuckDb, table: TableHeader, rows: Sequence[tuple[Any, ...]]) -> dict[int, int]:
    """Load rows of trace, number of the event and cells; return the numbers by `rowid`, if it is
    the position.
    """
    columns = {qualified(name): COLUMN_TYPES[type_] for name, type_, _ in table.columns}
    if table.time:
        columns[qualified(table.time)] = {"timestamp": "TIMESTAMP", "double": "DOUBLE"}.get(table.kind, "BIGINT")
    own = {table.trace: 0, table.position: 1}
    given = [place for name, place in own.items() if name not in ("", ROWID)]
    columns = {**{qualified(name): "BIGINT" for name, place in own.items() if place in given}, **columns}
    kept = [(*(row[place] for place in given), *row[2:]) for row in rows]
    first = program.load_table(qualified(table.table), columns, kept)
    return {first + place: row[1] for place, row in enumerate(rows)} if table.position == ROWID else {}


def dialect_of(text: str) -> str:
    """Return the dialect that the first line of a text names, or an empty string."""
    found = re.match(r"-- rvaft sql (\w+)\n", text)
    return found[1] if found else ""


def _written(event: Json, position: int) -> str:
    """Return an event as JSON that SQL programs read alike; raises `TraceError` if they would
    change it.
    """
    try:
        text = _JSON(event)
    except ValueError:
        raise TraceError("a number that is not finite is not JSON", line=position) from None
    if "\\u0000" in text and _NULL.search(text):
        raise TraceError("a string with the character NUL, which SQL programs cut off", line=position)
    if re.search(r"\d{19}", text) and has_larger(event, BITS):
        raise TraceError("an integer of more than 64 bits, which SQL programs round", line=position)
    return _HALF.sub(lambda half: f"\\u{ord(half[0]):04x}", text)


@lru_cache(maxsize=64)
def query(text: str, program: str) -> Query:
    """Return the compiled query of a text (cached)."""
    return Query(text, program)


atexit.register(_running.cache_clear)  # close connections before DuckDB is unloaded
