"""Work on many things in several processes, with the results in the order of the things."""

import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from typing import Any, Final, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_AHEAD: Final = 8
"""Things that wait for each process."""


class Killed(Exception):
    """A process that worked was killed; what it worked on, and what waited for it, has no result."""


def in_processes(
    work: Callable[[Item], Result], items: Iterable[Item], *, jobs: int
) -> Generator[tuple[Item, Result | Killed], None, None]:
    """Each thing with its result, in order; close the iterator to stop early, and all processes end.

    Things are taken from `items` a few ahead of the `jobs` processes, which are all made at once. `work` is called in
    processes that are copies of this one, made before the first result; things and results are sent by pickling.
    """
    # Most commands need no other process, and these are slow to import.
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
        if not finished:  # nobody wants the rest
            for process in multiprocessing.active_children():
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


_work: list[Callable[[Any], Any]] = []
"""The work of a process, which is there because the process is a copy: it cannot be sent."""


def _prepare(work: Callable[[Any], Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the parent to handle
    _work[:] = [work]


def _do(item: Any) -> Any:
    return _work[0](item)
