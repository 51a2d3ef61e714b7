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
QUICK: Final = 10_000_000
"""So many steps take about a second, and are allowed under any limit."""
SHORT: Final = 1_000_000
"""A text of so many characters is allowed under any limit."""


class Work:
    """What a construction builds and does, counted; raises `TooLarge` beyond `limit` items, and what goes with them.

    `item` names what the limit counts. For each item, `steps` and `characters` are allowed, and
    `QUICK` steps and a text of `SHORT` characters under any limit.
    """

    def __init__(self, limit: int, *, item: str = "state", steps: int = 1000, characters: int = 100) -> None:
        self.limit = limit
        self._item = item
        self._each = steps
        self._characters = characters
        self._steps = 0

    def step(self, many: int) -> None:
        """So many more steps are done; each takes about a tenth of a microsecond."""
        self._steps += many
        if self._steps > QUICK:
            self.check(
                self._steps, f"steps of the construction, {self._each} allowed for each {self._item}", self._each
            )

    def size(self, characters: int) -> None:
        """Refuse a text that is longer."""
        if characters > SHORT:
            what = f"characters of the text, {self._characters} allowed for each {self._item}"
            self.check(characters, what, self._characters)

    def check(self, reached: int, what: str, each: int = 1) -> None:
        """Refuse more of something than `each` for each item."""
        if reached > self.limit * each:
            raise TooLarge(what, limit=self.limit)


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
