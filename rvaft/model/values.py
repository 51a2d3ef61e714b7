"""JSON values: equality by mathematical value, and hashable keys.

Python's `==` is unsuitable, because `True == 1`. Functions do not recurse, so values may be nested
arbitrarily deep.
"""

import json
import math
import re
from collections.abc import Hashable, Iterable, Mapping
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from enum import Enum
from typing import Any, Final, TypeAlias

from rvaft.errors import WrongType

NUMBER: Final = re.compile(r"-?(?:0|[1-9][0-9]*)(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?", re.ASCII)
Json: TypeAlias = Any
JsonObject: TypeAlias = Mapping[str, Json]
"""Every event is a JSON object."""
Scalar: TypeAlias = str | int | float | bool | None
EXACT_INTEGERS: Final = 2**53
"""Integers below it, and their differences, are doubles without rounding."""
LONG: Final = 16
"""A decimal with fewer characters is the shortest one of its double."""
_PLAIN: Final = (str, int, float, bool, type(None))
KEYS: Final = (str, int, float)
"""The types of which a value is its own `key`, unless it is NaN."""
OWN_TYPES: Final = frozenset({str, int})
"""The types of which two values of one type are equal exactly if they are so in Python."""


class Exact(float):
    """A number with more digits than a double; its `repr` is the original text."""

    __slots__ = ("written",)
    written: str

    def __repr__(self) -> str:
        return self.written


def decimal(written: str) -> float:
    """Return the number that a JSON text with a point or an exponent denotes.

    >>> decimal("1772438400.123456789"), decimal("1772438400.123456789") + 1, decimal("2.50")
    (1772438400.123456789, 1772438401.1234567, 2.5)
    """
    number = float(written)
    if len(written) < LONG or repr(number) == written or number - number != 0:
        return number
    exact = Exact(number)
    exact.written = written
    return exact


def finite_decimal(written: str) -> float:
    """As `decimal`; raises `ValueError` for a number beyond a double, which decoders pass on.

    >>> finite_decimal("1e999")
    Traceback (most recent call last):
    ValueError: beyond a double
    """
    number = float(written)
    if number - number != 0:
        raise ValueError("beyond a double")
    return number if len(written) < LONG else decimal(written)


def at(value: Json, path: Iterable[str], missing: Json = None) -> Json:
    """Return the value at a path of fields, or `missing`.

    >>> at({"header": {"stamp": 7}}, ["header", "stamp"]), at({"header": 7}, ["header", "stamp"])
    (7, None)
    """
    for name in path:
        if not isinstance(value, Mapping) or name not in value:
            return missing
        value = value[name]
    return value


def is_number(value: Json) -> bool:
    """Whether a value is a JSON number; a boolean is not."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_finite(value: Json) -> bool:
    """Whether a value contains neither NaN nor an infinity.

    >>> is_finite({"a": [1.5]}), is_finite([float("nan")])
    (True, False)
    """
    if type(value) in _PLAIN:  # the most frequent case
        return type(value) is not float or math.isfinite(value)
    todo = [value]
    while todo:
        part = todo.pop()
        if type(part) in _PLAIN:
            if type(part) is float and not math.isfinite(part):
                return False
        elif isinstance(part, Mapping):
            todo.extend(part.values())
        elif isinstance(part, (list, tuple)):
            todo.extend(part)
        elif isinstance(part, float) and part - part != 0:
            return False
    return True


def has_larger(value: Json, bits: int, *, doubles: bool = False) -> bool:
    """Whether a value contains an integer that needs more than `bits` bits with its sign.

    `doubles` includes doubles.

    >>> has_larger({"id": 2**63 - 1}, 64), has_larger([2**63], 64)
    (False, True)
    >>> has_larger(1e20, 64), has_larger(1e20, 64, doubles=True)
    (False, True)
    """
    todo = [value]
    while todo:
        part = todo.pop()
        if isinstance(part, Mapping):
            todo.extend(part.values())
        elif isinstance(part, list):
            todo.extend(part)
        elif (isinstance(part, int) and part.bit_length() >= bits) or (
            doubles and isinstance(part, float) and abs(part) >= 1 << bits - 1
        ):
            return True
    return False


def finite(value: Json) -> Json:
    """Return the value with null instead of non-finite numbers.

    >>> finite({"a": [float("inf"), 1]})
    {'a': [None, 1]}
    """
    return value if is_finite(value) else json.loads(json.dumps(value), parse_constant=lambda _: None)


def equal(left: Json, right: Json) -> bool:
    """Whether two values are equal, deeply; booleans differ from numbers."""
    todo = [(left, right)]
    while todo:
        a, b = todo.pop()
        if is_number(a):
            if not (is_number(b) and a == b and a - a == 0):  # a non-finite number equals nothing
                return False
        elif isinstance(a, Mapping):
            if not (isinstance(b, Mapping) and a.keys() == b.keys()):
                return False
            todo.extend((a[key], b[key]) for key in a)
        elif isinstance(a, list):
            if not (isinstance(b, list) and len(a) == len(b)):
                return False
            todo.extend(zip(a, b, strict=True))
        elif type(a) is not type(b) or a != b:
            return False
    return True


def key(value: Json) -> Hashable:
    """Return a hashable key; two values are `equal` if and only if their keys are."""
    return _flattened(value, exactly=False)


def _flattened(value: Json, *, exactly: bool) -> Hashable:
    out: list[Hashable] = []
    todo: list[Json] = [value]
    while todo:
        v = todo.pop()
        if isinstance(v, Mapping):
            names = sorted(v)
            out.append(("{", tuple(names)))
            todo.extend(v[name] for name in names)
        elif isinstance(v, list):
            out.append(("[", len(v)))
            todo.extend(v)
        elif isinstance(v, bool) or v is None:
            out.append(("=", repr(v)))
        # non-finite numbers equal nothing, but are indistinguishable
        elif v - v != 0 if isinstance(v, float) else False:
            out.append("undefined" if exactly else object())
        else:
            out.append(v)
    return out[0] if len(out) == 1 else tuple(out)


def exact(value: Json) -> Hashable:
    """Return a hashable key that is equal for indistinguishable values, undefined ones included.

    >>> exact(1) == exact(1.0), exact(1) == exact(True), exact([math.nan]) == exact([math.nan])
    (True, False, True)
    """
    return value if type(value) in KEYS and value == value else _flattened(value, exactly=True)  # noqa: PLR0124


def fingerprint(binding: Mapping[str, Json]) -> frozenset[tuple[str, Hashable]]:
    """Return the binding as a hashable set of `exact` keys."""
    return frozenset((name, exact(value)) for name, value in binding.items())


def has_surrogate(text: str) -> bool:
    r"""Whether a text has an unpaired surrogate, which UTF-8 cannot encode.

    >>> has_surrogate("a\ud800"), has_surrogate("a")
    (True, False)
    """
    return any("\ud800" <= character <= "\udfff" for character in text)


SCALARS: Final = frozenset({*_PLAIN, Exact})
"""The types of JSON values that contain no other value."""
_EXPECTED: Final = "a value of JSON (str, int, float, bool, None, list or dict), or of NumPy or pandas"
_NONE: Final = frozenset({"NAType", "NaTType"})
"""The types of the missing values of pandas."""


def as_json(event: JsonObject) -> JsonObject:
    """Return an event with JSON values: the event itself, or a copy in which other values are converted.

    Numbers, texts and arrays of NumPy and pandas, `Decimal`, tuples, and members of enumerations of
    texts or numbers become JSON values. As in logs in Parquet, dates and instants become texts in
    ISO 8601, and durations nanoseconds. Missing values become null. Raises `WrongType` for a value of
    another type.

    >>> as_json({"x": Decimal("2.5"), "at": date(2026, 1, 2), "list": (1, 2)})
    {'x': 2.5, 'at': '2026-01-02', 'list': [1, 2]}
    """
    return event if _is_json(event) else {name: _converted(value, str(name)) for name, value in event.items()}


def _is_json(event: JsonObject) -> bool:
    agenda: list[Any] = [event.values()]
    while agenda:
        values = agenda.pop()
        if not SCALARS.issuperset(map(type, values)):
            for value in values:
                kind = type(value)
                if kind is dict:
                    agenda.append(value.values())
                elif kind is list:
                    agenda.append(value)
                elif kind not in SCALARS:
                    return False
    return True


def _converted(value: Any, path: str) -> Json:
    kind = type(value)
    if kind in SCALARS:
        return value
    if isinstance(value, Mapping):
        return {name: _converted(part, f"{path}.{name}") for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_converted(part, f"{path}[{place}]") for place, part in enumerate(value)]
    if kind.__name__ in _NONE:
        return None
    if kind.__module__.split(".")[0] == "numpy":
        if kind.__name__ not in ("datetime64", "timedelta64"):
            return _converted(value.tolist(), path)
        if str(value) == "NaT":
            return None
        return str(value) if kind.__name__ == "datetime64" else int(value / value.__class__(1, "ns"))
    if isinstance(value, datetime):
        return value.isoformat() if value.tzinfo is None else value.astimezone(UTC).isoformat().replace("+00:00", "Z")
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, timedelta):
        return value // timedelta(microseconds=1) * 1_000 + getattr(value, "nanoseconds", 0)
    if isinstance(value, Decimal) and value.is_finite():
        return int(value) if value == value.to_integral_value() else decimal(f"{value:f}")
    plain = next((plain for plain in (str, int, float) if isinstance(value, plain)), None)
    if plain is None:
        raise WrongType(f"the value of {path}", value, _EXPECTED)
    return plain(value.value if isinstance(value, Enum) else value)
