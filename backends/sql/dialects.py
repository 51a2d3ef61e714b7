"""The SQL dialects as templates.

A value at a path of an event has a type and facets: a 64-bit integer, another number, a string, a
Boolean; a facet is NULL for other types. Conversions that would silently change a number are
avoided: a result beyond 64 bits is a runtime error.
"""

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import count, groupby, takewhile
from typing import Final, TypeAlias

from rvaft.errors import NotExpressible, installed, unwritten
from rvaft.support.terminal import is_hidden

Path = tuple[str | int, ...]
Form: TypeAlias = Callable[..., str]

_WORD: Final = re.compile("[A-Za-z_][A-Za-z0-9_]*")
_RESERVED: Final = re.compile(
    "v[0-9]+_(key|json)|"  # columns of the query for variables
    "add|all|alter|analyse|analyze|and|anti|any|array|as|asc|asof|asymmetric|at|authorization|autoincrement|between|"
    "binary|both|by|case|cast|check|collate|collation|column|commit|concurrently|constraint|create|cross|current|"
    "current_catalog|current_date|current_role|current_schema|current_time|current_timestamp|current_user|default|deferrable|"
    "delete|desc|describe|distinct|do|drop|else|end|escape|except|exclude|exists|false|fetch|following|for|foreign|"
    "freeze|from|full|generated|glob|grant|group|having|if|ilike|in|index|initially|inner|insert|intersect|interval|"
    "into|is|isnull|join|lambda|lateral|leading|left|like|limit|localtime|localtimestamp|map|match|natural|not|"
    "nothing|notnull|null|of|offset|on|only|or|order|outer|over|overlaps|partition|pivot|pivot_longer|pivot_wider|"
    "placing|positional|preceding|primary|qualify|raise|range|references|regexp|returning|right|row|rows|select|semi|"
    "session_user|set|show|similar|some|struct|summarize|symmetric|system_user|table|tablesample|then|to|trailing|"
    "transaction|trigger|true|try_cast|unbounded|union|unique|unpack|unpivot|update|user|using|values|variadic|verbose|"
    "view|when|where|window|with",
    re.IGNORECASE,
)
_PLAIN: Final = re.compile(r'[^"\\\x00-\x1f]*')
_HALF: Final = re.compile("[\0\ud800-\udfff]")


@cache
def _capitals() -> tuple[str, str]:
    every = [(c, small) for c in map(chr, range(sys.maxunicode + 1)) if (small := c.lower()) != c and len(small) == 1]
    return "".join(c for c, _ in every), "".join(small for _, small in every)


def literal(text: str, character: str = "chr") -> str:
    """Return a string literal on one line; raises `NotExpressible` for characters that SQL lacks."""
    if _HALF.search(text):
        reason = f"{text!a} has a character that SQL strings cannot hold"
        raise NotExpressible(unwritten(reason))
    literals: list[str] = []
    for hidden, some in groupby(text, is_hidden):
        part = "".join(some)
        literals += [f"{character}({ord(one)})" for one in part] if hidden else ["'" + part.replace("'", "''") + "'"]
    kept = literals or ["''"]
    return kept[0] if len(kept) == 1 else f"({' || '.join(kept)})"


def identifier(name: str) -> str:
    """Return the name of a column or table in SQL, quoted unless it is a plain word.

    Raises `NotExpressible` for characters that SQL lacks.

    >>> identifier("src_ip"), identifier("order"), identifier('a"b.c')
    ('src_ip', '"order"', '"a""b.c"')
    """
    if _WORD.fullmatch(name) and not _RESERVED.fullmatch(name):
        return name
    if not name or _HALF.search(name):
        reason = f"{name!a} is no name of a column or table in SQL"
        raise NotExpressible(unwritten(reason))
    return '"' + name.replace('"', '""') + '"'


def qualified(name: str) -> str:
    """Return a name in SQL whose parts are separated by dots.

    >>> qualified("main.auth log")
    'main."auth log"'
    """
    return ".".join(map(identifier, name.split(".")))


@dataclass(frozen=True)
class Dialect:
    """One dialect.

    - `values`: templates over a path: `kind` (NULL if missing), `raw` scalar, `json`, `length` of a
      list.
    - `types`: tests of kind and raw value.
    - `facets`: conversions of raw values.
    - `keys`: an expression that is equal exactly for equal values.
    - `looks`: strings whose raw form resembles another type.

    >>> DIALECTS["sqlite"].kind("event", ("user", 0)), DIALECTS["duckdb"].kind("event", ("user", 0))
    ("json_type(event, '$.user[0]')", "json_type(event, '/user/0')")
    """

    name: str
    character: str
    way: Callable[[str, Path], tuple[str, str]]
    values: Mapping[str, str]
    types: Mapping[str, str]
    facets: Mapping[str, str]
    items: str
    """A table of the items of a list as JSON, from a value, a path and the name of the column."""
    keys: str
    looks: re.Pattern[str]
    whole: str
    real: str
    literal: Form
    """A Python number with its SQL type."""
    checked: Form
    """An integer result; an error beyond 64 bits."""
    finite: Form
    """A number, or NULL if it is not finite (in PostgreSQL, an error)."""
    integral: Form
    """A double as an integer; NULL if it has a fraction, an error beyond 64 bits."""
    fractional: Form
    """A double; NULL if it is integral."""
    part: str
    """Column name of a part, from type, depth of the comparison and number of the part."""
    with_parts: Callable[[int, "Parts", str], str]
    """A condition over named parts, evaluated lazily; a part may use earlier ones."""
    compare: Form
    """An exact comparison of an integer with a double."""
    least_of: str
    greatest: str
    numbers: Mapping[str, str]
    """Number that a string denotes, if it has that kind."""
    ordered: Form
    """A comparison of strings by code points."""
    startswith: Form
    endswith: Form
    contains: Form
    globbed: str
    signs: Mapping[str, str]
    """Replacements for characters of a glob."""
    microseconds: str
    """A timestamp as microseconds; empty without timestamps."""
    lowered: str
    """Lower case per character, from a string, the capitals, and their lower-case forms."""
    distinct: str = ""
    """The number of different values in a window whose rows have bounds of their own; empty without it."""
    nearest: str = ""
    """A join with the row of the next lower or higher value, from the kind of join; empty without it."""

    def text(self, value: str) -> str:
        """Return a string literal."""
        return literal(value, self.character)

    def value(self, what: str, event: str, path: Path) -> str:
        """Return a template of `values` for a value."""
        return self.values[what].format(*self.way(event, path))

    def kind(self, event: str, path: Path) -> str:
        """Return the type of a value, NULL if it is missing."""
        return self.value("kind", event, path)

    def is_a(self, kind: str, event: str, path: Path) -> str:
        """Return the test that a value has a type."""
        return self.types[kind].format(self.kind(event, path), self.value("raw", event, path))

    def facet(self, kind: str, event: str, path: Path) -> str:
        """Return a facet of a value."""
        converted = self.facets.get(kind, "{0}").format(self.value("raw", event, path))
        return f"CASE WHEN {self.is_a(kind, event, path)} THEN {converted} END"

    def is_text(self, value: str, event: str, path: Path) -> str:
        """Return the test that a value is this string."""
        same = f"{self.value('raw', event, path)} = {self.text(value)}"
        return f"{self.is_a('text', event, path)} AND {same}" if self.looks.match(value) else same

    def key(self, event: str, path: Path) -> str:
        """Return an expression that is equal exactly for equal values."""
        return self.keys.format(*(self.value(what, event, path) for what in ("kind", "raw", "json")))

    def cast(self, value: str, to: str) -> str:
        """Return a cast."""
        return f"CAST({value} AS {to})"

    def number(self, value: float) -> str:
        """Return a number literal."""
        return self.literal(repr(value), self.whole if isinstance(value, int) else self.real)

    def least(self, word: str, values: Sequence[str]) -> str:
        """Return the least or greatest integer, NULL if one is NULL."""
        nulls = " OR ".join(f"{value} IS NULL" for value in values)
        extreme = f"{self.least_of if word == 'least' else self.greatest}({', '.join(values)})"
        return values[0] if len(values) == 1 else f"CASE WHEN {nulls} THEN NULL ELSE {extreme} END"

    def read_number(self, text: str, kind: str) -> str:
        """Return the number that a string denotes, if it has that kind."""
        return self.numbers[kind].format(text)

    def like(self, text: str, glob: str) -> str:
        """Return the test that a glob matches a whole string."""
        return self.globbed.format(text, self.text("".join(self.signs.get(sign, sign) for sign in glob)))

    def lower(self, text: str) -> str:
        """Return a string in lower case, per character."""
        return self.lowered.format(text, *map(self.text, _capitals()))


def _named(**types: str) -> dict[str, str]:
    return {what: f"{{0}} = '{name}'" for what, name in types.items()}


_EACH: Final = (
    "CASE WHEN type IN ('true', 'false', 'null') THEN type ELSE CASE type WHEN 'text' THEN json_quote(value) "
    "WHEN 'real' THEN printf('%!.17g', value) ELSE coalesce(atom, value, type) END END"
)
"""The JSON of a row of `json_each` in SQLite."""


@lru_cache(maxsize=256)
def _sqlite_way(event: str, path: Path) -> tuple[str, str]:
    """Field names that SQLite paths do not support are searched with `json_each`."""
    steps = "$"
    for place, step in enumerate(path):
        if isinstance(step, str) and not _PLAIN.fullmatch(step):
            found = f"json_each({event}, {literal(steps, 'char')}) WHERE key = {literal(step, 'char')}"
            return _sqlite_way(f"(SELECT {_EACH} FROM {found})", path[place + 1 :])
        word = isinstance(step, str) and re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", step)
        steps += f"[{step}]" if isinstance(step, int) else f".{step}" if word else f'."{step}"'
    return event, literal(steps, "char")


def _pointer(event: str, path: Path) -> tuple[str, str]:
    return event, literal("".join(f"/{str(step).replace('~', '~0').replace('/', '~1')}" for step in path))


Parts: TypeAlias = Sequence[Mapping[str, str]]
"""The columns of each part of a comparison, by type."""


def _subquery(depth: int, parts: Parts, truth: str) -> str:
    tables, before = list[str](), ""
    for number, columns in enumerate(parts, 1):
        terms = ", ".join(f"{expression} AS {kind}_{depth}_{number}" for kind, expression in columns.items())
        start = f"SELECT *, {terms} FROM {before}" if before else f"SELECT {terms}"
        before = f"term_{depth}_{number}"
        tables.append(f"{before} AS MATERIALIZED ({start})")
    return f"(WITH {', '.join(tables)} SELECT {truth} FROM {before})"


def _lambdas(depth: int, parts: Parts, truth: str) -> str:
    """Return the condition with parts in a structure; DuckDB would run a subquery per event."""
    found = ""
    for number, columns in enumerate(parts, 1):
        terms = ", ".join(f"{kind}_{number} := {expression}" for kind, expression in columns.items())
        added = f"lambda term_{depth}: struct_insert(term_{depth}, {terms})"
        found = f"list_transform({found}, {added})" if found else f"[struct_pack({terms})]"
    return f"list_transform({found}, lambda term_{depth}: {truth})[1]"


_CHECKED: Final = (
    "(SELECT CASE typeof(v) WHEN 'real' THEN json('an integer of more than 64 bits') ELSE v END FROM (SELECT {0} AS v))"
)
_NUMBER: Final = "-?(0|[1-9][0-9]*)"
_FULL: Final = f"{_NUMBER}([.][0-9]+)?([eE][-+]?[0-9]+)?"
_KEY: Final = "CASE WHEN {0} = floor({0}) AND abs({0}) < 9e18 THEN 'n' || CAST({0} AS BIGINT) ELSE 'n' || {0} END"
_INFINITY: Final = "CAST('Infinity' AS DOUBLE)"
_FINITE: Final = f"nullif(nullif({{0}}, {_INFINITY}), -{_INFINITY})"

_SQLITE: Final = Dialect(
    name="sqlite",
    character="char",
    way=_sqlite_way,
    values={
        "kind": "json_type({0}, {1})",
        "raw": "{0} ->> {1}",
        "json": "({0} -> {1})",
        "length": "json_array_length({0}, {1})",
    },
    types={
        **_named(whole="integer", real="real", text="text", null="null", object="object", list="array"),
        "truth": "{0} IN ('true', 'false')",
    },
    facets={},
    items=f"(SELECT {_EACH} AS {{2}} FROM json_each({{0}}, {{1}}))",
    keys=(
        "CASE {0} WHEN 'integer' THEN {1} WHEN 'real' THEN {1} WHEN 'text' THEN 's' || ({1}) "
        "WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' WHEN 'null' THEN 'null' "
        "ELSE (SELECT 'c' || group_concat(part, char(10)) FROM (SELECT fullkey || ' ' || CASE type WHEN "
        "'integer' THEN 'n' || atom "
        "WHEN 'real' THEN CASE WHEN atom = CAST(atom AS INTEGER) AND abs(atom) < 9e18 THEN 'n' || "
        "CAST(atom AS INTEGER) "
        "ELSE 'n' || printf('%!.17g', atom) END WHEN 'text' THEN json_quote(atom) ELSE type END AS part "
        "FROM json_tree({2}) ORDER BY fullkey)) END"
    ),
    looks=re.compile(r"[\[{]"),
    whole="INTEGER",
    real="REAL",
    literal=lambda said, _: f"({said})" if said.startswith("-") else said,
    checked=_CHECKED.format,
    finite="nullif(nullif({0}, 9e999), -9e999)".format,
    integral=(
        "CASE WHEN abs({0}) >= 9223372036854775808.0 THEN json('an integer of more than 64 bits') "
        "WHEN {0} = CAST({0} AS INTEGER) THEN CAST({0} AS INTEGER) END"
    ).format,
    fractional="CASE WHEN {0} <> CAST({0} AS INTEGER) THEN {0} END".format,
    part="{0}_{1}_{2}",
    with_parts=_subquery,
    compare="{0} {1} {2}".format,
    least_of="min",
    greatest="max",
    numbers={
        kind: "CASE WHEN {0} GLOB '[-0-9]*' AND {0} NOT GLOB '*[^-+.eE0-9]*' THEN CASE WHEN json_valid({0}) THEN "
        f"CASE json_type({{0}}) WHEN '{name}' THEN {value} END END END"
        for kind, name, value in (
            ("whole", "integer", _CHECKED.format("json_extract({0}, '$')")),
            ("real", "real", "nullif(nullif(json_extract({0}, '$'), 9e999), -9e999)"),
        )
    },
    ordered="{0} {1} {2}".format,
    startswith="substr({0}, 1, length({1})) = {1}".format,
    endswith="(length({1}) <= length({0}) AND substr({0}, length({0}) - length({1}) + 1) = {1})".format,
    contains="instr({0}, {1}) > 0".format,
    globbed="{0} GLOB {1}",
    signs={"[": "[[]"},
    microseconds="",
    lowered=(  # SQLite's lower() is limited to ASCII
        "(SELECT CASE WHEN x GLOB '*[^' || char(1) || '-' || char(127) || ']*' THEN (WITH RECURSIVE w(n, "
        "t) AS (SELECT 1 AS n, '' AS t "
        "UNION ALL SELECT n + 1, t || CASE WHEN instr({1}, substr(x, n, 1)) > 0 THEN substr({2}, "
        "instr({1}, substr(x, n, 1)), 1) "
        "ELSE substr(x, n, 1) END FROM w WHERE n <= length(x)) SELECT t FROM w ORDER BY n DESC LIMIT 1) "
        "ELSE lower(x) END "
        "FROM (SELECT replace({0}, 'İ', 'i' || char(775)) AS x))"
    ),
)

_DUCKDB: Final = Dialect(
    name="duckdb",
    character="chr",
    way=_pointer,
    values={
        "kind": "json_type({0}, {1})",
        "raw": "json_extract_string({0}, {1})",
        "json": "CAST(json_extract({0}, {1}) AS VARCHAR)",
        "length": "json_array_length({0}, {1})",
    },
    types={
        **_named(real="DOUBLE", text="VARCHAR", truth="BOOLEAN", null="NULL", object="OBJECT", list="ARRAY"),
        "whole": "{0} IN ('BIGINT', 'UBIGINT')",
    },
    facets={"whole": "CAST({0} AS BIGINT)", "real": "CAST({0} AS DOUBLE)", "truth": "{0} = 'true'"},
    items="(SELECT value AS {2} FROM json_each(json_extract({0}, {1})))",
    keys=(
        "CASE WHEN {0} IN ('BIGINT', 'UBIGINT') THEN 'n' || {1} "
        f"WHEN {{0}} = 'DOUBLE' THEN {_KEY.format('CAST({1} AS DOUBLE)')} WHEN {{0}} = 'VARCHAR' THEN 's' || {{1}} "
        "WHEN {0} IN ('OBJECT', 'ARRAY') THEN (SELECT 'c' || string_agg(fullkey || ' ' || "
        f"CASE WHEN type = 'DOUBLE' THEN {_KEY.format('CAST(atom AS DOUBLE)')} "
        "WHEN type IN ('BIGINT', 'UBIGINT') THEN 'n' || CAST(atom AS VARCHAR) WHEN atom IS NULL THEN type "
        "ELSE CAST(atom AS VARCHAR) END, "
        "chr(10) ORDER BY fullkey) FROM json_tree({2})) ELSE coalesce({1}, 'null') END"
    ),
    looks=re.compile(r"[-\[{0-9]|(true|false|null)$|NaN|Inf"),
    whole="BIGINT",
    real="DOUBLE",
    literal=lambda said, kind: (
        (f"({said})" if said[0] == "-" else said) if said.lstrip("-").isdigit() else f"CAST('{said}' AS {kind})"
    ),
    checked="({0})".format,
    finite=_FINITE.format,
    integral="CASE WHEN {0} = floor({0}) THEN CAST({0} AS BIGINT) END".format,
    fractional="CASE WHEN {0} <> floor({0}) THEN {0} END".format,
    part="term_{1}.{0}_{2}",
    with_parts=_lambdas,
    compare=(
        "CASE WHEN {0} IS NULL OR {2} IS NULL THEN NULL WHEN {2} >= 9223372036854775808.0 THEN 0 {1} 1 "
        "WHEN {2} < -9223372036854775808.0 THEN 1 {1} 0 "
        "ELSE ({0}, 0) {1} (CAST(floor({2}) AS BIGINT), CASE WHEN {2} > floor({2}) THEN 1 ELSE 0 END) END"
    ).format,
    least_of="least",
    greatest="greatest",
    numbers={
        "whole": f"CASE WHEN regexp_full_match({{0}}, '{_NUMBER}') THEN CAST({{0}} AS BIGINT) END",
        "real": f"CASE WHEN regexp_full_match({{0}}, '{_FULL}') AND NOT regexp_full_match({{0}}, "
        f"'{_NUMBER}') THEN {_FINITE.format('CAST({0} AS DOUBLE)')} END",
    },
    ordered="{0} {1} {2}".format,
    startswith="starts_with({0}, {1})".format,
    endswith="right({0}, length({1})) = {1}".format,
    contains="strpos({0}, {1}) > 0".format,
    globbed="{0} LIKE {1} ESCAPE '\\'",
    signs={"*": "%", "?": "_", "%": r"\%", "_": r"\_", "\\": r"\\"},
    microseconds="epoch_us({0})",
    lowered="translate(replace({0}, 'İ', 'i' || chr(775)), {1}, {2})",  # DuckDB's lower() maps `İ` to `i`
    distinct="count(DISTINCT {0})",
    nearest="ASOF {0}JOIN",
)

_POSTGRES: Final = replace(
    _DUCKDB,
    name="postgres",
    way=lambda event, path: (f"{event}::json", ", ".join(literal(str(step)) for step in path)),
    values={
        "kind": "json_typeof(json_extract_path({0}, {1}))",
        "raw": "json_extract_path_text({0}, {1})",
        "json": "json_extract_path({0}, {1})::text",
        "length": "CASE json_typeof(json_extract_path({0}, {1})) WHEN 'array' THEN "
        "json_array_length(json_extract_path({0}, {1})) END",
    },
    types={
        **_named(text="string", truth="boolean", null="null", object="object", list="array"),
        "whole": "{0} = 'number' AND {1} ~ '^-?[0-9]+$'",  # the digits distinguish integers from doubles
        "real": "{0} = 'number' AND {1} !~ '^-?[0-9]+$'",
    },
    facets={"whole": "CAST({0} AS bigint)", "real": "CAST({0} AS double precision)", "truth": "{0} = 'true'"},
    keys=(  # numbers in lists and objects are decimals
        "CASE WHEN {0} = 'number' AND {1} ~ '^-?[0-9]+$' THEN to_jsonb({1}::bigint) WHEN {0} = 'number' THEN "
        "CASE WHEN {1}::float8 = floor({1}::float8) AND abs({1}::float8) < 9e18 THEN to_jsonb({1}::float8::bigint) "
        "ELSE to_jsonb({1}::float8) END ELSE ({2})::jsonb END"
    ),
    whole="bigint",
    real="double precision",
    finite="({0})".format,
    part="{0}_{1}_{2}",
    with_parts=_subquery,
    numbers={
        "whole": f"CASE WHEN {{0}} ~ '^({_NUMBER})$' THEN CAST({{0}} AS bigint) END",
        "real": f"CASE WHEN {{0}} ~ '^({_FULL})$' AND {{0}} !~ '^({_NUMBER})$' THEN CAST({{0}} AS double "
        "precision) END",
    },
    microseconds="CAST(extract(epoch FROM {0}) * 1000000 AS bigint)",
    ordered='{0} COLLATE "C" {1} {2} COLLATE "C"'.format,
    distinct="",
    nearest="",
)

DIALECTS: Final = {one.name: one for one in (_SQLITE, _DUCKDB, _POSTGRES)}
PORTABLE: Final = replace(_DUCKDB, distinct="", nearest="")
"""What SQLGlot writes in other dialects."""
TRANSPILED: Final = {
    "athena": "CAST(round(to_unixtime({0}) * 1000000) AS BIGINT)",
    "bigquery": "UNIX_MICROS({0})",
    "databricks": "unix_micros({0})",
    "snowflake": "DATE_PART(EPOCH_MICROSECOND, {0})",
    "spark": "unix_micros({0})",
    "trino": "CAST(round(to_unixtime({0}) * 1000000) AS BIGINT)",
}
"""Dialects that SQLGlot writes from a query for DuckDB, each with a timestamp in microseconds."""


def transpiled(text: str, dialect: str) -> str:
    """Return a query for DuckDB in another dialect; raises `ToolMissing` and `NotExpressible`."""
    sqlglot = installed("sqlglot", "SQLGlot", "pip install '.[sqlglot]' in a checkout of rvaft")
    first, *lines = text.splitlines(keepends=True)
    header = [*takewhile(lambda line: line.startswith("--"), lines)]
    try:
        [query] = sqlglot.parse("".join(lines[len(header) :]), read="duckdb")
        calls = [*query.find_all(sqlglot.exp.Anonymous)]
        names = [call.name for call in calls if call.name.lower() != "epoch_us"]
        if names:
            what = "a calculation whose parts have names" if "struct_insert" in names else f"the function {names[0]}"
            raise NotExpressible(unwritten(f"SQLGlot does not write {what} for {dialect}"))
        name = next(name for number in count() if (name := f"rvaft_us{number}") not in text)
        for call in calls:
            call.set("this", name)
        found = query.sql(dialect=dialect, pretty=True, unsupported_level=sqlglot.ErrorLevel.RAISE)
    except sqlglot.errors.SqlglotError as error:
        reason = f"SQLGlot does not write it for {dialect}: {' '.join(str(error).split())}"
        raise NotExpressible(unwritten(reason)) from None
    column = r"""((?:"(?:[^"]|"")*"|`(?:[^`]|``)*`|[^()"`])*)"""
    found = re.sub(rf"(?i)\b{name}\({column}\)", lambda call: TRANSPILED[dialect].format(call[1]), found)
    note = f"-- SQLGlot wrote this for {dialect} from the query for duckdb; rvaft does not run it.\n"
    return "".join([first.replace("duckdb", dialect), note, *header, found, "\n"])
