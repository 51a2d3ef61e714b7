"""Tables of events with typed columns, for the languages that query them.

A table has a row per event, and a column per field that the tree reads; NULL stands for a field
that is absent. The types are those of the parameters and literals of the tree (`assume types,
present;`).
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, TypeAlias, cast

from rvaft.core.property import Property
from rvaft.core.times import untimed
from rvaft.errors import LanguageError, NotExpressible, OptionError, unwritten
from rvaft.language.parser import parse_time
from rvaft.model.assumptions import has_type, places, used_events
from rvaft.model.event_time import UNITS, EventTime
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, SomeItem, Variable
from rvaft.model.values import Json, at, has_surrogate, is_finite

Path: TypeAlias = tuple[str | int, ...]
_NO_NAME: Final = re.compile('["\x00-\x1f\x7f]')
ROWID: Final = "rowid"
"""The position of rows in SQLite and DuckDB, which number them themselves."""
TIMES: Final = ("timestamp", "double", "s", "ms", "us", "ns")
"""Kinds of time columns: a timestamp, seconds as a double, or an integer of a unit."""
FINEST: Final = 1_000
"""Nanoseconds: timestamps and doubles hold whole microseconds."""
DOUBLES: Final = 2**32 * 10**9
"""Nanoseconds below which a double holds seconds to the microsecond."""
ABSENT: Final = cast("Json", object())
COLUMN_KINDS: Final = frozenset({ValueType.TEXT, ValueType.INTEGER, ValueType.NUMBER, ValueType.BOOLEAN})
_NUMBERS: Final = frozenset({ValueType.INTEGER, ValueType.NUMBER})


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
            if not isinstance(name, str) or _NO_NAME.search(name):
                raise OptionError(f"{name!a} is no name of a column or table")
        if not (table.name and table.position and all(columns.values())):
            raise OptionError("the name of a table or column is empty")
        return table


class TableColumn(NamedTuple):
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
    columns: tuple[TableColumn, ...]

    @classmethod
    def of(cls, table: Table, prop: Property, types: Mapping[Path, ValueType], kind: str) -> "TableHeader":
        """Return the columns that a query reads; `kind` is the type of the time.

        Raises `NotExpressible` and `OptionError`.
        """
        names = {".".join(map(str, path)): path for path in types}
        if len(names) < len(types):
            raise NotExpressible(unwritten("two fields have the same name with dots, and columns are named by it"))
        if unknown := sorted(set(table.columns) - set(names)):
            known = ", ".join(sorted(names)) or "none"
            raise OptionError(f"the tree reads no field {unknown[0]}; fields: {known}")
        columns = tuple(
            TableColumn(table.columns.get(name, name.replace(".", "_")), types[path], path)
            for name, path in names.items()
        )
        for column in columns:
            if _NO_NAME.search(column.name):
                raise NotExpressible(unwritten(f"the field {column.name!a} is no name of a column: name one for it"))
        taken = [*(column.name.lower() for column in columns), *filter(None, (table.trace.lower(),))]
        if twice := next((name for name in taken if taken.count(name) > 1), ""):
            raise OptionError(f"two fields have the column {twice}: name their columns")
        if prop.time is None or not table.time:
            timed = any(untimed(event.pattern)[1] is not None for event in prop.events)
            if prop.time is not None and (timed or prop.times_absences):
                raise OptionError(
                    f"the tree compares times: name the column of {'.'.join(prop.time.field)} as the time"
                )
            return cls(table.name, table.position, table.trace, "", "", columns)
        return cls(table.name, table.position, table.trace, table.time, kind, columns)

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
    def read(cls, text: str, comment: str = "--") -> "TableHeader | None":
        """Return the table that the comment of a text defines, or None; raises `LanguageError`."""
        word = r'("(?:[^"\\]|\\.)*")'
        first = re.search(
            rf"^{comment} table {word}, position {word}(?:, trace {word})?(?:, time {word} as (\w+))?$",
            text,
            re.MULTILINE,
        )
        if first is None:
            return None
        try:
            columns = [
                TableColumn(json.loads(name), ValueType(type_), tuple(json.loads(path)))
                for name, type_, path in re.findall(rf"^{comment} column {word} (\w+) of (\[.*\])$", text, re.MULTILINE)
            ]
            table, position, trace, time = (json.loads(one or '""') for one in first.groups()[:4])
        except (ValueError, TypeError):
            raise LanguageError("the comment has an invalid name, type or path of a column") from None
        names = (table, position, trace, time, *(one.name for one in columns))
        if any(not isinstance(one, str) or _NO_NAME.search(one) for one in names):
            raise LanguageError("the comment has a name that is no name of a column or table")
        if first[5] and first[5] not in TIMES:
            raise LanguageError(f"the comment has an unknown type of times: {first[5]}")
        return cls(table, position, trace, time, first[5] or "", tuple(columns))


def column_types(prop: Property) -> dict[Path, ValueType]:
    """Return the types of the fields that a property reads; raises `NotExpressible`."""
    tree, found = prop.tree, dict[Path, tuple[ValueType, str]]()

    def add(path: Path, type_: ValueType, what: str) -> None:
        known, where = found.setdefault(path, (type_, what))
        if known is not type_ and not {known, type_} <= _NUMBERS:
            name = ".".join(map(str, path))
            raise NotExpressible(
                unwritten(f"a column has one type, and {name} is {known} in {where} but {type_} in {what}")
            )
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
                        raise NotExpressible(unwritten(f"typed columns need `assume {', '.join(missing)};`"))
                    if type_ not in COLUMN_KINDS:
                        what = f"declare the type of parameter {parameter} of event {name}"
                        raise NotExpressible(unwritten(f"a column has text, numbers or Booleans: {what}"))
                    if type_ is ValueType.NUMBER and Assumption.EXACT not in prop.assumes:
                        raise NotExpressible(unwritten("columns of numbers are doubles, and need `assume exact;`"))
                    add(path, type_, f"event {name}")
                case Anything():
                    what = f"make the `_` of {written} in event {name} a parameter with a type"
                    raise NotExpressible(unwritten(f"a column does not distinguish null from an absent field: {what}"))
                case ObjectPattern(()) if path:
                    raise NotExpressible(unwritten(f"a column holds no object, as {written} of event {name} is"))
                case ListPattern() | SomeItem():
                    raise NotExpressible(unwritten(f"a column holds no list, as {written} of event {name} is"))
                case Literal() | ObjectPattern():
                    pass
    patterns = [
        *(one.pattern for one in prop.events),
        *(one.pattern for one in prop.alphabet),
        *(one.pattern for one in prop.ignored),
        *(one.pattern for one in prop.absences),
    ]
    for pattern in (untimed(one)[0] for one in dict.fromkeys(patterns)):
        for path, part, _ in places(pattern):
            if isinstance(part, Literal):
                add(path, _type(part, ".".join(map(str, path))), f"the literal {json.dumps(part.value)}")
    return {path: type_ for path, (type_, _) in found.items()}


def variable_types(prop: Property, types: Mapping[Path, ValueType]) -> dict[str, ValueType]:
    """Return the type of each variable; raises `NotExpressible` if its values are never equal."""
    found: dict[str, ValueType] = {}
    patterns = [(untimed(event.pattern)[0], frozenset[str]()) for event in prop.events]
    patterns += [(clause.pattern, clause.own) for clause in prop.absences]
    for pattern, own in patterns:
        for path, part, _ in places(pattern):
            if isinstance(part, Variable) and part.name not in own:
                known = found.setdefault(part.name, types[path])
                if known is not types[path] and not {known, types[path]} <= _NUMBERS:
                    reason = f"variable {part.name} is {known} and {types[path]}: columns of two types are not compared"
                    raise NotExpressible(unwritten(reason))
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
            raise NotExpressible(
                unwritten(f"a column does not distinguish null from an absent field, as {written} does")
            )


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


def time_line(time: EventTime) -> str:
    """Return the line of a comment that defines the time of events."""
    return f"time {json.dumps(time.field)} as {time.format}{'' if time.late is None else f' late {time.late} ns'}"


def with_time(text: str, time: EventTime, comment: str) -> str:
    """Return the text with a last line that defines the time of events, unless it has such a line."""
    return text if declared_time(text, comment) is not None else f"{text}\n{comment} {time_line(time)}\n"


def declared_time(text: str, comment: str = "--") -> EventTime | None:
    """Return the time of events that the comment of a text defines, or None; raises `LanguageError`."""
    found = re.search(rf"^{comment} time (\[.*\]) as (.+?)(?: late \d+ ns)?$", text, re.MULTILINE)
    if found is None:
        return None
    try:
        return EventTime(tuple(json.loads(found[1])), parse_time(f"time t as {found[2]}").format)
    except ValueError:
        raise LanguageError(
            "the header has an invalid field or format of times", line=text.count("\n", 0, found.start()) + 1
        ) from None
