"""What every monitor can do, whichever way it was made."""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Self

from rvaft.errors import TraceError
from rvaft.model import Kind
from rvaft.values import Json
from rvaft.verdict import Verdict


@dataclass(frozen=True, slots=True)
class Explanation:
    """One match (semantics, section 4): the branch with the lowest number that has one, and how it matched.

    `matched` maps each occurrence to the number of its event, from 1, in the order of the events; `branch` is None where
    a tree has too many branches to count.
    """

    branch: int | None
    kinds: frozenset[Kind]
    matched: Mapping[str, int]
    variables: Mapping[str, Json]


class Monitor(ABC):
    """Reads events one by one. After a final verdict it keeps returning it and looks at nothing."""

    def __init__(self) -> None:
        self._verdict = Verdict.UNKNOWN
        self._read = 0

    @property
    def verdict(self) -> Verdict:
        """The verdict so far; unknown before any event."""
        return self._verdict

    def step(self, event: Json) -> Verdict:
        """Read one event and return the verdict after it; raises `TraceError` for what is no JSON object."""
        if not isinstance(event, Mapping):
            message = f"an event is a JSON object (a dict), not {type(event).__name__}: decode the line first"
            raise TraceError(message, line=self._read + 1)
        self._read += 1
        if not self._verdict.final:
            self._verdict = self._advance(event)
        return self._verdict

    def run(self, events: Iterable[Json]) -> Iterator[Verdict]:
        """The verdict after each event in turn."""
        return (self.step(event) for event in events)

    def fork(self) -> Self:
        """An independent monitor that has read the same events.

        A subclass that changes its parts in place, instead of replacing them, copies those here.
        """
        return copy(self)

    @abstractmethod
    def _advance(self, event: Json) -> Verdict:
        """Read one event; called only while the verdict is unknown."""

    @property
    @abstractmethod
    def state(self) -> Hashable:
        """Equal states of monitors of one specification have equal futures."""

    @property
    def explanation(self) -> Explanation | None:
        """After ⊤, one match, where the monitor knows the tree; else None."""
        return None
