"""Whole logs in DuckDB, for `rvaft monitor --engine duckdb`.

DuckDB reads the file into typed columns, runs the query of the tree, and counts equal events. It
reads more leniently than rvaft: rows that rvaft might read in another way are read again by rvaft,
or the log is declined.
"""

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BufferedIOBase
from itertools import islice
from pathlib import Path
from tempfile import gettempdir
from threading import Timer
from typing import Any, ClassVar, Final

from backends.sql import SqlTableBackend
from backends.sql.dialects import DIALECTS
from backends.sql.reader import DuckDb
from backends.sql.translation import SqlQuery
from backends.tables import Path as Place
from backends.tables import Table, column_types
from rvaft.backend import SpecificationText
from rvaft.core.classifier import Scope
from rvaft.core.property import Property
from rvaft.errors import NotExpressible, OptionError, RvaftError, TraceError
from rvaft.model.assumptions import EXACT, AssumptionCheck, places, used_events
from rvaft.model.event_time import UNITS, EventTime, TimeFormat
from rvaft.model.guards import Guard, Operation, Operator, walk
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.patterns import Literal, Pattern, Variable
from rvaft.model.values import JsonObject
from rvaft.model.verdict import Semantics
from rvaft.readers.json_lines import BLANK, NonFiniteEvent, event_on
from rvaft.readers.csv_table import CsvReader, delimiter
from rvaft.readers.log import BOM, MAX_LINE, Log, LogReader
from rvaft.readers.parquet import ParquetReader, picked
from rvaft.stream.plan import MonitoringPlan
from rvaft.stream.whole_log import FIRST, Declined, EventCount, LogAnswer, QueryEngine
from rvaft.stream.whole_log import Place as EventPlace
from rvaft.support.files import opened

MATCHES: Final = 20_000
"""Maximum number of matches of a query; a log with more is replayed in full."""
PATIENCE: Final = 60.0
"""Seconds for the matches; then the log is replayed in full."""
DOUBTS: Final = 10_000
"""Maximum number of lines that rvaft reads again."""
CLASSES: Final = 10_000
SPELLINGS: Final = 60
_CHUNK: Final = 1 << 20
_BY_VALUE: Final = frozenset({Operator.DIV, Operator.MUL, Operator.NUMBER})
"""Operators that may be undefined for values of the right types."""
_FOLDED: Final = "ſKßẞﬀﬁﬂﬃﬄﬅﬆ"
"""Letters other than ASCII that are ASCII in folded case."""
_DOUBTFUL: Final = (  # a trailing comma, other numbers than JSON, escapes of ASCII and of surrogates, long numbers
    r'[,]\s*[\]}]|[nN][aA][nN]|[iI][nN][fF]|\\u(00[0-7]|[dD][89a-fA-F])|[0-9]{1000}'
)
_ISO: Final = (
    r"\d{4}-\d\d-\d\d[Tt ]([01]\d|2[0-3]):[0-5]\d:[0-5]\d([.,]\d{1,9})?([Zz]|[+-]([01]\d|2[0-3]):?[0-5]\d)?"
)
_NUMBER: Final = r"-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][-+]?[0-9]+)?"


def _quoted(text: str) -> str:
    return DIALECTS["duckdb"].text(text)


def _whole(number: str) -> str:
    """Return the integer of a text of a number, NULL for another number."""
    return f"CASE WHEN TRY_CAST({number} AS DOUBLE) = floor(TRY_CAST({number} AS DOUBLE)) THEN TRY_CAST({number} AS BIGINT) END"


def _numeral(text: str) -> str:
    """Return a text in the syntax of numbers that fits a double, else NULL."""
    return f"CASE WHEN regexp_full_match({text}, '{_NUMBER}') AND isfinite(TRY_CAST({text} AS DOUBLE)) THEN {text} END"


def _beyond(number: str, kind: ValueType) -> str:
    """Return whether a number is not finite, or whether a column of this type does not hold it."""
    double = f"TRY_CAST({number} AS DOUBLE)"
    found = f"{double} IS NULL OR NOT isfinite({double})"
    if kind is ValueType.INTEGER:
        found += f" OR ({double} = floor({double}) AND TRY_CAST({number} AS BIGINT) IS NULL)"
    if kind is ValueType.NUMBER:
        found += f" OR abs({double}) >= {EXACT}"
    return found


def _nanoseconds(number: str, unit: int) -> str:
    """Return the nanoseconds of a text of a number; NULL unless they are exact."""
    exact = f"TRY_CAST({number} AS DECIMAL(38, 9)) * {unit}"
    plain = rf"regexp_full_match({number}, '-?[0-9]{{1,11}}(\.[0-9]{{1,9}})?|-?[0-9]{{1,18}}')"
    found = f"CASE WHEN {plain} AND {exact} = floor({exact}) THEN TRY_CAST({exact} AS BIGINT) END"
    if unit == 10**9:  # microseconds are exact in short decimals, and faster
        double = f"TRY_CAST({number} AS DOUBLE)"
        micro = f"round({double} * 1000000)"
        short = f"length({number}) < 16 AND {micro} / 1000000 = {double} AND abs({double}) < 4294967296"
        found = f"CASE WHEN {short} THEN CAST({micro} AS BIGINT) * 1000 ELSE {found} END"
    return found


def _instant(text: str) -> str:
    """Return the nanoseconds of a text in ISO 8601 with seconds."""
    seconds = f"epoch(TRY_CAST(replace(replace(left({text}, 19), 't', ' '), 'T', ' ') AS TIMESTAMP))"
    rest = f"substr({text}, 20)"
    fraction = f"CAST(rpad(regexp_extract({rest}, '[0-9]+'), 9, '0') AS BIGINT)"
    zone = f"regexp_extract({rest}, '[+-].*')"
    ahead = f"(CAST({zone}[:3] AS BIGINT) * 60 + CAST({zone}[1] || right({zone}, 2) AS BIGINT)) * 60"
    return (
        f"CASE WHEN regexp_full_match({text}, '{_ISO}') AND left({text}, 4) <> '0000' THEN "
        f"(CAST({seconds} AS BIGINT) - CASE WHEN {zone} <> '' THEN {ahead} ELSE 0 END) * 1000000000 + "
        f"CASE WHEN regexp_matches({rest}, '^[.,]') THEN {fraction} ELSE 0 END END"
    )


def _plain(name: str) -> bool:
    """Whether JSON spells a name in one way, except for numeric escapes."""
    return name.isascii() and name.isprintable() and not set(name) & set('"\\/')


class Source(ABC):
    """The rows of a file: expressions of their cells, and the events of some of them."""

    time_number: str = "NULL"
    """The text of the number in the field of the time, and its text."""
    time_text: str = "NULL"
    instant: str = "NULL"
    """The nanoseconds of a column of times."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        self.path, self.read, self.time = path, read, time
        if set(str(path)) & set("*?[{"):
            raise Declined("the name of the file is a pattern in DuckDB")

    @abstractmethod
    def rows(self, connection: Any) -> str:
        """Return what stands after FROM."""

    @abstractmethod
    def cell(self, place: Place, kind: ValueType) -> str:
        """Return the value at a place if it has this type, else NULL."""

    @abstractmethod
    def odd(self, place: Place, kind: ValueType) -> str:
        """Return whether a column of this type cannot hold the value at a place."""

    doubtful: str = "false"
    """Whether rvaft has to read a row itself."""

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:
        """Raise `Declined` unless rvaft reads the same rows."""

    @abstractmethod
    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events of rows."""


class JsonRows(Source):
    """JSON Lines."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        super().__init__(path, read, time)
        self.blank = False
        """Whether some lines are blank."""
        tree: dict[str, Any] = {}
        for place in (*read, *([time] if time else [])):
            inner = tree
            for name in place[:-1]:
                inner = inner.setdefault(str(name), {})
            inner.setdefault(str(place[-1]), "JSON")
        self.form = json.dumps(tree)
        if any(not _plain(str(name)) for place in (*read, *([time] if time else [])) for name in place):
            raise Declined("JSON spells the name of a field in several ways")
        levels = [tree]
        for level in levels:
            if len({name.lower() for name in level}) < len(level):
                raise Declined("two fields differ in case only, which DuckDB does not distinguish")
            levels += [inner for inner in level.values() if isinstance(inner, dict)]
        if time:
            raw = self._raw(time)
            text = f"CASE WHEN left({raw}, 1) = '\"' THEN {self._value(time)} ->> '$' END"
            number = f"CASE WHEN left({raw}, 1) = '-' OR left({raw}, 1) BETWEEN '0' AND '9' THEN {raw} END"
            if len(time) == 1:  # DuckDB rounds the digits of long numbers
                key = re.escape(json.dumps(str(time[0]), ensure_ascii=False))
                field = _quoted(rf"{key}\s*:\s*(-?[0-9.eE+-]+)")
                written = f"regexp_extract(json, {field}, 1)"
                same = f"TRY_CAST({written} AS DOUBLE) = TRY_CAST({raw} AS DOUBLE)"
                long = f"CASE WHEN {same} THEN {written} END"
            else:
                long = "NULL"
            number = f"CASE WHEN long THEN CASE WHEN {number} IS NOT NULL THEN {long} END ELSE {number} END"
            self.time_number, self.time_text = f"coalesce({number}, {_numeral(text)})", text
        paths = (*read, *([time] if time else []))
        names = (re.sub(r"[%_\\]", r"\\\g<0>", json.dumps(str(name), ensure_ascii=False)) for one in paths for name in one)
        twice = " OR ".join(rf"json LIKE {_quoted(f'%{name}%{name}%')} ESCAPE '\'" for name in dict.fromkeys(names))
        objects = dict.fromkeys(one[:size] for one in paths for size in range(len(one)))
        written = ("$" + "".join(f".{json.dumps(str(name))}" for name in one) for one in objects)
        keys = [f"json_keys(json, {_quoted(one)})" for one in written]
        repeated = " OR ".join(f"len({one}) > len(list_distinct({one}))" for one in keys)
        deep = "length(json) - length(translate(json, '[{', '')) > 400"
        self.doubtful = (
            f"CASE WHEN regexp_matches(json, {_quoted(_DOUBTFUL)}) THEN true WHEN length(json) > 1000 AND {deep} "
            f"THEN true WHEN {twice} THEN {repeated} ELSE false END"
        )

    def rows(self, connection: Any) -> str:
        connection.execute("SET VARIABLE log = ?", [str(self.path.resolve())])
        lines = f"read_ndjson_objects(getvariable('log'), format = 'newline_delimited', maximum_object_size = {MAX_LINE})"
        form = _quoted(self.form)
        long = "regexp_matches(json, '[0-9.]{16}')" if self.time else "false"
        return f"(SELECT json, json_transform(json, {form}) AS f, json_type(json) <> 'OBJECT' AS other, {long} AS long FROM {lines})"

    def _value(self, place: Place) -> str:
        return "f" + "".join(f"[{_quoted(str(name))}]" for name in place)

    def _raw(self, place: Place) -> str:
        return f"CAST({self._value(place)} AS VARCHAR)"

    def cell(self, place: Place, kind: ValueType) -> str:
        raw = self._raw(place)
        match kind:
            case ValueType.TEXT:
                return f"CASE WHEN left({raw}, 1) = '\"' THEN {self._value(place)} ->> '$' END"
            case ValueType.INTEGER:
                return f"CASE WHEN left({raw}, 1) <> '\"' THEN {_whole(raw)} END"
            case ValueType.NUMBER:
                return f"CASE WHEN left({raw}, 1) <> '\"' THEN TRY_CAST({raw} AS DOUBLE) END"
            case _:
                return f"CASE {raw} WHEN 'true' THEN true WHEN 'false' THEN false END"

    def odd(self, place: Place, kind: ValueType) -> str:
        raw = self._raw(place)
        return f"CASE WHEN left({raw}, 1) IN ('\"', '{{', '[', 't', 'f') THEN false ELSE {_beyond(raw, kind)} END"

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:
        lines, ended = 0, True
        with opened(self.path) as stream:
            while data := stream.read(_CHUNK):
                if b"\x0c" in data or b"\x0b" in data or b"\r" in data.replace(b"\r\n", b"").removesuffix(b"\r"):
                    raise Declined("a line has a control character")
                lines, ended = lines + data.count(b"\n"), data.endswith(b"\n")
        self.blank = rows != lines + (not ended)
        if self.blank and sum(1 for _ in self._lines()) != rows:
            raise Declined("DuckDB finds another number of events than rvaft")
        for number, _, event in self.events(doubtful, reads):
            if isinstance(event, NonFiniteEvent):
                raise Declined(f"event {number} has a number that is not finite")

    def _lines(self) -> Iterator[tuple[int, bytes]]:
        """Yield the lines with an event."""
        with opened(self.path) as stream:
            for number, line in enumerate(stream, 1):
                text = line.removeprefix(BOM) if number == 1 else line
                if text.strip(BLANK):
                    yield number, text

    def _some(self, numbers: Iterable[int]) -> Iterator[tuple[int, int, bytes]]:
        if self.blank:
            wanted = iter(numbers)
            number = next(wanted, 0)
            for place, (line, text) in enumerate(self._lines(), 1):
                if place == number:
                    yield number, line, text
                    number = next(wanted, 0)
            return
        with opened(self.path) as stream:
            before = 0
            for number in numbers:
                text = next(islice(stream, number - before - 1, None), b"")
                yield number, number, text.removeprefix(BOM) if number == 1 else text
                before = number

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        for number, line, text in self._some(numbers):
            event = event_on(text.removesuffix(b"\n"), str(self.path), line, reads)
            if event is None:
                raise TraceError("the file has changed while it was read", file=str(self.path), line=line)
            yield number, line, event


class CsvRows(Source):
    """CSV without quotes."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        super().__init__(path, read, time)
        with opened(path) as stream:
            self.head = stream.readline(_CHUNK)
        head = self.head.removeprefix(BOM).decode(errors="replace")
        self.delimiter = delimiter(head, path)
        self.names = [name.strip() for name in head.rstrip("\r\n").split(self.delimiter)]
        if len({name.lower() for name in self.names}) < len(self.names) or not all(self.names):
            raise Declined("the header has an empty name, or names that differ in case only")
        if time:
            text = self._cell(time)
            self.time_number, self.time_text = _numeral(text), text

    def rows(self, connection: Any) -> str:
        """Return the table of the cells."""
        connection.execute("SET VARIABLE log = ?", [str(self.path.resolve())])
        columns = ", ".join(f"{_quoted(name)}: 'VARCHAR'" for name in self.names)
        cells = f"columns = {{{columns}}}, delim = {_quoted(self.delimiter)}, quote = '', escape = '', nullstr = ''"
        how = "header = false, skip = 1, auto_detect = false, null_padding = false, comment = '', strict_mode = true"
        return f"(SELECT *, false AS other FROM read_csv(getvariable('log'), {cells}, {how}))"

    def _cell(self, place: Place) -> str:
        name = str(place[0])
        return f'"{name}"' if len(place) == 1 and name in self.names else "CAST(NULL AS VARCHAR)"

    def cell(self, place: Place, kind: ValueType) -> str:
        """Return a cell; one in the syntax of numbers is a number."""
        text = self._cell(place)
        number = _numeral(text)
        match kind:
            case ValueType.TEXT:
                return f"CASE WHEN {number} IS NULL THEN {text} END"
            case ValueType.INTEGER:
                return _whole(number)
            case ValueType.NUMBER:
                return f"TRY_CAST({number} AS DOUBLE)"
            case _:
                return "CAST(NULL AS BOOLEAN)"

    def odd(self, place: Place, kind: ValueType) -> str:
        """Return whether a number is not finite, or has more bits than the column."""
        number = _numeral(self._cell(place))
        return f"CASE WHEN {number} IS NULL THEN false ELSE {_beyond(number, kind)} END"

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:  # noqa: ARG002
        """Raise `Declined` for quotes, blanks before cells and empty lines."""
        lines, ended, before = 0, True, b"\n"
        with opened(self.path) as stream:
            while data := stream.read(_CHUNK):
                text = before + data
                if b'"' in data or b"\0" in data or any(text.count(one + b" ") for one in (b"\n", self.delimiter.encode())):
                    raise Declined("the table has quotes, or blanks before cells")
                if b"\r" in text.replace(b"\r\n", b"").removesuffix(b"\r"):
                    raise Declined("a line has a control character")
                lines, ended, before = lines + data.count(b"\n"), data.endswith(b"\n"), data[-1:]
        if rows != lines + (not ended) - 1:
            raise Declined("DuckDB finds another number of events than rvaft")

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events of rows."""
        wanted = iter(numbers)
        given: list[int] = []

        def lines() -> Iterator[bytes]:
            yield self.head
            with opened(self.path) as stream:
                stream.readline()
                before = 0
                for number in wanted:
                    given.append(number)
                    yield next(islice(stream, number - before - 1, None), b"")
                    before = number

        log = Log(CsvReader(), LinesGiven(lines()), str(self.path), reads)
        for place, event in enumerate(log.events()):
            if event is None or log.rejected:
                raise TraceError("the file has changed while it was read", file=str(self.path), line=None)
            yield given[place], given[place] + 1, event


class LinesGiven(BufferedIOBase):
    """A stream of given lines."""

    def __init__(self, lines: Iterator[bytes]) -> None:
        super().__init__()
        self._lines = lines

    def readline(self, size: int | None = -1) -> bytes:  # noqa: ARG002
        """Return the next line."""
        return next(self._lines, b"")


_INTEGERS: Final = frozenset({"TINYINT", "SMALLINT", "INTEGER", "BIGINT", "UTINYINT", "USMALLINT", "UINTEGER", "UBIGINT"})
_INSTANTS: Final = {
    "TIMESTAMP": "epoch_us({}) * 1000",
    "TIMESTAMP WITH TIME ZONE": "epoch_us({}) * 1000",
    "TIMESTAMP_NS": "epoch_ns({})",
    "TIMESTAMP_MS": "epoch_ms({}) * 1000000",
    "TIMESTAMP_S": "epoch_ms({}) * 1000000",
}


class ParquetRows(Source):
    """Parquet tables with columns of texts, integers, doubles and Booleans."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        super().__init__(path, read, time)
        self.types: dict[str, str] = {}

    def rows(self, connection: Any) -> str:
        """Return the table."""
        connection.execute("SET VARIABLE log = ?", [str(self.path.resolve())])
        table = "read_parquet(getvariable('log'), binary_as_string = false)"
        self.types = {name: kind for name, kind, *_ in connection.execute(f"DESCRIBE SELECT * FROM {table}").fetchall()}
        for place in (*self.read, *([self.time] if self.time else [])):
            name = str(place[0])
            near = [other for other in self.types if other.lower() == name.lower()]
            if len(place) > 1 and near:
                raise Declined(f"DuckDB is not asked for fields inside the column {name}")
            if near and near != [name]:
                raise Declined(f"columns differ from the field {name} in case only")
            timed = self.types.get(name) in _INSTANTS and place == self.time and place not in self.read
            if near and not timed and self.types[name] not in {*_INTEGERS, "VARCHAR", "FLOAT", "DOUBLE", "BOOLEAN"}:
                raise Declined(f"the column {name} is of the type {self.types[name]}")
        if self.time and (kind := self.types.get(str(self.time[0]), "")):
            cell = f'"{self.time[0]}"'
            if kind in _INSTANTS:
                self.time_text = f"CASE WHEN {cell} IS NOT NULL THEN 'time' END"
                self.instant = _INSTANTS[kind].format(cell)
            elif kind == "VARCHAR":
                self.time_number, self.time_text = _numeral(cell), cell
            elif kind != "BOOLEAN":
                self.time_number = f"CAST({cell if kind in _INTEGERS else f'CAST({cell} AS DOUBLE)'} AS VARCHAR)"
        return f"(SELECT *, false AS other FROM {table})"

    def cell(self, place: Place, kind: ValueType) -> str:
        """Return a cell of a column of this type."""
        name = str(place[0])
        known = self.types.get(name, "") if len(place) == 1 else ""
        match kind:
            case ValueType.TEXT:
                return f'"{name}"' if known == "VARCHAR" else "CAST(NULL AS VARCHAR)"
            case ValueType.INTEGER if known in _INTEGERS:
                return f'TRY_CAST("{name}" AS BIGINT)'
            case ValueType.INTEGER if known in ("FLOAT", "DOUBLE"):
                return f'CASE WHEN "{name}" = floor("{name}") THEN TRY_CAST("{name}" AS BIGINT) END'
            case ValueType.INTEGER:
                return "CAST(NULL AS BIGINT)"
            case ValueType.NUMBER:
                number = known in ("FLOAT", "DOUBLE", *_INTEGERS)
                return f'CAST("{name}" AS DOUBLE)' if number else "CAST(NULL AS DOUBLE)"
            case _:
                return f'"{name}"' if known == "BOOLEAN" else "CAST(NULL AS BOOLEAN)"

    def odd(self, place: Place, kind: ValueType) -> str:
        """Return whether a number is not finite, or has more bits than the column."""
        name = str(place[0])
        known = self.types.get(name, "") if len(place) == 1 else ""
        if known not in ("FLOAT", "DOUBLE", *_INTEGERS):
            return "false"
        text = f'CAST("{name}" AS VARCHAR)'
        return f'CASE WHEN "{name}" IS NULL THEN false ELSE {_beyond(text, kind)} END'

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:
        """Accept all rows: the table is typed."""

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events of rows."""
        for number, event in picked(Log(ParquetReader(), self.path, str(self.path), reads), numbers):
            yield number, number, event


_FORMATS: Final[Mapping[str, type[Source]]] = {"csv": CsvRows, "jsonl": JsonRows, "parquet": ParquetRows}


class _LogBackend(SqlTableBackend):
    """The query of a tree, and conditions of its patterns."""

    name: ClassVar[str] = "the engine duckdb"
    query: SqlQuery

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the query."""
        assert self._table is not None, "the table is made for the tree"
        self.query = SqlQuery(prop, semantics, DIALECTS["duckdb"], limit, self._table)
        return SpecificationText(*self.query.text())


@dataclass(frozen=True)
class Column:
    """A column of the table of events."""

    name: str
    place: Place
    kind: ValueType


class DuckDbEngine(QueryEngine):
    """DuckDB, for trees whose query on typed columns rvaft can write, under `scattered` and `consecutive`."""

    formats: ClassVar[frozenset[str]] = frozenset(_FORMATS)

    def __init__(self, plan: MonitoringPlan) -> None:
        DuckDb.installed()
        self.plan, self.types = plan, plan.monitors.types
        part, tree, semantics = plan.monitors.columns[0].part, self.types.tree, plan.monitors.semantics
        if semantics not in (Semantics.SCATTERED, Semantics.CONSECUTIVE):
            raise NotExpressible(
                "a query does not tell when a verdict becomes false",
                backend=_LogBackend.name,
                semantics=semantics,
            )
        time = tree.time
        if time is not None and (time.format not in (*UNITS, TimeFormat.ISO8601)):
            raise NotExpressible(f"DuckDB does not read times as {time.format}", backend=_LogBackend.name)
        guards = [*(node.when for node in tree.top_down()), *(one.when for one in tree.ignores)]
        by_value = (one for guard in guards for one in walk(guard))
        if any(isinstance(one, Operation) and one.operator in _BY_VALUE for one in by_value):
            raise NotExpressible("guards with *, / and number() may be undefined in some events only", backend=_LogBackend.name)
        plain = _LogBackend(None, "duckdb")
        kinds = column_types(plain.prepared(tree, semantics))
        self.columns = [Column(f"c{number}", place, kind) for number, (place, kind) in enumerate(kinds.items(), 1)]
        used = column_types(plain.prepared(part, semantics))
        named = {".".join(map(str, one.place)): one.name for one in self.columns if one.place in used}
        table = Table("log", named, "pos", "", "" if time is None else "time", "ns")
        self.backend = _LogBackend(table, "duckdb")
        text = self.backend.translate(part, semantics).text
        self.every = bool(re.search(r"^-- .*: every match\.$", text, re.MULTILINE))
        self.query = text
        self.name_of = {one.place: one.name for one in self.columns}
        entries = [self._condition(letter.pattern) for what, _, letter in self.types.letters if what == "entry"]
        self.entry = f"({' OR '.join(f'({one})' for one in dict.fromkeys(entries))}) IS TRUE"

    def _condition(self, pattern: Pattern, when: Guard | None = None) -> str:
        return self.backend.query.condition(pattern, [] if when is None else [when])

    def _literal(self, value: object) -> str:
        term = self.backend.query.guards.literal(value)
        return term.whole or term.real or term.text or term.truth or "NULL"

    def _broken(self) -> str:
        """Return the condition that an event breaks the assumptions `types` or `present`."""
        tree, found = self.types.tree, list[str]()
        for name in used_events(tree):
            parts = [(place, part) for place, part, _ in places(tree.events[name].pattern)]
            fits = [f"{self.name_of[place]} = {self._literal(part.value)}" for place, part in parts if isinstance(part, Literal)]
            lacks = [f"{self.name_of[place]} IS NULL" for place, part in parts if isinstance(part, Variable)]
            if lacks:
                found.append(f"({' AND '.join([*fits, ''])}({' OR '.join(lacks)}))")
        if Assumption.EXACT in tree.assumes:
            integers = [one.name for one in self.columns if one.kind is ValueType.INTEGER]
            found += [f"abs({name}) >= {EXACT}" for name in integers]
        return " OR ".join(found) or "false"

    def _keys(self) -> Iterator[str]:
        """Yield expressions with equal values for events that match the same patterns and guards."""
        literals: dict[Place, dict[str, None]] = {}
        for what, _, letter in self.types.letters:
            for place, part, _ in places(letter.pattern):
                if isinstance(part, Literal):
                    literals.setdefault(place, {})[self._literal(part.value)] = None
            if letter.when is not None:
                yield f"({self._condition(letter.pattern, letter.when)}) IS TRUE"
        for place, values in literals.items():
            name = self.name_of[place]
            tests = [f"{name} IN ({', '.join(values)})"]
            if len(place) == 1 and place[0] in self.types.discriminators.fields:
                texts = [str(one) for one in self._texts(place)]
                spelled = dict.fromkeys(_quoted(text.strip("/ ").casefold()) for text in texts)
                tests.append(f"lower(trim({name}, '/ ')) IN ({', '.join(spelled)})")
                others = "[^ -~]" if not all(map(str.isascii, texts)) else f"[{_FOLDED}]"
                tests.append(f"regexp_matches({name}, {_quoted(others)})")
            yield f"CASE WHEN {' OR '.join(tests)} THEN {name} END"

    def _texts(self, place: Place) -> Iterator[str]:
        for _, _, letter in self.types.letters:
            for other, part, _ in places(letter.pattern):
                if other == place and isinstance(part, Literal) and isinstance(part.value, str):
                    yield part.value

    def ask(self, path: Path, reader: LogReader | None) -> "DuckDbAnswer":
        """Return what is in a log; raises `Declined`."""
        time = self.types.tree.time
        field: Place = ("time",) if time is None else time.field
        name = "jsonl" if reader is None else reader.name
        source = _FORMATS[name](path, [one.place for one in self.columns], field)
        duckdb = DuckDb.installed()
        connection = duckdb.connect()
        try:
            return DuckDbAnswer(self, source, connection)
        except duckdb.Error as error:
            connection.close()
            raise Declined(f"DuckDB: {str(error).strip().partition(chr(10))[0]}") from error
        except BaseException:
            connection.close()
            raise


class DuckDbAnswer(LogAnswer):
    """A table in DuckDB, and what was asked of it."""

    def __init__(self, engine: DuckDbEngine, source: Source, connection: Any) -> None:
        self.engine, self.source, self.connection = engine, source, connection
        connection.execute(f"SET temp_directory = {_quoted(gettempdir())}")
        self._load()
        self._check()
        keys = ", ".join(engine._keys()) or "1"
        groups = self._ask(f"SELECT count(*), min(pos, {FIRST}) FROM log GROUP BY {keys} LIMIT {CLASSES + 1}")
        if len(groups) > CLASSES:
            raise Declined(f"more than {CLASSES} kinds of events")
        self.groups = [EventCount(number, first) for number, first in groups]
        self.noted = [*self._noted()]
        self.selected = self._selected()

    def _ask(self, query: str) -> list[tuple[Any, ...]]:
        found: list[tuple[Any, ...]] = self.connection.execute(query).fetchall()
        return found

    def _load(self) -> None:
        engine, source, tree = self.engine, self.source, self.engine.types.tree
        rows = source.rows(self.connection)
        cells = [f"{source.cell(one.place, one.kind)} AS {one.name}" for one in engine.columns]
        match tree.time:
            case None:
                time = f"CAST(TRY_CAST({source.time_number} AS DOUBLE) AS DOUBLE)"
            case EventTime(format=TimeFormat.ISO8601):
                time = f"coalesce({_instant('time_text')}, instant)"
            case declared:
                time = _nanoseconds("time_number", UNITS[declared.format])
        odd = " OR ".join(["other", *(source.odd(one.place, one.kind) for one in engine.columns)])
        self.connection.execute(
            f"CREATE TABLE log AS SELECT pos, {''.join(f'{one.name}, ' for one in engine.columns)}"
            f"{time} AS time, time_number IS NULL AND time_text IS NOT NULL AS words, odd, doubtful FROM "
            f"(SELECT row_number() OVER () AS pos, {''.join(f'{one}, ' for one in cells)}"
            f"CAST({source.time_number} AS VARCHAR) AS time_number, CAST({source.time_text} AS VARCHAR) AS time_text, "
            f"{source.instant} AS instant, "
            f"coalesce({odd}, false) AS odd, coalesce({source.doubtful}, true) AS doubtful FROM {rows})"
        )

    def _check(self) -> None:
        """Raise `Declined` for a log with a warning, or with values that columns do not hold."""
        engine, tree = self.engine, self.engine.types.tree
        timed, entry = tree.time is not None, engine.entry
        causes = {
            "has a value that a column cannot hold exactly": "odd",
            "breaks an assumption of the tree": engine._broken(),
            "has a time that cannot be read": f"{entry} AND time IS NULL" if timed else f"{entry} AND words",
        }
        counts = ", ".join(f"min(pos) FILTER (WHERE {cause})" for cause in causes.values())
        [(self.total, *found)] = self._ask(f"SELECT count(*), {counts} FROM log")
        doubtful = [number for (number,) in self._ask(f"SELECT pos FROM log WHERE doubtful LIMIT {DOUBTS + 1}")]
        if len(doubtful) > DOUBTS:
            raise Declined(f"more than {DOUBTS} lines that DuckDB may read in another way")
        try:
            self.source.check(self.total, sorted(doubtful), engine.plan.reads)
        except (RvaftError, OSError) as error:
            raise error if isinstance(error, Declined) else Declined(str(error)) from error
        for cause, number in zip(causes, found, strict=True):
            if number is not None:
                raise Declined(f"event {number} {cause}")
        late = None if tree.time is None else tree.time.late
        if late is not None:
            before = "max(time) OVER (ROWS UNBOUNDED PRECEDING)"
            back = f"SELECT pos FROM (SELECT pos, {before} - time > {late} AS back FROM log) WHERE back LIMIT 1"
        else:
            before = "lag(time) OVER ()"
            back = f"SELECT pos FROM (SELECT pos, {before} > time AS back FROM log WHERE {entry} AND time IS NOT NULL) WHERE back LIMIT 1"
        for (number,) in self._ask(back):
            raise Declined(f"the time goes back at event {number}")
        if Assumption.CASE in tree.assumes:
            self._check_case()

    def _check_case(self) -> None:
        check = AssumptionCheck(self.engine.types.tree, [Assumption.CASE])
        for one in self.engine.columns:
            if one.kind is not ValueType.TEXT:
                continue
            for (text,) in self._ask(f"SELECT DISTINCT {one.name} FROM log WHERE {one.name} IS NOT NULL"):
                event: Any = text
                for name in reversed(one.place):
                    event = {name: event}
                if check.broken(event):
                    raise Declined(f"{json.dumps(text)} breaks the assumption case")

    def _noted(self) -> Iterator[int]:
        engine = self.engine
        for field in engine.types.discriminators.fields:
            name = engine.name_of[field,]
            known = ", ".join(map(_quoted, engine._texts((field,))))
            query = f"SELECT min(pos) FROM log WHERE NOT {engine.entry} AND {name} NOT IN ({known}) GROUP BY {name}"
            yield from (number for (number,) in self._ask(f"{query} ORDER BY 1 LIMIT {SPELLINGS}"))

    def _matches(self) -> list[tuple[int, list[int]]] | None:
        """Return each match: the number of the last event, and those of all; None for too many."""
        timer = Timer(PATIENCE, self.connection.interrupt)
        timer.daemon = True
        timer.start()
        try:
            found = self._ask(f"SELECT detected, nodes FROM (\n{self.engine.query}\n) AS found LIMIT {MATCHES + 1}")
        except DuckDb.installed().InterruptException:
            return None
        finally:
            timer.cancel()
        if len(found) > MATCHES:
            return None
        return [(last, sorted(_positions(nodes))) for last, nodes in found]

    def _selected(self) -> Iterable[int]:
        monitors = self.engine.plan.monitors
        whole = len(monitors.columns) == 1
        matches = self._matches()
        if matches == []:
            return []
        every = f"SELECT pos FROM log WHERE {self.engine.entry} ORDER BY pos"
        if matches is None or (monitors.repeat and not self.engine.every):
            return self._numbers(every)
        first = min(last for last, _ in matches)
        if not self.engine.every:
            return self._numbers(f"SELECT pos FROM log WHERE {self.engine.entry} AND pos <= {first} ORDER BY pos")
        if monitors.semantics is Semantics.SCATTERED:
            most = first if whole and not monitors.repeat else self.total
            return sorted({number for _, numbers in matches for number in numbers if number <= most})
        if not whole:
            return self._numbers(every)
        ranges, before = list[tuple[int, int]](), 0
        for last, numbers in sorted(matches):
            if numbers[0] > before:
                ranges.append((numbers[0], last))
                before = last
        chosen = " OR ".join(f"pos BETWEEN {start} AND {end}" for start, end in ranges[: None if monitors.repeat else 1])
        return self._numbers(f"SELECT pos FROM log WHERE {self.engine.entry} AND ({chosen}) ORDER BY pos")

    def _numbers(self, query: str) -> Iterator[int]:
        found = self.connection.cursor().execute(query)
        while rows := found.fetchmany(10_000):
            yield from (number for (number,) in rows)

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events with these numbers."""
        return self.source.events(numbers, reads)

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()


def _positions(nodes: str) -> Iterator[int]:
    for found in json.loads(nodes).values():
        yield from found if isinstance(found, list) else [found]
