"""The files that DuckDB reads for `rvaft monitor --engine duckdb`, as expressions of typed cells.

DuckDB reads more leniently than rvaft. Rows that rvaft might read in another way are *doubtful*, and
are read again by rvaft.
"""

import csv
import json
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import BufferedIOBase
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from backends.sql.connections import DuckDbConnection
from backends.sql.dialects import identifier, literal
from backends.tables import Path as Place
from rvaft.core.fields_to_read import Scope
from rvaft.errors import TraceError
from rvaft.model.nodes import ValueType
from rvaft.model.values import EXACT_INTEGERS
from rvaft.readers.csv_table import CsvReader, delimiter
from rvaft.readers.json_lines import BLANK, NonFiniteEvent, event_on
from rvaft.readers.log import BOM, MAX_LINE, Log, lines_of
from rvaft.readers.parquet import ParquetReader, column_names, picked
from rvaft.stream.keys import Field
from rvaft.stream.whole_log import Declined
from rvaft.stream.whole_log import Place as EventPlace
from rvaft.support.files import opened

_CHUNK: Final = 1 << 20
_DOUBTFUL: Final = (  # a trailing comma, other numbers than JSON, escapes of ASCII and of surrogates, long numbers
    r"[,]\s*[\]}]|[nN][aA][nN]|[iI][nN][fF]|\\u(00[0-7]|[dD][89a-fA-F])|[0-9]{1000}"
)
_ISO: Final = r"\d{4}-\d\d-\d\d[Tt ]([01]\d|2[0-3]):[0-5]\d:[0-5]\d([.,]\d{1,9})?([Zz]|[+-]([01]\d|2[0-3]):?[0-5]\d)?"
_NUMBER: Final = r"-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][-+]?[0-9]+)?"


def _whole(number: str) -> str:
    """Return the integer of a text of a number, NULL for another number."""
    double = f"TRY_CAST({number} AS DOUBLE)"
    return f"CASE WHEN {double} = floor({double}) THEN TRY_CAST({number} AS BIGINT) END"


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
        found += f" OR abs({double}) >= {EXACT_INTEGERS}"
    return found


def nanoseconds(number: str, unit: int) -> str:
    """Return the nanoseconds of a text of a number, rounded half to even; NULL beyond 63 bits.

    `unit` is a power of ten. An exponent is written out, if 38 digits suffice.
    """
    places = len(str(unit)) - 1
    cases = {
        f"'-?[0-9]{{1,{18 - places + (unit == 1)}}}'": f"TRY_CAST({number} AS BIGINT) * {unit}",
        rf"'-?[0-9]{{1,{19 - places}}}[.][0-9]+'": _rounded(number, places),
        "'-?[0-9.]{1,17}[eE](-0?[0-9]|[+]?0?[0-9]|[+]?1[01])'": _rounded(
            f"CAST(TRY_CAST({number} AS DECIMAL(38, 25)) AS VARCHAR)", places
        ),
    }
    found = " ".join(f"WHEN regexp_full_match({number}, {shape}) THEN {value}" for shape, value in cases.items())
    if unit == 10**9:  # microseconds are exact in short decimals, and faster
        double = f"TRY_CAST({number} AS DOUBLE)"
        micro = f"round({double} * 1000000)"
        short = f"length({number}) < 16 AND {micro} / 1000000 = {double} AND abs({double}) < 4294967296"
        found = f"WHEN {short} THEN CAST({micro} AS BIGINT) * 1000 {found}"
    return f"CASE {found} END"


def _rounded(number: str, places: int) -> str:
    """Return a decimal with a point as an integer of units in the last of some places, rounded half to even."""
    point = f"strpos({number}, '.')"
    base = f"TRY_CAST(left(replace({number} || '{'0' * places}', '.', ''), {point} - 1 + {places}) AS BIGINT)"
    rest = f"rtrim(substr({number}, {point} + {places + 1}), '0')"
    up = f"{rest} > '5' OR ({rest} = '5' AND {base} % 2 <> 0)"
    away = f"CASE WHEN left({number}, 1) = '-' THEN -1 ELSE 1 END"
    return f"CASE WHEN abs({base}) < 9000000000000000000 THEN {base} + CASE WHEN {up} THEN {away} ELSE 0 END END"


def instant(text: str) -> str:
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


def _key(text: str, number: str) -> tuple[str, str]:
    """Return the text of the value of a key, equal for equal numbers, and whether a double is not exact."""
    double = f"TRY_CAST({number} AS DOUBLE)"
    return f"coalesce(CAST({double} + 0.0 AS VARCHAR), {text})", f"length({number}) > 15 OR NOT isfinite({double})"


class LogFile(ABC):
    """The rows of a file: expressions of their cells, and the events of some of them."""

    time_number: str = "NULL"
    """The text of the number in the field of the time, and its text."""
    time_text: str = "NULL"
    instant: str = "NULL"
    """The nanoseconds of a column of times."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        self.path, self.read, self.time = path, read, time

    @abstractmethod
    def rows(self, connection: DuckDbConnection, name: str) -> str:
        """Return what stands after FROM; `name` is that of the file in DuckDB.

        Its columns have names of our own, so that no name in the file is one in SQL.
        """

    def _scan(self, function: str, name: str, options: Mapping[str, str]) -> str:
        """Return the call of a function that reads the file and nothing else."""
        given = {**options, **dict.fromkeys(("filename", "hive_partitioning", "union_by_name"), "false")}
        return f"{function}({', '.join([literal(name), *(f'{key} = {value}' for key, value in given.items())])})"

    @property
    def _compression(self) -> str:
        """How the file is compressed; as everywhere, its suffix decides."""
        return literal({".gz": "gzip", ".zst": "zstd"}.get(self.path.suffix.lower(), "uncompressed"))

    @abstractmethod
    def cell(self, place: Place, kind: ValueType) -> str:
        """Return the value at a place if it has this type, else NULL."""

    @abstractmethod
    def odd(self, place: Place, kind: ValueType) -> str:
        """Return whether a column of this type cannot hold the value at a place."""

    @abstractmethod
    def key(self, field: Field) -> tuple[str, str]:
        """Return the text of the value of a key, and whether other values may have this text.

        The text is NULL if the event lacks the field; raises `Declined` for a table without the column.
        """

    doubtful: str = "false"
    """Whether rvaft has to read a row itself."""

    @abstractmethod
    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:
        """Raise `Declined` unless rvaft reads the same rows."""

    @abstractmethod
    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events of rows."""


class JsonFile(LogFile):
    """JSON Lines."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        super().__init__(path, read, time)
        self.blank = False
        """Whether some lines are blank."""
        tree: dict[str, Any] = {}
        for place in (*read, *([time] if time else [])):
            inner: Any = tree
            for depth, name in enumerate(place, 1):
                if not isinstance(inner, dict):
                    raise Declined(f"the field {place[0]} is read as a whole, and inside")
                inner = inner.setdefault(str(name), "JSON" if depth == len(place) else {})
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
            # DuckDB rounds the digits of long numbers.
            name = json.dumps(str(time[-1]), ensure_ascii=False)
            field = literal(rf"{re.escape(name)}\s*:\s*(-?[0-9.eE+-]+)")
            written = f"regexp_extract(json, {field}, 1)"
            once = f"strpos(substr(json, strpos(json, {literal(name)}) + 1), {literal(name)}) = 0"
            same = f"TRY_CAST({written} AS DOUBLE) = TRY_CAST({raw} AS DOUBLE)"
            long = f"CASE WHEN {once} AND {same} THEN {written} END"
            number = f"CASE WHEN long THEN CASE WHEN {number} IS NOT NULL THEN {long} END ELSE {number} END"
            self.time_number, self.time_text = f"coalesce({number}, {_numeral(text)})", text
        paths = (*read, *([time] if time else []))
        names = dict.fromkeys(re.sub("[%_]", r"\\\g<0>", f'"{name}"') for one in paths for name in one)
        twice = " OR ".join(rf"json LIKE {literal(f'%{name}%{name}%')} ESCAPE '\'" for name in names)
        objects = dict.fromkeys(one[:size] for one in paths for size in range(len(one)))
        spelled = ("$" + "".join(f".{json.dumps(str(name))}" for name in one) for one in objects)
        keys = [f"json_keys(json, {literal(one)})" for one in spelled]
        repeated = " OR ".join(f"len({one}) > len(list_distinct({one}))" for one in keys)
        deep = "length(json) - length(translate(json, '[{', '')) > 400"
        self.doubtful = (
            f"CASE WHEN regexp_matches(json, {literal(_DOUBTFUL)}) THEN true WHEN length(json) > 1000 AND {deep} "
            f"THEN true WHEN {twice} THEN {repeated} ELSE false END"
        )

    def rows(self, connection: DuckDbConnection, name: str) -> str:  # noqa: ARG002
        """Return the table of the decoded lines."""
        options = {
            "format": "'newline_delimited'",
            "maximum_object_size": str(MAX_LINE),
            "compression": self._compression,
            "ignore_errors": "false",
        }
        lines = self._scan("read_ndjson_objects", name, options)
        form = literal(self.form)
        long = "regexp_matches(json, '[0-9.]{16}')" if self.time else "false"
        decoded = f"json_transform(json, {form}) AS f, json_type(json) <> 'OBJECT' AS other"
        return f"(SELECT json, {decoded}, {long} AS long FROM {lines})"

    def _value(self, place: Place) -> str:
        return "f" + "".join(f"[{literal(str(name))}]" for name in place)

    def _raw(self, place: Place) -> str:
        return f"CAST({self._value(place)} AS VARCHAR)"

    def cell(self, place: Place, kind: ValueType) -> str:
        """Return the value at a place if it has this type."""
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
        """Return whether a number is not finite, or has more bits than the column."""
        raw = self._raw(place)
        other = f"{raw} IS NULL OR left({raw}, 1) IN ('\"', '{{', '[', 't', 'f')"
        return f"CASE WHEN {other} THEN false ELSE {_beyond(raw, kind)} END"

    def key(self, field: Field) -> tuple[str, str]:
        """Return the value as JSON; objects and lists may have rounded numbers."""
        found, odd = list[str](), list[str]()
        for place in dict.fromkeys([(field.text,), field.path]):
            raw, path = self._raw(place), "$" + "".join(f".{json.dumps(name)}" for name in place)
            null = f"CASE WHEN json_exists(json, {literal(path)}) THEN 'null' END"
            text, beyond = _key(raw, f"CASE WHEN left({raw}, 1) NOT IN ('\"', 't', 'f') THEN {raw} END")
            found += [text, null]
            odd.append(f"left({raw}, 1) IN ('{{', '[') OR {beyond}")
        return f"coalesce({', '.join(found)})", " OR ".join(odd)

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:
        """Raise `Declined` for lines that rvaft reads in another way."""
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
            for number, text in lines_of(stream, str(self.path)):
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
        """Yield the events on lines."""
        for number, line, text in self._some(numbers):
            event = event_on(text.removesuffix(b"\n"), str(self.path), line, reads)
            if event is None:
                raise TraceError("the file has changed while it was read", file=str(self.path), line=line)
            yield number, line, event


class CsvFile(LogFile):
    """CSV with one line per row."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        super().__init__(path, read, time)
        with opened(path) as stream:
            self.head = stream.readline(_CHUNK)
        try:
            head = self.head.removeprefix(BOM).decode()
            self.delimiter = delimiter(head, path)
            lines = csv.reader([head], delimiter=self.delimiter, skipinitialspace=True, strict=True)
            self.names = [name.strip() for name in next(lines, [])]
        except (UnicodeDecodeError, csv.Error) as error:
            raise Declined("the header cannot be read") from error
        if not all(self.names) or len(set(self.names)) < len(self.names):
            raise Declined("the header has an empty name, or a name twice")
        if head.startswith(("{", "[", "<", "sep=")) or any('"' in name for name in self.names):
            raise Declined("the header has quotes in a name, or is none")
        self.quote = ""
        self.rows_written = self._scanned() - 1
        if time:
            text = self._cell(time)
            self.time_number, self.time_text = _numeral(text), text

    def _scanned(self) -> int:
        """Return the number of lines; raises `Declined` for lines that are read in several ways."""
        lines, ended, before, divider = 0, True, b"\n", re.escape(self.delimiter.encode())
        unusual = re.compile(rb'\0|\n\r?\n|[\n%s] |" | "|[^\n\r"%s]"[^\n\r"%s]' % (divider, divider, divider))
        cell = rb'(?:"(?:[^"\n]|"")*"|[^"\n%s]*)%s' % (divider, divider)
        columns = len(self.names)
        last = re.compile(rb"%s\r?$" % divider, re.MULTILINE)
        longer = re.compile(rb"^(?:%s){%d,}\r?$" % (cell, columns), re.MULTILINE)
        with opened(self.path) as stream:
            while data := stream.read(_CHUNK) + (rest := stream.readline(_CHUNK)):
                if len(rest) == _CHUNK:
                    raise Declined("a line is longer than 1 MiB")
                text = before + data
                if last.search(data) and longer.search(data):
                    raise Declined("a line ends with a separator after the last column")
                if unusual.search(text):
                    raise Declined("the table has empty lines, quotes inside cells, or blanks before cells")
                self.quote = self.quote or '"' * (b'"' in data)
                if b"\r" in text.replace(b"\r\n", b"").removesuffix(b"\r"):
                    raise Declined("a line has a control character")
                lines, ended, before = lines + data.count(b"\n"), data.endswith(b"\n"), text[-2:]
        return lines + (not ended)

    def rows(self, connection: DuckDbConnection, name: str) -> str:  # noqa: ARG002
        """Return the table of the cells."""
        columns = ", ".join(f"f{number}: 'VARCHAR'" for number in range(len(self.names)))
        options = {
            "columns": f"{{{columns}}}",
            "delim": literal(self.delimiter),
            **dict.fromkeys(("quote", "escape"), literal(self.quote)),
            **dict.fromkeys(("nullstr", "comment"), "''"),
            **dict.fromkeys(("header", "auto_detect", "null_padding", "ignore_errors"), "false"),
            "skip": "1",
            "strict_mode": "true",
            "compression": self._compression,
        }
        return f"(SELECT *, false AS other FROM {self._scan('read_csv', name, options)})"

    def _cell(self, place: Place) -> str:
        known = len(place) == 1 and place[0] in self.names
        return f"nullif(f{self.names.index(str(place[0]))}, '')" if known else "CAST(NULL AS VARCHAR)"

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

    def key(self, field: Field) -> tuple[str, str]:
        """Return the text of a cell."""
        if field.text not in self.names:
            raise Declined(f"there is no column {field.text}")
        text = self._cell((field.text,))
        return _key(text, _numeral(text))

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:  # noqa: ARG002
        """Raise `Declined` for empty lines."""
        if rows != self.rows_written:
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

        log = Log(CsvReader(), cast("BinaryIO", LinesGiven(lines())), str(self.path), reads)
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


_INTEGERS: Final = frozenset(
    {"TINYINT", "SMALLINT", "INTEGER", "BIGINT", "UTINYINT", "USMALLINT", "UINTEGER", "UBIGINT"}
)
_INSTANTS: Final = {
    "TIMESTAMP": "epoch_us({}) * 1000",
    "TIMESTAMP WITH TIME ZONE": "epoch_us({}) * 1000",
    "TIMESTAMP_NS": "epoch_ns({})",
    "TIMESTAMP_MS": "epoch_ms({}) * 1000000",
    "TIMESTAMP_S": "epoch_ms({}) * 1000000",
}


class ParquetFile(LogFile):
    """Parquet tables with columns of texts, integers, doubles and Booleans."""

    def __init__(self, path: Path, read: Sequence[Place], time: Place | None) -> None:
        super().__init__(path, read, time)
        self.types: dict[str, str] = {}
        self.columns: dict[str, str] = {}
        """Our name of a column that is read."""

    def rows(self, connection: DuckDbConnection, name: str) -> str:
        """Return the table."""
        table = self._scan("read_parquet", name, {"binary_as_string": "false"})
        self.types = {column: kind for column, kind, *_ in connection.ask(f"DESCRIBE SELECT * FROM {table}")[1]}
        if [*self.types] != column_names(self.path):
            raise Declined("DuckDB gives the columns other names")
        for place in (*self.read, *([self.time] if self.time else [])):
            self._admit(place)
        if self.time and (kind := self.types.get(str(self.time[0]), "")):
            cell = self.columns[str(self.time[0])]
            if kind in _INSTANTS:
                self.time_text = f"CASE WHEN {cell} IS NOT NULL THEN 'time' END"
                self.instant = _INSTANTS[kind].format(cell)
            elif kind == "VARCHAR":
                self.time_number, self.time_text = _numeral(cell), cell
            elif kind not in ("BOOLEAN", '"NULL"'):
                self.time_number = f"CAST({cell if kind in _INTEGERS else f'CAST({cell} AS DOUBLE)'} AS VARCHAR)"
        named = "".join(f"{identifier(column)} AS {own}, " for column, own in self.columns.items())
        return f"(SELECT {named}false AS other FROM {table})"

    def _admit(self, place: Place) -> None:
        """Name the column of a place, if there is one; raises `Declined` for what DuckDB reads in another way."""
        name = str(place[0])
        near = [other for other in self.types if other.lower() == name.lower()]
        if len(place) > 1 and near:
            raise Declined(f"DuckDB is not asked for fields inside the column {name}")
        if near and near != [name]:
            raise Declined(f"columns differ from the field {name} in case only")
        if not near:
            return
        timed = self.types[name] in _INSTANTS and place == self.time and place not in self.read
        if not timed and self.types[name] not in {*_INTEGERS, "VARCHAR", "FLOAT", "DOUBLE", "BOOLEAN", '"NULL"'}:
            raise Declined(f"the column {name} is of the type {self.types[name]}")
        self.columns.setdefault(name, f"f{len(self.columns)}")

    def _column(self, place: Place) -> tuple[str, str]:
        """Return our name of a column and its type; empty without a column."""
        name = str(place[0])
        return (self.columns[name], self.types[name]) if len(place) == 1 and name in self.columns else ("", "")

    def cell(self, place: Place, kind: ValueType) -> str:
        """Return a cell of a column of this type."""
        cell, known = self._column(place)
        match kind:
            case ValueType.TEXT:
                return cell if known == "VARCHAR" else "CAST(NULL AS VARCHAR)"
            case ValueType.INTEGER if known in _INTEGERS:
                return f"TRY_CAST({cell} AS BIGINT)"
            case ValueType.INTEGER if known in ("FLOAT", "DOUBLE"):
                return f"CASE WHEN {cell} = floor({cell}) THEN TRY_CAST({cell} AS BIGINT) END"
            case ValueType.INTEGER:
                return "CAST(NULL AS BIGINT)"
            case ValueType.NUMBER:
                number = known in ("FLOAT", "DOUBLE", *_INTEGERS)
                return f"CAST({cell} AS DOUBLE)" if number else "CAST(NULL AS DOUBLE)"
            case _:
                return cell if known == "BOOLEAN" else "CAST(NULL AS BOOLEAN)"

    def odd(self, place: Place, kind: ValueType) -> str:
        """Return whether a number is not finite, or has more bits than the column."""
        cell, known = self._column(place)
        if known not in ("FLOAT", "DOUBLE", *_INTEGERS):
            return "false"
        return f"CASE WHEN {cell} IS NULL THEN false ELSE {_beyond(f'CAST({cell} AS VARCHAR)', kind)} END"

    def key(self, field: Field) -> tuple[str, str]:
        """Return the text of a cell."""
        cell, known = self._column((field.text,))
        if not cell:
            raise Declined(f"there is no column {field.text}")
        real = known in ("FLOAT", "DOUBLE")
        return f"CAST({cell}{' + 0.0' * real} AS VARCHAR)", f"NOT isfinite({cell})" if real else "false"

    def check(self, rows: int, doubtful: Sequence[int], reads: Scope) -> None:
        """Accept all rows: the table is typed."""

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events of rows."""
        for number, event in picked(Log(ParquetReader(), self.path, str(self.path), reads), numbers):
            yield number, number, event


FORMATS: Final[Mapping[str, type[LogFile]]] = {"csv": CsvFile, "jsonl": JsonFile, "parquet": ParquetFile}
