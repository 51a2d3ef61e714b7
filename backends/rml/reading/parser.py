"""From RML text to `syntax.Program`, by the published grammar."""

from collections.abc import Iterator
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Final

from lark import Lark, Token
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

from backends.rml.reading import syntax as s
from backends.rml.reading.building import BUILD
from rvaft.errors import LanguageError

_WORDS: Final = {
    "SEMICOLON": "';'",
    "LOWER": "a name in lower case",
    "UPPER": "the name of an equation (upper case)",
    "MATCHES": "'matches'",
    "RPAR": "')'",
    "RBRACE": "'}'",
    "EQUAL": "'='",
    "COMMA": "','",
    "COLON": "':'",
    "STRING": "a string in single quotes",
    "INT": "a number",
    "FLOAT": "a number",
    "$END": "the end",
}
_REMEMBERED: Final = 64
"""Texts of which the parts are kept: whoever runs a text asks several things of it."""
_LITERALS: Final = {"LOWER", "INT", "FLOAT", "BOOLEAN", "NULL", "STRING", "IGNORED"}


@lru_cache(maxsize=_REMEMBERED)
def parse(text: str) -> s.Program:
    """The specification; raises `LanguageError` with line, column and what was expected."""
    try:
        program = _parser().parse(text, start="start")
    except UnexpectedInput as error:
        raise _language_error(text, error) from None
    except VisitError as error:
        raise error.orig_exc from None
    assert isinstance(program, s.Program)
    return program


@cache
def _parser() -> Lark:
    grammar = files("backends.rml.reading").joinpath("grammar.lark").read_text(encoding="utf-8")
    return Lark(
        grammar,
        parser="lalr",
        lexer="basic",
        start=["start", "parameters", "choices"],
        transformer=BUILD,
        postlex=_LookAhead(),
    )


class _LookAhead:
    """Tells a parenthesis that opens parameters from one that groups, and a brace that opens a block from one that counts."""

    always_accept = ()

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        tokens = list(stream)
        closing = _closing(tokens)
        for index, token in enumerate(tokens):
            opens = token.type == "LPAR" and index and tokens[index - 1].type == "LOWER" and index in closing
            if opens and _are_parameters(tokens[index + 1 : closing[index]]):
                yield Token.new_borrow_pos("CALL", token.value, token)
            elif token.type == "LBRACE" and index + 1 < len(tokens) and tokens[index + 1].type == "LET":
                yield Token.new_borrow_pos("BLOCK", token.value, token)
            else:
                yield token


def _closing(tokens: list[Token]) -> dict[int, int]:
    opened: list[int] = []
    closing: dict[int, int] = {}
    for index, token in enumerate(tokens):
        if token.type == "LPAR":
            opened.append(index)
        elif token.type == "RPAR" and opened:
            closing[opened.pop()] = index
    return closing


def _are_parameters(tokens: list[Token]) -> bool:
    """Whether the tokens between two parentheses can be read as parameters of an event type."""
    if all(
        (token.type == "COMMA") is bool(i % 2) and (i % 2 or token.type in _LITERALS) for i, token in enumerate(tokens)
    ):
        return len(tokens) % 2 == 1
    return _derives("parameters", tokens) or _derives("choices", tokens)


def _derives(start: str, tokens: list[Token]) -> bool:
    parser = _parser().parse_interactive("", start=start)
    try:
        for token in tokens:
            parser.feed_token(token)
        parser.feed_token(Token("$END", ""))
    except (UnexpectedInput, LanguageError):
        return False
    return True


def _language_error(text: str, error: UnexpectedInput) -> LanguageError:
    lines = text.splitlines() or [""]
    if isinstance(error, UnexpectedCharacters):
        line, column = error.line, error.column
        message = f"unexpected character {error.char!r}"
    elif isinstance(error, UnexpectedToken) and error.token.type != "$END":
        line, column = error.line, error.column
        message = f"unexpected {str(error.token)!r}; expected {_expected(error.accepts or error.expected)}"
    else:
        line, column = len(lines), len(lines[-1]) + 1
        expected = error.expected if isinstance(error, (UnexpectedEOF, UnexpectedToken)) else ()
        message = f"the specification ends too early; expected {_expected(expected)}"
    source = lines[line - 1] if 0 < line <= len(lines) else ""
    return LanguageError(message, file="<rml>", line=line, column=column, source=source[:200])


def _expected(terminals: Any) -> str:
    words = sorted({_WORDS[name] for name in terminals if name in _WORDS} or {"something else"})
    return " or ".join(words)
