"""Limits on work and time, and recursion without a stack limit.

Recursive functions are generators: `result = yield other(…)` calls, `return value` returns. Trees
may be thousands of gates deep, beyond Python's recursion limit.
"""

import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, TypeAlias, TypeVar

from rvaft.errors import RvaftError, TooLarge

T = TypeVar("T")
Call: TypeAlias = Generator[Any, Any, T]

DEFAULT_LIMIT: Final = 500_000
"""The default number of steps for a question that is hard in general."""
QUICK: Final = 10_000_000
"""The number of steps, about a second, that are allowed under any limit."""
SHORT: Final = 1_000_000
"""The number of characters of a text that are allowed under any limit."""


class Work:
    """A counter of the work of a construction; raises `TooLarge` beyond the limit.

    `limit` counts items; each allows `steps` and `characters`. `QUICK` steps and `SHORT` characters
    are always allowed.
    """

    def __init__(self, limit: int, *, item: str = "state", steps: int = 1000, characters: int = 100) -> None:
        self.limit = limit
        self._item = item
        self._each = steps
        self._characters = characters
        self._steps = 0

    def step(self, many: int) -> None:
        """Count more steps, of about 0.1 microseconds each."""
        self._steps += many
        if self._steps > QUICK:
            self.check(
                self._steps, f"steps of the construction, {self._each} allowed for each {self._item}", self._each
            )

    def size(self, characters: int) -> None:
        """Raise `TooLarge` if a text has too many characters."""
        if characters > SHORT:
            what = f"characters of the text, {self._characters} allowed for each {self._item}"
            self.check(characters, what, self._characters)

    def check(self, reached: int, what: str, each: int = 1) -> None:
        """Raise `TooLarge` if more than `each` per item is reached."""
        if reached > self.limit * each:
            raise TooLarge(what, limit=self.limit)


VISITS: Final = 20
"""The visits that one step may take for each partial match that the limit allows."""
MIN_VISITS: Final = 200_000
"""The visits, about a second, that one step may take under any limit."""


class StepWork:
    """The work of one step of a monitor, over all its searches; raises `TooLarge` beyond the limit.

    >>> effort = StepWork(100_000)
    >>> effort.spend(1_500_000, "ways")
    >>> effort.begin()
    >>> effort.spend(1_500_000, "ways")
    >>> effort.spend(600_000, "ways")
    Traceback (most recent call last):
    rvaft.errors.TooLarge: too large: one step of the monitor; it visits too many ways (limit 100000)
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._most = max(VISITS * limit, MIN_VISITS)
        self.spent = 0
        """The visits of the present step."""

    def begin(self) -> None:
        """Begin the next step."""
        self.spent = 0

    def spend(self, visits: int, what: str) -> None:
        """Count more visits, of a few microseconds each."""
        self.spent += visits
        if self.spent > self._most:
            remedy = "a smaller tree or a branch (--branch N) has fewer choices; --max-configurations allows more"
            raise TooLarge(f"one step of the monitor; it visits too many {what}", limit=self.limit, remedy=remedy)


class Undecided(RvaftError):
    """A question about the scenarios was not decided within the limit."""


@dataclass(slots=True)
class Budget:
    """The remaining steps; `spend` raises `Undecided` when there are none."""

    left: int = DEFAULT_LIMIT

    def spend(self, steps: int) -> None:
        """Take steps from the budget."""
        self.left -= steps
        if self.left < 0:
            raise Undecided("the limit of steps is reached")


class Expired(BaseException):
    """The time limit is reached; a `BaseException`, so that the interrupted code does not handle
    it.
    """


_AGAIN: Final = 0.25
"""Seconds after which a lost signal is repeated."""


@contextmanager
def within(seconds: float | None) -> Iterator[None]:
    """Raise `Expired` inside the block after this many seconds; None is no limit.

    It uses a signal, so it works only in the main thread and between two steps of the interpreter.
    """
    if seconds is None or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGALRM"):
        yield
        return

    def expire(_signal: int, _frame: FrameType | None) -> None:
        raise Expired

    before, report = signal.signal(signal.SIGALRM, expire), sys.unraisablehook
    # Python drops exceptions in callbacks of weak references, so the signal is repeated.
    sys.unraisablehook = lambda lost: None if lost.exc_type is Expired else report(lost)
    signal.setitimer(signal.ITIMER_REAL, seconds, _AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        sys.unraisablehook = report


@contextmanager
def looking(look: Callable[[], object], seconds: float) -> Iterator[None]:
    """Call a function periodically during the block; its exceptions are raised in the block.

    It is restricted as `within` is, and does nothing if the signal is in use.
    """
    main = threading.current_thread() is threading.main_thread() and hasattr(signal, "SIGALRM")
    if not main or signal.getsignal(signal.SIGALRM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGALRM, lambda _signal, _frame: look())
    signal.setitimer(signal.ITIMER_REAL, seconds, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        with suppress(ValueError):  # another thread may leave the block
            signal.signal(signal.SIGALRM, signal.SIG_DFL)


def run(call: Call[T]) -> T:
    """Return the value of a call, by an explicit stack."""
    stack: list[Call[Any]] = [call]
    value: Any = None
    while stack:
        try:
            called = stack[-1].send(value)
        except StopIteration as stop:
            stack.pop()
            value = stop.value
        else:
            stack.append(called)
            value = None
    result: T = value
    return result
