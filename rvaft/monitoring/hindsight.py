"""What the events of a trace that ended in ⊥ mean under `scattered`, where nobody chose the semantics under which they mean nothing.

The events that fit the tree are kept, as far as there is room, and read again at the end, as far as that is cheap.
"""

from functools import cached_property
from time import monotonic
from typing import Final

from rvaft.api import monitor
from rvaft.errors import TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor

ROOM: Final = 10_000
"""How many events of a trace are kept, of all keys together."""
LIMIT: Final = 1_000
"""Partial matches that are followed."""
SECONDS: Final = 2.0
"""How long all traces together may take."""
_MEANING: Final = (
    "false under projected, which neither the tree nor --semantics chose, means that the relevant events, none left out, "
    "cannot become a match any more; under scattered, which may leave some out,"
)


class Hindsight:
    """Reads the traces, or keys, that ended in ⊥ again, unless that is not to be `tried`; `line` sums up what came of it."""

    def __init__(self, tree: RVAFT, *, tried: bool = True) -> None:
        self._tree = tree
        self._tried = tried
        self._left = SECONDS
        self._room = ROOM
        self._kept: dict[int, list[tuple[int, Json]]] = {}
        self._full: dict[int, int] = {}
        self.ended = self.detecting = self.unread = 0
        self.first = self.last_read = ""

    @cached_property
    def _fresh(self) -> Monitor:
        return monitor(self._tree, semantics=Semantics.SCATTERED, limit=LIMIT)

    def keep(self, watch: int, number: int, event: Json) -> None:
        """Keep an event that fits the tree, of the trace or key of that number."""
        if self._room > 0 and self._tried:
            self._room -= 1
            self._kept.setdefault(watch, []).append((number, event))
        else:
            self._full.setdefault(watch, number)

    def look(self, watch: int, prefix: str) -> None:
        """Read again what was kept of a trace, or key, that ended in ⊥; `prefix` is what stands before a place in it."""
        self.ended += 1
        if not self._tried:
            return
        stop, number, begun = self._full.get(watch), 0, monotonic()
        again = self._fresh.fork()
        try:
            for number, event in self._kept.get(watch, ()):
                if again.step(event) is Verdict.TRUE:
                    self.detecting += 1
                    self.first = self.first or f"{prefix}event {number}"
                    stop = None
                    break
                if monotonic() - begun > self._left:
                    stop = number
                    break
        except TooLarge:
            stop = number
        self._left = max(self._left - (monotonic() - begun), 0)
        if stop is not None:
            self.unread += 1
            self.last_read = self.last_read or f"{prefix}event {stop}"

    def forget(self) -> None:
        """The trace has ended: what was kept of it is not needed any more."""
        self._room = ROOM
        self._kept.clear()
        self._full.clear()

    def merge(self, other: "Hindsight") -> None:
        """Add what came of other traces."""
        self.ended += other.ended
        self.detecting += other.detecting
        self.unread += other.unread
        self.first = self.first or other.first
        self.last_read = self.last_read or other.last_read

    @property
    def line(self) -> str | None:
        """What ⊥ means, and what `scattered`, which may leave events out, makes of the same events; None where there was none."""
        if not self.ended:
            return None
        if not self._tried:
            return f"{_MEANING} they were not tried"
        if self.ended > 1:
            first = f" (first: {self.first})" if self.first else ""
            unread = f"; {self.unread} were too long to be read to the end" if self.unread else ""
            return f"{_MEANING} {self.detecting} of the {self.ended} that ended so detect{first}{unread}"
        if self.unread:
            return f"{_MEANING} they were tried up to {self.last_read} only, where it took too long"
        return f"{_MEANING} they {f'detect at {self.first}' if self.detecting else 'do not detect either'}"
