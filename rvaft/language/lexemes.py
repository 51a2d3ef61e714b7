"""A text as lexemes, also a text with errors, for editors: the whole of it, and the sort of each.

The parser decides what a word is, up to the first error. The rest of the statement is read word by
word; then the parser starts afresh.
"""

import json
import re
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Final, NamedTuple

from lark import Token
from lark.exceptions import UnexpectedInput, UnexpectedToken
from lark.parsers.lalr_interactive_parser import InteractiveParser

from rvaft.language.parser import grammar
from rvaft.language.words import Sort

_ANY: Final = r"(?!\w)"
_ALTERNATIVES: Final = re.compile(r"\(\?:((?:\w+\|)*\w+)\)" + re.escape(_ANY))
_LOOKING: Final = ("TOPIC", "TIME", "SEMANTICS", "ASSUME", "SHOW", "REPEAT")
"""Statements whose first word is a keyword only before certain words."""
_PLAIN: Final = "PLAIN_NODE"
_PIECE: Final = re.compile(r"\w+|;")
GATES: Final = frozenset({"OR", "AND", "SAND", "SAND_RL", "PAND", "K_OF_N", "VOT_K", "DYNAMIC", "PDEP"})
_CLAUSES: Final = (
    *("ON", "WHEN", "FAULT", "ATTACK", "LABEL", "TIMES", "DISTINCT", "EACH", "WITHIN", "WITHOUT"),
    *("FOR", "AFTER", "BEFORE", "AS", "LATE", "YEAR", "ZONE", "TYPE", "FROM", "BY", "TOP_DOWN", "BOTTOM_UP"),
)
_STATEMENTS: Final = frozenset(
    {"TOPLEVEL", "PARAM", "CAUSALITY", "IMPORT", "PRUNE", "IGNORE", "EVENT", *_LOOKING},
)
_SORTS: Final[Mapping[str, Sort]] = {
    **dict.fromkeys(_STATEMENTS, Sort.STATEMENT),
    **dict.fromkeys(GATES, Sort.GATE),
    **dict.fromkeys(_CLAUSES, Sort.CLAUSE),
    **dict.fromkeys(("NOT", "IN", "COMPARISON", "PLUS", "MINUS", "STAR", "SLASH"), Sort.OPERATOR),
    **dict.fromkeys(("POINT", "FUNCTION"), Sort.FUNCTION),
    **dict.fromkeys(("TRUE", "FALSE", "NULL", "ANY"), Sort.CONSTANT),
    "VARIABLE": Sort.VARIABLE,
    "KEY": Sort.ATTRIBUTE,
    "NAME": Sort.NAME,
    "WORD": Sort.NAME,
    "STRING": Sort.STRING,
    "VALUE": Sort.STRING,
    "NUMBER": Sort.NUMBER,
    "DURATION": Sort.DURATION,
    "COMMENT": Sort.COMMENT,
    "BLANK": Sort.BLANK,
    "": Sort.ERROR,
}
"""The sort of each terminal of the grammar; the others are signs."""
_NAMED: Final = ("NAME", "WORD", "STRING", "VARIABLE")
_OPEN: Final = {"LPAR": "(", "LBRACE": "{", "LBRACKET": "["}
_CLOSED: Final = ("RPAR", "RBRACE", "RBRACKET")


class Lexeme(NamedTuple):
    """A piece of a text; `terminal` is its name in the grammar, or "" for an error.

    `defines` is whether this name of a node or an event type is the one that a statement is about.
    """

    sort: Sort
    text: str
    start: int
    terminal: str
    defines: bool = False

    @property
    def end(self) -> int:
        """The position after the piece."""
        return self.start + len(self.text)

    @property
    def name(self) -> str:
        """The name, without quotes."""
        if not self.text.startswith('"'):
            return self.text
        try:
            return str(json.loads(self.text))
        except ValueError:
            return self.text


class Statement(NamedTuple):
    """The lexemes of a statement without blanks and comments; `complete` if the grammar accepts it."""

    lexemes: tuple[Lexeme, ...]
    complete: bool

    @property
    def start(self) -> int:
        """The position of the first lexeme."""
        return self.lexemes[0].start

    @property
    def end(self) -> int:
        """The position after the last lexeme."""
        return self.lexemes[-1].end


class _Piece(NamedTuple):
    terminal: str
    text: str
    start: int
    sound: bool = True
    """Whether the parser has accepted it."""


_BREAK: Final = _Piece("", "", -1)
_MOST_ERRORS: Final = 100
"""After so many wrong statements the rest is read word by word."""


@cache
def patterns() -> Mapping[str, str]:
    r"""Return the regular expressions of the terminals, by name.

    >>> patterns()["COMMA"], patterns()["ON"]
    (',', 'on(?!\\w)')
    """
    found = {one.name: one.pattern for one in grammar(built=False).terminals}
    return {name: re.escape(one.value) if one.type == "str" else one.value for name, one in found.items()}


@cache
def words_of(terminal: str) -> tuple[str, ...]:
    """Return the words that a terminal stands for, or nothing if they are no closed list.

    >>> words_of("POINT"), words_of("SAND"), words_of("TIME"), words_of("WORD")
    (('at', 'start', 'end'), ('sand',), ('time',), ())
    """
    pattern = patterns()[terminal]
    if terminal in _LOOKING:
        return (terminal.lower(),)
    if found := _ALTERNATIVES.fullmatch(pattern):
        return tuple(found[1].split("|"))
    word = pattern.removesuffix(_ANY)
    return (word,) if pattern.endswith(_ANY) and word.isidentifier() else ()


@cache
def _keywords() -> Mapping[str, str]:
    """Return the terminals of words, for the text after an error."""
    return {word: name for name in patterns() if name not in _LOOKING for word in words_of(name)}


@cache
def _loose() -> re.Pattern[str]:
    """Return the lexemes of a text after an error."""
    names = ("STRING", "DURATION", "NUMBER", "COMPARISON", "BLANK", "DOTS")
    signs = [name for name, text in patterns().items() if len(text.removeprefix("\\")) == 1]
    known = "|".join(f"(?P<{name}>{patterns()[name]})" for name in (*names, *signs))
    comment = rf"(?P<COMMENT>{patterns()['COMMENT']})|/\*.*"  # one without its end is one error
    return re.compile(rf"{comment}|{known}|(?P<WORD>\w+)|.", re.DOTALL)


def _pieces(text: str) -> Iterator[_Piece]:
    """Yield the lexemes but blanks and comments, and `_BREAK` where a statement starts after a wrong one."""
    start, errors = 0, 0
    while start < len(text):
        failed = (yield from _accepted(text, start)) if errors < _MOST_ERRORS else start
        if failed is None:
            return
        errors += 1
        start = yield from _skipped(text, failed, start)
        yield _BREAK


def _accepted(text: str, start: int) -> Generator[_Piece, None, int | None]:
    """Yield what the parser accepts; return the position of an error, or None at the end."""
    parser = grammar(built=False).parse_interactive(text[start:], start="tree")
    try:
        for token in parser.lexer_thread.lex(parser.parser_state):  # type: ignore[no-untyped-call]
            parser.feed_token(token)
            at = start + (token.start_pos or 0)
            if token.type == _PLAIN:
                yield from _plain(token.value, at)
            else:
                yield _Piece(token.type, str(token), at)
    except UnexpectedInput as error:
        found = error.token.start_pos if isinstance(error, UnexpectedToken) else error.pos_in_stream
        return start + (found or 0)
    return None


def _plain(text: str, start: int) -> Iterator[_Piece]:
    """Yield the pieces of a statement that the lexer reads as one token."""
    for number, found in enumerate(_PIECE.finditer(text)):
        terminal = "SEMICOLON" if found[0] == ";" else "NAME"
        if number == 1 and terminal == "NAME":
            terminal = next(name for name in GATES if re.fullmatch(patterns()[name], found[0]))
        yield _Piece(terminal, found[0], start + found.start())


def _skipped(text: str, position: int, start: int) -> Generator[_Piece, None, int]:
    """Yield the rest of a wrong statement; return where the next one starts.

    That is after a semicolon, or at a line that starts with a keyword of statements.
    """
    for found in _loose().finditer(text, position):
        terminal, piece = found.lastgroup or "", found[0]
        if terminal in ("BLANK", "COMMENT"):
            continue
        if terminal == "WORD":
            terminal = _keywords().get(piece, "WORD")
            if terminal in _STATEMENTS and found.start() > start and text[found.start() - 1] == "\n":
                return found.start()
        yield _Piece(terminal, piece, found.start(), sound=False)
        if terminal == "SEMICOLON":
            return found.end()
    return len(text)


def statements(text: str) -> list[Statement]:
    """Return the statements of a text, the last one perhaps without its end.

    >>> [one.lexemes[0].text for one in statements("top or a b; a on ); b fault;")]
    ['top', 'a', 'b']
    """
    found: list[Statement] = []
    pieces: list[_Piece] = []

    def close() -> None:
        if pieces:
            complete = pieces[-1].terminal == "SEMICOLON" and all(one.sound for one in pieces)
            found.append(Statement(tuple(_classified(pieces)), complete))
            pieces.clear()

    for piece in _pieces(text.removeprefix("\ufeff").rjust(len(text))):
        if piece is not _BREAK:
            pieces.append(piece)
        if piece is _BREAK or piece.terminal == "SEMICOLON":
            close()
    close()
    return found


def lexemes(text: str, found: Iterable[Statement] | None = None) -> Iterator[Lexeme]:
    """Yield the lexemes of a text, which together are the text; `found` are its statements if they are known.

    >>> [(one.sort.value, one.text) for one in lexemes("a fault; # odd")][2:]
    [('clause', 'fault'), ('sign', ';'), ('blank', ' '), ('comment', '# odd')]
    """
    end, known = 0, statements(text) if found is None else found
    for one in (lexeme for statement in known for lexeme in statement.lexemes):
        yield from _between(text, end, one.start)
        yield one
        end = one.end
    yield from _between(text, end, len(text))


def _between(text: str, start: int, end: int) -> Iterator[Lexeme]:
    for found in _loose().finditer(text, start, end):
        terminal = found.lastgroup or ""
        known = terminal in ("BLANK", "COMMENT") or found[0] == "\ufeff"
        yield Lexeme(_SORTS[terminal or "BLANK"] if known else Sort.ERROR, found[0], found.start(), terminal)


def _classified(pieces: Sequence[_Piece]) -> Iterator[Lexeme]:
    """Yield the lexemes of one statement: the sort of a name depends on its place."""
    first = pieces[0].terminal
    brackets: list[str] = []
    children = False
    for number, (terminal, text, start, _) in enumerate(pieces):
        before = pieces[number - 1].terminal if number else ""
        after = pieces[number + 1].terminal if number + 1 < len(pieces) else ""
        sort, defines = _SORTS.get(terminal, Sort.SIGN), False
        is_node = first in ("NAME", "STRING")
        if terminal in GATES:
            children = is_node and number == 1
            sort = Sort.GATE if children or terminal not in ("OR", "AND") else Sort.OPERATOR
        elif terminal in _STATEMENTS and number:
            sort = Sort.NAME
        elif terminal in _NAMED:
            is_point = before == "LPAR" and pieces[number - 2].terminal == "POINT"
            if is_node and (number == 0 or children or is_point):
                sort, defines = Sort.NODE, number == 0
            else:
                sort, defines = _named(terminal, first, before, after, brackets)
        else:
            children = False
        if terminal in _OPEN:
            brackets.append(_OPEN[terminal])
        elif terminal in _CLOSED and brackets:
            brackets.pop()
        yield Lexeme(sort, text, start, terminal, defines)


def _named(terminal: str, first: str, before: str, after: str, brackets: Sequence[str]) -> tuple[Sort, bool]:
    """Return the sort of a word or string, and whether the statement is about it."""
    usual = _SORTS[terminal], False
    if before in ("ON", "WITHOUT", "IGNORE", "EVENT"):
        return Sort.EVENT, first == "EVENT"
    if first == "EVENT":
        inner = brackets[-1] if brackets else ""
        if inner == "{" and after == "COLON":
            return Sort.FIELD, False
        if before == "COLON" and inner == "(":
            return Sort.CHOICE, False
        return (Sort.PARAMETER if terminal == "WORD" else usual[0]), False
    match first:
        case "TOPLEVEL" | "PRUNE":
            return Sort.NODE, False
        case "SEMANTICS" | "ASSUME":
            return Sort.CHOICE, False
        case "SHOW":
            return Sort.VARIABLE, False
        case "TIME":
            if before in ("TIME", "DOT"):
                return Sort.FIELD, False
            return (Sort.CHOICE if before == "AS" and terminal == "WORD" else usual[0]), False
    return usual


def accepted(text: str, forced: str = "") -> frozenset[str]:
    """Return the terminals that can follow the beginning of a statement; none after an error.

    With `forced`, the first word is that keyword, which only the words after it would make one.

    >>> sorted(accepted("a on "))
    ['STRING', 'WORD']
    """
    word = words_of(forced)[0] if forced else ""
    parser = grammar(built=False).parse_interactive(text.removeprefix(word), start="tree")
    try:
        if forced:
            parser.feed_token(Token(forced, word))
        parser.exhaust_lexer()
    except UnexpectedInput:
        return frozenset()
    return _accepts(parser)


def _accepts(parser: InteractiveParser) -> frozenset[str]:
    return frozenset(parser.accepts()) - {"$END", _PLAIN}  # type: ignore[no-untyped-call]
