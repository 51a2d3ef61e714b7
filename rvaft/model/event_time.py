"""The time of an event (semantics, section 1.1): its field and its formats.

A time is an integer in nanoseconds. Decimals are read exactly and rounded, half to even; a double
is read as its shortest decimal.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from dataclasses import field as part
from datetime import date
from decimal import ROUND_HALF_EVEN, Context, Decimal, DecimalException
from enum import StrEnum
from typing import Final

from rvaft.errors import OptionError
from rvaft.model.nodes import Place
from rvaft.model.values import NUMBER, Json, at


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


@dataclass(frozen=True, slots=True)
class EventTime:
    """`time FIELD as FORMAT [late DURATION];`.

    `field` is the path to the field, `late` the allowed lateness in nanoseconds.

    >>> import rvaft
    >>> rvaft.loads("time header.stamp as ros late 2 s; top and a b;").time
    EventTime(field=('header', 'stamp'), format=<TimeFormat.ROS: 'ros'>, late=2000000000)
    """

    field: tuple[str, ...]
    format: TimeFormat
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
        return _READERS[self.format](at(event, self.field))

    def reads(self, value: Json) -> bool:
        """Whether a value of the time field can be read."""
        return _READERS[self.format](value) is not None

    def is_late(self, event: Json, latest: int | None) -> tuple[bool, int | None]:
        """Return whether an event is late, and the new maximum time.

        `latest` is the maximum time of the events before.

        >>> EventTime(("ts",), TimeFormat.SECONDS, late=0).is_late({"ts": 2}, 3_000_000_000)
        (True, 3000000000)
        """
        time = None if self.late is None else self.read(event)
        if time is None or latest is None:
            return False, latest if time is None else time
        return latest - time > (self.late or 0), max(latest, time)

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
    try:
        value = _EXACT.create_decimal(number)
        if not value or value.adjusted() < -40:
            return 0
        if not value.is_finite() or value.adjusted() > _MOST:
            return None
        return int(_EXACT.multiply(value, Decimal(UNITS[unit])).to_integral_value(ROUND_HALF_EVEN, _EXACT))
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


_MOST: Final = 30
"""The maximum power of ten of a time in any unit."""
_EXACT: Final = Context(prec=5_000, Emax=999_999, Emin=-999_999)
_LONGEST: Final = 1_000
"""The maximum length of a time text, in characters."""
_ISO: Final = re.compile(
    r"""(\d{4})-(\d\d)-(\d\d) [Tt\ ] (\d\d):(\d\d) (?: :(\d\d) (?: [.,](\d+) )? )?
        (?: [Zz] | ([+-])(\d\d) (?: :?(\d\d) )? )?""",
    re.VERBOSE | re.ASCII,
)
_EPOCH: Final = date(1970, 1, 1).toordinal()


def _numeric(unit: str) -> Callable[[Json], int | None]:
    def read(value: Json) -> int | None:
        if type(value) is int:
            return value * UNITS[unit] if abs(value) < 10 ** (_MOST + 1) else None
        if isinstance(value, float):
            return scaled(repr(value), unit)
        if isinstance(value, str) and len(value) <= _LONGEST and NUMBER.fullmatch(value):
            return scaled(value, unit)
        return None

    return read


def _iso8601(value: Json) -> int | None:
    found = _ISO.fullmatch(value) if isinstance(value, str) and len(value) <= _LONGEST else None
    if found is None:
        return None
    year, month, day, hour, minute, second = (int(found[number] or 0) for number in range(1, 7))
    ahead = (int(found[9] or 0) * 60 + int(found[10] or 0)) * (-1 if found[8] == "-" else 1)
    in_range = hour < 24 and minute < 60 and second <= 60 and int(found[9] or 0) < 24 and int(found[10] or 0) < 60
    try:
        days = date(year, month, day).toordinal() - _EPOCH
    except ValueError:
        return None
    whole = ((days * 24 + hour) * 60 + minute - ahead) * 60 + second
    part = scaled(f"0.{found[7]}", "s") if found[7] else 0
    return whole * UNITS["s"] + part if in_range and part is not None else None


def _ros(value: Json) -> int | None:
    if isinstance(value, Mapping):
        for whole, part in (("sec", "nanosec"), ("secs", "nsecs")):
            seconds, rest = value.get(whole), value.get(part)
            if type(seconds) is int and type(rest) is int:
                return seconds * UNITS["s"] + rest
    return None


_READERS: Final[Mapping[TimeFormat, Callable[[Json], int | None]]] = {
    TimeFormat.ISO8601: _iso8601,
    TimeFormat.ROS: _ros,
    **{form: _numeric(form.value) for form in TimeFormat if form.value in UNITS},
}
assert set(_READERS) == set(TimeFormat)
