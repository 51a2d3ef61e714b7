"""A limit on the time that a computation takes."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Expired(BaseException):
    """The time is up; not an `Exception`, so that nobody takes it for a failure of what it interrupts."""


@contextmanager
def within(seconds: float | None) -> Iterator[None]:
    """Raise `Expired` inside the block after so many seconds; None is no limit.

    Works by a signal, so only in the main thread of a process and between two steps of the interpreter; elsewhere there is no limit.
    """
    if seconds is None or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGALRM"):
        yield
        return

    def expire(_signal: int, _frame: FrameType | None) -> None:
        raise Expired

    before = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
