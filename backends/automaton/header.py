"""What the propositions of a HOA text mean: its lower-case header lines (see `hoa`), read back."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from rvaft.errors import LanguageError
from rvaft.guards import Guard, holds, variables
from rvaft.language import parse_guard, parse_pattern
from rvaft.patterns import Anything, ObjectPattern, Pattern, match
from rvaft.values import Json

_TOKEN: Final = re.compile(
    r'(?P<string>"(?:\\.|[^"\\])*")|(?P<comment>/\*.*?\*/)|(?P<name>[A-Za-z_][\w-]*:)|(?P<end>--BODY--)|(?P<word>[^\s"]+)',
    re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class Fit:
    """A pattern and a guard on it, which an event fits or not for some values of the variables."""

    pattern: Pattern
    guard: Guard | None

    def fits(self, event: Json) -> bool:
        """Whether the event matches and the guard, if any, holds."""
        bound = match(self.pattern, event, {})
        if bound is None or self.guard is None:
            return bound is not None
        return bound.keys() >= set(variables(self.guard)) and holds(self.guard, bound)  # else it has no value


@dataclass(frozen=True, slots=True)
class Meaning:
    """What the header says: by number of a proposition its event or guard, and what makes an event relevant."""

    events: dict[int, Pattern] = field(default_factory=dict)
    guards: dict[int, Guard] = field(default_factory=dict)
    relevant: set[int] = field(default_factory=set)
    alphabet: list[Fit] = field(default_factory=list)
    ignored: list[Fit] = field(default_factory=list)

    def is_relevant(self, event: Json) -> bool:
        """Whether an event fits a line of the alphabet and none to ignore."""
        return any(fit.fits(event) for fit in self.alphabet) and not any(fit.fits(event) for fit in self.ignored)


@dataclass(frozen=True, slots=True)
class _Line:
    """A header line: its name, its values, where it stands in the text."""

    name: str
    values: list[str]
    position: int


def meaning(text: str) -> Meaning:
    """The meaning that a text gives to its propositions; raises `LanguageError`."""
    found = Meaning()
    for line in _lines(text):
        match line.name:
            case "event:":
                first, pattern = _values(text, line, "a number and a pattern in quotes", 2)
                number = _number(text, line, first)
                found.events[number] = _pattern(text, line, pattern)
            case "guard:":
                first, guard = _values(text, line, "a number and a guard in quotes", 2)
                number = _number(text, line, first)
                found.guards[number] = _guard(text, line, guard)
            case "relevant:":
                (first,) = _values(text, line, "a number", 1)
                found.relevant.add(_number(text, line, first))
            case "alphabet:":
                found.alphabet.append(_fit(text, line))
            case "ignore:":
                found.ignored.append(_fit(text, line))
            case _:
                pass
    return found


def _lines(text: str) -> Iterator[_Line]:
    """The header lines, comments left out."""
    line: _Line | None = None
    for token in _TOKEN.finditer(text):
        match token.lastgroup:
            case "end":
                break
            case "name":
                if line is not None:
                    yield line
                line = _Line(token.group(), [], token.start())
            case "string" | "word":
                if line is not None:
                    line.values.append(token.group())
            case _:
                pass
    if line is not None:
        yield line


def _fit(text: str, line: _Line) -> Fit:
    if len(line.values) == 1:
        return Fit(_pattern(text, line, line.values[0]), None)
    pattern, guard = _values(text, line, "a pattern in quotes, and a guard in quotes where there is one", 2)
    return Fit(_pattern(text, line, pattern), _guard(text, line, guard))


def _values(text: str, line: _Line, expected: str, many: int) -> list[str]:
    if len(line.values) != many:
        raise error_at(text, line.position, f"{line.name} expects {expected}")
    return line.values


def _number(text: str, line: _Line, value: str) -> int:
    if not (value.isascii() and value.isdigit()):
        raise error_at(text, line.position, f"{line.name} expects the number of a proposition, not {value}")
    return int(value)


def _string(text: str, line: _Line, value: str) -> str:
    if not value.startswith('"'):
        raise error_at(text, line.position, f"{line.name} expects quotes around {value}")
    return re.sub(r"\\(.)", r"\1", value[1:-1], flags=re.DOTALL)


def _pattern(text: str, line: _Line, value: str) -> Pattern:
    try:
        pattern = parse_pattern(_string(text, line, value))
    except LanguageError as error:
        raise error_at(text, line.position, error.message) from None
    if not isinstance(pattern, ObjectPattern | Anything):
        raise error_at(text, line.position, "an event is an object: expected a pattern such as { field: 1 }, or _")
    return pattern


def _guard(text: str, line: _Line, value: str) -> Guard:
    try:
        return parse_guard(_string(text, line, value))
    except LanguageError as error:
        raise error_at(text, line.position, error.message) from None


def error_at(text: str, position: int, message: str) -> LanguageError:
    """The error for a place in a HOA text."""
    before = text[:position]
    number = before.count("\n") + 1
    column = position - (before.rfind("\n") + 1) + 1
    source = text.split("\n")[number - 1].rstrip("\r")
    return LanguageError(message, file="<hoa>", line=number, column=column, source=source)
