"""A text in an editor with its lexemes and positions, and the files that it imports."""

import bisect
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Final, NamedTuple

from rvaft.errors import RvaftError
from rvaft.language.lexemes import Lexeme, Statement, statements
from rvaft.language.parser import file_text
from rvaft.language.words import Sort
from rvaft.model.nodes import Place
from rvaft.model.tree import RVAFT
from rvaft.rules.validity import loads

MAX_TEXT: Final = 512 * 1024
"""The maximum number of characters that are analysed."""
MAX_PAGES: Final = 100
"""The maximum number of files that are searched for names."""
_statements: Final = lru_cache(maxsize=MAX_PAGES)(statements)
_BREAK: Final = re.compile(r"\r\n|\n|\r")
_WIDE: Final = re.compile("[\U00010000-\U0010ffff]")


class Position(NamedTuple):
    """A position of the protocol: a line from 0, and a number of UTF-16 units in it."""

    line: int
    character: int


class Region(NamedTuple):
    """A part of a text between two positions."""

    start: Position
    end: Position


class Target(NamedTuple):
    """A region of a file."""

    file: str
    region: Region


@dataclass(frozen=True)
class Document:
    r"""A text with the path of its file; `confined` is whether imports stay in the folder of the file.

    >>> document = Document("top or a;\n/* 😀 */ a fault;")
    >>> document.position(document.text.index("fault"))
    Position(line=1, character=11)
    >>> document.text[document.offset(Position(1, 11)) :]
    'fault;'
    """

    text: str
    file: str = "<text>"
    confined: bool = False

    @cached_property
    def statements(self) -> list[Statement]:
        """The statements of the text; none if it is too large to be analysed."""
        return _statements(self.text) if len(self.text) <= MAX_TEXT else []

    @cached_property
    def lexemes(self) -> list[Lexeme]:
        """The lexemes without blanks and comments."""
        return [one for statement in self.statements for one in statement.lexemes]

    @cached_property
    def tree(self) -> RVAFT | None:
        """The tree of the text, or None if it has an error."""
        try:
            return loads(self.text, self.file, confine_imports=self.confined)
        except RvaftError:
            return None

    @cached_property
    def _lines(self) -> list[int]:
        """The start of each line of the protocol, which also ends at a carriage return."""
        return [0, *(found.end() for found in _BREAK.finditer(self.text))]

    @cached_property
    def _newlines(self) -> list[int]:
        return [0, *(found.end() for found in re.finditer("\n", self.text))]

    def position(self, offset: int) -> Position:
        """Return the position of an offset."""
        line = bisect.bisect_right(self._lines, offset) - 1
        before = self.text[self._lines[line] : offset]
        return Position(line, len(before) + len(_WIDE.findall(before)))

    def offset(self, position: Position) -> int:
        """Return the offset of a position; one beyond a line or the text is at its end."""
        if position.line >= len(self._lines):
            return len(self.text)
        start = self._lines[position.line]
        end = self._lines[position.line + 1] if position.line + 1 < len(self._lines) else len(self.text)
        line = self.text[start:end].rstrip("\r\n")
        units = 0
        for number, character in enumerate(line):
            units += 2 if character > "\uffff" else 1
            if units > position.character:
                return start + number
        return start + len(line)

    def offset_of(self, place: Place) -> int:
        """Return the offset of a place of `rvaft`, whose lines end at a newline."""
        line = min(place.line, len(self._newlines)) - 1
        mark = line == 0 and self.text.startswith("\ufeff")
        return min(self._newlines[line] + place.column - 1 + mark, len(self.text))

    def region(self, start: int, end: int) -> Region:
        """Return the region between two offsets."""
        return Region(self.position(start), self.position(end))

    def target(self, one: Lexeme) -> Target:
        """Return the place of a lexeme."""
        return Target(self.file, self.region(one.start, one.end))

    def lexeme_at(self, offset: int) -> Lexeme | None:
        """Return the lexeme at an offset, or else the one that ends there."""
        number = bisect.bisect_right(self.lexemes, offset, key=lambda one: one.start) - 1
        if number < 0:
            return None
        one = self.lexemes[number]
        if one.start == offset and one.sort is Sort.SIGN and number and self.lexemes[number - 1].end == offset:
            return self.lexemes[number - 1]
        return one if offset <= one.end else None

    @cached_property
    def imports(self) -> list[Lexeme]:
        """The names of imported files."""
        named = [one.lexemes for one in self.statements if one.lexemes[0].terminal == "IMPORT"]
        return [found[1] for found in named if len(found) > 1 and found[1].terminal == "STRING"]

    def imported(self, one: Lexeme) -> str:
        """Return the path of an imported file."""
        return os.path.join(os.path.dirname(self.file), one.name)  # noqa: PTH118, PTH120 - as the parser writes it

    @cached_property
    def pages(self) -> list["Document"]:
        """The document and those that it imports, also indirectly, as far as they can be read."""
        folder = Path(os.path.realpath(os.path.dirname(self.file))) if self.confined else None  # noqa: PTH120
        return list(_pages(self, folder))

    def text_of(self, statement: Statement) -> str:
        """Return the text of a statement."""
        return self.text[statement.start : statement.end]


def _pages(main: Document, folder: Path | None) -> Iterator[Document]:
    todo, seen = [main], set[str]()
    while todo and len(seen) < MAX_PAGES:
        page = todo.pop(0)
        yield page
        seen.add(os.path.realpath(page.file))
        for one in page.imports:
            name = page.imported(one)
            try:
                if os.path.realpath(name) not in seen:
                    todo.append(Document(file_text(name, folder), name, main.confined))
                    seen.add(os.path.realpath(name))
            except (RvaftError, OSError, ValueError):
                continue
