"""Lines of a block that the fast decoder cannot be trusted with.

It checks all of JSON's grammar but passes over strings and numbers that nobody reads. So what it does not see is looked for here, in the
bytes: what is no UTF-8, what is nested too deeply, numbers that are too long, keys that are written with escapes, or repeated.
"""

import re
from collections.abc import Iterable
from typing import Final

from rvaft.fast.blocks import Block
from rvaft.traces import MAX_DEPTH, MAX_DIGITS, MAX_LINE

SHORT: Final = 2 * MAX_DEPTH
"""A line no longer than this has neither too many levels nor too many digits."""
_DIGITS: Final = re.compile(rb"[0-9]{%d}" % (MAX_DIGITS + 1))
_ASCII: Final = tuple(bytes([digit]) for digit in b"234567")
"""The third digit of the numbers of ASCII's letters and signs."""


def doubtful(block: Block) -> set[int]:
    """The places of lines with something about them that the decoder does not see."""
    found: set[int] = set()
    text, lines = block.text, block.lines
    if not utf8(text):
        found.update(place for place, line in enumerate(lines) if not utf8(line))
    if _escapes(text):
        found.update(place for place, line in enumerate(lines) if _escapes(line))
    if max(map(len, lines)) > SHORT:
        found.update(place for place, line in enumerate(lines) if len(line) > SHORT and _endless(line))
    return found


def repeated(lines: Iterable[bytes], key: bytes) -> set[int]:
    """The places of lines in which a quoted key stands more than once, as a key or as anything else."""
    return {place for place, line in enumerate(lines) if line.count(key) > 1}


def utf8(text: bytes) -> bool:
    """Whether that is what the bytes are."""
    if text.isascii():
        return True
    try:
        text.decode()
    except UnicodeDecodeError:
        return False
    return True


def _escapes(text: bytes) -> bool:
    """Whether some ASCII letter or sign is written by its number, as those of a key could be."""
    place = text.find(b"\\")
    while place >= 0:
        if text.startswith(b"u00", place + 1) and text[place + 4 : place + 5] in _ASCII:
            return True
        place = text.find(b"\\", place + 2)
    return False


def _endless(line: bytes) -> bool:
    return (
        line.count(b"{") + line.count(b"[") > MAX_DEPTH
        or len(line) > MAX_LINE
        or (len(line) > MAX_DIGITS and bool(_DIGITS.search(line)))
    )
