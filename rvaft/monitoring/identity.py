"""Whether a trace is the one that was read before."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from rvaft.compressed import SUFFIXES
from rvaft.errors import OptionError

_EDGE: Final = 1 << 16
"""Bytes at the start of a trace, and before the place that was reached, by which it is known again."""


@dataclass(frozen=True, slots=True)
class Identity:
    """By what a trace is known again: digests of the first and of the last bytes among the first `length` of the file.

    Neither the path nor the inode counts: a log that was moved, restored or synchronised is the same trace as long as it begins with the
    same bytes. Of a compressed file these are the compressed bytes, all there are; more may follow in each case.
    """

    length: int
    head: str
    tail: str


def identity(trace: Path | BinaryIO, offset: int) -> Identity:
    """The identity of a trace that was read up to this offset; a stream is an uncompressed file, and is moved.

    Raises `OSError` for what cannot be read, and `OptionError` for what is no regular file or ends before.
    """
    if not isinstance(trace, Path):
        return first(trace, offset)
    if not trace.is_file():
        trace.stat()
        raise OptionError(f"{trace}: a checkpoint needs a trace in a regular file")
    with trace.open("rb") as stream:
        return first(stream, trace.stat().st_size if compressed(trace) else offset)


def first(stream: BinaryIO, length: int) -> Identity:
    """The identity of the first `length` bytes of a file; raises `OptionError` if it has fewer."""
    stream.seek(0)
    head = stream.read(min(length, _EDGE))
    start = max(0, length - _EDGE)
    stream.seek(start)
    tail = stream.read(length - start)
    if len(tail) < length - start:
        raise OptionError(f"the trace has fewer than {length} bytes")
    return Identity(length, _sha(head), _sha(tail))


def compressed(path: Path) -> bool:
    """Whether a file is read through a decompressor."""
    return path.suffix.lower() in SUFFIXES


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
