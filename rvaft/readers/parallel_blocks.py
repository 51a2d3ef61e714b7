"""One file of JSON Lines decoded by several processes; the blocks come in the order of the file.

Processes send only the output of a `JsonBlockReader`. The monitors run in one process.
"""

import marshal
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from io import BufferedIOBase
from typing import Final

from rvaft.errors import TraceError
from rvaft.readers.json_blocks import JsonBlockReader
from rvaft.readers.json_lines import MAX_DEPTH
from rvaft.readers.log import Batch
from rvaft.support.processes import Killed, in_processes

STRETCH: Final = 1 << 20
"""Bytes per task."""


class _Stretch(BufferedIOBase):
    """The lines that begin between two offsets of a file."""

    def __init__(self, handle: int, start: int, end: int | None, *, torn: bool) -> None:
        super().__init__()
        self._handle = handle
        self._torn = torn
        """Whether an earlier line may continue here."""
        self._place = start - torn
        self._end = sys.maxsize if end is None else end
        self._last = b"\n"

    def read1(self, size: int | None = -1) -> bytes:
        """Return the next bytes."""
        most = STRETCH if size is None or size < 0 else size
        while self._torn:
            data = self._more(min(most, self._end - self._place))
            start = data.find(b"\n") + 1
            self._torn = bool(data) and not start
            if data[start:] and not self._torn:
                return data[start:]
        if self._place < self._end:
            return self._more(min(most, self._end - self._place))
        if self._last == b"\n":
            return b""
        return self._more(most, to_end=True)

    def _more(self, most: int, *, to_end: bool = False) -> bytes:
        """Return up to `most` bytes, with `to_end` at most up to the end of the line."""
        data = os.pread(self._handle, most, self._place) if most > 0 else b""
        data = data[: data.find(b"\n") + 1 or len(data)] if to_end else data
        self._place += len(data)
        self._last = data[-1:] or b"\n"
        return data


def read_in_processes(
    reader: JsonBlockReader,
    source: BufferedIOBase,
    file: str,
    *,
    jobs: int,
    line: int = 1,
    reached: Callable[[int, int], None] = lambda _size, _lines: None,
) -> Iterator[Batch]:
    """Yield the blocks of a regular file from its position, the start of a line."""
    handle, begin = source.fileno(), source.tell()
    starts = range(begin, max(os.fstat(handle).st_size, begin + 1), STRETCH)

    def work(start: int) -> tuple[list[bytes], list[tuple[int, int]], tuple[str, int | None] | None]:
        end = None if start == starts[-1] else start + STRETCH
        stretch = _Stretch(handle, start, end, torn=start > begin)
        sizes: list[tuple[int, int]] = []
        found: list[bytes] = []
        failure: tuple[str, int | None] | None = None
        first = 1 if start == 0 else 2  # line 1 may begin with a byte order mark
        try:
            batches = reader.read(stretch, file, line=first, reached=lambda *one: sizes.append(one))
            found.extend(map(_packed, batches))
        except TraceError as error:
            failure = error.message, None if error.line is None else error.line - first
        return found, sizes, failure

    with closing(in_processes(work, starts, jobs=min(jobs, len(starts)))) as running:
        for start, result in running:
            if isinstance(result, Killed):
                raise TraceError("cannot be read: the process that read it was killed", file=file, line=line)
            found, sizes, failure = result
            if source.seekable():
                source.seek(start)  # for the progress bar
            before = line
            for batch, (size, lines) in zip(found, sizes, strict=True):
                line += lines
                reached(size, lines)
                block = _unpacked(batch)
                later = before - (1 if start == 0 else 2)
                every = [one + later for one in block.lines if one is not None]
                yield block._replace(lines=every or range(line - lines, line - lines + block.total))
            if failure is not None:
                message, place = failure
                raise TraceError(message, file=file, line=None if place is None else before + place)


def _packed(batch: Batch) -> bytes:
    """Serialise a block, if possible with `marshal`."""
    found = tuple([] if one is batch.lines and isinstance(one, range) else list(one) for one in batch[1:5])
    try:
        return b"m" + marshal.dumps((batch.total, *found))
    except ValueError:
        limit = sys.getrecursionlimit()
        sys.setrecursionlimit(limit + 4 * MAX_DEPTH)
        try:
            return b"p" + pickle.dumps((batch.total, *found), protocol=5)
        finally:
            sys.setrecursionlimit(limit)


def _unpacked(data: bytes) -> Batch:
    found = memoryview(data)[1:]
    return Batch(*(marshal.loads(found) if data.startswith(b"m") else pickle.loads(found)))  # noqa: S301, S302
