"""Parallel work in several processes, with results in the order of the items."""

import ctypes
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from typing import Any, Final, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_AHEAD: Final = 8
"""The number of waiting items per process."""


class Killed(Exception):
    """A worker process was killed; its item and the waiting items have no result."""


def in_processes(
    work: Callable[[Item], Result], items: Iterable[Item], *, jobs: int
) -> Generator[tuple[Item, Result | Killed], None, None]:
    """Iterate over the items with their results, in order; closing it stops all processes.

    A few items per process are read in advance. `jobs` processes are forked before the first
    result; items and results are pickled.
    """
    # Slow to import, and rarely needed.
    import multiprocessing  # noqa: PLC0415
    from concurrent.futures import Future, ProcessPoolExecutor  # noqa: PLC0415
    from concurrent.futures.process import BrokenProcessPool  # noqa: PLC0415

    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare, initargs=(work,))
    finished = False
    waiting = deque[tuple[Item, Future[Result]]]()
    rest = iter(items)

    def submit(count: int) -> None:
        for item in islice(rest, count):
            future: Future[Result] = Future()
            try:
                future = pool.submit(_do, item)
            except BrokenProcessPool as broken:
                future.set_exception(broken)
            waiting.append((item, future))

    try:
        submit(jobs * _AHEAD)
        while waiting:
            item, future = waiting.popleft()
            try:
                yield item, future.result()
            except BrokenProcessPool:
                yield item, Killed()
            submit(1)
        finished = True
    finally:
        if not finished:  # the remaining results are not needed
            for process in multiprocessing.active_children():
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


_DEATH_SIGNAL: Final = 1
_LIBC: Final = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


def end_with_parent() -> None:
    """Have this process killed when its parent ends, where the system can (Linux)."""
    if _LIBC is not None:
        _LIBC.prctl(_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)


_work: list[Callable[[Any], Any]] = []
"""The function of a process, inherited by the fork because it cannot be pickled."""


def _prepare(work: Callable[[Any], Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles interrupts
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with_parent()
    _work[:] = [work]


def _do(item: Any) -> Any:
    return _work[0](item)
