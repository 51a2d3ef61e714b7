"""A stream of bytes cut into blocks of whole lines."""

from collections.abc import Iterator
from functools import cached_property
from io import DEFAULT_BUFFER_SIZE, BufferedIOBase
from pathlib import Path
from typing import Final

from rvaft.compressed import SUFFIXES
from rvaft.traces import BOM, MAX_LINE, failures_of, unreadable

SIZE: Final = 3 << 15
"""Bytes that are read at once: small enough for the caches of the machine."""


class Block:
    """Whole lines, as one piece of bytes."""

    def __init__(self, text: bytes) -> None:
        self.text = text

    @cached_property
    def lines(self) -> list[bytes]:
        """The lines without their ends."""
        lines = self.text.split(b"\n")
        if not lines[-1]:
            lines.pop()
        return lines

    def within(self, length: int) -> bool:
        """Whether certainly no line is longer than that."""
        text, half = self.text, length // 2
        return all(text.find(b"\n", start, start + half) >= 0 for start in range(0, len(text) - half, half))


class Blocks:
    """The lines of a stream in turn; one longer than `MAX_LINE` is the last."""

    def __init__(self, stream: BufferedIOBase, file: str) -> None:
        self._stream = stream
        self._file = file
        self._failures = failures_of(file)
        # Damaged data is lost from the call on that meets it, so there no more is asked for at once than when it is read by lines.
        self._at_once = min(SIZE, DEFAULT_BUFFER_SIZE) if Path(file).suffix.lower() in SUFFIXES else SIZE
        self.line = 1
        """The number of the first line of the block that comes next; kept by who takes the blocks."""

    def __iter__(self) -> Iterator[Block]:
        """Raises `TraceError` where the file cannot be read, after the lines that end before."""
        held = b""
        begun = False
        while True:
            text, more, failure = self._more(held)
            whole = not more and failure is None
            end = len(text) if whole else text.rfind(b"\n") + 1
            given = text[:end] if begun else text[:end].removeprefix(BOM)
            begun = True
            if given:
                yield Block(given)
            if failure is not None:
                raise unreadable(failure, self._file, self.line) from failure
            if not more:
                return
            held = text[end:]

    def _more(self, held: bytes) -> tuple[bytes, bool, Exception | None]:
        """What is held and what comes after it, up to some line's end; whether there may be more; what it failed with."""
        pieces, size = [held], len(held)
        ended = False
        while size < SIZE or (not ended and size <= len(BOM) + MAX_LINE):
            try:
                data = self._stream.read1(self._at_once)
            except self._failures as error:
                return b"".join(pieces), False, error
            if not data:
                return b"".join(pieces), False, None
            pieces.append(data)
            size += len(data)
            ended = ended or b"\n" in data
        return b"".join(pieces), ended, None
