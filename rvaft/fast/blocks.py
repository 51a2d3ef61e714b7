"""A stream of bytes cut into blocks of whole lines."""

from collections.abc import Iterator
from functools import cached_property
from io import BufferedIOBase
from typing import Final

from rvaft.traces import BOM, MAX_LINE, failures_of, unreadable

SIZE: Final = 1 << 16
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
        self.line = 1
        """The number of the first line of the block that comes next; kept by who takes the blocks."""

    def __iter__(self) -> Iterator[Block]:
        """Raises `TraceError` where the file cannot be read."""
        failures = failures_of(self._file)
        held: list[bytes] = []
        size = 0
        begun = False
        while True:
            try:
                data = self._stream.read1(SIZE)
            except failures as error:
                raise unreadable(error, self._file, self.line) from error
            end = data.rfind(b"\n") + 1
            if data and not end and size <= MAX_LINE:
                held.append(data)
                size += len(data)
                continue
            text = b"".join((*held, data[:end]))
            if not begun:
                text = text.removeprefix(BOM)
            begun = True
            if text:
                yield Block(text)
            if not data or size > MAX_LINE:
                return
            held = [data[end:]]
            size = len(held[0])
