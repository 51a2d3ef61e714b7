"""A query that runs: traces become rows of the table `events`, and its rows are the detections.

A query has a column `detected`, the number of the event with which a match is complete, and, if it tells traces apart, a column `trace`; one that does
not is asked once for each trace. The header of a text that was written here says where events have their times.
"""

import atexit
import json
import re
import signal
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any, Final

from rvaft.backend import Match
from rvaft.errors import LanguageError, ToolFailed, TraceError, installed
from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.values import Json, has_larger
from rvaft.support.budget import Expired

_TABLE: Final = "CREATE TABLE events (trace INTEGER, pos INTEGER, event {}, time {})"
_TIME: Final = re.compile(r"^-- time (\[.*\]) as (\w+)", re.MULTILINE)
_NULL: Final = re.compile(r"(?<!\\)(?:\\\\)*\\u0000")
_HALF: Final = re.compile("[\ud800-\udfff]")
_LARGEST: Final = 2**62
BITS: Final = 64
"""Of so many bits are the whole numbers of a column."""
KEPT: Final = 2_000
"""So many answers a query remembers: a monitor asks for each beginning of a trace."""


class SqliteTable:
    """SQLite in memory."""

    errors: tuple[type[Exception], ...] = (sqlite3.Error, sqlite3.Warning)

    def __init__(self) -> None:
        self.connection = sqlite3.connect(":memory:", check_same_thread=False, isolation_level=None)
        self.connection.execute(_TABLE.format("TEXT", "INTEGER"))
        self.connection.execute("PRAGMA temp_store = MEMORY")  # tables of a few rows, made anew for each query
        self.connection.set_progress_handler(lambda: 0, 100_000)  # so that a time that is up is noticed

    def load(self, rows: Sequence[tuple[Any, ...]]) -> None:
        """Make these the rows of the table."""
        self.connection.execute("DELETE FROM events")
        self.connection.executemany("INSERT INTO events VALUES (?, ?, ?, ?)", rows)

    def ask(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """The names of the columns and the rows of a query."""
        try:
            found = self.connection.execute(query)
            return [column[0] for column in found.description or ()], found.fetchall()
        except sqlite3.OperationalError as error:
            if str(error) != "interrupted":
                raise
            raise (Expired if callable(signal.getsignal(signal.SIGALRM)) else KeyboardInterrupt) from None


class DuckDb:
    """DuckDB in memory."""

    def __init__(self) -> None:
        duckdb = installed("duckdb", "DuckDB", "pip install '.[duckdb]' in a checkout of rvaft")
        self.errors = (duckdb.Error,)
        self.connection = duckdb.connect(config={"enable_external_access": "false", "threads": "1"})
        self.connection.execute(_TABLE.format("VARCHAR", "BIGINT"))
        self.statements: Callable[[str], Sequence[object]] = duckdb.extract_statements

    def load(self, rows: Sequence[tuple[Any, ...]]) -> None:
        """Make these the rows of the table."""
        self.connection.execute("DELETE FROM events")
        columns = [[row[place] for row in rows] for place in range(4)]
        types = ("BIGINT[]", "BIGINT[]", "VARCHAR[]", "BIGINT[]")
        unnested = ", ".join(f"unnest(CAST(? AS {one}))" for one in types)
        self.connection.execute(f"INSERT INTO events SELECT {unnested}", columns)

    def ask(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """The names of the columns and the rows of a query."""
        if len(self.statements(query)) > 1:
            message = "more than one statement"
            raise self.errors[0](message)
        found = self.connection.execute(query)
        return [column[0] for column in found.description or ()], found.fetchall()


class Query:
    """A text with the program that runs it; raises `LanguageError` for what is no query on the table `events`."""

    def __init__(self, text: str, program: Callable[[], SqliteTable | DuckDb]) -> None:
        self.program = program()
        self.every = bool(re.search(r"^-- .*: every match\.$", text, re.MULTILINE))
        self.time = _declared(text)
        self.body = re.sub(r"(?:\s|;|^\s*--[^\n]*$)*\Z", "", text, flags=re.MULTILINE)
        self._known: dict[str, int | None] = {}
        if not self.body:
            raise LanguageError("there is no query")
        columns, _ = self._ask(f"SELECT * FROM (\n{self.body}\n) AS found LIMIT 0")
        if "detected" not in columns:
            raise LanguageError("the query has no column `detected`, the number of the event that completes a match")
        self.many = "trace" in columns

    def _ask(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        try:
            return self.program.ask(query)
        except self.program.errors as error:
            raise LanguageError(" ".join(str(error).split("\n\n", maxsplit=1)[0].split())) from None

    def _rows(self, columns: str, traces: Sequence[Sequence[Json]], group: str = "") -> Iterator[tuple[int, list[Any]]]:
        """The rows for each trace, by its number."""
        parts = [[*enumerate(traces)]] if self.many and traces else [[pair] for pair in enumerate(traces)]
        for part in parts:
            self.program.load([row for number, trace in part for row in self._loaded(number, trace)])
            trace = "trace" if self.many else str(part[0][0]) if part else "0"
            query = f"SELECT {trace} AS trace, {columns} FROM (\n{self.body}\n) AS found {group}"
            try:
                _, rows = self.program.ask(query)
            except self.program.errors as error:
                raise ToolFailed("the query", reason=" ".join(str(error).split())) from None
            for number, *values in rows:
                yield number, values

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """For each trace the least number in `detected`."""
        names = [json.dumps(trace) for trace in traces]
        new = {name: trace for name, trace in zip(names, traces, strict=True) if name not in self._known}
        if len(self._known) + len(new) > KEPT:
            self._known.clear()
            new = dict(zip(names, traces, strict=True))
        found: dict[int, int] = {}
        for number, (detected,) in self._rows("min(detected)", [*new.values()], "GROUP BY 1") if new else ():
            if detected is not None and not isinstance(detected, int):
                raise ToolFailed("the query", reason=f"`detected` is {detected!r}, which is no number of an event")
            if detected is not None:
                found[number] = detected
        self._known.update((name, found.get(number)) for number, name in enumerate(new))
        return [self._known[name] for name in names]

    def matches(self, traces: Sequence[Sequence[Json]]) -> list[frozenset[Match]]:
        """For each trace all its matches."""
        found: list[set[Match]] = [set() for _ in traces]
        for number, (nodes,) in self._rows("nodes", traces):
            found[number].add(frozenset(json.loads(nodes).items()))
        return [*map(frozenset, found)]

    def left_open(self, trace: Sequence[Json]) -> str:
        """Why a table does not keep an event, or its time, if that is so."""
        try:
            _ = [*self._loaded(0, trace)]
        except TraceError as error:
            return error.message
        return ""

    def _loaded(self, number: int, trace: Sequence[Json]) -> Iterator[tuple[Any, ...]]:
        for position, event in enumerate(trace, 1):
            time = None if self.time is None else self.time.read(event)
            if time is not None and abs(time) >= _LARGEST:
                raise TraceError("a time of more than 62 bits of nanoseconds, which no column holds", line=position)
            yield number, position, _written(event, position), time


def _written(event: Json, position: int) -> str:
    """An event as JSON that SQL programs read alike; raises `TraceError` for what they do not keep as it is."""
    try:
        text = json.dumps(event, ensure_ascii=False, allow_nan=False)
    except ValueError:
        raise TraceError("a number that is not finite, which JSON does not have", line=position) from None
    if "\\u0000" in text and _NULL.search(text):
        raise TraceError("a text with the character NUL, at which SQL programs end it", line=position)
    if re.search(r"\d{19}", text) and has_larger(event, BITS):
        raise TraceError("an integer of more than 64 bits, which SQL programs round", line=position)
    return _HALF.sub(lambda half: f"\\u{ord(half[0]):04x}", text)


def _declared(text: str) -> EventTime | None:
    """Where events have their times, as the header of a text says it."""
    found = _TIME.search(text)
    if found is None:
        return None
    try:
        return EventTime(tuple(json.loads(found[1])), TimeFormat(found[2]))
    except ValueError:
        raise LanguageError(
            "the header names no field and format of times", line=text.count("\n", 0, found.start()) + 1
        ) from None


@lru_cache(maxsize=64)
def query(text: str, program: Callable[[], SqliteTable | DuckDb] = SqliteTable) -> Query:
    """A text made ready, once for all who ask it."""
    return Query(text, program)


atexit.register(query.cache_clear)  # DuckDB complains of connections that outlive it
