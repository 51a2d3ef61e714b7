"""The time of an event (semantics, section 1.1): its field and its formats.

A time is an integer in nanoseconds. Decimals are read exactly and rounded, half to even; a double
is read as its shortest decimal.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from dataclasses import field as part
from datetime import UTC, date, datetime, timedelta, timezone, tzinfo
from decimal import ROUND_05UP, ROUND_HALF_EVEN, Context, Decimal, DecimalException
from enum import StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

from rvaft.errors import OptionError
from rvaft.model.nodes import Place
from rvaft.model.values import NUMBER, Json, JsonObject, at
from rvaft.support.terminal import readable_json


class _TimeKey(str):
    """A key that equals only itself, so that no field name equals it."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return self is other

    def __ne__(self, other: object) -> bool:
        return self is not other

    def __hash__(self) -> int:
        return str.__hash__(self)

    def __reduce__(self) -> str:
        return "TIME"


TIME: Final = _TimeKey("time of the event")
"""The key of an event's time in patterns (`EventTime.stamped`)."""
UNITS: Final[Mapping[str, int]] = {
    "d": 86_400_000_000_000,
    "h": 3_600_000_000_000,
    "min": 60_000_000_000,
    "s": 1_000_000_000,
    "ms": 1_000_000,
    "us": 1_000,
    "ns": 1,
}
"""The units of durations in nanoseconds, the longest first."""


class TimeFormat(StrEnum):
    """The format of the time field."""

    SECONDS = "s"
    MILLISECONDS = "ms"
    MICROSECONDS = "us"
    NANOSECONDS = "ns"
    ISO8601 = "iso8601"
    ROS = "ros"
    FILETIME = "filetime"


NUMERIC: Final = frozenset(TimeFormat) - {TimeFormat.ISO8601, TimeFormat.ROS}
"""The formats whose times are numbers."""


@dataclass(frozen=True, slots=True)
class TextFormat:
    """A strptime format; without `%Y` or `%y` it needs a `year`, without `%z` a `zone` may replace UTC.

    Raises `OptionError` for what `docs/semantics.md` does not list.

    >>> format = TextFormat("%d/%b/%Y:%H:%M:%S %z")
    >>> format.read("02/Mar/2026:08:00:01 +0100"), format.read("today")
    (1772434801000000000, None)
    """

    pattern: str
    year: int | None = None
    zone: str | None = None

    def __post_init__(self) -> None:
        own = {"year": "Y", "zone": "z"}
        groups = _text_pattern(self.pattern).groupindex
        for name, group in own.items():
            read = next((one for one in (group, "y" if group == "Y" else "") if one in groups), None)
            if read is not None and getattr(self, name) is not None:
                raise OptionError(f"the format {self.pattern!r} reads the {name} with %{read}: omit `{name}`")
        if self.year is not None and not 1 <= self.year <= 9999:
            raise OptionError(f"the year {self.year} is not between 1 and 9999")
        _zone(self.zone)

    @property
    def needs_year(self) -> bool:
        """Whether times have no year."""
        return self.year is None and _text_pattern(self.pattern).groupindex.keys().isdisjoint("Yy")

    def __str__(self) -> str:
        year = "" if self.year is None else f" year {self.year}"
        zone = "" if self.zone is None else f" zone {json.dumps(self.zone)}"
        return f"{readable_json(self.pattern)}{year}{zone}"

    def read(self, value: Json) -> int | None:
        """Return the time of a value in nanoseconds, or None if undefined."""
        found = _text_pattern(self.pattern).fullmatch(value) if isinstance(value, str) else None
        if found is None or len(found.string) > _LONGEST or self.needs_year:
            return None
        given = {name: text for name, text in found.groupdict().items() if text}
        month = next((_MONTHS.index(given[name][:3]) + 1 for name in "bB" if name in given), int(given.get("m", 1)))
        hour = int(given.get("H", given.get("I", 0)))
        if "I" in given:
            if not 1 <= hour <= 12:
                return None
            hour = hour % 12 + 12 * (given["p"].upper() == "PM")
        clock = (hour, int(given.get("M", 0)), int(given.get("S", 0)))
        try:
            year = _century(int(given["y"])) if "y" in given else int(given.get("Y", self.year or 0))
            day = date(year, month, int(given["d"]))
            ahead = _ahead(given["z"]) if "z" in given else _offset(day, clock, _zone(self.zone))
        except (ValueError, OverflowError):
            return None
        return _instant(day, clock, given.get("f", ""), ahead)


_MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_TWO: Final = r"\d\d?+"
_DIRECTIVES: Final[Mapping[str, str]] = {
    "Y": r"\d{4}",
    "y": r"\d{2}",
    "m": _TWO,
    "b": "|".join(_MONTHS),
    "B": "January|February|March|April|May|June|July|August|September|October|November|December",
    "d": _TWO,
    "a": "Mon|Tue|Wed|Thu|Fri|Sat|Sun",
    "A": "Monday|Tuesday|Wednesday|Thursday|Friday|Saturday|Sunday",
    "H": _TWO,
    "I": _TWO,
    "p": "AM|PM|am|pm",
    "M": _TWO,
    "S": _TWO,
    "f": r"\d{1,9}+",
    "z": r"[Zz]|[+-]\d\d(?::?\d\d)?+",
}
"""The directives of text formats as regular expressions."""
_DIGITS: Final = tuple("0123456789")
_EXCLUSIVE: Final = ("Yy", "mbB", "HI", "aA")
_PARTS: Final = re.compile(r"%.?|[ \t]+|.", re.DOTALL)


@lru_cache(maxsize=256)
def _text_pattern(text: str) -> re.Pattern[str]:
    """Return the regular expression of a strptime format; raises `OptionError`."""
    whole, seen = list[str](), set[str]()
    parts = _PARTS.findall(text)
    for part_, following in zip(parts, [*parts[1:], ""], strict=True):
        if not part_.startswith("%") or part_ == "%%":
            whole.append(r"[ \t]++" if not part_.strip(" \t") else re.escape(part_[-1]))
            continue
        name = part_[1:]
        if name not in _DIRECTIVES:
            known = " ".join(f"%{one}" for one in _DIRECTIVES)
            raise OptionError(f"the format {text!r} has the unknown directive {part_}; known are {known} %%")
        if clash := seen & {*name, *next((group for group in _EXCLUSIVE if name in group), "")}:
            raise OptionError(f"the format {text!r} has both %{min(clash)} and {part_}: keep one")
        seen.add(name)
        digit = following in ("%Y", "%y", "%m", "%d", "%H", "%I", "%M", "%S", "%f") or following in _DIGITS
        if digit and name in "fz":
            raise OptionError(f"the format {text!r} has a digit after {part_}, whose length varies: separate them")
        whole.append(f"(?P<{name}>{_DIRECTIVES[name].replace('?+', '') if digit else _DIRECTIVES[name]})")
    if "d" not in seen or not seen & {*"mbB"}:
        raise OptionError(f"the format {text!r} lacks the day (%d) or the month (%m, %b or %B)")
    if ("I" in seen) != ("p" in seen):
        raise OptionError(f"the format {text!r} needs %I and %p together, or %H")
    return re.compile("".join(whole), re.ASCII)


@lru_cache(maxsize=64)
def _zone(name: str | None) -> tzinfo:
    """Return a zone by its name in the database of time zones, or by its offset; raises `OptionError`."""
    if name is None:
        return UTC
    try:
        if _OFFSET.fullmatch(name):
            return timezone(timedelta(seconds=_ahead(name)))
        if name != "localtime":  # of the machine
            from zoneinfo import ZoneInfo  # noqa: PLC0415 -- imported on use

            return ZoneInfo(name)
        raise ValueError(name)  # noqa: TRY301
    except (OSError, ValueError, LookupError):
        raise OptionError(
            f"unknown time zone {name!r}: write a name such as Europe/Berlin or an offset such as +02:00"
        ) from None


def _century(year: int) -> int:
    """Return the year of two digits, as POSIX reads it: 69 to 99 are 1969 to 1999."""
    return year + (1900 if year >= 69 else 2000)


def _ahead(offset: str) -> int:
    """Return the seconds of an offset such as `+02:00`; raises `ValueError` if out of range."""
    found = _OFFSET.fullmatch(offset)
    if found is None:
        return 0  # Z or z
    hours, minutes = int(found[2]), int(found[3] or 0)
    if hours > 23 or minutes > 59:
        raise ValueError(offset)
    return (hours * 60 + minutes) * (-60 if found[1] == "-" else 60)


_OFFSET: Final = re.compile(r"([+-])(\d\d)(?::?(\d\d))?", re.ASCII)


def _offset(day: date, clock: tuple[int, int, int], zone: tzinfo) -> int:
    """Return the offset of a zone in seconds; raises `ValueError` if it skips this time."""
    local = datetime(day.year, day.month, day.day, *clock[:2], tzinfo=zone)
    offset, later = ((local.replace(fold=fold).utcoffset() or timedelta()) for fold in (0, 1))
    if offset < later:  # a gap: the offset after it is larger
        raise ValueError(local)
    return int(offset.total_seconds())


def _instant(day: date, clock: tuple[int, int, int], decimals: str, ahead: int) -> int | None:
    """Return a local time in nanoseconds, or None if the clock is out of range."""
    hour, minute, second = clock
    part_ = scaled(f"0.{decimals}", "s") if decimals else 0
    if hour > 23 or minute > 59 or second > 60 or part_ is None:
        return None
    whole = ((day.toordinal() - _EPOCH) * 24 + hour) * 3_600 + minute * 60 + second - ahead
    return whole * UNITS["s"] + part_


class Jump(NamedTuple):
    """An event whose time is more than the allowed lateness ahead of the maximum before it, or the first time."""

    number: int
    before: int | None
    time: int
    line: int | None = None

    def makes_late(self, time: int, latest: int, allowed: int) -> bool:
        """Whether a late event of that time would not be late without the jump, and the events after it."""
        if self.before is None:
            return latest == self.time
        return self.before - allowed <= time < self.time


JUMPS: Final = 16
"""Number of jumps that are remembered."""


@dataclass(frozen=True, slots=True)
class EventTime:
    """`time FIELD as FORMAT [late DURATION];`.

    `field` is the path to the field, `late` the allowed lateness in nanoseconds.

    >>> import rvaft
    >>> rvaft.loads("time header.stamp as ros late 2 s; top and a b;").time
    EventTime(field=('header', 'stamp'), format=<TimeFormat.ROS: 'ros'>, late=2000000000)
    """

    field: tuple[str, ...]
    format: TimeFormat | TextFormat
    late: int | None = None
    place: Place = part(default=Place(), compare=False, repr=False)

    def written(self, event: Json) -> Json:
        """Return the value of an event's time field, or None if absent.

        >>> EventTime(("header", "stamp"), TimeFormat.SECONDS).written({"header": {"stamp": "12.5"}})
        '12.5'
        """
        return at(event, self.field)

    def read(self, event: Json) -> int | None:
        """Return the time of an event in nanoseconds, or None if undefined.

        >>> EventTime(("ts",), TimeFormat.MILLISECONDS).read({"ts": "1.5"})
        1500000
        """
        return self.of(at(event, self.field))

    def reader(self) -> Callable[[Json], int | None]:
        """Return `read` as a function for many events.

        >>> EventTime(("ts",), TimeFormat.MILLISECONDS).reader()({"ts": 7})
        7000000
        """
        read_value = self._value_reader
        if len(self.field) > 1:
            return lambda event: read_value(at(event, self.field))
        (field,) = self.field
        return lambda event: read_value(event.get(field) if type(event) is dict else at(event, self.field))

    def written_in(self, events: Iterable[JsonObject]) -> list[Json]:
        """Return `written` of each event."""
        if len(self.field) > 1:
            return [at(event, self.field) for event in events]
        (field,) = self.field
        return [event.get(field) for event in events]

    def of_all(self, values: Iterable[Json]) -> list[int | None]:
        """Return `of` each value.

        >>> EventTime(("ts",), TimeFormat.SECONDS).of_all([1.5, 2, None])
        [1500000000, 2000000000, None]
        """
        return list(map(self._value_reader, values))

    @property
    def _value_reader(self) -> Callable[[Json], int | None]:
        """The function `of`, faster for numbers."""
        found = _SIZES.get(self.format) if isinstance(self.format, TimeFormat) else None
        if found is None:
            return self.of
        size, begin = found
        scale = {UNITS["s"]: 10**6, UNITS["ms"]: 10**3}.get(size, 1)
        step, of = size // scale, self.of

        def read(value: Json) -> int | None:
            if type(value) is float and -_MOST_EXACT < (scaled := value * scale) < _MOST_EXACT:
                whole = round(scaled)
                if whole / scale == value:  # then it is the shortest decimal: near ones are other doubles
                    return whole * step + begin
            elif type(value) is int and -_MOST_WHOLE < value < _MOST_WHOLE:
                return value * size + begin
            return of(value)

        return read

    def now(self, value: Json | datetime) -> int:
        """Return a time in nanoseconds, given as events have it or as a `datetime` (without a zone, in UTC).

        >>> EventTime(("ts",), TimeFormat.SECONDS).now(2.5)
        2500000000

        Raises `OptionError` if it cannot be read.
        """
        if isinstance(value, datetime):
            whole = value if value.tzinfo is not None else value.replace(tzinfo=UTC)
            since = whole - datetime(1970, 1, 1, tzinfo=UTC)
            return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000
        found = self.of(value)
        if found is None:
            raise OptionError(f"{value!r} is no time as {self.format}")
        return found

    def reads(self, value: Json) -> bool:
        """Whether a value of the time field can be read."""
        return self.of(value) is not None

    def of(self, value: Json) -> int | None:
        """Return the time of a value of the time field in nanoseconds, or None if undefined."""
        # equal numbers with all their digits may be different times
        return _remembered(self.format, value) if type(value) in _SCALARS else _read(self.format, value)

    def is_late(self, event: Json, latest: int | None) -> tuple[bool, int | None]:
        """Return whether an event is late, and the new maximum time.

        `latest` is the maximum time of the events before.

        >>> EventTime(("ts",), TimeFormat.SECONDS, late=0).is_late({"ts": 2}, 3_000_000_000)
        (True, 3000000000)
        """
        time = self.read(event)
        if self.late is None or time is None:
            return False, latest
        if latest is None:
            return False, time
        return latest - time > self.late, max(latest, time)

    def jumped(
        self, jumps: tuple[Jump, ...], number: int, before: int | None, latest: int | None, line: int | None = None
    ) -> tuple[Jump, ...]:
        """Return the last `JUMPS` jumps after an event that moved the maximum time on from `before`."""
        if latest is None or (before is not None and latest - before <= (self.late or 0)):
            return jumps
        return (*jumps[1 - JUMPS :], Jump(number, before, latest, line))

    def stamped(self, event: Json) -> Json:
        """Return the event with its time in nanoseconds (or null) at the key `TIME`.

        >>> EventTime(("ts",), TimeFormat.SECONDS).stamped({"ts": 2})
        {'ts': 2, 'time of the event': 2000000000}
        """
        return {**event, TIME: self.read(event)} if isinstance(event, Mapping) else event


def duration_text(nanoseconds: int) -> str:
    """Return a duration in the longest unit that divides it.

    >>> duration_text(5_400_000_000_000), duration_text(0)
    ('90 min', '0 s')
    """
    if nanoseconds == 0:
        return "0 s"
    unit = next(unit for unit, size in UNITS.items() if nanoseconds % size == 0)
    return f"{nanoseconds // UNITS[unit]} {unit}"


def scaled(number: str, unit: str) -> int | None:
    """Return a decimal number of a unit in nanoseconds, or None if it is too large for a time.

    >>> scaled("1.5", "h"), scaled("2e-10", "s"), scaled("0e31", "s"), scaled("1e999999", "s")
    (5400000000000, 0, 0, None)
    """
    return _multiplied(number, UNITS[unit])


def _multiplied(number: str, size: int) -> int | None:
    whole, _, part = number.partition(".")
    digits = whole + part
    if len(digits) <= _FEW and digits.isascii() and digits.isdigit():  # fast, for most numbers
        tens: int = 10 ** len(part)
        if int(digits) * size % tens == 0:
            return int(digits) * size // tens
    try:
        value = _EXACT.create_decimal(number)
        if not value or value.adjusted() < -40:
            return 0
        if not value.is_finite() or value.adjusted() > _MOST:
            return None
        return int(_EXACT.multiply(value, Decimal(size)).to_integral_value(ROUND_HALF_EVEN, _EXACT))
    except DecimalException:
        return None


def duration(text: str) -> int:
    """Return a duration option in nanoseconds, greater than 0; raises `OptionError`.

    >>> duration("10 min")
    600000000000
    """
    found = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)\s*([a-z]+)", text.strip(), re.ASCII)
    size = scaled(*found.groups()) if found is not None and found[2] in UNITS else None
    if not size:
        raise OptionError(f"{text!r} is not a duration: write a number and one of {', '.join(UNITS)}, as in 10 min")
    return size


_FEW: Final = 20
_MOST: Final = 30
"""The maximum power of ten of a time in any unit."""
_EXACT: Final = Context(prec=5_000, rounding=ROUND_05UP, Emax=999_999, Emin=-999_999)
"""With `ROUND_05UP` a number that has lost digits is never halfway between two times."""
_LONGEST: Final = 1_000
"""The maximum length of a time text, in characters."""
_ISO: Final = re.compile(
    r"""(\d{4})-(\d\d)-(\d\d) [Tt\ ] (\d\d):(\d\d) (?: :(\d\d) (?: [.,](\d+) )? )?
        (?: [Zz] | ([+-]\d\d (?: :?\d\d )?) )?""",
    re.VERBOSE | re.ASCII,
)
_EPOCH: Final = date(1970, 1, 1).toordinal()


def _numeric(size: int, begin: int) -> Callable[[Json], int | None]:
    def read(value: Json) -> int | None:
        if type(value) is int:
            return value * size + begin if abs(value) < _MOST_WHOLE else None
        text = repr(value) if isinstance(value, float) else value
        if not isinstance(text, str) or (text is value and not (len(text) <= _LONGEST and NUMBER.fullmatch(text))):
            return None
        found = _multiplied(text, size)
        return None if found is None else found + begin

    return read


def _iso8601(value: Json) -> int | None:
    found = _ISO.fullmatch(value) if isinstance(value, str) and len(value) <= _LONGEST else None
    if found is None:
        return None
    year, month, day, hour, minute, second = (int(found[number] or 0) for number in range(1, 7))
    try:
        ahead = _ahead(found[8]) if found[8] else 0
        return _instant(date(year, month, day), (hour, minute, second), found[7] or "", ahead)
    except ValueError:
        return None


def _ros(value: Json) -> int | None:
    if isinstance(value, Mapping):
        for whole, part in (("sec", "nanosec"), ("secs", "nsecs")):
            seconds, rest = value.get(whole), value.get(part)
            if type(seconds) is int and type(rest) is int:
                return seconds * UNITS["s"] + rest
    return None


_SIZES: Final[Mapping[TimeFormat, tuple[int, int]]] = {
    TimeFormat.FILETIME: (100, -11_644_473_600 * UNITS["s"]),
    **{form: (UNITS[form.value], 0) for form in TimeFormat if form.value in UNITS},
}
"""The numeric formats: the nanoseconds of a unit, and the time of 0."""
_MOST_WHOLE: Final = 10 ** (_MOST + 1)
_MOST_EXACT: Final = 2.0**52
"""Doubles below it are at most 1 apart."""
_READERS: Final[Mapping[TimeFormat, Callable[[Json], int | None]]] = {
    TimeFormat.ISO8601: _iso8601,
    TimeFormat.ROS: _ros,
    **{form: _numeric(*size) for form, size in _SIZES.items()},
}
assert set(_READERS) == set(TimeFormat)
_SCALARS: Final = frozenset({str, float})


def _read(form: TimeFormat | TextFormat, value: Json) -> int | None:
    return form.read(value) if isinstance(form, TextFormat) else _READERS[form](value)


_remembered: Final = lru_cache(maxsize=4096, typed=True)(_read)
"""As `_read`, because several parts of a monitor read the time of an event."""
