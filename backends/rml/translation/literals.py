"""Literals, field names and patterns as RML text.

A number is equal to another of the same value, but the published monitor tells 1 from 1.0: where a literal is an integer both
spellings are written. Its patterns know neither a sign nor an exponent, and no integer beyond 32 bits: such a number stands as
an argument (`Spelling.argument`) or, larger still, is compared in a `with`.
"""

from decimal import Decimal
from typing import Final

from backends.rml.words import LARGEST, quoted
from rvaft.values import Scalar, is_number

_CHUNK: Final = 10**9


def spellings(value: Scalar) -> tuple[str, ...] | None:
    """The spellings of a literal that together match exactly the equal values, or None for an integer beyond 32 bits.

    Those of a negative number can be an argument only, not stand in a pattern.
    """
    if isinstance(value, bool):
        return ("true" if value else "false",)
    if value is None:
        return ("null",)
    if isinstance(value, str):
        return (quoted(value),)
    if value == int(value):
        whole = int(value)
        return (str(whole), f"{whole}.0") if abs(whole) <= LARGEST else None
    return (_decimal(value),)


def in_patterns(value: Scalar) -> bool:
    """Whether the literal can stand in a pattern."""
    return not is_number(value) or (value >= 0 and spellings(value) is not None)  # type: ignore[operator]


def in_arithmetic(value: int | float) -> str:
    """A number in an arithmetic expression; integers stay exact."""
    if value < 0:
        return f"(-{in_arithmetic(-value)})"
    if isinstance(value, float):
        return _decimal(value)
    if value <= LARGEST:
        return str(value)
    return f"(({in_arithmetic(value // _CHUNK)} * {_CHUNK}) + {value % _CHUNK})"


def _decimal(value: float) -> str:
    text = format(Decimal(repr(float(value))), "f")
    return text if "." in text else f"{text}.0"
