"""Work that may be done before something is too large or late, and recursion that no stack limits.

Functions written as generators yield the calls they need: `result = yield other(…)` calls, `return
value` answers. A tree may be thousands of gates deep; Python's own recursion may not.
"""

import signal
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
"""Elementary steps that one question may cost on questions that are hard in general."""
CELLS: Final = 20
"""How many cells (members of states and scenarios) may be made for each subformula that the limit allows."""


class CellBudget:
    """Cells that may still be made; `TooLarge` names what they are and the caller's limit."""

    def __init__(self, what: str, limit: int) -> None:
        self._what = what
        self._limit = limit
        self._left = limit * CELLS

    def spend(self, cells: int) -> None:
        """Make some cells; raises `TooLarge` when there were not so many left."""
        self._left -= cells
        if self._left < 0:
            raise TooLarge(self._what, limit=self._limit)


class Undecided(RvaftError):
    """A question about the scenarios was not decided within the limit."""


@dataclass(slots=True)
class Budget:
    """Steps that are left; `spend` raises `Undecided` when there are none."""

    left: int = DEFAULT_LIMIT

    def spend(self, steps: int) -> None:
        """Take steps from the budget."""
        self.left -= steps
        if self.left < 0:
            raise Undecided("the limit of steps is reached")


class Expired(BaseException):
    """The time is up; not an `Exception`, so that nobody takes it for a failure of what it interrupts."""


@contextmanager
def within(seconds: float | None) -> Iterator[None]:
    """Raise `Expired` inside the block after so many seconds; None is no limit.

    Works by a signal, so only in the main thread of a process and between two steps of the
    interpreter; elsewhere there is no limit.
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


@contextmanager
def looking(look: Callable[[], object], seconds: float) -> Iterator[None]:
    """Call a function again and again while the block lasts; what it raises is raised wherever the block is.

    Works as `within` does, and not at all where somebody else uses the signal.
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
        with suppress(ValueError):  # another thread may let go of it
            signal.signal(signal.SIGALRM, signal.SIG_DFL)


def run(call: Call[T]) -> T:
    """The value of a call."""
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
