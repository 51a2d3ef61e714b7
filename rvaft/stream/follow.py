"""Follows a growing file line by line, until a stop is requested.

The file is polled with `os.stat`, which works on every file system. Two forms of log rotation are
detected, read from the start, and reported. After renaming, a new file stands at the path; the old
one is read to its end first, and its last line may lack a line end. After truncating or rewriting,
the bytes last read have changed; an unfinished line is dropped. A file that is replaced twice
between two polls is missed.
"""

import io
import os
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import BinaryIO, Final, cast

from rvaft.errors import OptionError
from rvaft.readers.log import BOM
from rvaft.support.files import SUFFIXES
from rvaft.support.output import STOP

POLL: Final = 0.2
"""Seconds between polls."""
_BLOCK: Final = 1 << 18
"""Bytes read at a time."""
_KEPT: Final = 256


class FollowedFile(io.IOBase):
    """The lines of a file as it grows; an input stream for `rvaft.readers.json_lines.read`.

    `changed` is called with a message when another file begins, `idle` while no data comes. Reading
    ends once `stop` returns true, also before lines that are in the buffer. It starts at `offset`,
    the start of a line, after `line` lines. The attributes `offset` and `line` count what was returned of the
    current `file`.

    Raises `OSError` for a file that cannot be opened, also later for its replacement. Raises
    `OptionError` for a file that is compressed, not regular, or shorter than `offset`.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        stop: Callable[[], bool],
        changed: Callable[[str], object],
        idle: Callable[[], object],
        offset: int = 0,
        line: int = 0,
    ) -> None:
        super().__init__()
        self.path = Path(path)
        if self.path.suffix.lower() in SUFFIXES:
            raise OptionError(f"{self.path}: a compressed file cannot be followed")
        self._stop = stop
        self._changed = changed
        self._idle = idle
        self.line = line
        self.given = line
        """The number of the line returned last, in its file."""
        self.file = _opened(self.path)
        self._next: BinaryIO | None = None
        self._ending = False
        """Whether the buffer holds the last line of the file."""
        self._marked = False
        """Whether a byte order mark may follow."""
        self._ready = bytearray()
        self._searched = 0
        self._position = offset
        kept = min(offset, _KEPT)
        self.file.seek(offset - kept)
        self._before = self.file.read(kept)
        if len(self._before) < kept:
            self.close()
            raise OptionError(f"{self.path}: the file has fewer than {offset} bytes")

    @property
    def offset(self) -> int:
        """The number of bytes returned so far."""
        return self._position - len(self._ready)

    @property
    def unfinished(self) -> int:
        """The number of buffered bytes of an incomplete line; 0 if whole lines come first."""
        return 0 if b"\n" in self._ready else len(self._ready)

    @property
    def goes_on(self) -> bool:
        """Whether the file has whole lines, or bytes not looked at, after the line returned last."""
        return b"\n" in self._ready or os.fstat(self.file.fileno()).st_size > self._position

    def close(self) -> None:
        """Close the file."""
        self.file.close()
        if self._next is not None:
            self._next.close()
        super().close()

    def readline(self, size: int | None = -1) -> bytes:
        """Return the next line, or the first `size` bytes of it; b"" after the stop."""
        most = sys.maxsize if size is None or size < 0 else size
        while not self._stop():
            end = self._ready.find(b"\n", self._searched) + 1
            if end or most <= len(self._ready):
                given = bytes(self._ready[: min(end or most, most)])
                del self._ready[: len(given)]
                self._searched = 0
                self.line += given.endswith(b"\n")
                self.given = self.line
                if self._ending:  # the caller had room for the whole line
                    self._replace()
                return given
            self._searched = len(self._ready)
            self._look()
        return b""

    def _look(self) -> None:
        """Look for more bytes, and wait if there are none."""
        if self._fill():
            return
        if self._next is None:
            with suppress(FileNotFoundError):  # wait for a file at the path
                if not os.path.samestat(self.path.stat(), os.fstat(self.file.fileno())):
                    self._next = _opened(self.path)
            self._idle()
            time.sleep(POLL)  # the old file may still grow
        elif self._ready:
            self._ready += b"\n"
            self._ending = True
        else:
            self._replace()

    def _fill(self) -> bool:
        """Read on, and re-read preceding bytes to detect a rewrite; return whether there was
        data.
        """
        self.file.seek(self._position - len(self._before))
        seen = self.file.read(len(self._before) + _BLOCK)
        if not seen.startswith(self._before):
            lost = f"; an unfinished line of {len(self._ready)} bytes is lost" if self._ready else ""
            self._start_anew("was truncated or written anew", lost)
            return self._fill()
        new = seen[len(self._before) :]
        self._ready += new
        if self._marked and (self._ready.startswith(BOM) or not BOM.startswith(self._ready)):
            self._marked = False
            self._ready = self._ready.removeprefix(BOM)
        self._position += len(new)
        self._before = seen[-_KEPT:]
        return bool(new)

    def _replace(self) -> None:
        assert self._next is not None
        self.file.close()
        self.file, self._next = self._next, None
        self._ending = False
        self._start_anew("was replaced")

    def _start_anew(self, why: str, lost: str = "") -> None:
        self._changed(f"{self.path} {why} and is now read from its start{lost}")
        self._ready = bytearray()
        self._searched = self._position = self.line = 0
        self._before = b""
        self._marked = True


@contextmanager
def stopping() -> Iterator[Callable[[], bool]]:
    """Catch Ctrl-C and SIGTERM; yield a function that returns whether a signal came.

    The first signal restores the former handlers, so that a second Ctrl-C interrupts. It also ends
    commands and blocked output soon, through `STOP`. Must run in the main thread.
    """
    STOP.reset()

    def restore() -> None:
        for each, handler in before.items():
            signal.signal(each, handler)

    def request_stop(_number: int, _frame: FrameType | None) -> None:
        STOP.request()
        restore()

    before = {each: signal.signal(each, request_stop) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield STOP.passed
    finally:
        restore()


def _opened(path: Path) -> BinaryIO:
    if not stat.S_ISREG(path.stat().st_mode):  # opening a pipe would block
        raise OptionError(f"{path}: only a regular file can be followed")
    return cast("BinaryIO", path.open("rb", buffering=0))
