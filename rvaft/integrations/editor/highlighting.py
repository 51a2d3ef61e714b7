"""Highlighting of the tree language: a lexer of Pygments, and the grammar for TextMate.

Run as a module it writes the grammar of TextMate to standard output.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final

from pygments.lexer import Lexer
from pygments.token import (
    Comment,
    Error,
    Keyword,
    Literal,
    Name,
    Number,
    Operator,
    Punctuation,
    String,
    Whitespace,
)

from rvaft.language.lexemes import GATES, lexemes, patterns, words_of
from rvaft.language.parser import SUFFIXES
from rvaft.language.words import WORDS, Sort
from rvaft.support.terminal import readable_json

_TOKENS: Final[Mapping[Sort, Any]] = {
    Sort.BLANK: Whitespace,
    Sort.COMMENT: Comment,
    Sort.STATEMENT: Keyword.Declaration,
    Sort.GATE: Keyword,
    Sort.CLAUSE: Keyword,
    Sort.OPERATOR: Operator,
    Sort.FUNCTION: Name.Builtin,
    Sort.CONSTANT: Keyword.Constant,
    Sort.CHOICE: Keyword.Type,
    Sort.NODE: Name,
    Sort.EVENT: Name.Function,
    Sort.FIELD: Name.Attribute,
    Sort.PARAMETER: Name.Variable,
    Sort.VARIABLE: Name.Variable,
    Sort.ATTRIBUTE: Name.Attribute,
    Sort.NAME: Name,
    Sort.STRING: String,
    Sort.NUMBER: Number,
    Sort.DURATION: Literal.Date,
    Sort.SIGN: Punctuation,
    Sort.ERROR: Error,
}


class RvaftLexer(Lexer):  # type: ignore[misc] # Pygments has no types
    """The lexer of Pygments for `rvaft`.

    >>> [text for kind, text in RvaftLexer().get_tokens("top or a b;") if kind in Keyword]
    ['or']
    """

    name = "rvaft"
    aliases: ClassVar = ["rvaft"]
    filenames: ClassVar = [f"*{suffix}" for suffix in SUFFIXES]
    mimetypes: ClassVar = ["text/x-rvaft"]
    url = ""

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Any, str]]:
        """Yield the position, the kind and the text of each lexeme."""
        for one in lexemes(text):
            kind = Operator.Word if one.sort is Sort.OPERATOR and one.text.isalpha() else _TOKENS[one.sort]
            yield one.start, kind, one.text


_SCOPES: Final[Mapping[Sort, str]] = {
    Sort.STATEMENT: "keyword.other.statement",
    Sort.GATE: "keyword.control.gate",
    Sort.CLAUSE: "keyword.other.clause",
    Sort.OPERATOR: "keyword.operator.word",
    Sort.FUNCTION: "support.function",
    Sort.CONSTANT: "constant.language",
}
_CONTROLS: Final = re.compile(r"[\x00-\x1f]")
_NEVER_BEFORE: Final = r"(?<![\w\"])"


def text_mate() -> dict[str, Any]:
    """Return the grammar for TextMate, from the terminals of the grammar of the language.

    An editor colours one line after the other, without the parser: a word is a keyword wherever it
    stands, but for the names of fields.
    """
    found = {name: _portable(text) for name, text in patterns().items()}
    escape = {"match": r"\\(?:u[0-9a-fA-F]{4}|.)", "name": "constant.character.escape.rvaft"}
    rules: list[dict[str, Any]] = [
        {"begin": r"/\*", "end": r"\*/", "name": "comment.block.rvaft"},
        {"match": r"//.*$|#.*$", "name": "comment.line.rvaft"},
        {"match": rf"(?:{found['STRING']}|{found['WORD']})(?=\s*:)", "name": "variable.other.property.rvaft"},
        {"match": rf"{_NEVER_BEFORE}{found['WORD']}(?=\s*=(?!=))", "name": "entity.other.attribute-name.rvaft"},
        {"match": found["STRING"], "name": "string.quoted.double.rvaft", "captures": {"0": {"patterns": [escape]}}},
        {"match": _NEVER_BEFORE + found["DURATION"], "name": "constant.numeric.duration.rvaft"},
    ]
    for sort, scope in _SCOPES.items():
        rules += [{"match": _portable(pattern), "name": f"{scope}.rvaft"} for pattern in _matches(sort)]
    rules += [
        {"match": _NEVER_BEFORE + found["NUMBER"], "name": "constant.numeric.rvaft"},
        {"match": rf"{_NEVER_BEFORE}{found['WORD']}(?=\s*\()", "name": "entity.name.function.rvaft"},
        {"match": _NEVER_BEFORE + found["VARIABLE"], "name": "variable.parameter.rvaft"},
        {"match": found["COMPARISON"], "name": "keyword.operator.comparison.rvaft"},
        {"match": r"[;,:=(){}\[\]]|\.\.\.", "name": "punctuation.rvaft"},
    ]
    return {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "name": "rvaft",
        "scopeName": "source.rvaft",
        "fileTypes": [suffix.removeprefix(".") for suffix in SUFFIXES],
        "patterns": rules,
    }


def _portable(pattern: str) -> str:
    """Return a regular expression without control characters."""
    return _CONTROLS.sub(lambda found: f"\\x{ord(found[0]):02x}", pattern)


def _matches(sort: Sort) -> Iterator[str]:
    """Yield the patterns of the words of a sort: their terminals, and one for the plain words.

    Words that are gates and operators are gates here.
    """
    plain = [word for word in WORDS[sort] if word.isidentifier()]
    if sort is Sort.GATE:
        yield from (f"{_NEVER_BEFORE}{patterns()[name]}" for name in sorted(GATES) if not words_of(name))
    if sort is Sort.OPERATOR:
        plain = [word for word in plain if word not in WORDS[Sort.GATE]]
    looking = [name for name in patterns() if words_of(name) == (name.lower(),) and "(?=" in patterns()[name]]
    if sort is Sort.STATEMENT:  # a node can have these names, so what follows decides
        yield from (f"{_NEVER_BEFORE}{patterns()[name]}" for name in looking)
        plain = [word for word in plain if word.upper() not in looking]
    called = r"(?=\s*\()" if sort is Sort.FUNCTION else ""
    yield rf"{_NEVER_BEFORE}(?:{'|'.join(map(re.escape, sorted(plain)))})(?![\w\"]){called}"


if __name__ == "__main__":
    print(readable_json(text_mate(), indent=2))
