"""Opening a file that may be compressed: `.gz` by the standard library, `.zst` by the package `zstandard`."""

import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from rvaft.errors import ToolMissing

SUFFIXES: Final = (".gz", ".zst")
_CHUNK: Final = 1 << 16


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """The bytes of a file, decompressed where its suffix says that they are compressed.

    Raises `OSError` where it cannot be opened, and `ToolMissing`; what reading raises for damaged data is in `damage`.
    """
    with path.open("rb") as stream:
        match path.suffix.lower():
            case ".gz":
                with gzip.GzipFile(fileobj=stream) as inner:
                    yield cast("BinaryIO", inner)
            case ".zst":
                yield io.BufferedReader(_Zstd(stream))
            case _:
                yield stream


class _Zstd(io.RawIOBase):
    """Decompressed frames, one after the other; the package's own reader takes a truncated file for a whole one."""

    def __init__(self, source: BinaryIO) -> None:
        self._source = source
        self._start = _zstandard().ZstdDecompressor().decompressobj
        self._frame = self._start()
        self._begun = False
        self._ready = b""

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer as far as there is something; raises `EOFError` where the last frame is not whole."""
        while not self._ready:
            if self._frame.eof:
                data, self._frame, self._begun = self._frame.unused_data, self._start(), False
            else:
                data = b""
            data = data or self._source.read(_CHUNK)
            if not data:
                if self._begun:
                    raise EOFError("the compressed file ended before the end of the stream")
                return 0
            self._begun = True
            self._ready = self._frame.decompress(data)
        taken = min(len(buffer), len(self._ready))
        buffer[:taken], self._ready = self._ready[:taken], self._ready[taken:]
        return taken


def damage() -> tuple[type[Exception], ...]:
    """What reading compressed data raises where it is truncated or no such data."""
    try:
        found: tuple[type[Exception], ...] = (_zstandard().ZstdError,)
    except ToolMissing:
        found = ()
    return (EOFError, zlib.error, gzip.BadGzipFile, *found)


def _zstandard() -> Any:
    try:
        import zstandard  # noqa: PLC0415 -- imported on use
    except ImportError as error:
        raise ToolMissing("zstandard", remedy="pip install 'rvaft[zstd]', or decompress the file first") from error
    return zstandard
