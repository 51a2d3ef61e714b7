"""Texts as lines of some width: labels between words, events and guards where their parts end."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple, TypeAlias

from rvaft.support.terminal import visible


def wrapped(text: str, width: int) -> list[str]:
    """The lines of a text of at most `width` columns; line ends in the text are kept, other control codes shown.

    A word that is a little wider, by half at most, is not broken.
    """
    return [line for paragraph in _paragraphs(text) for line in _of_words(paragraph, width)]


def wrapped_code(text: str, width: int) -> list[str]:
    """The lines of an event or a guard of at most `width` columns, not one blank of a string lost.

    Broken is what stands in the fewest brackets, and there at `;`, `and` and `or`, then at commas, then behind `when`, then before
    comparisons; a comparison that is a little wider, by half at most, is not broken.
    """
    return [line for paragraph in _paragraphs(text) for line in _of_code(paragraph, width)]


def _paragraphs(text: str) -> list[str]:
    return [visible(line.replace("\t", " ")).rstrip() for line in text.splitlines()]


class _Lines:
    """Takes pieces of text, as many on a line as it has room for; the blanks before a piece do not begin a line."""

    def __init__(self, width: int) -> None:
        self.width = width
        self._lines: list[list[str]] = [[]]
        self._used = 0

    def __iter__(self) -> Iterator[str]:
        return map("".join, self._lines)

    def fits(self, blank: str, columns: int) -> bool:
        return self._used + len(blank) * bool(self._lines[-1]) + columns <= self.width

    def add(self, blank: str, text: str, columns: int) -> None:
        if not self.fits(blank, columns) and self._lines[-1]:
            self._lines.append([])
            self._used = 0
        if self._lines[-1]:
            self._lines[-1].append(blank)
            self._used += len(blank)
        self._lines[-1].append(text)
        self._used += columns

    def add_parts(self, blank: str, text: str) -> None:
        """A piece that is too wide: broken behind blanks and signs such as `/`, and anywhere where these are too far."""
        for part in _PART.findall(text):
            for cut in _cut(part, self.width):
                self.add(blank, cut, _columns(cut))
                blank = ""


_WORD: Final = re.compile(r"(\s*)(\S+)")
_PART: Final = re.compile(r"[^/_.:,;\s-]*[/_.:,;\s-]+|[^/_.:,;\s-]+")


def _of_words(text: str, width: int) -> Iterator[str]:
    lines = _Lines(width)
    for blank, word in _WORD.findall(text):
        columns = _columns(word)
        if columns <= width + width // 2:
            lines.add(blank, word, columns)
        else:
            lines.add_parts(blank, word)
    yield from lines


def _cut(text: str, width: int) -> Iterator[str]:
    start = used = 0
    for place, character in enumerate(text):
        columns = _columns(character)
        if used + columns > width and place > start:
            yield text[start:place]
            start, used = place, 0
        used += columns
    yield text[start:]


def _columns(text: str) -> int:
    """The columns of a text: two for what is as wide as it is high, none for marks upon other characters."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(character) else 2 if unicodedata.east_asian_width(character) in "WF" else 1
        for character in text
    )


_Rank: TypeAlias = tuple[int, int]


class _Token(NamedTuple):
    """What is not parted, the blanks before it, and how late a line is broken there: the brackets around, then the kind of place."""

    blank: str
    text: str
    rank: _Rank


_TOKEN: Final = re.compile(r"""(\s*)(?=\S)(\[?not\s+\(+|(?:"(?:[^"\\]|\\.)*"?|[^\s"(]+)?[^\s"(]*\(*)""")
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"?')
_INSIDE: Final = 3
"""The first kind of place that is inside of a comparison or another term."""
_COMPARISONS: Final = frozenset({"==", "!=", "<", "<=", ">", ">="})


def _of_code(text: str, width: int) -> Iterator[str]:
    lines = _Lines(width)
    if tokens := list(_tokens(text)):
        _lay(tokens, lines)
    yield from lines


def _tokens(text: str) -> Iterator[_Token]:
    depth, before = 0, ""
    for blank, word in _TOKEN.findall(text):
        yield _Token(blank, word, (depth, _kind(before, blank, word)))
        signs = _STRING.sub("", word)
        depth += sum(signs.count(sign) for sign in "([{") - sum(signs.count(sign) for sign in ")]}")
        before = word


def _kind(before: str, blank: str, word: str) -> int:
    if before.endswith(";") or word in ("and", "or"):
        return 0
    if before.endswith(","):
        return 1
    if before == "when":
        return 2
    if not blank or before == "not":
        return 5
    return _INSIDE if word in _COMPARISONS else 4


def _lay(tokens: Sequence[_Token], lines: _Lines) -> None:
    """Add tokens as one piece where a line has room for them, and otherwise in the parts that the earliest breaks make."""
    blank = tokens[0].blank
    text = "".join(token.blank + token.text for token in tokens).removeprefix(blank)
    columns = _columns(text)
    first = min((token.rank for token in tokens[1:]), default=(0, _INSIDE))
    if columns <= lines.width or (
        len(tokens) > 1 and first[1] >= _INSIDE and columns <= lines.width + lines.width // 2
    ):
        lines.add(blank, text, columns)
    elif len(tokens) == 1:
        lines.add_parts(blank, text)
    else:
        start = 0
        for place, token in enumerate(tokens):
            if place > start and token.rank == first:
                _lay(tokens[start:place], lines)
                start = place
        _lay(tokens[start:], lines)
