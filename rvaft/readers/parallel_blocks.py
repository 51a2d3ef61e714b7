"""One file read by several processes: each takes stretches of it and makes batches of their lines,
which are given in the order of the file.

Only what a `JsonBlockReader` gives is sent, so little of what concerns nothing; the monitors stay
in one process, and cannot tell who has read.
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
from rvaft.readers.json_blocks import EventBlock, JsonBlockReader
from rvaft.readers.json_lines import MAX_DEPTH
from rvaft.support.processes import Killed, in_processes

STRETCH: Final = 1 << 20
"""Bytes that a process reads at a time; a file that is not longer is read by one."""


class _Stretch(BufferedIOBase):
    """The lines of a file that begin between two places, without an end all the rest; the file itself is not moved."""

    def __init__(self, handle: int, start: int, end: int | None, *, torn: bool) -> None:
        super().__init__()
        self._handle = handle
        self._torn = torn
        """Whether a line that began before may go on here."""
        self._place = start - torn
        self._end = sys.maxsize if end is None else end
        self._last = b"\n"

    def read1(self, size: int | None = -1) -> bytes:
        """The next bytes, up to so many."""
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
        """The next bytes, up to so many, or to the end of the line if that comes first."""
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
) -> Iterator[EventBlock]:
    """What `reader.read` gives of a regular file, from the place on where the source is, which is the start of a line.

    Raises what it raises.
    """
    handle, begin = source.fileno(), source.tell()
    starts = range(begin, max(os.fstat(handle).st_size, begin + 1), STRETCH)

    def work(start: int) -> tuple[list[bytes], list[tuple[int, int]], tuple[str, int | None] | None]:
        end = None if start == starts[-1] else start + STRETCH
        stretch = _Stretch(handle, start, end, torn=start > begin)
        sizes: list[tuple[int, int]] = []
        found: list[bytes] = []
        failure: tuple[str, int | None] | None = None
        first = 1 if start == 0 else 2  # where a byte order mark may stand
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
                source.seek(start)  # for who looks how far it was read
            before = line
            for batch, (size, lines) in zip(found, sizes, strict=True):
                line += lines
                reached(size, lines)
                yield _unpacked(batch)
            if failure is not None:
                message, place = failure
                raise TraceError(message, file=file, line=None if place is None else before + place)


def _packed(batch: EventBlock) -> bytes:
    """A batch as bytes: fast where its values are plain, and else whatever they are."""
    found = tuple(map(list, batch[1:]))
    try:
        return b"m" + marshal.dumps((batch.total, *found))
    except ValueError:
        limit = sys.getrecursionlimit()
        sys.setrecursionlimit(limit + 4 * MAX_DEPTH)
        try:
            return b"p" + pickle.dumps((batch.total, *found), protocol=5)
        finally:
            sys.setrecursionlimit(limit)


def _unpacked(data: bytes) -> EventBlock:
    found = memoryview(data)[1:]
    return EventBlock(*(marshal.loads(found) if data.startswith(b"m") else pickle.loads(found)))  # noqa: S301, S302
