"""What a query reads of an event: fields of a column with JSON, or typed columns of a table."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from backends.sql.dialects import Dialect, Path, qualified
from backends.sql.guards import FACETS, SqlTerm
from backends.tables import FINEST, Table, TableHeader, column_types, variable_types
from rvaft.core.property import Property
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.event_time import UNITS, EventTime, TimeFormat
from rvaft.model.nodes import ValueType

_FACETS: Final[Mapping[ValueType, str]] = {
    ValueType.TEXT: "text",
    ValueType.INTEGER: "whole",
    ValueType.NUMBER: "real",
    ValueType.BOOLEAN: "truth",
}
COLUMN_TYPES: Final[Mapping[ValueType, str]] = {
    ValueType.TEXT: "TEXT",
    ValueType.INTEGER: "BIGINT",
    ValueType.NUMBER: "DOUBLE PRECISION",
    ValueType.BOOLEAN: "BOOLEAN",
}
OWN: Final = frozenset(
    {"trace", "pos", "time", "place", "start", "shift", "late", "event", "detected", "branch", "nodes"}
    | {"first_pos", "first_time", "is_first", "found", "number", "reach", "bound"}
)
"""Names of columns of the query."""


def renamed(expression: str, name: str) -> str:
    """Return a column of a selection; empty without an expression."""
    return expression if expression in ("", name) else f"{expression} AS {name}"


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
        types = column_types(prop)
        kind = table.kind or ("" if prop.time is None else _kind(prop.time, dialect))
        header = TableHeader.of(table, prop, types, kind)
        time = _nanoseconds(qualified(header.time), kind, dialect) if header.time else ""
        expressions = {column.path: qualified(column.name) for column in header.columns}
        source, trace, position = map(qualified, (table.name, table.trace or "_", table.position))
        trace = trace if table.trace else ""
        return cls(header, source, trace, position, time, types, expressions, variable_types(prop, types), dialect)

    def header(self) -> Iterator[str]:
        """Yield the lines of the comment that describe the table."""
        yield from self.table.lines()

    def numbered(self) -> "tuple[str, TableRows]":
        """Return the columns for a table of numbered events, and the rows of that table."""
        taken, inner = OWN | {name.lower() for name in self.names.values()}, dict[Path, str]()
        for path, name in self.names.items():
            inner[path] = name
            while name.lower() in OWN and inner[path].lower() in taken:
                inner[path] += "_"
        own = [renamed(self.trace, "trace"), renamed(self.position, "pos"), renamed(self.time, "time")]
        shown = [*filter(None, own), *(renamed(name, inner[path]) for path, name in self.names.items())]
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
        raise NotExpressible(
            unwritten(f"a column holds no list{'' if length is None else f' of {length} items'}: {path[-1]}")
        )

    def items(self, path: Path, name: str) -> "tuple[str, TableRows]":  # noqa: ARG002
        """Raise `NotExpressible`."""
        raise NotExpressible(unwritten(self.is_list(path)))

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
                unwritten(f"{dialect.name} has no timestamps: give the type of the time, as in --time {column}:s")
            )
        case "double":
            return f"{dialect.cast(f'round({column} * 1000000)', dialect.whole)} * {FINEST}"
        case "ns":
            return column
        case _:
            return f"{column} * {UNITS[kind]}"
