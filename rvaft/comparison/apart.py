"""Work in a process that is forked for it: whatever it reads, remembers or breaks is gone with it."""

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import NoReturn, TypeVar

from rvaft.comparison.bounds import SLACK, bound_time, time_left, time_spent

T = TypeVar("T")


class Died(Exception):
    """The process ended without a result; `code` is its exit status, or minus the number of the signal that ended it."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(code)


def apart(work: Callable[[], T], *, seconds: float | None = None) -> T:
    """What the work gives, which has to be something that can be pickled.

    It may use so many seconds of the processor, or those that are left to this process, of which they are taken. Raises `Died`.
    """
    left, clock = time_left() if seconds is None else (seconds, SLACK * seconds)
    heard, said = Pipe(duplex=False)
    process = os.fork()
    if not process:
        _do(work, said, left, clock)
    said.close()
    try:
        with heard:
            result: list[T] = [heard.recv()]
    except EOFError:
        result = []
    finally:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)  # it has said all, or nobody wants to know it any more
        _, status, used = os.wait4(process, 0)
    if seconds is None:
        time_spent(used.ru_utime + used.ru_stime)
    if not result:
        raise Died(os.waitstatus_to_exitcode(status))
    return result[0]


def _do(work: Callable[[], object], said: Connection, seconds: float, clock: float) -> NoReturn:
    status = 1
    try:
        bound_time(seconds, clock=clock)
        said.send(work())
        status = 0
    finally:
        os._exit(status)  # and nothing that the parent has to clean up is touched
