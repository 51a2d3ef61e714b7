"""The events that an explanation names, found again after they were read.

Those that may become part of a match are remembered, up to a bound; beyond it the oldest are forgotten. In a regular file they are
then looked up where they stand; in a stream they are gone, and an explanation does without them.
"""

import re
from collections import OrderedDict
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from io import BufferedIOBase
from pathlib import Path
from typing import Final, cast

from rvaft.analysis.pattern_index import Scope
from rvaft.errors import RvaftError
from rvaft.model.values import Json
from rvaft.monitoring.fast_reader import Block, Blocks
from rvaft.monitoring.reader import BLANK, decode
from rvaft.support.files import opened

BOUND: Final = 10_000
"""How many events are remembered."""

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
    with suppress(OSError, RvaftError, ValueError), opened(path) as stream:
        for number, line in _lines(Blocks(cast("BufferedIOBase", stream), str(path)), numbers):
            found[number] = decode(line, reads=reads)
            if len(found) == len(numbers):
                break
    return found


def _lines(blocks: Iterable[Block], numbers: set[int]) -> Iterator[tuple[int, bytes]]:
    """The lines of the events that have these numbers. Blocks without any are counted and not split."""
    number = 0
    for block in blocks:
        text = block.text
        if text[:1] not in BLANK and not _UNSURE.search(text):
            count = text.count(b"\n") + (not text.endswith(b"\n"))
            if numbers.isdisjoint(range(number + 1, number + count + 1)):
                number += count
                continue
        for line in block.lines:
            if line.strip(BLANK):
                number += 1
                if number in numbers:
                    yield number, line
