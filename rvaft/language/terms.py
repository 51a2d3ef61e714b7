"""Building patterns and guards bottom-up: nesting is counted while it grows, and slips are raised with their place."""

import json
import math
from dataclasses import dataclass
from typing import Final

from lark import Token

from rvaft.guards import MAX_DEPTH, Guard, Operation, Operator
from rvaft.language.words import shown
from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.values import Scalar

CONSTANTS: Final[dict[str, Scalar]] = {"true": True, "false": False, "null": None}


class Slip(Exception):
    """Something that the grammar allows and the language does not, at a line and a column."""

    def __init__(self, message: str, token: Token) -> None:
        self.message = message
        self.line = token.line or 1
        self.column = token.column or 1
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class PatternTerm:
    """A pattern under construction, how deep it is, and the words in it."""

    pattern: Pattern
    depth: int = 0
    words: tuple[Token, ...] = ()


@dataclass(frozen=True, slots=True)
class GuardTerm:
    """A guard under construction, how deep it is, and whether it is a number written without sign."""

    guard: Guard
    depth: int = 0
    unsigned: bool = False


def text_of(token: Token) -> str:
    """The string that a quoted token stands for; a JSON string."""
    try:
        text: str = json.loads(token)
    except ValueError:
        raise Slip("unknown escape in a string: a backslash is written \\\\", token) from None
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise Slip("half of a surrogate pair in a string: write the whole character", token)
    return text


def number_of(token: Token, *, negative: bool = False) -> int | float:
    """The number that a token stands for: integers exact, the rest finite doubles."""
    try:
        number = int(token) if token.isdigit() else float(token)
    except ValueError:  # Python reads no more digits than sys.get_int_max_str_digits
        raise Slip(f"a number of {len(token)} digits is too long", token) from None
    if not math.isfinite(number):
        raise Slip(f"the number {shown(token)} is too large for a double", token)
    return -number if negative else number


def integer_of(digits: str, token: Token) -> int:
    """A count written in decimal digits."""
    try:
        return int(digits)
    except ValueError:
        raise Slip(f"a number of {len(digits)} digits is too long", token) from None


def _nested(depth: int, what: str, token: Token) -> int:
    if depth >= MAX_DEPTH:
        raise Slip(f"this {what} is nested deeper than {MAX_DEPTH}", token)
    return depth + 1


def object_of(brace: Token, fields: list[tuple[Token, PatternTerm]]) -> PatternTerm:
    """An object pattern."""
    named: dict[str, Pattern] = {}
    for key, inner in fields:
        name = text_of(key) if key.type == "STRING" else str(key)
        if name in named:
            raise Slip(f"the field {shown(name)} stands twice in one object", key)
        named[name] = inner.pattern
    depth = _nested(max((inner.depth for _, inner in fields), default=0), "pattern", brace)
    return PatternTerm(ObjectPattern(tuple(named.items())), depth, _words([inner for _, inner in fields]))


def list_of(bracket: Token, items: list[PatternTerm]) -> PatternTerm:
    """A list pattern."""
    depth = _nested(max((inner.depth for inner in items), default=0), "pattern", bracket)
    return PatternTerm(ListPattern(tuple(inner.pattern for inner in items)), depth, _words(items))


def _words(items: list[PatternTerm]) -> tuple[Token, ...]:
    return tuple(word for inner in items for word in inner.words)


def word_of(word: Token) -> PatternTerm:
    """A variable or parameter in a pattern."""
    return PatternTerm(Variable(str(word)), words=(word,))


def anything() -> PatternTerm:
    """`_`."""
    return PatternTerm(Anything())


def scalar_of(value: Scalar) -> PatternTerm:
    """A literal in a pattern."""
    return PatternTerm(Literal(value))


def operation_of(operator: Operator, operands: list[GuardTerm], token: Token) -> GuardTerm:
    """An operator applied; a minus right before a number belongs to the number."""
    depth = _nested(max(operand.depth for operand in operands), "guard", token)
    if operator is Operator.NEGATE and operands[0].unsigned and isinstance(operands[0].guard, Literal):
        number = operands[0].guard.value
        assert isinstance(number, (int, float))
        return GuardTerm(Literal(-number))
    return GuardTerm(Operation(operator, tuple(operand.guard for operand in operands)), depth)
