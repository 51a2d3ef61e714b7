"""The dialects of SQL: how each reads a value out of an event, and what it has for numbers and texts.

A value of an event is asked for its facets: a whole number of 64 bits, another number, a text, a truth; each is NULL where it is something else.
What a program keeps in silence as another number than the event has is not left to it: a result beyond 64 bits is an error when the query runs.
"""

import re
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from typing import ClassVar, Final

from rvaft.errors import NotExpressible

Path = tuple[str | int, ...]
"""The fields, and places in lists, that lead to a value."""

_NUMBER: Final = "-?(0|[1-9][0-9]*)"
_PLAIN: Final = re.compile(r'[^"\\\x00-\x1f]*')
_LIKE: Final = {"*": "%", "?": "_", "%": r"\%", "_": r"\_", "\\": r"\\"}
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
        raise NotExpressible(reason, backend="sql", semantics="any semantics")
    parts = enumerate(_CONTROL.split(text))
    said = [f"{character}({ord(part)})" if odd % 2 else "'" + part.replace("'", "''") + "'" for odd, part in parts]
    kept = [part for part in said if part != "''"] or ["''"]
    return kept[0] if len(kept) == 1 else f"({' || '.join(kept)})"


class Duckdb:
    """DuckDB, whose paths are JSON pointers; what is alike in PostgreSQL."""

    name = "duckdb"
    whole, real = "BIGINT", "DOUBLE"
    types: ClassVar[Mapping[str, str]] = {
        "whole": "('BIGINT', 'UBIGINT')",
        "real": "('DOUBLE')",
        "text": "('VARCHAR')",
        "truth": "('BOOLEAN')",
        "null": "('NULL')",
        "object": "('OBJECT')",
        "list": "('ARRAY')",
    }
    """What the types of values are called."""
    infinity = "CAST('Infinity' AS DOUBLE)"
    greatest = "greatest"

    def text(self, value: str) -> str:
        """A text as a literal."""
        return quoted(value)

    def path(self, path: Path) -> str:
        """The way to a value."""
        return self.text("".join(f"/{str(step).replace('~', '~0').replace('/', '~1')}" for step in path))

    def kind(self, event: str, path: Path) -> str:
        """What type a value has, NULL where there is none."""
        return f"json_type({event}, {self.path(path)})"

    def written(self, event: str, path: Path) -> str:
        """A scalar as a text."""
        return f"json_extract_string({event}, {self.path(path)})"

    def json(self, event: str, path: Path) -> str:
        """A value as JSON writes it."""
        return f"CAST(json_extract({event}, {self.path(path)}) AS VARCHAR)"

    def length(self, event: str, path: Path) -> str:
        """How many items a list has."""
        return f"json_array_length({event}, {self.path(path)})"

    def is_a(self, kind: str, event: str, path: Path) -> str:
        """Whether a value is of a type."""
        types = self.types[kind]
        return f"{self.kind(event, path)} {f'IN {types}' if ',' in types else f'= {types[1:-1]}'}"

    def facet(self, kind: str, event: str, path: Path) -> str:
        """A value where it is of a type, else NULL."""
        raw = self.written(event, path)
        said = {"whole": self.cast(raw, self.whole), "real": self.cast(raw, self.real), "truth": f"{raw} = 'true'"}
        return f"CASE WHEN {self.is_a(kind, event, path)} THEN {said.get(kind, raw)} END"

    def is_text(self, value: str, event: str, path: Path) -> str:
        """Whether a value is this text."""
        same = f"{self.written(event, path)} = {self.text(value)}"
        looks = re.match(r"[-\[{0-9]|(true|false|null)$|NaN|Inf", value)
        return f"{self.is_a('text', event, path)} AND {same}" if looks else same

    def key(self, event: str, path: Path) -> str:
        """What is equal for equal values, and for no others."""
        one, real = "CAST(atom AS VARCHAR)", "CAST(atom AS DOUBLE)"
        part = f"fullkey || ' ' || CASE WHEN type = 'DOUBLE' THEN {self._exact(real)} WHEN type IN ('BIGINT', 'UBIGINT') THEN 'n' || {one} "
        part += f"WHEN atom IS NULL THEN type ELSE {one} END"
        tree = f"json_tree(json_extract({event}, {self.path(path)}))"
        inner = f"(SELECT 'c' || string_agg({part}, chr(10) ORDER BY fullkey) FROM {tree})"
        raw, kind = self.written(event, path), self.kind(event, path)
        return (
            f"CASE WHEN {kind} IN ('BIGINT', 'UBIGINT') THEN 'n' || {raw} WHEN {kind} = 'DOUBLE' THEN {self._exact(f'CAST({raw} AS DOUBLE)')} "
            f"WHEN {kind} = 'VARCHAR' THEN 's' || {raw} WHEN {kind} IN ('OBJECT', 'ARRAY') THEN {inner} ELSE coalesce({raw}, 'null') END"
        )

    def _exact(self, real: str) -> str:
        return f"CASE WHEN {real} = floor({real}) AND abs({real}) < 9e18 THEN 'n' || CAST({real} AS BIGINT) ELSE 'n' || {real} END"

    # numbers

    def cast(self, value: str, to: str) -> str:
        """A value as another type."""
        return f"CAST({value} AS {to})"

    def number(self, value: float) -> str:
        """A number as a literal."""
        return self.cast(f"'{value!r}'", self.whole if isinstance(value, int) else self.real)

    def checked(self, whole: str) -> str:
        """The result of whole numbers, an error where it has more than 64 bits."""
        return f"({whole})"

    def finite(self, real: str) -> str:
        """The result of numbers, NULL where it is not finite."""
        return f"nullif(nullif({real}, {self.infinity}), -{self.infinity})"

    def compare(self, whole: str, sign: str, real: str) -> str:
        """A whole number compared with another number, exactly."""
        floor = self.cast(f"floor({real})", self.whole)
        part = {"<": f"{real} > floor({real})", ">": "false", "<=": "true"}.get(sign, f"{real} = floor({real})")
        beside = f"{whole} {sign[:1]} {floor} OR " if sign != "=" else ""
        return (
            f"CASE WHEN {real} >= 9223372036854775808.0 THEN 0 {sign} 1 WHEN {real} < -9223372036854775808.0 THEN 1 {sign} 0 "
            f"ELSE {beside}({whole} = {floor} AND {part}) END"
        )

    def least(self, word: str, values: Sequence[str]) -> str:
        """The least or the greatest of whole numbers, NULL where one of them is."""
        nulls = " OR ".join(f"{value} IS NULL" for value in values)
        return f"CASE WHEN {nulls} THEN NULL ELSE {word}({', '.join(values)}) END"

    def read_number(self, text: str, kind: str) -> str:
        """The number that a text writes, where it is of that kind."""
        full = f"{_NUMBER}([.][0-9]+)?([eE][-+]?[0-9]+)?"
        if kind == "whole":
            return f"CASE WHEN {self.is_like(text, _NUMBER)} THEN {self.cast(text, self.whole)} END"
        wanted = f"{self.is_like(text, full)} AND NOT {self.is_like(text, _NUMBER)}"
        return f"CASE WHEN {wanted} THEN {self.finite(self.cast(text, self.real))} END"

    def is_like(self, text: str, expression: str) -> str:
        """Whether a regular expression matches the whole of a text."""
        return f"regexp_full_match({text}, '{expression}')"

    # texts

    def ordered(self, left: str, sign: str, right: str) -> str:
        """Two texts compared by their code points."""
        return f"{left} {sign} {right}"

    def startswith(self, text: str, start: str) -> str:
        """Whether a text begins so."""
        return f"starts_with({text}, {start})"

    def endswith(self, text: str, end: str) -> str:
        """Whether a text ends so."""
        return f"right({text}, length({end})) = {end}"

    def contains(self, text: str, part: str) -> str:
        """Whether a text has that in it."""
        return f"strpos({text}, {part}) > 0"

    def like(self, text: str, glob: str) -> str:
        """Whether a glob matches the whole of a text."""
        return f"{text} LIKE {self.text(''.join(_LIKE.get(c, c) for c in glob))} ESCAPE '\\'"

    def lower(self, text: str) -> str:
        """A text in lower case, each character for itself."""
        capitals, small = _capitals()
        return f"translate(replace({text}, 'İ', 'i' || chr(775)), {self.text(capitals)}, {self.text(small)})"


class Postgres(Duckdb):
    """PostgreSQL."""

    name = "postgres"
    whole, real = "bigint", "double precision"
    types: ClassVar[Mapping[str, str]] = {
        "text": "('string')",
        "truth": "('boolean')",
        "null": "('null')",
        "object": "('object')",
        "list": "('array')",
    }

    def path(self, path: Path) -> str:
        """All but the last step."""
        return "".join(f" -> {step if isinstance(step, int) else self.text(step)}" for step in path)

    def kind(self, event: str, path: Path) -> str:
        """What type a value has, NULL where there is none."""
        return f"json_typeof({event}::json{self.path(path)})"

    def written(self, event: str, path: Path) -> str:
        """A scalar as a text."""
        return f"({event}::json{self.path(path[:-1])} ->>{self.path(path[-1:])[3:]})"

    def json(self, event: str, path: Path) -> str:
        """A value as JSON writes it."""
        return f"({event}::json{self.path(path)})::text"

    def length(self, event: str, path: Path) -> str:
        """How many items a list has."""
        value = f"{event}::json{self.path(path)}"
        return f"CASE WHEN json_typeof({value}) = 'array' THEN json_array_length({value}) END"

    def is_a(self, kind: str, event: str, path: Path) -> str:
        """Whether a value is of a type; which of its two a number is, its digits say."""
        if kind in self.types:
            return super().is_a(kind, event, path)
        sign = "~" if kind == "whole" else "!~"
        return f"{self.kind(event, path)} = 'number' AND {self.written(event, path)} {sign} '^-?[0-9]+$'"

    def key(self, event: str, path: Path) -> str:
        """What is equal for equal values, and for no others; numbers within lists and objects are decimals."""
        value, raw = f"({event}::json{self.path(path)})", self.written(event, path)
        real = f"{raw}::float8"
        return (
            f"CASE WHEN {self.is_a('whole', event, path)} THEN to_jsonb({raw}::bigint) WHEN {self.is_a('real', event, path)} THEN "
            f"CASE WHEN {real} = floor({real}) AND abs({real}) < 9e18 THEN to_jsonb({real}::bigint) ELSE to_jsonb({real}) END "
            f"ELSE {value}::jsonb END"
        )

    def finite(self, real: str) -> str:
        """The result of numbers; where it is not finite PostgreSQL stops with an error."""
        return f"({real})"

    def is_like(self, text: str, expression: str) -> str:
        """Whether a regular expression matches the whole of a text."""
        return f"{text} ~ '^({expression})$'"

    def ordered(self, left: str, sign: str, right: str) -> str:
        """Two texts compared by their code points."""
        return f'{left} COLLATE "C" {sign} {right} COLLATE "C"'


class Sqlite(Duckdb):
    """SQLite, whose numbers compare exactly, and whose results beyond 64 bits are rounded in silence unless that is checked."""

    name = "sqlite"
    whole, real = "INTEGER", "REAL"
    types: ClassVar[Mapping[str, str]] = {
        "whole": "('integer')",
        "real": "('real')",
        "text": "('text')",
        "truth": "('true', 'false')",
        "null": "('null')",
        "object": "('object')",
        "list": "('array')",
    }
    infinity = "9e999"
    greatest = "max"

    def text(self, value: str) -> str:
        """A text as a literal."""
        return quoted(value, "char")

    def _ask(self, event: str, path: Path) -> tuple[str, str]:
        """The JSON text to look into, and the path there; a field whose name a path cannot have is looked for among all."""
        steps = "$"
        for place, step in enumerate(path):
            if isinstance(step, str) and not _PLAIN.fullmatch(step):
                value = "CASE type WHEN 'text' THEN json_quote(value) WHEN 'real' THEN printf('%!.17g', value) ELSE coalesce(atom, value, type) END"
                value = f"CASE WHEN type IN ('true', 'false', 'null') THEN type ELSE {value} END"
                found = f"(SELECT {value} FROM json_each({event}, {self.text(steps)}) WHERE key = {self.text(step)})"
                return self._ask(found, path[place + 1 :])
            word = isinstance(step, str) and re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", step)
            steps += f"[{step}]" if isinstance(step, int) else f".{step}" if word else f'."{step}"'
        return event, self.text(steps)

    def kind(self, event: str, path: Path) -> str:
        """What type a value has, NULL where there is none."""
        return f"json_type({', '.join(self._ask(event, path))})"

    def written(self, event: str, path: Path) -> str:
        """A scalar as SQLite has it."""
        return f"{' ->> '.join(self._ask(event, path))}"

    def json(self, event: str, path: Path) -> str:
        """A value as JSON writes it."""
        return f"({' -> '.join(self._ask(event, path))})"

    def length(self, event: str, path: Path) -> str:
        """How many items a list has."""
        return f"json_array_length({', '.join(self._ask(event, path))})"

    def facet(self, kind: str, event: str, path: Path) -> str:
        """A value where it is of a type, else NULL."""
        return f"CASE WHEN {self.is_a(kind, event, path)} THEN {self.written(event, path)} END"

    def is_text(self, value: str, event: str, path: Path) -> str:
        """Whether a value is this text, which for SQLite no number is."""
        same = f"{self.written(event, path)} = {self.text(value)}"
        return f"{self.is_a('text', event, path)} AND {same}" if value[:1] in ("{", "[") else same

    def key(self, event: str, path: Path) -> str:
        """What is equal for equal values, and for no others."""
        whole = "atom = CAST(atom AS INTEGER) AND abs(atom) < 9e18"
        real = f"CASE WHEN {whole} THEN 'n' || CAST(atom AS INTEGER) ELSE 'n' || printf('%!.17g', atom) END"
        part = f"fullkey || ' ' || CASE type WHEN 'integer' THEN 'n' || atom WHEN 'real' THEN {real} WHEN 'text' THEN json_quote(atom) ELSE type END"
        tree = f"json_tree({self.json(event, path)})"
        inner = (
            f"(SELECT 'c' || group_concat(part, char(10)) FROM (SELECT {part} AS part FROM {tree} ORDER BY fullkey))"
        )
        raw = self.written(event, path)
        return (
            f"CASE {self.kind(event, path)} WHEN 'integer' THEN {raw} WHEN 'real' THEN {raw} WHEN 'text' THEN 's' || ({raw}) "
            f"WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' WHEN 'null' THEN 'null' ELSE {inner} END"
        )

    def number(self, value: float) -> str:
        """A number as a literal."""
        return f"({value!r})" if value < 0 else repr(value)

    def checked(self, whole: str) -> str:
        """The result of whole numbers, an error where it has more than 64 bits."""
        error = "json('an integer of more than 64 bits')"
        return f"(SELECT CASE typeof(v) WHEN 'real' THEN {error} ELSE v END FROM (SELECT {whole} AS v))"

    def compare(self, whole: str, sign: str, real: str) -> str:
        """A whole number compared with another number, exactly."""
        return f"{whole} {sign} {real}"

    def least(self, word: str, values: Sequence[str]) -> str:
        """The least or the greatest of whole numbers, NULL where one of them is."""
        return f"{'min' if word == 'least' else 'max'}({', '.join(values)})" if len(values) > 1 else values[0]

    def read_number(self, text: str, kind: str) -> str:
        """The number that a text writes, where it is of that kind."""
        signs = f"{text} GLOB '[-0-9]*' AND {text} NOT GLOB '*[^-+.eE0-9]*'"
        value = f"json_extract({text}, '$')"
        value = self.checked(value) if kind == "whole" else self.finite(value)
        typed = f"CASE json_type({text}) WHEN '{'integer' if kind == 'whole' else 'real'}' THEN {value} END"
        return f"CASE WHEN {signs} THEN CASE WHEN json_valid({text}) THEN {typed} END END"

    def startswith(self, text: str, start: str) -> str:
        """Whether a text begins so."""
        return f"substr({text}, 1, length({start})) = {start}"

    def endswith(self, text: str, end: str) -> str:
        """Whether a text ends so."""
        return f"(length({end}) <= length({text}) AND substr({text}, length({text}) - length({end}) + 1) = {end})"

    def contains(self, text: str, part: str) -> str:
        """Whether a text has that in it."""
        return f"instr({text}, {part}) > 0"

    def like(self, text: str, glob: str) -> str:
        """Whether a glob matches the whole of a text."""
        return f"{text} GLOB {self.text(glob.replace('[', '[[]'))}"

    def lower(self, text: str) -> str:
        """A text in lower case, each character for itself; SQLite's own knows those of ASCII."""
        large, small = (self.text(some[26:]) for some in _capitals())  # without those of ASCII
        one = "substr(x, n, 1)"
        step = f"t || CASE WHEN instr({large}, {one}) > 0 THEN substr({small}, instr({large}, {one}), 1) ELSE lower({one}) END"
        rows = f"SELECT 1 AS n, '' AS t UNION ALL SELECT n + 1, {step} FROM w WHERE n <= length(x)"
        slow = f"(WITH RECURSIVE w(n, t) AS ({rows}) SELECT t FROM w ORDER BY n DESC LIMIT 1)"
        foreign = "x GLOB '*[^' || char(1) || '-' || char(127) || ']*'"
        value = f"replace({text}, 'İ', 'i' || char(775))"
        return f"(SELECT CASE WHEN {foreign} THEN {slow} ELSE lower(x) END FROM (SELECT {value} AS x))"


DIALECTS: Final = {one.name: one for one in (Sqlite(), Duckdb(), Postgres())}
"""Those there are, by name."""
