"""A reader of the subset of KQL that rvaft writes, on a typed table.

The comment of a text defines the table. Expressions are typed as in KQL: comparisons of other types
are errors, a null makes an expression null, and `where` drops it.
"""

import operator
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from itertools import pairwise, takewhile
from typing import Any, Final, NamedTuple, TypeAlias

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedInput, UnexpectedToken

from backends.tables import TableHeader, declared_time
from rvaft.backend import Match
from rvaft.errors import LanguageError, ToolFailed, TraceError, error_at
from rvaft.model.nodes import ValueType
from rvaft.model.values import Json

_GRAMMAR: Final = r"""
start: let* tabular ";"?
let: "let" name "=" tabular ";"
tabular: name step* | "union" name ("," name)* -> union
?step: "|" "where" or_ -> where
    | "|" "project" column ("," column)* -> project
    | "|" "join" "kind" "=" "inner" name "on" pair ("," pair)* -> join
    | "|" "join" "kind" "=" "leftanti" name "on" pair ("," pair)* -> without
    | "|" "extend" column ("," column)* -> extend
    | "|" "sort" "by" key ("," key)* -> sort
    | "|" "summarize" extreme ("," extreme)* "by" name ("," name)* -> summarize
extreme: name "=" EXTREME "(" name ")"
key: name ORDER
column: name "=" or_
pair: "$left" "." name EQUAL "$right" "." name
?or_: and_ | and_ ("or" and_)+ -> either
?and_: test | test ("and" test)+ -> both
?test: sum | sum (EQUAL | COMPARE) sum -> compare
    | sum TEXTUAL STRING -> textual
    | sum "in" "(" sum ("," sum)* ")" -> among
    | sum "matches" "regex" STRING -> like
?sum: atom | sum SIGN atom -> calculate
?atom: "(" or_ ")"
    | FUNCTION "(" or_ ("," or_)* ")" -> call
    | name -> variable
    | STRING -> text | SPAN -> span | REAL -> real | WHOLE -> whole | TRUTH -> truth
name: NAME | QUOTED
EQUAL: "=="
COMPARE: "!=" | "<=" | ">=" | "<" | ">"
TEXTUAL: "startswith_cs" | "endswith_cs" | "contains_cs"
FUNCTION.2: /(not|abs|isnotnull|max_of|min_of|bag_pack|pack_array|prev|row_number)(?=\()/
EXTREME: "min" | "max"
ORDER: "asc" | "desc"
SIGN: "+" | "-"
TRUTH.2: /(true|false)\b/
SPAN.3: /[0-9]+(microsecond|tick|ms|d|h|m|s)\b/
REAL.2: /-?[0-9]+\.[0-9]+/
WHOLE: /-?[0-9]+/
STRING: /"(?:[^"\\\r\n]|\\["\\nrt])*"/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
QUOTED: /\['[A-Za-z0-9_ .-]+'\]/
%ignore /\s+|\/\/[^\n]*/
"""
_FILE: Final = "<kql>"
_TYPES: Final = {
    ValueType.TEXT: "string",
    ValueType.INTEGER: "long",
    ValueType.NUMBER: "real",
    ValueType.BOOLEAN: "bool",
}
_SPANS: Final = {"d": 86_400 * 10**9, "h": 3_600 * 10**9, "m": 60 * 10**9, "s": 10**9} | {
    "ms": 10**6,
    "microsecond": 1_000,
    "tick": 100,
}
_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_LARGEST: Final = 2**63
_PLACE: Final = "\0"
"""In a row that `extend` changes, all rows and its place."""
_DEEPEST: Final = 100
_ORDERED: Final = frozenset({"long", "real", "datetime", "timespan"})
_ESCAPES: Final = {"n": "\n", "r": "\r", "t": "\t"}
_REGEX: Final = re.compile(r"\\A\(\?s:((?:[^\\.*+?()|\[\]{}^$]|\\[\\.*+?()|\[\]{}^$]|\.\*?)*)\)\\z")
_TEXTUAL: Final = {"startswith_cs": str.startswith, "endswith_cs": str.endswith, "contains_cs": str.__contains__}

_Row: TypeAlias = dict[str, Any]
_Rows: TypeAlias = list[_Row]


class _Expression(NamedTuple):
    type: str
    of: Callable[[_Row], Any]


class _Tabular(NamedTuple):
    types: Mapping[str, str]
    of: Callable[[_Rows], _Rows]
    sorted: bool = False
    """Whether the rows have an order, which `prev` and `row_number` need."""


@cache
def _parser() -> Lark:
    return Lark(_GRAMMAR, parser="lalr", propagate_positions=True)


class KqlProgram:
    """A query with its table; raises `LanguageError` for other texts."""

    def __init__(self, text: str) -> None:
        self._depth, self._sorted = 0, False
        self.every = re.search(r"^// .*: every match\.$", text, re.MULTILINE) is not None
        self.source, header, self.time = text, TableHeader.read(text, "//"), declared_time(text, "//")
        if header is not None and header.kind == "double":
            raise LanguageError("KQL rounds times in seconds: use a column of datetime", file=_FILE)
        if header is None:
            raise LanguageError("no comment defines the table: // table NAME, position COLUMN", file=_FILE)
        self.header = header
        try:
            tree: Any = _parser().parse(text)
        except UnexpectedInput as error:
            ended = isinstance(error, UnexpectedToken) and error.token.type == "$END"
            place = len(text) if ended or error.pos_in_stream is None else error.pos_in_stream
            raise self._wrong("not in the subset of KQL that rvaft reads", place) from None
        time = {"timestamp": "datetime"}.get(header.kind, "long")
        types = {header.trace: "long", header.position: "long", header.time: time}
        types |= {name: _TYPES[type_] for name, type_, _ in header.columns if type_ in _TYPES}
        self.tables = {
            header.table: _Tabular({name: type_ for name, type_ in types.items() if name}, lambda rows: rows)
        }
        *lets, last = tree.children
        for let in lets:
            name = self._name(let.children[0])
            if name in self.tables:
                raise self._wrong(f"{name} is defined twice", let)
            self.tables[name] = self._tabular(let.children[1])
        self.query = self._tabular(last)
        if "detected" not in self.query.types or self.query.types.get("nodes") != "bag":
            raise self._wrong("the query has no columns `detected` and `nodes`", last)

    @property
    def fields(self) -> tuple[tuple[str, ...], ...]:
        """The paths of the fields of columns and of the time, up to an index of a list."""
        paths = [takewhile(lambda part: isinstance(part, str), path) for *_, path in self.header.columns]
        times = [self.time.field] if self.time is not None and self.header.time else []
        return tuple(dict.fromkeys([*(tuple(map(str, path)) for path in paths), *times]))

    # Traces.

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """Return for each trace the number of the event that completes the first match, or None."""
        found = map(self._run, traces)
        return [min((numbers[row["detected"]] for row in rows), default=None) for rows, numbers in found]

    def matches(self, traces: Sequence[Sequence[Json]]) -> list[frozenset[Match]]:
        """Return all matches in each trace."""
        found = list[frozenset[Match]]()
        for rows, numbers in map(self._run, traces):
            nodes = [[(node, one) for node, ones in row["nodes"].items() for one in ones] for row in rows]
            found.append(frozenset(frozenset((node, numbers[one]) for node, one in some) for some in nodes))
        return found

    def left_open(self, trace: Sequence[Json]) -> str:
        """Return why a table cannot hold a trace, or an empty text."""
        try:
            self._rows(trace)
        except TraceError as error:
            return error.message
        return ""

    def _run(self, trace: Sequence[Json]) -> tuple[_Rows, dict[Any, int]]:
        """Return the rows of the result, and the number of the event at each position."""
        rows = self._rows(trace)
        numbers = {row[self.header.position]: number for number, row in enumerate(rows, 1)}
        found = self.query.of(rows)
        used = [one for row in found for one in (row["detected"], *_flat((row["nodes"] or {"": None}).values()))]
        if any(isinstance(one, float | list | dict) or one not in numbers for one in used):
            raise ToolFailed("the query", reason="`detected` and `nodes` have other values than positions of rows")
        return found, numbers

    def _rows(self, trace: Sequence[Json]) -> _Rows:
        header, rows = self.header, list[_Row]()
        for number, event in enumerate(trace, 1):
            try:
                *cells, time = [*header.cells(event, None if self.time is None else self.time.read(event)), None][
                    : len(header.columns) + 1
                ]
            except OverflowError as error:
                raise TraceError(f"{error}, which the table cannot hold", line=number) from None
            values = zip(header.columns, cells, strict=True)
            row = {one.name: "" if cell is None and one.type is ValueType.TEXT else cell for one, cell in values}
            time = time * 1_000 if header.kind == "timestamp" and time is not None else time
            rows.append({header.trace: 0, header.position: number, **row})
            if header.time:
                rows[-1][header.time] = time
        times = [row[header.position] for row in rows]
        if header.position == header.time and (None in times or any(a >= b for a, b in pairwise(times))):
            raise TraceError("times order the rows of the table, and those of this trace do not increase", line=None)
        return rows

    # Tables.

    def _wrong(self, message: str, place: int | Tree[Any] | Token) -> LanguageError:
        at = place if isinstance(place, int) else place.start_pos if isinstance(place, Token) else place.meta.start_pos
        return error_at(message, self.source, at or 0, _FILE)

    @staticmethod
    def _name(tree: Any) -> str:
        token = str(tree.children[0])
        return token[2:-2] if token.startswith("[") else token

    def _table(self, tree: Any) -> _Tabular:
        if (name := self._name(tree)) not in self.tables:
            raise self._wrong(f"no table {name}", tree)
        return self.tables[name]

    def _tabular(self, tree: Any) -> _Tabular:
        first, *steps = tree.children
        found = self._table(first)
        if tree.data == "union":
            tables = [found, *map(self._table, steps)]
            types = {name: type_ for table in tables for name, type_ in table.types.items()}
            if any(types[name] != type_ for table in tables for name, type_ in table.types.items()):
                raise self._wrong("a column of the union has two types", tree)
            absent = dict.fromkeys(types)
            return _Tabular(types, lambda source: [{**absent, **row} for one in tables for row in one.of(source)])
        for step in steps:
            found = getattr(self, f"_{step.data}")(found, step)
        return found

    def _where(self, table: _Tabular, step: Any) -> _Tabular:
        test = self._expression(step.children[0], table.types, "bool")
        return table._replace(of=lambda source: [row for row in table.of(source) if test.of(row) is True])

    def _project(self, table: _Tabular, step: Any) -> _Tabular:
        made = [(self._name(one.children[0]), self._expression(one.children[1], table.types)) for one in step.children]
        types = {name: expression.type for name, expression in made}
        if len(types) < len(made):
            raise self._wrong("two columns have one name", step)
        return _Tabular(types, lambda source: [{name: one.of(row) for name, one in made} for row in table.of(source)])

    def _extend(self, table: _Tabular, step: Any) -> _Tabular:
        self._sorted = table.sorted
        made = [(self._name(one.children[0]), self._expression(one.children[1], table.types)) for one in step.children]
        self._sorted = False
        types = {name: expression.type for name, expression in made}
        if len(types) < len(made) or types.keys() & table.types.keys():
            raise self._wrong("two columns have one name", step)

        def extended(source: _Rows) -> _Rows:
            rows = table.of(source)
            placed = [{**row, _PLACE: (rows, place)} for place, row in enumerate(rows)]
            return [
                {**row, **{name: one.of(inner) for name, one in made}} for row, inner in zip(rows, placed, strict=True)
            ]

        return table._replace(types={**table.types, **types}, of=extended)

    def _sort(self, table: _Tabular, step: Any) -> _Tabular:
        """Return sorted rows; those with equal keys change places, since Kusto does not keep their order."""
        keys = [(self._name(key.children[0]), key.children[1] == "desc") for key in step.children]
        for name, _ in keys:
            if table.types.get(name) not in {*_ORDERED, "string"}:
                raise self._wrong(f"rows are not sorted by {name}", step)

        def ordered(source: _Rows) -> _Rows:
            rows = table.of(source)[::-1]
            for name, falling in reversed(keys):
                rows.sort(key=lambda row: (row[name] is not None, row[name]), reverse=falling)
            return rows

        return table._replace(of=ordered, sorted=True)

    def _summarize(self, table: _Tabular, step: Any) -> _Tabular:
        extremes = [one for one in step.children if one.data == "extreme"]
        names = [self._name(one) for one in step.children if one.data == "name"]
        made = {self._name(one.children[0]): (str(one.children[1]), self._name(one.children[2])) for one in extremes}
        if unknown := [name for name in (*(of for _, of in made.values()), *names) if name not in table.types]:
            raise self._wrong(f"no column {unknown[0]}", step)
        if len({*made, *names}) < len(extremes) + len(names):
            raise self._wrong("two columns have one name", step)
        for _, of in made.values():
            if table.types[of] not in _ORDERED:
                raise self._wrong(f"a value of type {table.types[of]} has no minimum", step)

        def summarized(source: _Rows) -> _Rows:
            found: dict[tuple[Any, ...], _Rows] = {}
            for row in table.of(source):
                found.setdefault(tuple(row[name] for name in names), []).append(row)

            def value(rows: _Rows, word: str, of: str) -> Any:
                return (min if word == "min" else max)(_known(row[of] for row in rows), default=None)

            groups = ((dict(zip(names, key, strict=True)), rows) for key, rows in found.items())
            return [{**own, **{name: value(rows, *how) for name, how in made.items()}} for own, rows in groups]

        types = {name: table.types[name] for name in names} | {name: table.types[of] for name, (_, of) in made.items()}
        return _Tabular(types, summarized)

    def _pairs(self, left: _Tabular, right: _Tabular, step: Any) -> list[tuple[str, str]]:
        """Return the columns on which a step joins two tables."""
        pairs = list[tuple[str, str]]()
        for pair in step.children[1:]:
            a, b = map(self._name, pair.children[::2])
            if a not in left.types or b not in right.types or left.types[a] != right.types[b]:
                raise self._wrong(f"{a} and {b} are no columns of one type on the two sides", pair)
            pairs.append((a, b))
        return pairs

    def _without(self, left: _Tabular, step: Any) -> _Tabular:
        right = self._table(step.children[0])
        pairs = self._pairs(left, right, step)

        def unmatched(source: _Rows) -> _Rows:
            found = {tuple(row[b] for _, b in pairs) for row in right.of(source)}
            keys = ((row, tuple(row[a] for a, _ in pairs)) for row in left.of(source))
            return [row for row, key in keys if None in key or key not in found]

        return _Tabular(left.types, unmatched)

    def _join(self, left: _Tabular, step: Any) -> _Tabular:
        right = self._table(step.children[0])
        pairs = self._pairs(left, right, step)
        if twice := sorted(left.types.keys() & right.types.keys()):
            raise self._wrong(f"both sides have a column {twice[0]}", step)

        def joined(source: _Rows) -> _Rows:
            found = defaultdict[tuple[Any, ...], _Rows](list)
            for row in right.of(source):
                found[tuple(row[b] for _, b in pairs)].append(row)
            keys = ((row, tuple(row[a] for a, _ in pairs)) for row in left.of(source))
            return [{**row, **other} for row, key in keys if None not in key for other in found.get(key, ())]

        return _Tabular({**left.types, **right.types}, joined)

    # Expressions.

    def _expression(self, tree: Any, types: Mapping[str, str], wanted: str = "") -> _Expression:
        if tree.data == "variable":
            name = self._name(tree.children[0])
            if name not in types:
                raise self._wrong(f"no column {name}", tree)
            found = _Expression(types[name], lambda row: row[name])
        else:
            if (depth := self._depth) > _DEEPEST:
                raise self._wrong("nested too deeply", tree)
            self._depth += 1
            parts = [one if isinstance(one, Token) else self._expression(one, types) for one in tree.children]
            self._depth = depth
            found = getattr(self, f"_of_{tree.data}")(tree, *parts)
        if wanted and found.type != wanted:
            raise self._wrong(f"a value of type {found.type}, not {wanted}", tree)
        return found

    def _typed(self, tree: Any, parts: Sequence[_Expression], *wanted: str) -> str:
        """Return the one type of some expressions."""
        for part in parts:
            if part.type != parts[0].type or (wanted and part.type not in wanted):
                raise self._wrong(f"a value of type {part.type}, not {' or '.join(wanted) or parts[0].type}", tree)
        return parts[0].type

    def _of_either(self, tree: Any, *parts: _Expression) -> _Expression:
        self._typed(tree, parts, "bool")
        return _Expression("bool", lambda row: _either(part.of(row) for part in parts))

    def _of_both(self, tree: Any, *parts: _Expression) -> _Expression:
        self._typed(tree, parts, "bool")
        return _Expression("bool", lambda row: _negated(_either(_negated(part.of(row)) for part in parts)))

    def _of_compare(self, tree: Any, left: _Expression, sign: Token, right: _Expression) -> _Expression:
        if {left.type, right.type} != {"long", "real"}:
            self._typed(tree, (left, right), *(() if sign in ("==", "!=") else _ORDERED))
        return _Expression("bool", lambda row: _compared(left.of(row), sign, right.of(row)))

    def _of_among(self, tree: Any, part: _Expression, *parts: _Expression) -> _Expression:
        self._typed(tree, (part, *parts), "string", "long")
        return _Expression("bool", lambda row: _either(_compared(part.of(row), "==", one.of(row)) for one in parts))

    def _of_textual(self, tree: Any, part: _Expression, word: Token, text: Token) -> _Expression:
        self._typed(tree, (part,), "string")
        test, wanted = _TEXTUAL[word], _text(text)
        return _Expression("bool", lambda row: test(part.of(row), wanted))

    def _of_like(self, tree: Any, part: _Expression, text: Token) -> _Expression:
        self._typed(tree, (part,), "string")
        if (found := _REGEX.fullmatch(_text(text))) is None:
            raise self._wrong("a regular expression other than a glob, as in \\A(?s:a.*)\\z", text)
        test = re.compile(found[1], re.DOTALL)
        return _Expression("bool", lambda row: test.fullmatch(part.of(row)) is not None)

    def _of_calculate(self, tree: Any, left: _Expression, sign: Token, right: _Expression) -> _Expression:
        type_ = self._typed(tree, (left, right), *(("long", "datetime") if sign == "-" else ("long",)))
        change = -1 if sign == "-" else 1
        calculate = lambda row: _whole(left.of(row), change, right.of(row))  # noqa: E731
        return _Expression("timespan" if type_ == "datetime" else type_, calculate)

    def _of_call(self, tree: Any, function: Token, *parts: _Expression) -> _Expression:
        match str(function):
            case "not" if len(parts) == 1:
                self._typed(tree, parts, "bool")
                return _Expression("bool", lambda row: _negated(parts[0].of(row)))
            case "abs" if len(parts) == 1:
                type_ = self._typed(tree, parts, "long", "timespan")
                return _Expression(type_, lambda row: None if (found := parts[0].of(row)) is None else abs(found))
            case "max_of" | "min_of" if len(parts) > 1:
                extreme = max if function == "max_of" else min
                type_ = self._typed(tree, parts, *_ORDERED)
                return _Expression(type_, lambda row: extreme(_known(part.of(row) for part in parts), default=None))
            case "isnotnull" if len(parts) == 1:
                return _Expression("bool", lambda row: parts[0].of(row) is not None)
            case "prev" if self._sorted and (len(parts) == 1 or (len(parts) == 2 and tree.children[2].data == "whole")):
                shift = 1 if len(parts) == 1 else parts[1].of({})
                return _Expression(parts[0].type, lambda row: _earlier(row, parts[0], shift))
            case "row_number" if (
                self._sorted and len(parts) == 2 and (parts[0].type, parts[1].type) == ("long", "bool")
            ):
                return _Expression("long", lambda row: _numbered(row, *parts))
            case "pack_array":
                return _Expression("array", lambda row: [part.of(row) for part in parts])
            case "bag_pack" if len(parts) % 2 == 0 and {part.type for part in parts[::2]} == {"string"}:
                pairs = [*zip(parts[::2], parts[1::2], strict=True)]
                return _Expression("bag", lambda row: {a.of(row): [*_flat([b.of(row)])] for a, b in pairs})
        raise self._wrong(f"{function} does not take these arguments", tree)

    def _of_text(self, _tree: Any, token: Token) -> _Expression:
        return _constant("string", _text(token))

    def _of_span(self, _tree: Any, token: Token) -> _Expression:
        number, word = re.fullmatch("([0-9]+)([a-z]+)", token).groups()  # type: ignore[union-attr]
        return _constant("timespan", int(number) * _SPANS[word])

    def _of_real(self, _tree: Any, token: Token) -> _Expression:
        return _constant("real", float(token))

    def _of_whole(self, tree: Any, token: Token) -> _Expression:
        if abs(int(token)) >= _LARGEST:
            raise self._wrong("an integer of more than 64 bits", tree)
        return _constant("long", int(token))

    def _of_truth(self, _tree: Any, word: Token) -> _Expression:
        return _constant("bool", word == "true")


def _earlier(row: _Row, part: _Expression, shift: int) -> Any:
    """Return a value in the row that is some places before; a text is empty without it."""
    rows, place = row[_PLACE]
    if not 0 <= place - shift < len(rows):
        return "" if part.type == "string" else None
    return part.of(rows[place - shift])


def _numbered(row: _Row, start: _Expression, restart: _Expression) -> int:
    """Return the number of a row, which starts again where a condition holds."""
    rows, place = row[_PLACE]
    first = place
    while first and restart.of({**rows[first], _PLACE: (rows, first)}) is not True:
        first -= 1
    return int(start.of(row)) + int(place) - int(first)


def _constant(type_: str, value: Json) -> _Expression:
    return _Expression(type_, lambda _: value)


def _text(token: Token) -> str:
    return re.sub(r"\\(.)", lambda found: _ESCAPES.get(found[1], found[1]), token[1:-1])


def _flat(values: Iterable[Any]) -> Iterator[Any]:
    for value in values:
        yield from value if isinstance(value, list) else [value]


def _known(values: Iterator[Any]) -> list[Any]:
    return [one for one in values if one is not None]


def _negated(value: bool | None) -> bool | None:
    return None if value is None else not value


def _either(values: Iterator[bool | None]) -> bool | None:
    """Return the disjunction, which is null if no value is true and one is null."""
    found: bool | None = False
    for value in values:
        if value:
            return True
        found = None if value is None else found
    return found


def _compared(left: Any, sign: str, right: Any) -> bool | None:
    if left is None or right is None:
        return None if left is right or sign not in ("==", "!=") else sign == "!="
    if isinstance(left, float) or isinstance(right, float):
        left, right = float(left), float(right)
    return _COMPARE[sign](left, right)


def _whole(left: int | None, change: int, right: int | None) -> int | None:
    if left is None or right is None:
        return None
    if abs(found := left + change * right) >= _LARGEST:
        raise ToolFailed("the query", reason="an integer of more than 64 bits")
    return found


@lru_cache(maxsize=64)
def compiled(text: str) -> KqlProgram:
    """Return the program of a text (cached)."""
    return KqlProgram(text)
