"""The leading comment of a text: what each atom is, and the shared subformulas.

Lines, one each:

    atom NAME := PATTERN when GUARD when GUARD      an event under guards, each true while one of its variables is unbound
    relevant NAME := PATTERN when GUARD             several lines: events that fit one of them, for some values of the variables,
    ignored NAME := PATTERN when GUARD              and none of these
    NAME := FORMULA                                 a shared subformula, of atoms and of what was defined above

Patterns and guards are written as in the language of trees. The comment starts with `/* rvaft`; any other comment is just that.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from rvaft.errors import LanguageError
from rvaft.guards import Guard
from rvaft.language import guard_text, parse_guard, parse_pattern, pattern_text
from rvaft.patterns import Anything, ObjectPattern, Pattern

OPENING: Final = "/* rvaft"
CLOSING: Final = "*/"
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_LINE: Final = re.compile(r"\s*(?:(atom|relevant|ignored)\s+)?([a-z_][a-z0-9_]*)\s*:=\s*(.*\S)\s*")
_STRING_OR_WHEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]]|(?<!\w)when(?!\w)')


@dataclass(frozen=True, slots=True)
class Observation:
    """An event pattern under guards."""

    pattern: Pattern
    guards: tuple[Guard, ...] = ()

    def __str__(self) -> str:
        whens = "".join(f" when {guard_text(guard)}" for guard in self.guards)
        return _STRING.sub(_without_comment_signs, pattern_text(self.pattern) + whens)


def _without_comment_signs(string: re.Match[str]) -> str:
    return string.group().replace("*/", "*\\u002f").replace("/*", "\\u002f*")


@dataclass(slots=True)
class Header:
    """What a leading comment says."""

    atoms: dict[str, Observation] = field(default_factory=dict)
    relevant: dict[str, list[Observation]] = field(default_factory=dict)
    ignored: dict[str, list[Observation]] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    places: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Of each definition the line and column of its formula."""

    def __str__(self) -> str:
        lines = [OPENING]
        lines += [f"atom {name} := {observation}" for name, observation in self.atoms.items()]
        lines += [f"relevant {name} := {entry}" for name, entries in self.relevant.items() for entry in entries]
        lines += [f"ignored {name} := {entry}" for name, entries in self.ignored.items() for entry in entries]
        lines += [f"{name} := {formula}" for name, formula in self.definitions.items()]
        return "\n".join([*lines, CLOSING]) + "\n"


def split(text: str) -> tuple[Header, str]:
    """The header of a text (empty where it has none) and the text with the header blanked out, places unchanged.

    Raises `LanguageError` for a line that says none of the things above, or says them twice.
    """
    header = Header()
    start = len(text) - len(text.lstrip())
    if not re.match(re.escape(OPENING) + r"(?!\w)", text[start:]):
        return header, text
    end = text.find(CLOSING, start)
    if end < 0:
        raise _malformed("the comment is not closed: write */ after its last line", text, 1, start + 1)
    inside = _blank(text[: start + len(OPENING)]) + text[start + len(OPENING) : end]
    for number, line in enumerate(inside.split("\n"), 1):
        if line.strip():
            _read_line(header, line, number)
    return header, _blank(text[: end + len(CLOSING)]) + text[end + len(CLOSING) :]


def _blank(text: str) -> str:
    return re.sub(r"[^\n]", " ", text)


def _read_line(header: Header, line: str, number: int) -> None:
    found = _LINE.fullmatch(line)
    if found is None:
        message = "a line of the header reads `atom NAME := PATTERN when GUARD` or `NAME := FORMULA`"
        raise _malformed(message, line, number, len(line) - len(line.lstrip()) + 1)
    kind, name, what = found.groups()
    column = found.start(3) + 1
    several = {"relevant": header.relevant, "ignored": header.ignored}
    if (name in header.atoms or name in header.definitions) or (kind not in several and name in header.relevant):
        raise _malformed(f"{name} is defined twice", line, number, found.start(2) + 1)
    if kind is None:
        header.definitions[name] = what
        header.places[name] = (number, column)
    elif kind == "atom":
        header.atoms[name] = _observation(what, line, number, column)
    else:
        several[kind].setdefault(name, []).append(_observation(what, line, number, column))


def _observation(text: str, line: str, number: int, column: int) -> Observation:
    pieces = list(_pieces(text))
    try:
        pattern = parse_pattern(pieces[0][1])
    except LanguageError as error:
        raise _malformed(error.message, line, number, column + error.column - 1) from None
    if not isinstance(pattern, ObjectPattern | Anything):
        raise _malformed("an event is an object: expected a pattern such as { field: 1 }, or _", line, number, column)
    guards: list[Guard] = []
    for start, piece in pieces[1:]:
        try:
            guards.append(parse_guard(piece))
        except LanguageError as error:
            raise _malformed(error.message, line, number, column + start + error.column - 1) from None
    return Observation(pattern, tuple(guards))


def _pieces(text: str) -> Iterator[tuple[int, str]]:
    """What stands before, between and after the words `when` outside strings and brackets, with its offset."""
    start, depth = 0, 0
    for token in _STRING_OR_WHEN.finditer(text):
        if token.group() in "{[":
            depth += 1
        elif token.group() in "}]":
            depth -= 1
        elif token.group() == "when" and depth == 0:
            yield start, text[start : token.start()]
            start = token.end()
    yield start, text[start:]


def _malformed(message: str, source: str, line: int, column: int) -> LanguageError:
    return LanguageError(message, file="<ltlf>", line=line, column=column, source=source)
