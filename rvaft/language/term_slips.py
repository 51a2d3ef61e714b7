"""Common slips in guards, calls, patterns and strings: one function each; the first that knows something speaks."""

from typing import Final

from rvaft.language.advice import Advice, Hint
from rvaft.language.lexemes import Situation
from rvaft.language.words import shown

_SIGNS: Final = {
    "&&": "and",
    "&": "and",
    "||": "or",
    "|": "or",
    "!": "not",
    "<>": "!=",
    "=<": "<=",
    "=>": ">=",
    "=": "==",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "∧": "and",
    "∨": "or",
    "¬": "not",
}
_COMPARISONS: Final = ("==", "!=", "<=", ">=", "<", ">")


def _open_comment(at: Situation) -> Advice | None:
    last = at.last
    if at.bad.text == "/" and at.after and at.after[0].text == "*" and at.after[0].start == at.bad.end:
        return Advice("this comment has no end: it is closed by */", at.bad.start)
    if at.bad.text == "*" and last is not None and last.text == "/" and last.end == at.bad.start:
        return Advice("this comment has no end: it is closed by */", last.start)
    return None


def _bad_string(at: Situation) -> Advice | None:
    text = at.bad.text
    if text == '"':
        return Advice('this string has no end: the closing " must be on the same line', at.bad.start)
    if text.startswith('"') and any(c < " " for c in text):
        return Advice("a tab or control character in a string is written as an escape, such as \\t", at.bad.start)
    if text in ("'", "`", "‘", "’", "“", "”", "«", "»"):
        return Advice('a string is written in straight double quotes: "text"', at.bad.start)
    return None


def _chained_comparison(at: Situation) -> Advice | None:
    if at.bad.text in _COMPARISONS and at.can("PLUS") and not at.can("COMPARISON"):
        return Advice("comparisons do not chain: write `A < B and B < C`", at.bad.start)
    return None


def _foreign_sign(at: Situation) -> Advice | None:
    """`&&`, `||`, `!`, `=` and their like in a guard."""
    if at.bad.text not in _SIGNS or not (at.can("PLUS") or at.can("VARIABLE", "LPAR")):
        return None
    if at.bad.text == "=" and at.last is not None and at.last.text in _COMPARISONS:
        return Advice("equality is written ==", at.last.start)
    return Advice(f"{shown(at.bad.text)} is written {_SIGNS[at.bad.text]} here", at.bad.start)


def _lower_case_variable(at: Situation) -> Advice | None:
    if not at.can("VARIABLE") or not at.bad.is_word:
        return None
    word = at.bad.text
    if word == "not":
        return Advice("`not` binds weaker than a comparison: put parentheses around it", at.bad.start)
    bare = word.lstrip("_")
    mend = f": {bare[:1].upper()}{bare[1:]}" if bare[:1].isalpha() else ""
    message = f'{shown(word)} is no variable, which starts with a capital{mend}; for text write "{word}"'
    return Advice(message if len(word) <= 40 else "a variable starts with a capital", at.bad.start)


def _bad_number(at: Situation) -> Advice | None:
    if at.can("NUMBER") and (at.bad.text[:1].isdigit() or at.bad.text in (".", "+")):
        return Advice("a number is written as in JSON: 10, -0.5, 1e-3", at.bad.start)
    return None


def _no_arguments(at: Situation) -> Advice | None:
    if at.possible == {"LPAR"} and at.last is not None:
        name = shown(at.last.text)[1:-1]
        return Advice(f"an event type has parentheses: {name}(…), or {name}() without arguments", at.last.end)
    return None


def _trailing_comma(at: Situation) -> Advice | None:
    if at.last is not None and at.last.text == "," and at.bad.text in (")", "}", "]"):
        return Advice(f"no comma stands before {shown(at.bad.text)}", at.last.start)
    return None


LEXICAL_SLIPS: Final[tuple[Hint, ...]] = (_open_comment, _bad_string)
"""Slips that leave no lexeme to reason about; asked first."""

TERM_SLIPS: Final[tuple[Hint, ...]] = (
    _chained_comparison,
    _foreign_sign,
    _lower_case_variable,
    _bad_number,
    _no_arguments,
    _trailing_comma,
)
