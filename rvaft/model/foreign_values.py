"""Values of NumPy, pandas and the standard library in events, as JSON values."""

from collections.abc import Mapping
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from enum import Enum
from typing import Any, Final

from rvaft.errors import WrongType
from rvaft.model.values import Exact, Json, JsonObject, decimal

SCALARS: Final = frozenset({str, int, float, bool, type(None), Exact})
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

        >>> from decimal import Decimal
    from enum import Enum
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
