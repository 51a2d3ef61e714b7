"""Names that RML allows: an injective renaming of the names of a tree.

Event types and variables start with a lower-case ASCII letter, equations with an upper-case one; some words are taken.
"""

import re
from decimal import Decimal
from typing import Final

from rvaft.model.values import Scalar, is_number

# What every writer of RML text has to know of the language: words that no name may be, strings, the largest integer.
#
# Facts, not translation: the readers keep their own account of the language.

KEYWORDS: Final = frozenset(["not", "matches", "with", "empty", "all", "let", "var", "if", "else"])
FUNCTIONS: Final = frozenset(["abs", "sin", "cos", "tan", "min", "max"])
VALUES: Final = frozenset(["true", "false", "null"])
TYPES: Final = frozenset(["any", "none"])
"""Event types that the compiler declares itself; to declare one again widens it."""
RESERVED: Final = KEYWORDS | FUNCTIONS | VALUES | TYPES
"""The words that no name may be."""
LARGEST: Final = 2**31 - 1
"""The largest integer that the compiler reads."""
_ESCAPES: Final = str.maketrans({"\\": "\\\\", "'": "\\'", "\n": "\\n", "\t": "\\t", "\r": "\\r"})


def quoted(text: str) -> str:
    """A string or a field name."""
    return f"'{text.translate(_ESCAPES)}'"


class Names:
    """Gives out names of one kind; no name twice."""

    def __init__(self, *taken: str) -> None:
        self._taken = {*RESERVED, *taken}

    def fresh(self, wanted: str, *, otherwise: str = "e") -> str:
        """A new name that resembles the wanted one."""
        base = identifier(wanted, otherwise=otherwise)
        name, number = base, 2
        while name in self._taken:
            name, number = f"{base}_{number}", number + 1
        self._taken.add(name)
        return name


def identifier(text: str, *, otherwise: str = "e") -> str:
    """A lower-case identifier that resembles the text; different texts may give the same one."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_")
    if not plain:
        return otherwise
    return plain[0].lower() + plain[1:] if plain[0].isalpha() else f"{otherwise}{plain}"


# Literals, field names and patterns as RML text.
#
# A number is equal to another of the same value, but the published monitor tells 1 from 1.0: where a literal is an integer both
# spellings are written. Its patterns know neither a sign nor an exponent, and no integer beyond 32 bits: such a number stands as
# an argument (`Spelling.argument`) or, larger still, is compared in a `with`.

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
