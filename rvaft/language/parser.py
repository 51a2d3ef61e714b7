"""Text to statements, patterns and guards. Whatever is wrong with a text, `LanguageError` is what comes out."""

import re
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Final

from lark import Lark
from lark.exceptions import UnexpectedInput

from rvaft.language.builder import Build, Slip, Statement
from rvaft.language.diagnostics import diagnose, error_at, error_in_line
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern

_NO_TEXT: Final = re.compile("[\0\ud800-\udfff]")
_REMEMBERED: Final = 1024
"""Texts of which the pattern or guard is kept: specifications repeat them."""


@cache
def _parser() -> Lark:
    grammar = files("rvaft.language").joinpath("grammar.lark").read_text(encoding="utf-8")
    start = ["tree", "only_pattern", "only_guard"]
    return Lark(grammar, parser="lalr", start=start, transformer=Build())


def parse_statements(text: str, file: str = "<text>") -> list[Statement]:
    """The statements of one text, imports not followed; raises `LanguageError`."""
    statements: list[Statement] = _parse(text, file, "tree")
    return statements


@lru_cache(maxsize=_REMEMBERED)
def parse_pattern(text: str, file: str = "<pattern>") -> Pattern:
    """The pattern that a text stands for; every word in it is a variable. Raises `LanguageError`."""
    pattern: Pattern = _parse(text, file, "only_pattern")
    return pattern


@lru_cache(maxsize=_REMEMBERED)
def parse_guard(text: str, file: str = "<guard>") -> Guard:
    """The guard that a text stands for; raises `LanguageError`."""
    guard: Guard = _parse(text, file, "only_guard")
    return guard


def _parse(text: str, file: str, start: str) -> Any:
    text = text.removeprefix("\ufeff")
    if found := _NO_TEXT.search(text):
        what = "binary data (a zero byte), not a text" if found[0] == "\0" else "half of a surrogate pair is no text"
        raise error_at(what, text, found.start(), file)
    try:
        return _parser().parse(text, start=start)
    except Slip as slip:
        raise error_in_line(slip.message, text, slip.line, slip.column, file) from None
    except UnexpectedInput as error:
        raise diagnose(error, text, file) from None
