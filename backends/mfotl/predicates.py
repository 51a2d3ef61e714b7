"""The leading comment of a text, which says what each predicate is, and the facts that an event becomes.

Lines of the comment, one each:

    time FIELD as FORMAT                    where an event has its time: the field `"τ"` of the patterns, in nanoseconds, or null
    NAME(VARIABLE ASPECT, …) := PATTERN     an event pattern; the arguments are what is seen of its variables, and last the position
    when GUARD                              a guard on the events of the predicate above

An aspect is `text` (any value, as one word: equal for equal values), `kind` (n for a number, s for a string, o for another),
`number` (a double, 0 where it is none), `string` (its UTF-8 in hexadecimal digits, which keep the order) or `integer`.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, Final, TypeAlias
from urllib.parse import quote

from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern, parse_time
from rvaft.model import guards, patterns
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import guard_text, pattern_text, time_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json, is_number

Column: TypeAlias = tuple[str, str]
"""A variable, and an aspect of it."""

TYPES: Final = {"text": "string", "kind": "string", "number": "float", "string": "string", "integer": "int"}
"""The type of each aspect in a signature."""
EXACT: Final = 2**46
"""Up to here sums of many whole numbers are exact as doubles, too."""

_LINE: Final = re.compile(r"(\w+)\(([^)]*)\) := (.*)")
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')


def word(value: Json) -> str:
    """A value as one word, the same for equal values.

    >>> word("a b"), word(1.0), word({"k": [None, True]})
    ('a%20b', '1', '%7B%22k%22%3A%5Bnull%2Ctrue%5D%7D')
    """
    text = value if isinstance(value, str) else json.dumps(_plain(value), separators=(",", ":"), sort_keys=True)
    mark = "%22" if isinstance(value, str) and (not value or value[0] in '"-0123456789{[nft') else ""
    return mark + quote(text, safe="", errors="surrogatepass")


def _plain(value: Json) -> Json:
    """Numbers without a fraction as integers, at all depths."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return int(value) if value.is_integer() else float(value)
    return value


def hexadecimal(text: str) -> str:
    """The UTF-8 of a string in hexadecimal digits; strings keep their order.

    >>> hexadecimal("ab") < hexadecimal("b"), hexadecimal("é")
    (True, 'c3a9')
    """
    return text.encode("utf-8", "surrogatepass").hex()


def decimal_text(number: float) -> str:
    """A number as MonPoly reads a double.

    >>> decimal_text(1), decimal_text(-2.5e-7)
    ('1.0', '-0.00000025')
    """
    digits = f"{Decimal(repr(float(number) + 0.0)):f}"  # no zero is negative
    return digits if "." in digits else f"{digits}.0"


def aspect(value: Json, name: str) -> str:
    """What an argument is for a value, as a log writes it."""
    match name:
        case "text":
            return f'"{word(value)}"'
        case "kind":
            return '"n"' if is_number(value) else '"s"' if isinstance(value, str) else '"o"'
        case "string":
            return f'"{hexadecimal(value) if isinstance(value, str) else ""}"'
        case "integer":
            return str(value if isinstance(value, int) else 0)
        case _:
            known = is_number(value) and abs(value) <= EXACT
            return decimal_text(value) if known else "0.0"


@dataclass(frozen=True, slots=True)
class Predicate:
    """An event pattern under guards, and the arguments that the formula looks at."""

    pattern: Pattern
    guards: tuple[Guard, ...] = ()
    columns: tuple[Column, ...] = ()

    def values(self, event: Json) -> dict[str, Json] | None:
        """The variables of an event that fits, else None."""
        found = patterns.match(self.pattern, event, {})
        return found if found is not None and all(guards.holds(one, found) for one in self.guards) else None


@dataclass(slots=True)
class MfotlHeader:
    """What the comment says: the predicates by name, in the order of their lines."""

    predicates: dict[str, Predicate] = field(default_factory=dict)
    time: EventTime | None = None

    def __str__(self) -> str:
        lines = [] if self.time is None else [_commented(time_text(self.time))]
        for name, one in self.predicates.items():
            columns = ", ".join(map(" ".join, one.columns))
            lines.append(f"{name}({columns}) := {_commented(pattern_text(one.pattern))}")
            lines += [f"when {_commented(guard_text(guard))}" for guard in one.guards]
        return "\n".join(["(* rvaft", *lines, "*)\n"])

    @classmethod
    def read(cls, text: str) -> "MfotlHeader":
        """The header of a text; raises `LanguageError` where it has none."""
        opening, _, rest = text.partition("\n")
        lines, end, _ = rest.partition("*)")
        if opening.strip() != "(* rvaft" or not end:
            raise LanguageError("the text begins with a comment (* rvaft … *) that says what each predicate is")
        header, last = cls(), ""
        for line in filter(None, map(str.strip, lines.split("\n"))):
            found = _LINE.fullmatch(line)
            if line.startswith("time "):
                header.time = parse_time(line)
            elif line.startswith("when ") and last:
                one = header.predicates[last]
                guard = parse_guard(line.removeprefix("when "))
                header.predicates[last] = Predicate(one.pattern, (*one.guards, guard), one.columns)
            elif found is not None:
                last, columns, pattern = found.groups()
                pairs = [tuple(column.split()) for column in columns.split(", ")] if columns else []
                parsed: Any = parse_pattern(pattern)
                header.predicates[last] = Predicate(parsed, (), tuple((name, what) for name, what in pairs))
            else:
                raise LanguageError(f"no line that says what a predicate is: {line}")
        return header

    def signature(self) -> str:
        """The predicates with the types of their arguments, as the programs read them."""
        lines = []
        for name, one in self.predicates.items():
            arguments = [f"{variable}_{what}: {TYPES[what]}" for variable, what in one.columns]
            lines.append(f"{name}({', '.join([*arguments, 'position: int'])})\n")
        return "".join(lines)

    def facts(self, event: Json, position: int) -> Iterator[str]:
        """The facts that an event at a position becomes."""
        seen = event if self.time is None else self.time.stamped(event)
        for name, one in self.predicates.items():
            values = one.values(seen)
            if values is not None:
                arguments = [aspect(values[variable], what) for variable, what in one.columns]
                yield f"{name}({','.join([*arguments, str(position)])})"

    def is_exact(self, event: Json) -> bool:
        """Whether each number that a predicate hands over as a double is one that doubles calculate with as whole numbers do."""
        seen = event if self.time is None else self.time.stamped(event)
        asked = ((one.values(seen) or {}, one.columns) for one in self.predicates.values())
        numbers = (values.get(name) for values, columns in asked for name, what in columns if what == "number")
        return all(abs(number) <= EXACT for number in numbers if number is not None and is_number(number))


def _commented(text: str) -> str:
    """The text without what would end the comment, in its strings."""
    return _STRING.sub(lambda found: found[0].replace("*)", "*\\u0029").replace("(*", "\\u0028*"), text)
