"""A second, tolerant look at a text that did not parse: what stands around the place where it went wrong."""

import re
from dataclasses import dataclass
from typing import Final

_LEXEME: Final = re.compile(
    r"""(?P<skip>\s+|//[^\n]*|\#[^\n]*|/\*.*?\*/)
      | "[^"\\\n]*(?:\\.[^"\\\n]*)*"
      | \w+
      | == | != | <= | >= | && | \|\| | <> | =< | => | .""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class Lexeme:
    """A piece of text: a string with its quotes, a word or number, a sign; the empty text stands for the end."""

    text: str
    start: int
    line: int

    @property
    def end(self) -> int:
        """The position after the piece."""
        return self.start + len(self.text)

    @property
    def is_word(self) -> bool:
        """Whether it is a word (and no number)."""
        return self.text[:1].isalpha() or self.text[:1] == "_"

    @property
    def is_name(self) -> bool:
        """Whether it is a word or a string."""
        return self.is_word or (len(self.text) > 1 and self.text[0] == '"')


@dataclass(frozen=True, slots=True)
class Situation:
    """Where a text went wrong: the statement so far, what cannot stand there, what follows, what could stand there."""

    before: tuple[Lexeme, ...]
    bad: Lexeme
    after: tuple[Lexeme, ...]
    possible: frozenset[str]

    def can(self, *terminals: str) -> bool:
        """Whether all these terminals could stand there."""
        return self.possible.issuperset(terminals)

    @property
    def last(self) -> Lexeme | None:
        """The piece before the bad one."""
        return self.before[-1] if self.before else None

    @property
    def new_line(self) -> bool:
        """Whether the bad piece stands on a later line than the one before it."""
        return self.last is not None and self.last.line < self.bad.line


def situation(text: str, position: int, possible: frozenset[str]) -> Situation:
    """What stands around a position of a text; the end of the text where nothing follows."""
    before: list[Lexeme] = []
    around: list[Lexeme] = []
    line = 1
    for found in _LEXEME.finditer(text):
        piece = found.group()
        if found.lastgroup != "skip":
            lexeme = Lexeme(piece, found.start(), line)
            if found.end() <= position:
                before.append(lexeme)
                if piece == ";":
                    before.clear()
            else:
                around.append(lexeme)
                if len(around) == 3:
                    break
        line += piece.count("\n")
    bad = around[0] if around else Lexeme("", len(text), line)
    return Situation(tuple(before), bad, tuple(around[1:]), possible)
