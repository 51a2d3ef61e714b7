"""Standard output and error of servers and other runs without an end, which nobody may read.

A thread writes the lines for standard error, so they never block a run. Beyond `ROOM` characters
lines are dropped, and a later line has their number. Standard output does block, because it is the
result; after a stop was requested, it blocks for `PATIENCE` at most.
"""

import errno
import io
import os
import select
import stat
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Condition, Thread
from time import monotonic
from typing import Any, Final, cast

ROOM: Final = 1 << 20
"""Maximum number of characters that wait for standard error."""
PATIENCE: Final = 1.0
"""Seconds for pending output at the end, and for commands after a stop was requested."""
_POLL: Final = 0.1


class Stop:
    """Whether a signal has requested a stop, and when."""

    _at: float | None = None

    def request(self) -> None:
        """Note the request; may be called by a signal handler."""
        self._at = monotonic()

    def reset(self) -> None:
        """Forget an earlier request."""
        self._at = None

    def passed(self, seconds: float = 0.0) -> bool:
        """Whether the request is so many seconds old."""
        return self._at is not None and monotonic() - self._at >= seconds


STOP: Final = Stop()
"""The stop of this process."""


class LogStream(io.TextIOBase):
    r"""A text stream to a file descriptor; writing never blocks.

    >>> import os
    >>> reading, writing = os.pipe()
    >>> stream = LogStream(writing)
    >>> stream.write("a line\n"), stream.finish(), os.read(reading, 100)
    (7, True, b'a line\n')
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting = deque[str]()
        self._changed = Condition()
        self._size = self._lost = 0
        self._busy = False
        self._thread: Thread | None = None
        self._process = os.getpid()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The encoding of the text."""
        return "utf-8"

    @property
    def errors(self) -> str:  # type: ignore[override]
        """How characters without an encoding are written."""
        return "backslashreplace"

    def fileno(self) -> int:
        """The file descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether the descriptor is a terminal."""
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        """Text can always be written."""
        return True

    def write(self, text: str, /) -> int:
        """Queue text, or drop and count its lines if there is no room."""
        if not isinstance(text, str):
            raise TypeError(f"write() argument must be str, not {type(text).__name__}")
        if not text:
            return 0
        if os.getpid() != self._process:  # a forked process has no thread
            with suppress(OSError):
                os.write(self._descriptor, text.encode(self.encoding, self.errors))
            return len(text)
        with self._changed:
            if self._size + len(text) > ROOM:
                self._lost += text.count("\n")
                return len(text)
            self._waiting.append(text)
            self._size += len(text)
            if self._thread is None:
                self._thread = Thread(target=self._serve, name="log", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        return len(text)

    def finish(self, patience: float = PATIENCE) -> bool:
        """Wait until all is written; return False if it was not within so many seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._waiting or self._busy), patience)

    def _serve(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting)
                text, lost = "".join(self._waiting), self._lost
                self._waiting.clear()
                self._size = self._lost = 0
                self._busy = True
            if lost:
                lines = "1 line was" if lost == 1 else f"{lost} lines were"
                text += f"rvaft: warning: {lines} dropped here: standard error was not read\n"
            data = text.encode(self.encoding, self.errors)
            with suppress(OSError):  # nobody can read it any more
                while data:
                    data = data[os.write(self._descriptor, data[: select.PIPE_BUF]) :]


class _Output(io.RawIOBase):
    """A file descriptor to which writing blocks until shortly after `STOP`; raises `OSError`."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLOUT)

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        return True

    def write(self, data: Any, /) -> int:
        while not self._poll.poll(_POLL * 1000):
            if STOP.passed(PATIENCE):
                raise OSError(errno.ETIMEDOUT, "nothing reads it, so the rest of the output is lost")
        # so much can be written at once to a pipe that can be written to
        return os.write(self._descriptor, memoryview(data).cast("B")[: select.PIPE_BUF])


def unblock() -> None:
    """Let standard error never block, and standard output not after a stop was requested.

    Streams that cannot block, such as files, are left as they are.
    """
    if sys.stderr is not None and _may_block(sys.stderr, 2):
        sys.stderr.flush()
        sys.stderr = LogStream(2)
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper) and _may_block(out, 1):
        out.flush()
        raw = cast("Any", io.BufferedWriter(_Output(1), 1 << 16))
        sys.stdout = io.TextIOWrapper(raw, out.encoding, "backslashreplace", line_buffering=out.line_buffering)


def finish() -> None:
    """Wait a short time for lines of standard error that are not written yet."""
    if isinstance(sys.stderr, LogStream):
        sys.stderr.finish()


def waits(wait: Callable[[float], object], timeout: float) -> None:
    """Wait in short steps, up to a timeout, or until `PATIENCE` seconds after a requested stop.

    `wait` gets the seconds of a step, and raises `TimeoutError` if that was too short. Raises
    `TimeoutError`, too.
    """
    until = monotonic() + timeout
    while True:
        try:
            wait(min(_POLL, max(until - monotonic(), 0)))
        except TimeoutError:
            if monotonic() >= until or STOP.passed(PATIENCE):
                raise
        else:
            return


def _may_block(stream: Any, descriptor: int) -> bool:
    """Whether a stream is the standard one of the process, and not a regular file."""
    try:
        mode = os.fstat(stream.fileno()).st_mode
    except (OSError, ValueError, AttributeError):
        return False
    own = stream.fileno() == descriptor and not isinstance(stream, LogStream)
    return own and (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or stat.S_ISCHR(mode))
