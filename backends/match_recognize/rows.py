"""The leading comment of a text, which says what each column of the table `events` is, and the row that an event becomes.

Every row has `trace` (the log that an event is of), `pos` (its number there, from 1) and `ts`, a time attribute that increases with `pos`; it is not the time of
the event. The other columns are those of the comment, one line each:

    time FIELD as FORMAT        where an event has its time: the field `"τ"` of the patterns, in nanoseconds, or null
    COLUMN := PATTERN           whether the event fits a pattern (BOOLEAN); of several lines for one column, one of them
    when GUARD                  and this guard holds of it
    COLUMN ASPECT of EXPRESSION what an event has that fits the pattern above; NULL where it does not fit, and where the expression is undefined

An aspect is `text` (any value as JSON, the same for equal values), `number` (DOUBLE, NULL where it is none), `string` (its UTF-8 in hexadecimal digits, which
keep the order; NULL where it is none), `time` (BIGINT, nanoseconds) or `truth` (BOOLEAN, NULL where it is neither).
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern, parse_time
from rvaft.model import guards, patterns
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import guard_text, pattern_text, time_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json, is_finite, is_number

ASPECTS: Final = {"text": "STRING", "number": "DOUBLE", "string": "STRING", "time": "BIGINT", "truth": "BOOLEAN"}
"""The type of each aspect."""
EXACT: Final = 2**46
"""Up to here sums of many whole numbers are exact as doubles, too."""
LONGEST: Final = 2**60
"""The greatest time, and the longest duration, that columns calculate with."""

_OPENING: Final = "/* rvaft"
_FITS: Final = re.compile(r"(\w+) := (.*)")
_HAS: Final = re.compile(rf"(\w+) ({'|'.join(ASPECTS)}) of (.*)")
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')


class FittingEvent(NamedTuple):
    """A pattern, and guards over its variables."""

    pattern: Pattern
    guards: tuple[Guard, ...] = ()

    def values(self, event: Json) -> dict[str, Json] | None:
        """The variables of an event that fits, else None."""
        found = patterns.match(self.pattern, event, {})
        return found if found is not None and all(guards.holds(one, found) for one in self.guards) else None


class ValueColumn(NamedTuple):
    """An aspect of an expression over the variables of an event that fits."""

    aspect: str
    expression: Guard

    def of(self, values: dict[str, Json]) -> Json:
        """What stands in the column; raises `OverflowError` for a number that it cannot hold exactly."""
        found = guards.value(self.expression, values)
        if found is guards.UNDEFINED or not is_finite(found):
            return None
        match self.aspect:
            case "text":
                return json_text(found)
            case "string":
                return found.encode("utf-8", "surrogatepass").hex() if isinstance(found, str) else None
            case "truth":
                return found if isinstance(found, bool) else None
            case _ if not is_number(found):
                return None
            case "time":
                return _bounded(int(found), LONGEST)
            case _:
                return float(_bounded(found, EXACT)) + 0.0  # no zero is negative


def json_text(value: Json) -> str:
    """A value as JSON in ASCII, the same for equal values.

    >>> json_text({"b": 1.0, "a": True})
    '{"a":true,"b":1}'
    """
    return json.dumps(_plain(value), separators=(",", ":"), sort_keys=True)


def _bounded(number: float, most: int) -> Any:
    if abs(number) > most:
        raise OverflowError(f"a number beyond 2**{most.bit_length() - 1} is no exact one there")
    return number


def _plain(value: Json) -> Json:
    """Numbers without a fraction as integers, at all depths."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return int(value) if value.is_integer() else float(value)
    return value


@dataclass(slots=True)
class RowHeader:
    """What the comment says: of each BOOLEAN column the events that fit it, and of some the columns of their values."""

    fitting: dict[str, list[FittingEvent]] = field(default_factory=dict)
    values: dict[str, dict[str, ValueColumn]] = field(default_factory=dict)
    time: EventTime | None = None

    def __str__(self) -> str:
        lines = [] if self.time is None else [time_text(self.time)]
        for column, several in self.fitting.items():
            for one in several:
                lines.append(f"{column} := {pattern_text(one.pattern)}")
                lines += [f"when {guard_text(guard)}" for guard in one.guards]
            for name, value in self.values.get(column, {}).items():
                lines.append(f"{name} {value.aspect} of {guard_text(value.expression)}")
        return "\n".join([_OPENING, *map(_commented, lines), "*/\n"])

    @classmethod
    def read(cls, text: str) -> "RowHeader":
        """The header of a text; raises `LanguageError` where it has none."""
        opening, _, rest = text.partition("\n")
        lines, end, _ = rest.partition("*/")
        if opening.strip() != _OPENING or not end:
            raise LanguageError(f"the text begins with a comment {_OPENING} … */ that says what each column is")
        header, last = cls(), ""
        for line in filter(None, map(str.strip, lines.split("\n"))):
            if line.startswith("time "):
                header.time = parse_time(line)
            elif line.startswith("when ") and last:
                pattern, known = header.fitting[last].pop()
                guard = parse_guard(line.removeprefix("when "))
                header.fitting[last].append(FittingEvent(pattern, (*known, guard)))
            elif fits := _FITS.fullmatch(line):
                last, parsed = fits[1], parse_pattern(fits[2])
                header.fitting.setdefault(last, []).append(FittingEvent(parsed))
            elif last and (has := _HAS.fullmatch(line)):
                header.values.setdefault(last, {})[has[1]] = ValueColumn(has[2], parse_guard(has[3]))
            else:
                raise LanguageError(f"no line that says what a column is: {line}")
        return header

    def types(self) -> dict[str, str]:
        """The columns with their types."""
        found = dict.fromkeys(self.fitting, "BOOLEAN")
        for columns in self.values.values():
            found.update({name: ASPECTS[one.aspect] for name, one in columns.items()})
        return found

    def row(self, event: Json) -> dict[str, Json]:
        """The columns of an event; raises `OverflowError` where one cannot hold a number."""
        seen, found = event if self.time is None else self.time.stamped(event), dict[str, Json]()
        for column, several in self.fitting.items():
            values = next((one for one in (some.values(seen) for some in several) if one is not None), None)
            found[column] = values is not None
            for name, one in self.values.get(column, {}).items():
                found[name] = None if values is None else one.of(values)
        return found

    def left_open(self, trace: Sequence[Json]) -> str:
        """Why the columns cannot say what a trace is, in a few words; empty where they can."""
        try:
            for event in trace:
                self.row(event)
        except OverflowError as error:
            return str(error)
        return ""


def _commented(line: str) -> str:
    """The line without what would end the comment, in its strings."""
    return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f").replace("/*", "/\\u002a"), line)
