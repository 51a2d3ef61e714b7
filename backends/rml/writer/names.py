"""The words of an RML text: names that RML allows, an injective renaming of those of a tree, and literals.

Event types and variables start with a lower-case ASCII letter, equations with an upper-case one; some words are taken. Facts that every
writer of RML text has to know, not translation: the readers keep their own account of the language.

A number is equal to another of the same value, but the published monitor tells 1 from 1.0: where a literal is an integer both
spellings are written. Its patterns know neither a sign nor an exponent, and no integer beyond 32 bits: such a number stands as
an argument or, larger still, is compared in a `with`.
"""

import re
from decimal import Decimal
from typing import Final

from rvaft.model.values import Scalar, is_number

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
_CHUNK: Final = 10**9


class RmlNames:
    """Gives out names of one kind; no name twice."""

    def __init__(self) -> None:
        self._taken = set(RESERVED)

    def fresh(self, wanted: str, *, otherwise: str = "e") -> str:
        """A new name that resembles the wanted one.

        >>> names = RmlNames()
        >>> names.fresh("Valve 1"), names.fresh("valve_1"), names.fresh("all")
        ('valve_1', 'valve_1_2', 'all_2')
        """
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


def quoted(text: str) -> str:
    """A string or a field name."""
    return f"'{text.translate(_ESCAPES)}'"


def spellings(value: Scalar) -> tuple[str, ...] | None:
    """The spellings of a literal that together match exactly the equal values, or None for an integer beyond 32 bits.

    Those of a negative number can be an argument only, not stand in a pattern.

    >>> spellings(2), spellings(0.5), spellings("two"), spellings(2**31)
    (('2', '2.0'), ('0.5',), ("'two'",), None)
    """
    match value:
        case bool():
            return ("true" if value else "false",)
        case None:
            return ("null",)
        case str():
            return (quoted(value),)
        case _ if value == int(value):
            return (str(int(value)), f"{int(value)}.0") if abs(value) <= LARGEST else None
        case _:
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
