"""The layout of a text: indentation, alignment and blanks, and nothing else.

Unlike `rvaft.dumps` this keeps comments, the order of statements, and the breaks of lines. Lines
with one statement each are aligned as `dumps` aligns them.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from rvaft.errors import RvaftError
from rvaft.language.lexemes import GATES, Lexeme, lexemes, statements
from rvaft.language.printer import aligned
from rvaft.language.words import Sort

_INDENT: Final = "  "
_OPENING: Final = ("LPAR", "LBRACE", "LBRACKET")
_CLOSING: Final = ("RPAR", "RBRACE", "RBRACKET")
_BEFORE_COMMENT: Final = 2
_COLUMNS: Final = {
    "WITHIN": 1,
    **dict.fromkeys(("FAULT", "ATTACK"), 2),
    **dict.fromkeys(("ON", "TIMES", "WHEN", "WITHOUT"), 3),
    "KEY": 4,
    "LABEL": 5,
}
"""The column of each clause of a node, after the name (0) and the gate (1)."""


class NotFormatted(RvaftError, ValueError):
    """A text has no layout: it has a syntax error."""


class _Line(NamedTuple):
    """A line of a text: its lexemes, and what its beginning is."""

    lexemes: tuple[Lexeme, ...]
    blank_before: bool
    starts: bool
    """Whether a statement, or a comment between statements, starts the line."""
    depth: int
    """The number of brackets that are open at its beginning."""


def formatted(text: str) -> str:
    r"""Return a text with another layout; its lexemes are the same, comments included.

    Raises `NotFormatted` for a text with a syntax error.

    >>> print(formatted("top   or a b ; // either\n a fault;"), end="")
    top or a b;  // either
    a          fault;
    """
    found = statements(text)
    if not all(one.complete for one in found):
        raise NotFormatted("a text with a syntax error is not formatted")
    newline = "\r\n" if "\r\n" in text else "\n"
    before = list(lexemes(text, found))
    result = "".join(line + newline for line in _written(list(_lines(before))))
    if _content(lexemes(result)) != _content(before):  # whatever the layout does wrong
        raise NotFormatted("the layout would change the text")
    return result


def _content(found: Iterable[Lexeme]) -> list[tuple[str, str]]:
    return [(one.terminal, one.text.rstrip()) for one in found if one.sort is not Sort.BLANK]


def _lines(found: Iterable[Lexeme]) -> Iterator[_Line]:
    """Yield the lines; a comment of several lines is in one."""
    line: list[Lexeme] = []
    newlines, depth, begun = 0, 0, False
    starts, opened, blank = True, 0, False
    for one in found:
        if one.sort is Sort.BLANK:
            newlines = one.text.count("\n")
            continue
        if line and newlines:
            yield _Line(tuple(line), blank, starts, opened)
            line, blank = [], newlines > 1
        newlines = 0
        if not line:
            starts, opened = not begun, depth - (one.terminal in _CLOSING)
        line.append(one)
        if one.sort is not Sort.COMMENT:
            begun = one.terminal != "SEMICOLON"
            depth += one.terminal in _OPENING
            depth -= one.terminal in _CLOSING
    if line:
        yield _Line(tuple(line), blank, starts, opened)


def _written(lines: Sequence[_Line]) -> Iterator[str]:
    """Yield the lines of the result; those of one block are aligned."""
    done = 0
    while done < len(lines):
        end = done + 1
        kind = _kind(lines[done])
        while kind and end < len(lines) and not lines[end].blank_before and _kind(lines[end]) == kind:
            end += 1
        block = lines[done:end]
        if lines[done].blank_before:
            yield ""
        texts = _table([_statement(line) for line in block]) if kind else [_plain(block[0])]
        yield from _with_comments(texts, [_comment(line) for line in block])
        done = end


def _statement(line: _Line) -> tuple[Lexeme, ...]:
    """Return the lexemes of a line without the comment at its end."""
    last = line.lexemes[-1]
    return line.lexemes[:-1] if last.sort is Sort.COMMENT and len(line.lexemes) > 1 else line.lexemes


def _comment(line: _Line) -> str:
    last = line.lexemes[-1]
    return last.text.rstrip() if last.sort is Sort.COMMENT and len(line.lexemes) > 1 else ""


def _kind(line: _Line) -> str:
    """Return the kind of a line that is one whole statement, or "" for another line."""
    found = _statement(line)
    ends = [one.terminal == "SEMICOLON" for one in found]
    if not line.starts or ends.count(True) != 1 or not ends[-1] or any(one.sort is Sort.COMMENT for one in found):
        return ""
    return found[0].terminal if found[0].sort is not Sort.NODE else "node"


def _table(rows: Sequence[Sequence[Lexeme]]) -> list[str]:
    """Return the texts of statements of one kind, with their cells below each other."""
    cells = [_cells(row[:-1]) for row in rows]
    width = max(map(len, cells))
    lines = iter(aligned([row + [""] * (width - len(row)) for row in cells if len(row) > 1]))
    return [next(lines) if len(row) > 1 else row[0] + ";" for row in cells]


def _cells(row: Sequence[Lexeme]) -> list[str]:
    """Return the cells of a statement; a single one if its clauses have another order than the columns."""
    found: list[list[Lexeme]] = [[] for _ in range(6)]
    column = 0
    for number, one in enumerate(row):
        wanted = _column(row, number)
        if wanted is not None and wanted < column:
            return [_joined(row)]
        column = column if wanted is None else wanted
        found[column].append(one)
    if not any(found[1:]):
        return [_joined(row), ""] if row[0].sort is Sort.NODE else [_joined(row)]
    return [_joined(cell) for cell in found]


def _column(row: Sequence[Lexeme], number: int) -> int | None:
    """Return the column that starts with a lexeme, or None within a cell."""
    one = row[number]
    match row[0].terminal:
        case "EVENT":
            return 1 if one.terminal == "EQUALS" else None
        case "TOPIC":
            return {"TYPE": 1, "FROM": 2}.get(one.terminal)
    if row[0].sort is not Sort.NODE:
        return None
    if number == 1 and one.terminal in GATES:
        return 1
    guarded = one.terminal == "WHEN" and number > 0
    return 3 if guarded else _COLUMNS.get(one.terminal)


def _plain(line: _Line) -> str:
    """Return a line that is aligned with no other."""
    closes = line.lexemes[0].terminal in _CLOSING
    levels = 0 if line.starts else max(line.depth, 0 if closes else 1)
    return _INDENT * levels + _joined(_statement(line))


def _joined(row: Sequence[Lexeme]) -> str:
    """Return lexemes with one blank where there is some, and none before a comma or a semicolon."""
    text = ""
    for before, one in zip([None, *row], row, strict=False):
        apart = before is not None and before.end < one.start and one.terminal not in ("COMMA", "SEMICOLON")
        text += (" " if apart else "") + one.text
    return text.rstrip()


def _with_comments(texts: Sequence[str], comments: Sequence[str]) -> Iterator[str]:
    width = max((len(text) for text, comment in zip(texts, comments, strict=True) if comment), default=0)
    for text, comment in zip(texts, comments, strict=True):
        yield f"{text.ljust(width + _BEFORE_COMMENT)}{comment}" if comment else text
