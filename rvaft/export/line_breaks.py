"""Texts as lines of some width: labels between words, events and guards where their parts end."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from rvaft.support.terminal import visible

_WORD: Final = re.compile(r"(\s*)(\S+)")
_PART: Final = re.compile(r"[^/_.:,;\s-]*[/_.:,;\s-]+|[^/_.:,;\s-]+")
_TOKEN: Final = re.compile(r"""(\s*)(?=\S)(\[?not\s+\(+|(?:"(?:[^"\\]|\\.)*"?|[^\s"(]+)?[^\s"(]*\(*)""")
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"?')
_COMPARISONS: Final = frozenset({"==", "!=", "<", "<=", ">", ">="})
_INSIDE: Final = 3
"""The first kind of place that is inside of a comparison or another term."""


def wrapped(text: str, width: int) -> list[str]:
    """The lines of a text of at most `width` columns; line ends in the text are kept, other control codes shown.

    A word that is a little wider, by half at most, is not broken.

    >>> wrapped("to the decontamination waypoint", 12)
    ['to the', 'decontamination', 'waypoint']
    """
    found: list[str] = []
    for paragraph in _paragraphs(text):
        lines = LineFiller(width)
        for blank, word in _WORD.findall(paragraph):
            lines.add(blank, word, breakable=_columns(word) > width + width // 2)
        found += lines
    return found


def wrapped_code(text: str, width: int) -> list[str]:
    """The lines of an event or a guard of at most `width` columns, not one blank of a string lost.

    Broken is what stands in the fewest brackets, and there at `;`, `and` and `or`, then at commas, then behind `when`, then before
    comparisons; a comparison that is a little wider, by half at most, is not broken.

    >>> wrapped_code("when A >= 1 and (B < 2 or C > 3)", 24)
    ['when A >= 1', 'and (B < 2 or C > 3)']
    """
    found: list[str] = []
    for paragraph in _paragraphs(text):
        lines = LineFiller(width)
        _lay(list(_tokens(paragraph)), lines)
        found += lines
    return found


def _paragraphs(text: str) -> list[str]:
    return [visible(line.replace("\t", " ")).rstrip() for line in text.splitlines()]


class LineFiller:
    """Takes pieces of text, as many on a line as it has room for; the blanks before a piece do not begin a line."""

    def __init__(self, width: int) -> None:
        self.width = width
        self._lines: list[list[str]] = [[]]
        self._used = 0

    def __iter__(self) -> Iterator[str]:
        return map("".join, self._lines)

    def add(self, blank: str, text: str, *, breakable: bool = False) -> None:
        """A piece; one that is too wide may be broken behind blanks and signs such as `/`, or anywhere where these are too far."""
        for part in [cut for piece in _PART.findall(text) for cut in self._cut(piece)] if breakable else [text]:
            columns = _columns(part)
            if self._lines[-1] and self._used + len(blank) + columns > self.width:
                self._lines.append([])
                self._used = 0
            if self._lines[-1]:
                self._lines[-1].append(blank)
                self._used += len(blank)
            self._lines[-1].append(part)
            self._used += columns
            blank = ""

    def _cut(self, text: str) -> Iterator[str]:
        start = used = 0
        for place, character in enumerate(text):
            columns = _columns(character)
            if used + columns > self.width and place > start:
                yield text[start:place]
                start, used = place, 0
            used += columns
        yield text[start:]


def _columns(text: str) -> int:
    """The columns of a text: two for what is as wide as it is high, none for marks upon other characters."""
    if text.isascii():
        return len(text)
    wide = sum(
        unicodedata.east_asian_width(character) in "WF" for character in text if not unicodedata.combining(character)
    )
    return len(text) + wide - sum(bool(unicodedata.combining(character)) for character in text)


class CodeToken(NamedTuple):
    """What is not parted, the blanks before it, and how late a line is broken there: the brackets around, then the kind of place."""

    blank: str
    text: str
    rank: tuple[int, int]


def _tokens(text: str) -> Iterator[CodeToken]:
    depth, before = 0, ""
    for blank, word in _TOKEN.findall(text):
        if before.endswith(";") or word in ("and", "or"):
            kind = 0
        elif before.endswith(","):
            kind = 1
        elif before == "when":
            kind = 2
        elif not blank or before == "not":
            kind = 5
        else:
            kind = _INSIDE if word in _COMPARISONS else 4
        yield CodeToken(blank, word, (depth, kind))
        signs = _STRING.sub("", word)
        depth += sum(signs.count(sign) for sign in "([{") - sum(signs.count(sign) for sign in ")]}")
        before = word


def _lay(tokens: Sequence[CodeToken], lines: LineFiller) -> None:
    """Add tokens as one piece where a line has room for them, and otherwise in the parts that the earliest breaks make."""
    if not tokens:
        return
    blank = tokens[0].blank
    text = "".join(token.blank + token.text for token in tokens).removeprefix(blank)
    first = min((token.rank for token in tokens[1:]), default=(0, 0))
    room = lines.width + (lines.width // 2 if first[1] >= _INSIDE else 0)
    if len(tokens) == 1 or _columns(text) <= room:
        lines.add(blank, text, breakable=_columns(text) > room)
        return
    start = 0
    for place, token in enumerate(tokens):
        if place > start and token.rank == first:
            _lay(tokens[start:place], lines)
            start = place
    _lay(tokens[start:], lines)
