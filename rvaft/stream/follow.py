"""A file that grows, read line by line: what is there, then what comes, until somebody asks for the end.

The file is looked at now and then with `os.stat`, which works on every file system. Logs are
rotated in two ways. Renaming: another file stands at the path; the old one is read to its end
first, and its last line may lack a line end. Truncating, or writing the file anew: what was read
last is no longer there; a line that was still unfinished is dropped. Either way the file is then
read from its start, and that is told. Two rotations between two looks are one, and the file between
them is not seen.
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

POLL: Final = 0.2
"""Seconds between two looks at a file."""
_BLOCK: Final = 1 << 18
"""Bytes that are read at once."""
_KEPT: Final = 256
"""Bytes before the place of reading that tell whether the file is still the same."""


class FollowedFile(io.IOBase):
    """The lines of a file as it grows, to be closed after use; `rvaft.readers.json_lines.read` takes it for a trace.

    It tells `changed`, in a sentence, when it goes over to another file and `idle` that nothing
    comes, and ends as soon as `stop` says so; a line that is unfinished then is not given. `offset`
    is where to begin, at the start of a line, and `line` how many lines are before.

    Raises `OSError` for a file that cannot be opened, also later for the one that replaces it, and
    `OptionError` for what is no regular file, for a compressed one, and for one that ends before
    `offset`.

    The attributes `offset` and `line` say how many bytes and lines of the present file, `file`,
    have been given. Nothing moves `file` but this object, which looks for its place every time.
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
        self.file = _opened(self.path)
        self._next: BinaryIO | None = None
        """The file that stands at the path now, once it is another one."""
        self._ending = False
        """Whether what is ready is the last line of the file."""
        self._marked = False
        """Whether a byte order mark may come: at the start of each file but the first, where it is
        left to who reads the trace.
        """
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
        """How many bytes of the present file have been given."""
        return self._position - len(self._ready)

    @property
    def unfinished(self) -> int:
        """How many bytes of a line without an end are not given."""
        return len(self._ready)

    def close(self) -> None:
        """Close the file."""
        self.file.close()
        if self._next is not None:
            self._next.close()
        super().close()

    def readline(self, size: int | None = -1) -> bytes:
        """The next line once it is whole, or the first `size` bytes of a longer one; nothing after
        the end was asked for.
        """
        most = sys.maxsize if size is None or size < 0 else size
        while True:
            end = self._ready.find(b"\n", self._searched) + 1
            if end or most <= len(self._ready):
                given = bytes(self._ready[: min(end or most, most)])
                del self._ready[: len(given)]
                self._searched = 0
                self.line += given.endswith(b"\n")
                if self._ending:  # whoever waited for it had room for all of it
                    self._replace()
                return given
            self._searched = len(self._ready)
            if not self._more():
                return b""

    def _more(self) -> bool:
        """Wait until more is ready; False once the end is asked for. What is ready has no line end yet."""
        while not self._stop():
            if self._fill():
                return True
            if self._next is None:
                with suppress(FileNotFoundError):  # a path where nothing stands is waited for
                    if not os.path.samestat(self.path.stat(), os.fstat(self.file.fileno())):
                        self._next = _opened(self.path)
                self._idle()
                time.sleep(POLL)  # whoever writes to the old file may not have noticed yet
            elif self._ready:
                self._ready += b"\n"
                self._ending = True
                return True
            else:
                self._replace()
        return False

    def _fill(self) -> bool:
        """Read on; whether there was something.

        What stands before is read again, to see whether it is still the same.
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
    """Within, Ctrl-C or SIGTERM asks for the end: gives the function that says whether one came.

    After the first one the signals do what they did before, so that a second Ctrl-C interrupts at
    once. For the main thread alone, as Python has it for signals.
    """
    asked = False

    def restore() -> None:
        for each, handler in before.items():
            signal.signal(each, handler)

    def ask(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        restore()

    before = {each: signal.signal(each, ask) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    finally:
        restore()


def _opened(path: Path) -> BinaryIO:
    if not stat.S_ISREG(path.stat().st_mode):  # before it is opened: opening a pipe waits for somebody who writes
        raise OptionError(f"{path}: only a regular file can be followed")
    return cast("BinaryIO", path.open("rb", buffering=0))
