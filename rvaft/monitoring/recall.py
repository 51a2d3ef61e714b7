"""The events that an explanation names, found again after they were read.

Those that may become part of a match are remembered, up to a bound; beyond it the oldest are forgotten. In a regular file they are
then looked up where they stand; in a stream they are gone, and an explanation does without them.
"""

import re
from collections import OrderedDict
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from rvaft.compressed import SUFFIXES, damage, opened
from rvaft.errors import RvaftError
from rvaft.reads import Scope
from rvaft.traces import decode
from rvaft.values import Json

BOUND: Final = 10_000
"""How many events are remembered."""

_BOM: Final = b"\xef\xbb\xbf"
_BLANK: Final = b" \t\r\n"
_BLOCK: Final = 1 << 20
_UNSURE: Final = re.compile(rb"\n[ \t\r\n]")
"""What may be a blank line, which counts as no event."""


class Recall:
    """The events of one trace by their numbers.

    `path` is the file in which they are numbered as they stand, if there is one, and `reads` what was read of them.
    """

    def __init__(self, path: Path | None = None, *, reads: Scope | None = None, bound: int = BOUND) -> None:
        self.path = path
        self.reads = reads
        self.bound = bound
        self.known: OrderedDict[int, Json] = OrderedDict()  # a dict looks for its first key among all that were removed
        """Those that are remembered."""

    def remember(self, number: int, event: Json) -> None:
        """An event that may become part of a match."""
        if len(self.known) >= self.bound:
            self.known.popitem(last=False)
        self.known[number] = event

    def events(self, numbers: Collection[int]) -> Mapping[int, Json]:
        """Those of these events that are known."""
        known = {number: self.known[number] for number in numbers if number in self.known}
        missing = {number for number in numbers if number not in known}
        if missing and self.path is not None:
            known |= _found(self.path, missing, self.reads)
        return known


def _found(path: Path, numbers: set[int], reads: Scope | None) -> dict[int, Json]:
    """The events of a file that have these numbers; what has changed since it was read is left out."""
    found: dict[int, Json] = {}
    damaged = damage() if path.suffix.lower() in SUFFIXES else ()
    with suppress(OSError, RvaftError, ValueError, *damaged), opened(path) as stream:
        for number, line in _lines(stream, numbers):
            found[number] = decode(line, reads=reads)
            if len(found) == len(numbers):
                break
    return found


def _lines(stream: BinaryIO, numbers: set[int]) -> Iterator[tuple[int, bytes]]:
    """The lines of the events that have these numbers. Blocks without any are counted and not split."""
    number = 0
    for chunk in _chunks(stream):
        if chunk[:1] not in _BLANK and not _UNSURE.search(chunk):
            count = chunk.count(b"\n")
            if numbers.isdisjoint(range(number + 1, number + count + 1)):
                number += count
                continue
        for line in chunk.split(b"\n"):
            if line.strip(_BLANK):
                number += 1
                if number in numbers:
                    yield number, line


def _chunks(stream: BinaryIO) -> Iterator[bytes]:
    """The file in pieces of whole lines, each with a line end."""
    rest = stream.read(len(_BOM)).removeprefix(_BOM)
    while block := stream.read(_BLOCK):
        cut = block.rfind(b"\n") + 1
        if not cut:
            rest += block
            continue
        yield rest + block[:cut]
        rest = block[cut:]
    if rest:
        yield rest + b"\n"
