"""Work on many things in several processes, with the results in the order of the things."""

import gc
import multiprocessing
import os
import resource
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from time import thread_time
from typing import Any, Final, Generic, NoReturn, TypeVar

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
    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_Worker.prepare, initargs=(work,))
    finished = False
    waiting = deque[tuple[Item, Future[Result]]]()
    rest = iter(items)
    try:
        waiting.extend(_submitted(pool, islice(rest, jobs * _AHEAD)))
        while waiting:
            item, future = waiting.popleft()
            try:
                yield item, future.result()
            except BrokenProcessPool:
                yield item, Killed()
            waiting.extend(_submitted(pool, islice(rest, 1)))
        finished = True
    finally:
        if not finished:  # nobody wants the rest
            for process in multiprocessing.active_children():
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


def _submitted(pool: ProcessPoolExecutor, items: Iterable[Item]) -> list[tuple[Item, Future[Any]]]:
    submitted: list[tuple[Item, Future[Any]]] = []
    for item in items:
        future: Future[Any]
        try:
            future = pool.submit(_Worker.run, item)
        except BrokenProcessPool as broken:
            future = Future()
            future.set_exception(broken)
        submitted.append((item, future))
    return submitted


class _Worker(Generic[Item, Result]):
    """The work of a process, which is there because the process is a copy: it cannot be sent."""

    work: Callable[[Any], Any]

    @classmethod
    def prepare(cls, work: Callable[[Any], Any]) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the parent to handle
        cls.work = staticmethod(work)

    @classmethod
    def run(cls, item: Any) -> Any:
        return cls.work(item)


# What a process may use: processor time, time by the clock, memory. Set in a process for good, it is never one that goes on with other work.
#
# A process that takes too long is ended by a signal, whatever it is doing: `LATE` after so much processor time, `STUCK` by the clock.

LATE: Final = signal.SIGPROF
STUCK: Final = signal.SIGALRM
SLACK: Final = 10
"""How much longer than of the processor something may take by the clock, for each of the processes that share the machine."""
_MEGABYTE: Final = 2**20
_SOON: Final = 1e-6
"""Seconds; none at all would stop the timer."""


def bound_time(seconds: float, *, clock: float) -> None:
    """From now on so many seconds of the processor, and so many by the clock in case that it waits for something and uses none."""
    for number in (LATE, STUCK):
        signal.signal(number, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, clock)


def time_left() -> tuple[float, float]:
    """The seconds of the processor that are left, and those by the clock; 0 where nothing bounds them."""
    return signal.getitimer(signal.ITIMER_PROF)[0], signal.getitimer(signal.ITIMER_REAL)[0]


def time_spent(seconds: float) -> None:
    """Count so many seconds of a child as those of this process."""
    if left := time_left()[0]:
        signal.setitimer(signal.ITIMER_PROF, max(left - seconds, _SOON))


def end_if_late(seconds: float) -> None:
    """End a process that has used more, for which the system has not looked at its clock yet."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    if thread_time() + children.ru_utime + children.ru_stime > seconds:
        signal.raise_signal(LATE)


def bound_memory(megabytes: int) -> None:
    """From now on whoever asks for more gets a `MemoryError`; what was there before counts."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    wanted = megabytes * _MEGABYTE
    resource.setrlimit(resource.RLIMIT_AS, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))


def free_memory() -> None:
    """Take that bound away, to have room for telling that it was met."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


# Work in a process that is forked for it: whatever it reads, remembers or breaks is gone with it.

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


# The collector of cyclic garbage, which else runs in the middle of what is timed.


@contextmanager
def no_collection() -> Iterator[None]:
    """It rests meanwhile, as in `timeit`."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
