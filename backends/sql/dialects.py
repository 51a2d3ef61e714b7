"""The dialects of SQL: a table of what each says in its own way, as forms to fill in.

A value stands at a path of an event, and is asked for what it is and for its facets: a whole number
of 64 bits, another number, a text, a truth; each is NULL where it is something else. What a program
keeps in silence as another number than the event has is not left to it: a result beyond 64 bits is
an error when the query runs.
"""

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Final, TypeAlias

from rvaft.errors import NotExpressible

Path = tuple[str | int, ...]
"""The fields, and places in lists, that lead to a value."""
Form: TypeAlias = Callable[..., str]
"""An expression, made of others."""

_PLAIN: Final = re.compile(r'[^"\\\x00-\x1f]*')
_HALF: Final = re.compile("[\0\ud800-\udfff]")
_CONTROL: Final = re.compile("([\x01-\x1f\x7f-\x9f\u2028\u2029])")


@cache
def _capitals() -> tuple[str, str]:
    """The characters that are one other in lower case, and those."""
    every = [(c, small) for c in map(chr, range(sys.maxunicode + 1)) if (small := c.lower()) != c and len(small) == 1]
    return "".join(c for c, _ in every), "".join(small for _, small in every)


def quoted(text: str, character: str = "chr") -> str:
    """A text as a literal on one line; raises `NotExpressible` for what no table can hold."""
    if _HALF.search(text):
        reason = f"{text!a} has a character that no text in a table can have"
        raise NotExpressible(reason)
    parts = enumerate(_CONTROL.split(text))
    said = [f"{character}({ord(part)})" if odd % 2 else "'" + part.replace("'", "''") + "'" for odd, part in parts]
    kept = [part for part in said if part != "''"] or ["''"]
    return kept[0] if len(kept) == 1 else f"({' || '.join(kept)})"


@dataclass(frozen=True)
class Dialect:
    """One dialect. `values` are forms of the way to a value.

    Its `kind` (NULL where there is none), a scalar as the program has it (`raw`), `json`, the
    `length` of a list.

    `types` say of kind and raw value whether it is of a type, `facets` make of the raw value what
    it is not yet, `key` of kind, raw value and JSON what is equal for equal values alone; a text
    that `looks` like a value of another type needs to be told from it.

    >>> DIALECTS["sqlite"].kind("event", ("user", 0)), DIALECTS["duckdb"].kind("event", ("user", 0))
    ("json_type(event, '$.user[0]')", "json_type(event, '/user/0')")
    """

    name: str
    character: str
    way: Callable[[str, Path], tuple[str, str]]
    values: Mapping[str, str]
    types: Mapping[str, str]
    facets: Mapping[str, str]
    keys: str
    looks: re.Pattern[str]
    whole: str
    real: str
    literal: Form
    """A number of Python, and its type."""
    checked: Form
    """The result of whole numbers, an error where it has more than 64 bits."""
    finite: Form
    """The result of numbers, NULL where it is not finite; PostgreSQL stops there with an error."""
    integral: Form
    """A number with decimals as a whole number, NULL where it is none, an error where it has more than 64 bits."""
    fractional: Form
    """A number with decimals, NULL where it is a whole number."""
    part: str
    """What a column of a part is called, of its type, the depth of the comparison and the number of the part."""
    with_parts: Callable[[int, "Parts", str], str]
    """A truth value over named parts of it, each of which may use those before; they run only where it is looked at."""
    compare: Form
    """A whole number, a sign, another number: exactly."""
    least_of: str
    greatest: str
    numbers: Mapping[str, str]
    """The number that a text writes, where it is of that kind."""
    ordered: Form
    """A text, a sign, a text: by their code points."""
    startswith: Form
    endswith: Form
    contains: Form
    globbed: str
    signs: Mapping[str, str]
    """What is written for some characters of a glob."""
    lowered: str
    """A text, the capitals, and what these are in lower case: each character for itself."""

    def text(self, value: str) -> str:
        """A text as a literal."""
        return quoted(value, self.character)

    def value(self, what: str, event: str, path: Path) -> str:
        """What is asked of a value."""
        return self.values[what].format(*self.way(event, path))

    def kind(self, event: str, path: Path) -> str:
        """What type a value has, NULL where there is none."""
        return self.value("kind", event, path)

    def is_a(self, kind: str, event: str, path: Path) -> str:
        """Whether a value is of a type."""
        return self.types[kind].format(self.kind(event, path), self.value("raw", event, path))

    def facet(self, kind: str, event: str, path: Path) -> str:
        """A value where it is of a type, else NULL."""
        said = self.facets.get(kind, "{0}").format(self.value("raw", event, path))
        return f"CASE WHEN {self.is_a(kind, event, path)} THEN {said} END"

    def is_text(self, value: str, event: str, path: Path) -> str:
        """Whether a value is this text."""
        same = f"{self.value('raw', event, path)} = {self.text(value)}"
        return f"{self.is_a('text', event, path)} AND {same}" if self.looks.match(value) else same

    def key(self, event: str, path: Path) -> str:
        """What is equal for equal values, and for no others."""
        return self.keys.format(*(self.value(what, event, path) for what in ("kind", "raw", "json")))

    def cast(self, value: str, to: str) -> str:
        """A value as another type."""
        return f"CAST({value} AS {to})"

    def number(self, value: float) -> str:
        """A number as a literal."""
        return self.literal(repr(value), self.whole if isinstance(value, int) else self.real)

    def least(self, word: str, values: Sequence[str]) -> str:
        """The least or the greatest of whole numbers, NULL where one of them is."""
        nulls = " OR ".join(f"{value} IS NULL" for value in values)
        said = f"{self.least_of if word == 'least' else self.greatest}({', '.join(values)})"
        return values[0] if len(values) == 1 else f"CASE WHEN {nulls} THEN NULL ELSE {said} END"

    def read_number(self, text: str, kind: str) -> str:
        """The number that a text writes, where it is of that kind."""
        return self.numbers[kind].format(text)

    def like(self, text: str, glob: str) -> str:
        """Whether a glob matches the whole of a text."""
        return self.globbed.format(text, self.text("".join(self.signs.get(sign, sign) for sign in glob)))

    def lower(self, text: str) -> str:
        """A text in lower case, each character for itself."""
        return self.lowered.format(text, *map(self.text, _capitals()))


def _named(**types: str) -> dict[str, str]:
    """The types that have one name."""
    return {what: f"{{0}} = '{name}'" for what, name in types.items()}


@lru_cache(maxsize=256)
def _sqlite_way(event: str, path: Path) -> tuple[str, str]:
    """A field whose name a path of SQLite cannot have is looked for among all."""
    steps = "$"
    for place, step in enumerate(path):
        if isinstance(step, str) and not _PLAIN.fullmatch(step):
            value = (
                "CASE type WHEN 'text' THEN json_quote(value) WHEN 'real' THEN printf('%!.17g', value) "
                "ELSE coalesce(atom, value, type) END"
            )
            value = f"CASE WHEN type IN ('true', 'false', 'null') THEN type ELSE {value} END"
            found = f"json_each({event}, {quoted(steps, 'char')}) WHERE key = {quoted(step, 'char')}"
            return _sqlite_way(f"(SELECT {value} FROM {found})", path[place + 1 :])
        word = isinstance(step, str) and re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", step)
        steps += f"[{step}]" if isinstance(step, int) else f".{step}" if word else f'."{step}"'
    return event, quoted(steps, "char")


def _pointer(event: str, path: Path) -> tuple[str, str]:
    return event, quoted("".join(f"/{str(step).replace('~', '~0').replace('/', '~1')}" for step in path))


Parts: TypeAlias = Sequence[Mapping[str, str]]
"""The columns of each part of a comparison, by their types."""


def _subquery(depth: int, parts: Parts, truth: str) -> str:
    """Each part as a table with the columns of those before it."""
    tables, before = list[str](), ""
    for number, columns in enumerate(parts, 1):
        said = ", ".join(f"{expression} AS {kind}_{depth}_{number}" for kind, expression in columns.items())
        start = f"SELECT *, {said} FROM {before}" if before else f"SELECT {said}"
        before = f"term_{depth}_{number}"
        tables.append(f"{before} AS MATERIALIZED ({start})")
    return f"(WITH {', '.join(tables)} SELECT {truth} FROM {before})"


def _lambdas(depth: int, parts: Parts, truth: str) -> str:
    """Each part as a step that adds columns to a structure: DuckDB would run a subquery for every event."""
    found = ""
    for number, columns in enumerate(parts, 1):
        said = ", ".join(f"{kind}_{number} := {expression}" for kind, expression in columns.items())
        added = f"lambda term_{depth}: struct_insert(term_{depth}, {said})"
        found = f"list_transform({found}, {added})" if found else f"[struct_pack({said})]"
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
    lowered=(  # SQLite's own knows those of ASCII
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
    literal="CAST('{0}' AS {1})".format,
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
    lowered="translate(replace({0}, 'İ', 'i' || chr(775)), {1}, {2})",  # DuckDB's own makes `İ` an `i`
)

_POSTGRES: Final = replace(
    _DUCKDB,
    name="postgres",
    way=lambda event, path: (f"{event}::json", ", ".join(quoted(str(step)) for step in path)),
    values={
        "kind": "json_typeof(json_extract_path({0}, {1}))",
        "raw": "json_extract_path_text({0}, {1})",
        "json": "json_extract_path({0}, {1})::text",
        "length": "CASE json_typeof(json_extract_path({0}, {1})) WHEN 'array' THEN "
        "json_array_length(json_extract_path({0}, {1})) END",
    },
    types={
        **_named(text="string", truth="boolean", null="null", object="object", list="array"),
        "whole": "{0} = 'number' AND {1} ~ '^-?[0-9]+$'",  # its digits say which of the two it is
        "real": "{0} = 'number' AND {1} !~ '^-?[0-9]+$'",
    },
    facets={"whole": "CAST({0} AS bigint)", "real": "CAST({0} AS double precision)", "truth": "{0} = 'true'"},
    keys=(  # numbers within lists and objects are decimals
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
    ordered='{0} COLLATE "C" {1} {2} COLLATE "C"'.format,
)

DIALECTS: Final = {one.name: one for one in (_SQLITE, _DUCKDB, _POSTGRES)}
"""Those there are, by name."""
