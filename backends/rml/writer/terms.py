"""RML expressions as a term, and their text.

Terms are built bottom-up; `depth` is known at once, so that whoever builds them can put a deep one into an equation of its own
and nothing here ever recurses far. Everything that is not a single name is put into parentheses.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, assert_never

MAX_DEPTH: Final = 24
MAX_PARTS: Final = 60


class Operator(Enum):
    """How parts are put together; the value is what stands between them."""

    THEN = " "
    OR = " \\/ "
    AND = " /\\ "
    SHUFFLE = " | "


@dataclass(frozen=True, slots=True)
class Name:
    """An event type applied to arguments, an equation, or `all`, as it is written."""

    text: str
    depth: int = 0


@dataclass(frozen=True, slots=True)
class Join:
    """Two parts or more."""

    operator: Operator
    parts: tuple["Term", ...]
    depth: int = field(compare=False)


@dataclass(frozen=True, slots=True)
class Postfix:
    """A part repeated: `*` or `?`."""

    part: "Term"
    sign: str
    depth: int = field(compare=False)


@dataclass(frozen=True, slots=True)
class Filter:
    """`event type >> body`."""

    event: str
    body: "Term"
    depth: int = field(compare=False)


@dataclass(frozen=True, slots=True)
class Let:
    """`{ let variables; body }`."""

    variables: tuple[str, ...]
    body: "Term"
    depth: int = field(compare=False)


Term = Name | Join | Postfix | Filter | Let

ALL: Final = Name("all")
ANY: Final = Name("any")
NONE: Final = Name("none")


def join(operator: Operator, parts: Iterable[Term]) -> Term:
    """The parts joined, nested joins of the same operator made one; a single part stays as it is."""
    flat: list[Term] = []
    for part in parts:
        if isinstance(part, Join) and part.operator is operator and len(part.parts) + len(flat) <= MAX_PARTS:
            flat.extend(part.parts)
        else:
            flat.append(part)
    while len(flat) > MAX_PARTS:  # all four are associative, left preference included
        groups = [flat[start : start + MAX_PARTS] for start in range(0, len(flat), MAX_PARTS)]
        flat = [join(operator, group) for group in groups]
    if len(flat) == 1:
        return flat[0]
    return Join(operator, tuple(flat), 1 + max(part.depth for part in flat))


def then(*parts: Term) -> Term:
    """One after the other."""
    return join(Operator.THEN, parts)


def either(parts: Iterable[Term]) -> Term:
    """The first that can take the event."""
    return join(Operator.OR, parts)


def both(parts: Iterable[Term]) -> Term:
    """All at once."""
    return join(Operator.AND, parts)


def shuffle(parts: Iterable[Term]) -> Term:
    """In any order."""
    return join(Operator.SHUFFLE, parts)


def star(part: Term) -> Term:
    """Any number of times."""
    return Postfix(part, "*", part.depth + 1)


def optional(part: Term) -> Term:
    """Once or not at all."""
    return Postfix(part, "?", part.depth + 1)


def filtered(event: str, body: Term) -> Term:
    """The body, looking only at events of the type."""
    return Filter(event, body, body.depth + 1)


def let(variables: tuple[str, ...], body: Term) -> Term:
    """The body with variables, or just the body where there are none."""
    return Let(variables, body, body.depth + 1) if variables else body


def written(term: Term) -> str:
    """The text of a term."""
    match term:
        case Name(text):
            return text
        case Join(operator, parts):
            return operator.value.join(_inner(part) for part in parts)
        case Postfix(part, sign):
            return f"{_inner(part)}{sign}"
        case Filter(event, body):
            return f"{event} >> {_inner(body)}"
        case Let(variables, body):
            return f"{{ let {', '.join(variables)}; {written(body)} }}"
        case _:
            assert_never(term)


def _inner(term: Term) -> str:
    return written(term) if isinstance(term, Name | Let | Postfix) else f"({written(term)})"


_TOKEN: Final = re.compile(r"'(?:[^'\\]|\\.)*'|[0-9]+\.[0-9]+|\w+|>>|\\/|/\\|\S", re.DOTALL)


def symbols(text: str) -> int:
    """The number of tokens of an RML text without comments."""
    return sum(1 for _ in _TOKEN.finditer(text))


@dataclass(slots=True)
class Equations:
    """Equations under construction, each a name and a term."""

    prefix: str
    made: list[tuple[str, Term]] = field(default_factory=list)

    def named(self, term: Term) -> Term:
        """A new equation for the term; its name."""
        self.made.append((f"{self.prefix}{len(self.made) + 1}", term))
        return Name(self.made[-1][0])

    def shallow(self, term: Term) -> Term:
        """The term, or, where it is deep, the name of an equation for it."""
        return self.named(term) if term.depth >= MAX_DEPTH or _long(term) else term


def _long(term: Term) -> bool:
    return isinstance(term, Join) and term.operator is Operator.THEN and len(term.parts) >= MAX_PARTS
