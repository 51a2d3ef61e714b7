"""What a query reads of an event: fields of a column with JSON, or typed columns of a table.

A table has a row per event, and a column per field that the tree reads; NULL stands for a field
that is absent. The types are those of the parameters and literals of the tree (`assume types,
present;`).
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple, TypeAlias, cast

from backends.sql.dialects import Dialect, Path
from backends.sql.guards import FACETS, SqlTerm
from rvaft.core.property import Property
from rvaft.core.times import untimed
from rvaft.errors import NotExpressible, OptionError
from rvaft.model.assumptions import has_type, places, used_events
from rvaft.model.event_time import UNITS, EventTime, TimeFormat
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.values import Json, at, has_surrogate, is_finite

ROWID: Final = "rowid"
"""The position of rows in SQLite and DuckDB, which number them themselves."""
TIMES: Final = ("timestamp", "double", "s", "ms", "us", "ns")
"""Kinds of time columns: a timestamp, seconds as a double, or an integer of a unit."""
FINEST: Final = 1_000
"""Nanoseconds: timestamps and doubles hold whole microseconds."""
DOUBLES: Final = 2**32 * 10**9
"""Nanoseconds below which a double holds seconds to the microsecond."""
ABSENT: Final = cast("Json", object())
_FACETS: Final[Mapping[ValueType, str]] = {
    ValueType.TEXT: "text",
    ValueType.INTEGER: "whole",
    ValueType.NUMBER: "real",
    ValueType.BOOLEAN: "truth",
}
_NUMBERS: Final = frozenset({ValueType.INTEGER, ValueType.NUMBER})
COLUMN_TYPES: Final[Mapping[ValueType, str]] = {
    ValueType.TEXT: "TEXT",
    ValueType.INTEGER: "BIGINT",
    ValueType.NUMBER: "DOUBLE PRECISION",
    ValueType.BOOLEAN: "BOOLEAN",
}
OWN: Final = frozenset(
    {"trace", "pos", "time", "place", "start", "shift", "late", "event", "detected", "branch", "nodes"}
)
"""Names of columns of the query."""
_RESERVED: Final = re.compile(
    "all|analyse|analyze|and|any|array|as|asc|asymmetric|between|binary|both|by|case|cast|check|collate|"
    "collation|column|constraint|create|cross|current|current_date|current_time|current_timestamp|"
    "current_user|default|deferrable|delete|desc|describe|distinct|do|drop|else|end|except|exclude|exists|"
    "false|fetch|following|for|foreign|freeze|from|full|grant|group|having|if|ilike|in|index|initially|inner|"
    "insert|intersect|interval|into|is|isnull|join|lateral|leading|left|like|limit|localtime|natural|not|"
    "notnull|null|of|offset|on|only|or|order|outer|over|overlaps|partition|pivot|placing|preceding|primary|"
    "qualify|range|references|returning|right|row|rows|select|session_user|set|show|similar|some|summarize|"
    "symmetric|table|tablesample|then|to|trailing|transaction|trigger|true|unbounded|union|unique|unpivot|"
    "update|user|using|values|variadic|verbose|view|when|where|window|with",
    re.IGNORECASE,
)


def identifier(name: str) -> str:
    """Return a name in SQL, quoted where it is no plain word.

    >>> identifier("src_ip"), identifier("order"), identifier("main.auth log")
    ('src_ip', '"order"', 'main."auth log"')
    """
    return ".".join(
        part if re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", part) and not _RESERVED.fullmatch(part) else f'"{part}"'
        for part in name.split(".")
    )


@dataclass(frozen=True)
class Table:
    """A table of events; `columns` names the column of a field, whose path is joined by dots.

    By default a column has the name of its field, `position` orders the rows, and `trace` separates
    the logs of a table.
    """

    name: str = "events"
    columns: Mapping[str, str] = field(default_factory=dict)
    position: str = "pos"
    trace: str = "trace"
    time: str = "time"
    kind: str = "ns"
    """One of `TIMES`; empty for the one that suits the format of the tree."""

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "Table":
        """Return the table of some options; raises `OptionError`.

        >>> Table.of({"table": "auth", "time": "ts:ms"}).kind
        'ms'
        """
        known = {"table", "columns", "position", "partition", "time", "dialect"}
        if unknown := sorted(set(options) - known):
            raise OptionError(f"a table has no {unknown[0]}; known: {', '.join(sorted(known))}")
        columns = options.get("columns", {})
        if not isinstance(columns, dict) or "table" not in options:
            raise OptionError("name the table, and its columns as an object from fields to columns")
        time, _, kind = str(options.get("time", "")).partition(":")
        if kind and kind not in TIMES:
            raise OptionError(f"no column of times has the type {kind}; known: {', '.join(TIMES)}")
        table = cls(options["table"], columns, options.get("position", ROWID), options.get("partition", ""), time, kind)
        for name in (table.name, *columns.values(), table.position, table.trace, table.time):
            if not isinstance(name, str) or re.search('["\x00-\x1f\x7f]', name):
                raise OptionError(f"{name!a} is no name of a column or table")
        if not (table.name and table.position and all(columns.values())):
            raise OptionError("the name of a table or column is empty")
        return table


class Column(NamedTuple):
    """A column of a table with the type and the path of its field."""

    name: str
    type: ValueType
    path: Path


class TableHeader(NamedTuple):
    """The table of a text, as its comment defines it."""

    table: str
    position: str
    trace: str
    time: str
    kind: str
    columns: tuple[Column, ...]

    def cells(self, event: Json, time: int | None) -> list[Json]:
        """Return the columns of an event, without those of its position and trace.

        A value that the type excludes is NULL. Raises `OverflowError` for one that the column
        cannot hold exactly.
        """
        cells = [_cell(at(event, map(str, path), ABSENT), type_) for _, type_, path in self.columns]
        return [*cells, _time_cell(time, self.kind)] if self.time else cells

    def lines(self) -> Iterator[str]:
        """Yield the lines of the comment."""
        parts = {"position": self.position, "trace": self.trace, "time": self.time}
        named = "".join(f", {what} {json.dumps(name)}" for what, name in parts.items() if name)
        yield f"table {json.dumps(self.table)}{named}{f' as {self.kind}' if self.time else ''}"
        for name, type_, path in self.columns:
            yield f"column {json.dumps(name)} {type_} of {json.dumps(path)}"

    @classmethod
    def read(cls, text: str) -> "TableHeader | None":
        """Return the table that the comment of a text defines, or None."""
        word = r'("(?:[^"\\]|\\.)*")'
        first = re.search(
            rf"^-- table {word}, position {word}(?:, trace {word})?(?:, time {word} as (\w+))?$", text, re.MULTILINE
        )
        if first is None:
            return None
        columns = [
            Column(json.loads(name), ValueType(type_), tuple(json.loads(path)))
            for name, type_, path in re.findall(rf"^-- column {word} (\w+) of (\[.*\])$", text, re.MULTILINE)
        ]
        table, position, trace, time = (json.loads(one or '""') for one in first.groups()[:4])
        return cls(table, position, trace, time, first[5] or "", tuple(columns))


@dataclass(frozen=True)
class JsonRows:
    """Events as JSON in a column `event`."""

    dialect: Dialect
    source: str = "events"
    trace: str = "trace"
    position: str = "pos"
    time: str = "time"
    column: str = "event"

    def header(self) -> Iterator[str]:
        """Yield the lines of the comment that describe the table."""
        yield "events(trace, pos, event, time): the log, its number from 1, the event as JSON, nanoseconds or NULL."

    def numbered(self) -> "tuple[str, JsonRows]":
        """Return the columns for a table of numbered events, and the rows of that table."""
        return "trace, pos, event, time", self

    def is_event(self, path: Path) -> bool:
        """Whether a path leads to a whole event."""
        return self.column == "event" and not path

    def is_text(self, value: str, path: Path) -> str:
        """Return the test that a value is this string."""
        return self.dialect.is_text(value, self.column, path)

    def there(self, path: Path) -> list[str]:
        """Return the tests that an event has a value."""
        return [] if self.is_event(path) else [f"{self.dialect.kind(self.column, path)} IS NOT NULL"]

    def is_object(self, path: Path) -> list[str]:
        """Return the tests that a value is an object."""
        return [] if self.is_event(path) else [self.dialect.is_a("object", self.column, path)]

    def is_list(self, path: Path, length: int | None = None) -> str:
        """Return the test that a value is a list, of this length."""
        size = f" AND {self.dialect.value('length', self.column, path)} = {length}"
        return f"{self.dialect.is_a('list', self.column, path)}{'' if length is None else size}"

    def items(self, path: Path, name: str) -> "tuple[str, JsonRows]":
        """Return the table of the items of a list, and the rows of that table."""
        return self.dialect.items.format(*self.dialect.way(self.column, path), name), replace(self, column=name)

    def facets(self, path: Path) -> dict[str, str]:
        """Return the columns of a variable at a path."""
        dialect = self.dialect
        facets = {kind: dialect.facet(kind, self.column, path) for kind in FACETS[:4]}
        facets |= {"null": dialect.is_a("null", self.column, path), "key": dialect.key(self.column, path)}
        return {**facets, "json": dialect.value("json", self.column, path)}

    def term(self, path: Path) -> SqlTerm:
        """Return the value at a path."""
        return SqlTerm.of(self.facets(path))

    def variable(self, columns: Mapping[str, str], path: Path) -> SqlTerm:  # noqa: ARG002
        """Return the variable with these columns."""
        return SqlTerm.of(columns)


@dataclass(frozen=True)
class TableRows:
    """Events in the typed columns of a table; `names` are expressions for the columns."""

    table: TableHeader
    source: str
    trace: str
    position: str
    time: str
    types: Mapping[Path, ValueType]
    names: Mapping[Path, str]
    variables: Mapping[str, ValueType]
    dialect: Dialect

    @classmethod
    def of(cls, table: Table, prop: Property, dialect: Dialect) -> "TableRows":
        """Return the rows of a table for a property; raises `NotExpressible` and `OptionError`."""
        types = _types(prop)
        names = {".".join(map(str, path)): path for path in types}
        if len(names) < len(types):
            raise NotExpressible("two fields have the same name with dots, and columns are named by it")
        if unknown := sorted(set(table.columns) - set(names)):
            known = ", ".join(sorted(names)) or "none"
            raise OptionError(f"the tree reads no field {unknown[0]}; fields: {known}")
        columns = tuple(
            Column(table.columns.get(name, name.replace(".", "_")), types[path], path) for name, path in names.items()
        )
        for column in columns:
            if re.search('["\x00-\x1f\x7f]', column.name):
                raise NotExpressible(f"the field {column.name!a} is no name of a column: name one for it")
        taken = [*(column.name.lower() for column in columns), *filter(None, (table.trace.lower(),))]
        if twice := next((name for name in taken if taken.count(name) > 1), ""):
            raise OptionError(f"two fields have the column {twice}: name their columns")
        time, kind = "", ""
        if prop.time is not None and table.time:
            kind = table.kind or _kind(prop.time, dialect)
            time = _nanoseconds(identifier(table.time), kind, dialect)
        elif any(untimed(event.pattern)[1] is not None for event in prop.events) and prop.time is not None:
            raise OptionError(f"the tree compares times: name the column of {'.'.join(prop.time.field)} as the time")
        header = TableHeader(table.name, table.position, table.trace, table.time if kind else "", kind, columns)
        expressions = {column.path: identifier(column.name) for column in columns}
        source, trace, position = map(identifier, (table.name, table.trace or "_", table.position))
        trace = trace if table.trace else ""
        return cls(header, source, trace, position, time, types, expressions, _variables(prop, types), dialect)

    def header(self) -> Iterator[str]:
        """Yield the lines of the comment that describe the table."""
        yield from self.table.lines()

    def numbered(self) -> "tuple[str, TableRows]":
        """Return the columns for a table of numbered events, and the rows of that table."""
        inner = {
            path: f"{name.strip(chr(34))}_" if name.strip('"').lower() in OWN else name
            for path, name in self.names.items()
        }
        own = {"trace": self.trace, "pos": self.position, "time": self.time}
        columns = {**{expression: name for name, expression in own.items() if expression}}
        shown = [*(name if name == expression else f"{expression} AS {name}" for expression, name in columns.items())]
        shown += [name if inner[path] == name else f"{name} AS {inner[path]}" for path, name in self.names.items()]
        trace, time = ("trace" if self.trace else ""), ("time" if self.time else "")
        return ", ".join(shown), replace(self, trace=trace, position="pos", time=time, names=inner)

    def is_event(self, path: Path) -> bool:
        """Whether a path leads to a whole event."""
        return not path

    def is_text(self, value: str, path: Path) -> str:
        """Return the test that a value is this string."""
        return f"{self.names[path]} = {self.dialect.text(value)}"

    def there(self, path: Path) -> list[str]:  # noqa: ARG002
        """Return no test: the tree assumes that its parameters have values."""
        return []

    def is_object(self, path: Path) -> list[str]:  # noqa: ARG002
        """Return no test: a column inside the object has a value."""
        return []

    def is_list(self, path: Path, length: int | None = None) -> str:
        """Raise `NotExpressible`."""
        raise NotExpressible(f"a column holds no list{'' if length is None else f' of {length} items'}: {path[-1]}")

    def items(self, path: Path, name: str) -> "tuple[str, TableRows]":  # noqa: ARG002
        """Raise `NotExpressible`."""
        raise NotExpressible(self.is_list(path))

    def facets(self, path: Path) -> dict[str, str]:
        """Return the column of a variable at a path."""
        return dict.fromkeys(("key", "json"), self.names[path])

    def term(self, path: Path) -> SqlTerm:
        """Return the value at a path."""
        return self._term(self.names[path], path)

    def variable(self, columns: Mapping[str, str], path: Path) -> SqlTerm:
        """Return the variable at a path with this column."""
        return self._term(columns["key"], path)

    def absent(self, variable: str) -> str:
        """Return NULL with the type of a variable."""
        return self.dialect.cast("NULL", COLUMN_TYPES[self.variables[variable]])

    def _term(self, column: str, path: Path) -> SqlTerm:
        kind = _FACETS[self.types[path]]
        return SqlTerm(
            whole=column if kind == "whole" else None,
            real=column if kind == "real" else None,
            text=column if kind == "text" else None,
            truth=column if kind == "truth" else None,
            total=True,
            key=column,
            plain=True,
        )


Rows: TypeAlias = JsonRows | TableRows
"""The rows of a query."""


def _types(prop: Property) -> dict[Path, ValueType]:
    """Return the types of the fields that a property reads; raises `NotExpressible`."""
    tree, found = prop.tree, dict[Path, tuple[ValueType, str]]()

    def add(path: Path, type_: ValueType, what: str) -> None:
        known, where = found.setdefault(path, (type_, what))
        if known is not type_ and not {known, type_} <= _NUMBERS:
            name = ".".join(map(str, path))
            raise NotExpressible(f"a column has one type, and {name} is {known} in {where} but {type_} in {what}")
        found[path] = (known if known is type_ else ValueType.NUMBER), where

    missing = [one for one in (Assumption.TYPES, Assumption.PRESENT) if one not in prop.assumes]
    for name in used_events(tree):
        event = tree.events[name]
        for path, part, _ in places(event.pattern):
            written = ".".join(map(str, path))
            match part:
                case Variable(parameter):
                    type_ = event.type_of(parameter)
                    if missing:
                        raise NotExpressible(f"typed columns need `assume {', '.join(missing)};`")
                    if type_ not in _FACETS:
                        what = f"declare the type of parameter {parameter} of event {name}"
                        raise NotExpressible(f"a column has text, numbers or Booleans: {what}")
                    if type_ is ValueType.NUMBER and Assumption.EXACT not in prop.assumes:
                        raise NotExpressible("columns of numbers are doubles, and need `assume exact;`")
                    add(path, type_, f"event {name}")
                case Anything():
                    what = f"make the `_` of {written} in event {name} a parameter with a type"
                    raise NotExpressible(f"a column does not distinguish null from an absent field: {what}")
                case ObjectPattern(()) if path:
                    raise NotExpressible(f"a column holds no object, as {written} of event {name} is")
                case ListPattern() | SomeItem():
                    raise NotExpressible(f"a column holds no list, as {written} of event {name} is")
                case Literal() | ObjectPattern():
                    pass
    patterns = [
        *(one.pattern for one in prop.events),
        *(one.pattern for one in prop.alphabet),
        *(one.pattern for one in prop.ignored),
    ]
    for pattern in map(_without_time, dict.fromkeys(patterns)):
        for path, part, _ in places(pattern):
            if isinstance(part, Literal):
                add(path, _type(part, ".".join(map(str, path))), f"the literal {json.dumps(part.value)}")
    return {path: type_ for path, (type_, _) in found.items()}


def _variables(prop: Property, types: Mapping[Path, ValueType]) -> dict[str, ValueType]:
    """Return the type of each variable; raises `NotExpressible` if its values are never equal."""
    found: dict[str, ValueType] = {}
    for event in prop.events:
        for path, part, _ in places(_without_time(event.pattern)):
            if isinstance(part, Variable):
                known = found.setdefault(part.name, types[path])
                if known is not types[path] and not {known, types[path]} <= _NUMBERS:
                    reason = f"variable {part.name} is {known} and {types[path]}: columns of two types are not compared"
                    raise NotExpressible(reason)
    return found


def _type(literal: Literal, written: str) -> ValueType:
    match literal.value:
        case bool():
            return ValueType.BOOLEAN
        case int() | float() as number:
            return ValueType.INTEGER if float(number).is_integer() else ValueType.NUMBER
        case str():
            return ValueType.TEXT
        case _:
            raise NotExpressible(f"a column does not distinguish null from an absent field, as {written} does")


def _without_time(pattern: Pattern) -> Pattern:
    return untimed(pattern)[0]


def _kind(time: EventTime, dialect: Dialect) -> str:
    if time.format is TimeFormat.SECONDS or (time.format not in UNITS and dialect.name == "sqlite"):
        return "double"
    return str(time.format) if time.format in UNITS else "timestamp"


def _nanoseconds(column: str, kind: str, dialect: Dialect) -> str:
    match kind:
        case "timestamp" if dialect.microseconds:
            return f"{dialect.microseconds.format(column)} * {FINEST}"
        case "timestamp":
            raise NotExpressible(
                f"{dialect.name} has no timestamps: give the type of the time, as in --time {column}:s"
            )
        case "double":
            return f"{dialect.cast(f'round({column} * 1000000)', dialect.whole)} * {FINEST}"
        case "ns":
            return column
        case _:
            return f"{column} * {UNITS[kind]}"


def _cell(value: Json, type_: ValueType) -> Json:
    if value is ABSENT or value is None or not has_type(value, type_):
        return None
    match type_:
        case ValueType.TEXT if "\0" in cast("str", value):
            raise OverflowError("a string with the character NUL, which SQL programs cut off")
        case ValueType.TEXT if has_surrogate(cast("str", value)):
            raise OverflowError("a string with half of a surrogate pair, which a column cannot hold")
        case ValueType.INTEGER if abs(cast("float", value)) >= 2**63:
            raise OverflowError("an integer of more than 64 bits")
        case ValueType.INTEGER:
            return int(cast("float", value))
        case ValueType.NUMBER if not is_finite(value) or float(cast("float", value)) != value:
            raise OverflowError("a number that a double does not hold exactly")
        case ValueType.NUMBER:
            return float(cast("float", value))
        case _:
            return value


def _time_cell(time: int | None, kind: str) -> Json:
    """Return the cell of a time in nanoseconds; timestamps as microseconds."""
    if time is None:
        return None
    unit = UNITS.get(kind, FINEST)
    if time % unit or abs(time) >= 2**62:
        raise OverflowError(f"a time that is not a number of {'us' if unit == FINEST else kind} of 62 bits")
    if kind == "double" and abs(time) >= DOUBLES:
        raise OverflowError("a time in seconds that a double does not hold to the microsecond")
    return time / 10**9 if kind == "double" else time // unit
