"""Names, literals and expressions of RML texts; independent of the reader.

Event types and variables start with a lower-case ASCII letter, equations with an upper-case one.
The renaming of tree names is injective.

Numbers are equal by value, but the published monitor distinguishes 1 from 1.0; an integer literal
is therefore written in both spellings. Its patterns allow neither signs nor exponents, nor integers
beyond 32 bits. Such a number becomes an argument or, if larger, a comparison in a `with`.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Final

from rvaft.model.values import Scalar, is_number

KEYWORDS: Final = frozenset(["not", "matches", "with", "empty", "all", "let", "var", "if", "else"])
FUNCTIONS: Final = frozenset(["abs", "sin", "cos", "tan", "min", "max"])
VALUES: Final = frozenset(["true", "false", "null"])
TYPES: Final = frozenset(["any", "none"])
"""Predefined event types; redeclaring one adds alternatives."""
RESERVED: Final = KEYWORDS | FUNCTIONS | VALUES | TYPES
LARGEST: Final = 2**31 - 1
"""Largest integer that the compiler reads."""
_ESCAPES: Final = str.maketrans({"\\": "\\\\", "'": "\\'", "\n": "\\n", "\t": "\\t", "\r": "\\r"})
_CHUNK: Final = 10**9


class RmlNames:
    """Allocates distinct names of one kind."""

    def __init__(self) -> None:
        self._taken = set(RESERVED)

    def fresh(self, wanted: str, *, otherwise: str = "e") -> str:
        """Return an unused name similar to the wanted one.

        >>> names = RmlNames()
        >>> names.fresh("Valve 1"), names.fresh("valve_1"), names.fresh("all")
        ('valve_1', 'valve_1_2', 'all_2')
        """
        return self.distinct(identifier(wanted, otherwise=otherwise))

    def distinct(self, base: str) -> str:
        """Return the name, numbered if it is taken."""
        name, number = base, 2
        while name in self._taken:
            name, number = f"{base}_{number}", number + 1
        self._taken.add(name)
        return name


def identifier(text: str, *, otherwise: str = "e") -> str:
    """Return a lower-case identifier similar to the text; it may not be unique."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_")
    return plain[0].lower() + plain[1:] if plain and plain[0].isalpha() else f"{otherwise}{plain}"


def applied(name: str, arguments: Sequence[str]) -> str:
    """Return an event type with its arguments, if any."""
    return f"{name}({', '.join(arguments)})" if arguments else name


def quoted(text: str) -> str:
    """Return a string or field name in quotes."""
    return f"'{text.translate(_ESCAPES)}'"


def spellings(value: Scalar) -> tuple[str, ...] | None:
    """Return the literals that together match exactly the values equal to `value`; None for large
    integers.

    Negative numbers are allowed as arguments only.

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
    """Return whether the literal is allowed in a pattern."""
    return not is_number(value) or (value >= 0 and spellings(value) is not None)  # type: ignore[operator]


def in_arithmetic(value: int | float) -> str:
    """Return a number in an arithmetic expression; integers stay exact."""
    if value < 0:
        return f"(-{in_arithmetic(-value)})"
    if isinstance(value, float):
        return _decimal(value)
    return str(value) if value <= LARGEST else f"(({in_arithmetic(value // _CHUNK)} * {_CHUNK}) + {value % _CHUNK})"


def _decimal(value: float) -> str:
    text = format(Decimal(repr(float(value))), "f")
    return text if "." in text else f"{text}.0"


# Expressions, built bottom-up; a deep expression (`depth`) needs its own equation.

MAX_DEPTH: Final = 24
MAX_PARTS: Final = 60
THEN, OR, AND, SHUFFLE = " ", " \\/ ", " /\\ ", " | "
_TOKEN: Final = re.compile(r"'(?:[^'\\]|\\.)*'|[0-9]+\.[0-9]+|\w+|>>|\\/|/\\|\S", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Written:
    """An expression; `operator` joins the parts, or is a postfix sign, `>>` or `let`; empty for a
    name.
    """

    operator: str
    parts: tuple["Written", ...] = ()
    word: str = ""
    """The name, the event type of a filter, or the variables of a block."""
    depth: int = field(default=0, compare=False)

    def __str__(self) -> str:
        match self.operator:
            case "":
                return self.word
            case ">>":
                return f"{self.word} >> {self.parts[0].inner}"
            case "let":
                return f"{{ let {self.word}; {self.parts[0]} }}"
            case "*" | "?":
                return f"{self.parts[0].inner}{self.operator}"
            case _:
                return self.operator.join(part.inner for part in self.parts)

    @property
    def inner(self) -> str:
        """The text as a part of another expression, in parentheses unless it is atomic."""
        return str(self) if self.operator in ("", "let", "*", "?") else f"({self})"

    @property
    def is_large(self) -> bool:
        """Whether the expression is deep or long."""
        return self.depth >= MAX_DEPTH or (self.operator == THEN and len(self.parts) >= MAX_PARTS)


def named(name: str) -> Written:
    """Return an applied event type, an equation name, or `all` as an expression."""
    return Written("", word=name)


ALL: Final = named("all")
ANY: Final = named("any")
NONE: Final = named("none")


def join(operator: str, parts: Iterable[Written]) -> Written:
    """Return the parts joined; nested joins of the same operator are flattened.

    >>> print(join(THEN, [named("a"), join(SHUFFLE, [named("b"), named("c")]), join(THEN, [ANY, ALL])]))
    a (b | c) any all
    """
    flat: list[Written] = []
    for part in parts:
        fits = part.operator == operator and len(part.parts) + len(flat) <= MAX_PARTS
        flat.extend(part.parts if fits else (part,))
    while len(flat) > MAX_PARTS:  # all four are associative, including left preference
        flat = [join(operator, flat[start : start + MAX_PARTS]) for start in range(0, len(flat), MAX_PARTS)]
    return flat[0] if len(flat) == 1 else Written(operator, tuple(flat), depth=1 + max(part.depth for part in flat))


def then(*parts: Written) -> Written:
    """Return the sequence of the parts."""
    return join(THEN, parts)


def around(part: Written, operator: str, word: str = "") -> Written:
    """Return the part with `*` or `?`, behind a filter (`>>`) or in a block (`let`)."""
    return Written(operator, (part,), word, part.depth + 1)


def symbols(text: str) -> int:
    """Return the number of tokens of an RML text without comments."""
    return sum(1 for _ in _TOKEN.finditer(text))
