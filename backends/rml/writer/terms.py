"""RML expressions as they are written, and their text.

They are built bottom-up; `depth` is known at once, so that whoever builds them can put a deep one into an equation of its own
and nothing here ever recurses far. Everything that is not a single name is put into parentheses.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

MAX_DEPTH: Final = 24
MAX_PARTS: Final = 60
THEN: Final = " "
OR: Final = " \\/ "
AND: Final = " /\\ "
SHUFFLE: Final = " | "


@dataclass(frozen=True, slots=True)
class Written:
    """An expression. `operator` is what joins its parts, the sign behind its only part, `>>` or `let`; a name has none."""

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
        """The text as a part of another one."""
        return str(self) if self.operator in ("", "let", "*", "?") else f"({self})"


def named(name: str) -> Written:
    """An event type applied to arguments, an equation, or `all`, as it is written."""
    return Written("", word=name)


ALL: Final = named("all")
ANY: Final = named("any")
NONE: Final = named("none")


def join(operator: str, parts: Iterable[Written]) -> Written:
    """The parts joined, nested joins of the same operator made one; a single part stays as it is.

    >>> print(join(THEN, [named("a"), join(SHUFFLE, [named("b"), named("c")]), join(THEN, [ANY, ALL])]))
    a (b | c) any all
    """
    flat: list[Written] = []
    for part in parts:
        fits = part.operator == operator and len(part.parts) + len(flat) <= MAX_PARTS
        flat.extend(part.parts if fits else (part,))
    while len(flat) > MAX_PARTS:  # all four are associative, left preference included
        groups = [flat[start : start + MAX_PARTS] for start in range(0, len(flat), MAX_PARTS)]
        flat = [join(operator, group) for group in groups]
    return flat[0] if len(flat) == 1 else Written(operator, tuple(flat), depth=1 + max(part.depth for part in flat))


def then(*parts: Written) -> Written:
    """One after the other."""
    return join(THEN, parts)


def around(part: Written, operator: str, word: str = "") -> Written:
    """The part repeated (`*`), optional (`?`), behind a filter (`>>`) or in a block (`let`)."""
    return Written(operator, (part,), word, part.depth + 1)


_TOKEN: Final = re.compile(r"'(?:[^'\\]|\\.)*'|[0-9]+\.[0-9]+|\w+|>>|\\/|/\\|\S", re.DOTALL)


def symbols(text: str) -> int:
    """The number of tokens of an RML text without comments."""
    return sum(1 for _ in _TOKEN.finditer(text))


@dataclass(slots=True)
class Equations:
    """Equations under construction, each a name and an expression."""

    made: list[tuple[str, Written]] = field(default_factory=list)

    def called(self, term: Written) -> Written:
        """A new equation for the expression; its name."""
        self.made.append((f"P{len(self.made) + 1}", term))
        return named(self.made[-1][0])

    def shallow(self, term: Written) -> Written:
        """The expression, or, where it is deep or long, the name of an equation for it."""
        long = term.operator == THEN and len(term.parts) >= MAX_PARTS
        return self.called(term) if term.depth >= MAX_DEPTH or long else term
