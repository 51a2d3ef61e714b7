"""Columns of events for programs that do not read JSON, defined by the leading comment of a text.

    time FIELD as FORMAT        the time of an event
    NAME := PATTERN at T        a matching event; `T` is its time in nanoseconds, or null; several
                                lines for one name are alternatives; `at T` only if the time is used
    when GUARD                  a guard on the pattern above
    COLUMN ASPECT of EXPRESSION a column of the pattern above; null if the expression is undefined

Aspects: `text` (the value as JSON, the same for equal values), `kind` (n: number, s: string, o:
other), `number` (a double or null), `string` (UTF-8 in hexadecimal digits, which keep the order, or
null), `time` (whole nanoseconds), `truth` (a Boolean or null).
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, NamedTuple, Self

from rvaft.core.conditions import Unsayable
from rvaft.core.property import Property
from rvaft.core.times import timed, untimed
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern, parse_time
from rvaft.model import guards, patterns
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import guard_text, pattern_text, time_text
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Literal, Pattern
from rvaft.model.values import EXACT_INTEGERS, Json, is_finite, is_number

ASPECTS: Final = ("text", "kind", "number", "string", "time", "truth")
EXACT: Final = 2**46
"""Columns hold smaller numbers: sums of several remain exact as doubles."""
LONGEST_TIME: Final = 22 * 10**17
"""Bound of times and durations in nanoseconds (up to 2039), so that differences fit in 63 bits."""
_FITS: Final = re.compile(r"(\w+) := (.*?)(?:(?<=[}\]_]) at ([A-Za-z_]\w*))?", re.ASCII)
_HAS: Final = re.compile(rf"(\w+) ({'|'.join(ASPECTS)}) of (.*)")
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')


class FittingEvent(NamedTuple):
    """A pattern, and guards over its variables."""

    pattern: Pattern
    guards: tuple[Guard, ...] = ()

    def values(self, event: Json) -> dict[str, Json] | None:
        """Return the variables of a matching event, or None."""
        found = patterns.match(self.pattern, event, {})
        return found if found is not None and all(guards.holds(one, found) for one in self.guards) else None


class ValueColumn(NamedTuple):
    """An aspect of an expression over the variables of a matching event."""

    aspect: str
    expression: Guard

    def of(self, values: dict[str, Json]) -> Json:
        """Return the column's value; raises `OverflowError` for a number that it cannot hold
        exactly.
        """
        found = guards.value(self.expression, values)
        if found is guards.UNDEFINED or not is_finite(found):
            return None
        match self.aspect:
            case "text":
                return json_text(found)
            case "kind":
                return "n" if is_number(found) else "s" if isinstance(found, str) else "o"
            case "string":
                return found.encode("utf-8", "surrogatepass").hex() if isinstance(found, str) else None
            case "truth":
                return found if isinstance(found, bool) else None
            case _ if not is_number(found):
                return None
            case "time":
                if abs(found) >= LONGEST_TIME:
                    raise OverflowError("times of 2.2e18 ns or more are not exact in this language")
                return int(found)
            case _ if abs(found) >= EXACT:
                raise OverflowError("numbers of 2**46 or more are not exact in this language")
            case _:
                return float(found) + 0.0  # avoid negative zero


@dataclass(slots=True)
class EventColumns:
    """The definitions of the comment: patterns by name, and columns of their values."""

    fitting: dict[str, list[FittingEvent]] = field(default_factory=dict)
    values: dict[str, dict[str, ValueColumn]] = field(default_factory=dict)
    time: EventTime | None = None

    comment: ClassVar[tuple[str, str]] = ("/*", "*/")

    def __str__(self) -> str:
        opening, closing = self.comment
        lines = [] if self.time is None else [time_text(self.time)]
        for name, several in self.fitting.items():
            for one in several:
                pattern, time = untimed(one.pattern)
                lines.append(f"{name} := {pattern_text(pattern)}{'' if time is None else f' at {time}'}")
                lines += [f"when {guard_text(guard)}" for guard in one.guards]
            for column, value in self.values.get(name, {}).items():
                lines.append(f"{column} {value.aspect} of {guard_text(value.expression)}")
        return "\n".join([f"{opening} rvaft", *map(self._commented, lines), f"{closing}\n"])

    def _commented(self, line: str) -> str:
        marks = re.compile("|".join(map(re.escape, self.comment)))
        escape = lambda mark: re.sub("[^*]", lambda sign: f"\\u{ord(sign[0]):04x}", mark[0])  # noqa: E731
        return _STRING.sub(lambda found: marks.sub(escape, found[0]), line)

    @classmethod
    def read(cls, text: str) -> Self:
        """Return the header of a text; raises `LanguageError` without one."""
        opening, closing = cls.comment
        remarks = rf"(?:{re.escape(opening)}(?! rvaft\n).*?{re.escape(closing)}\s*)*"
        text = re.sub(rf"\A{remarks}", "", text, flags=re.DOTALL)
        first, _, rest = text.partition("\n")
        lines, end, _ = rest.partition(closing)
        if first.strip() != f"{opening} rvaft" or not end:
            what = "that defines each name"
            raise LanguageError(f"the text must begin with a comment {opening} rvaft … {closing} {what}")
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
                parsed = parsed if fits[3] is None else timed(parsed, fits[3])
                header.fitting.setdefault(last, []).append(FittingEvent(parsed))
            elif last and (has := _HAS.fullmatch(line)):
                header.values.setdefault(last, {})[has[1]] = ValueColumn(has[2], parse_guard(has[3]))
            else:
                raise LanguageError(f"not a definition of a name: {line}")
        return header

    def cells(self, event: Json) -> dict[str, dict[str, Json] | None]:
        """Return the columns of a matching event for each name, or None; raises as `ValueColumn.of`
        does.
        """
        seen, found = event if self.time is None else self.time.stamped(event), dict[str, dict[str, Json] | None]()
        for name, several in self.fitting.items():
            values = next((one for one in (some.values(seen) for some in several) if one is not None), None)
            columns = self.values.get(name, {}).items()
            found[name] = None if values is None else {column: one.of(values) for column, one in columns}
        return found

    def left_open(self, trace: Sequence[Json]) -> str:
        """Return why the columns cannot represent a trace, or an empty string."""
        try:
            for event in trace:
                self.cells(event)
        except OverflowError as error:
            return str(error)
        return ""


def json_text(value: Json) -> str:
    """Return a value as ASCII JSON, the same for equal values.

    >>> json_text({"b": 1.0, "a": True})
    '{"a":true,"b":1}'
    """
    return json.dumps(_plain(value), separators=(",", ":"), sort_keys=True)


def _plain(value: Json) -> Json:
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return int(value) if value.is_integer() else float(value)
    return value


def constant(literal: Literal, aspect: str) -> Json:
    """Return the column value of a constant; raises `Unsayable` if it is not exact."""
    number = literal.value
    try:
        cell = ValueColumn(aspect, literal).of({})
    except OverflowError:
        cell = None
    if cell is None or (aspect in ("number", "time") and cell != number):
        raise Unsayable(f"it compares with {number}, which the language cannot hold exactly")
    return cell


def require_exact_sums(*terms: Guard, time: bool) -> None:
    """Raise `Unsayable` if a sum could exceed exact doubles or, for times, 63-bit integers."""

    def reach(term: Guard) -> float:
        match term:
            case Literal(int() | float() as constant):
                return min(abs(constant), unit)
            case Operation(Operator.ADD | Operator.SUB, operands):
                return sum(map(reach, operands))
            case Operation(_, operands):
                return max(map(reach, operands))
            case _:
                return unit

    unit = LONGEST_TIME - 1 if time else EXACT - 1
    if max(map(reach, terms)) >= (2**62 if time else EXACT_INTEGERS):
        raise Unsayable("its sums are too large to be exact in the language")


def time_variables(prop: Property) -> frozenset[str]:
    """Return the variables that hold times of events."""
    return frozenset(time for event in prop.events if (time := untimed(event.pattern)[1]) is not None)
