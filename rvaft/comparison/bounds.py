"""What a process may use: processor time, time by the clock, memory. Set in a process for good, it is never one that goes on with other work.

A process that takes too long is ended by a signal, whatever it is doing: `LATE` after so much processor time, `STUCK` by the clock.
"""

import resource
import signal
from time import thread_time
from typing import Final

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
