"""A hint for traces that end in ⊥ under a default semantics: the verdicts under `scattered`.

Events that match a pattern are kept and read again at the end, up to a time limit.
"""

from contextlib import suppress
from functools import cached_property
from time import monotonic
from typing import Final

from rvaft.engine.monitor import Engine
from rvaft.errors import TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor

ROOM: Final = 10_000
"""Maximum number of kept events per trace."""
LIMIT: Final = 1_000
SECONDS: Final = 2.0
"""Time limit in seconds, for all traces."""
_MEANING: Final = (
    "false under projected, the default semantics: a match must use every relevant event, "
    "and these events cannot become a match; "
    "under scattered, where a match may skip events,"
)


class SemanticsHint:
    """Reads traces (or keys) that ended in ⊥ again, if `tried`; `line` is the result."""

    def __init__(self, tree: RVAFT, *, tried: bool = True) -> None:
        self._tree = tree
        self._tried = tried and not tree.absences  # any event may decide that another was absent
        self._left = SECONDS
        self.forget()
        self.ended = self.detecting = self.unread = 0
        self.first = self.last_read = ""

    @cached_property
    def _fresh(self) -> Monitor:
        return Engine(self._tree, Semantics.SCATTERED, limit=LIMIT)

    def keep(self, watch: int, number: int, event: Json) -> None:
        """Keep an event for that trace or key; without room, keep only its number."""
        kept = self._kept.setdefault(watch, [])
        if self._room > 0:
            self._room -= 1
            kept.append((number, event))
        elif not kept or kept[-1][1] is not None:
            kept.append((number, None))

    def is_full(self, watch: int) -> bool:
        """Whether further events make no difference."""
        kept = self._kept.get(watch, [])
        return bool(kept) and self._room <= 0 and kept[-1][1] is None

    def look(self, watch: int, prefix: str) -> None:
        """Read the kept events of a trace that ended in ⊥; `prefix` precedes event numbers."""
        self.ended += 1
        if not self._tried:
            return
        again, begun = self._fresh.fork(), monotonic()
        for number, event in self._kept.get(watch, ()):
            verdict = None
            if event is not None and monotonic() - begun <= self._left:
                with suppress(TooLarge):
                    verdict = again.step(event)
            if verdict is None:
                self.unread += 1
                self.last_read = self.last_read or f"{prefix}event {number}"
                break
            if verdict is Verdict.TRUE:
                self.detecting += 1
                self.first = self.first or f"{prefix}event {number}"
                break
        self._left = max(self._left - (monotonic() - begun), 0)

    def forget(self) -> None:
        """Drop all kept events, at the start of a trace."""
        self._room = ROOM if self._tried else 0
        self._kept: dict[int, list[tuple[int, Json]]] = {}

    def merge(self, other: "SemanticsHint") -> None:
        """Add the results of other traces."""
        self.ended += other.ended
        self.detecting += other.detecting
        self.unread += other.unread
        self.first = self.first or other.first
        self.last_read = self.last_read or other.last_read

    @property
    def line(self) -> str | None:
        """The meaning of ⊥ and the result, or None if no trace ended in ⊥."""
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
