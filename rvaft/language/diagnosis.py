"""From the parser library's exceptions to `LanguageError`: where, what was expected, and how to mend common slips."""

from typing import Final

from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from rvaft.errors import LanguageError
from rvaft.language.advice import Advice
from rvaft.language.lexemes import Situation, situation
from rvaft.language.statement_slips import STATEMENT_SLIPS
from rvaft.language.term_slips import LEXICAL_SLIPS, TERM_SLIPS
from rvaft.language.topic_slips import TOPIC_SLIPS
from rvaft.language.words import expectation, shown

_LONGEST_LINE: Final = 300
"""Above this a source line is not shown: nobody finds the caret."""


def diagnose(error: UnexpectedInput, text: str, file: str) -> LanguageError:
    """The error to raise for what the parser library reports."""
    at = situation(text, _position(error, text), _possible(error))
    for slip in (*LEXICAL_SLIPS, *TOPIC_SLIPS, *STATEMENT_SLIPS, *TERM_SLIPS):
        if advice := slip(at):
            return error_at(advice.message, text, advice.position, file)
    advice = _unexpected(at)
    return error_at(advice.message, text, advice.position, file)


def error_at(message: str, text: str, position: int, file: str) -> LanguageError:
    """A `LanguageError` about a position of a text."""
    line = text.count("\n", 0, position) + 1
    start = text.rfind("\n", 0, position) + 1
    end = text.find("\n", position)
    source = _source_line(text[start : end if end >= 0 else len(text)])
    return LanguageError(message, file=file, line=line, column=position - start + 1, source=source)


def error_in_line(message: str, text: str, line: int, column: int, file: str) -> LanguageError:
    """A `LanguageError` about a line and column of a text."""
    source = _source_line(text.split("\n", line)[line - 1])
    return LanguageError(message, file=file, line=line, column=column, source=source)


def _source_line(line: str) -> str:
    """A line as it can be shown, or nothing where it is too long."""
    line = line.rstrip("\r")
    if len(line) > _LONGEST_LINE:
        return ""
    return "".join(c if c.isprintable() or c == "\t" else "?" for c in line)


def _unexpected(at: Situation) -> Advice:
    expected = expectation(at.possible)
    if not at.bad.text:
        position = at.last.end if at.last else 0
        return Advice(f"the text ends too early: expected {expected}", position)
    return Advice(f"unexpected {shown(at.bad.text)}: expected {expected}", at.bad.start)


def _position(error: UnexpectedInput, text: str) -> int:
    match error:
        case UnexpectedToken(token=token) if token.type == "$END":
            return len(text)
        case UnexpectedToken(token=token):
            return token.start_pos or 0
        case UnexpectedCharacters():
            return error.pos_in_stream or 0
        case _:
            return len(text)


def _possible(error: UnexpectedInput) -> frozenset[str]:
    parser = getattr(error, "interactive_parser", None)
    return frozenset(parser.accepts()) if parser is not None else frozenset()
