"""What one connection has read: the monitor of the tree, and where they are asked for those of its parts."""

from collections.abc import Mapping
from typing import Self

from rvaft.api import monitor, one_of
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge
from rvaft.monitoring.bank import Bank
from rvaft.monitoring.columns import Column, Per, columns
from rvaft.monitoring.recall import Recall
from rvaft.monitoring.told import places
from rvaft.monitors import Explanation
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict


class Watched:
    """The monitor of one column, which gives up where it would raise `TooLarge`; `failure` then says why."""

    def __init__(self, bank: Bank, failure: str | None = None) -> None:
        self._bank = bank
        self.failure = failure

    def fork(self) -> Self:
        """An independent one that has read the same events."""
        return type(self)(self._bank.fork(), self.failure)

    def read(self, event: Json, number: int) -> bool:
        """Read the event of that number, and say whether an explanation may name it."""
        if self.failure is None:
            try:
                self._bank.step(event, number)
            except TooLarge as error:
                self.failure = str(error)
        return self.failure is None and self._bank.serves

    @property
    def verdict(self) -> Verdict | None:
        """The verdict so far, or None after it gave up."""
        return None if self.failure is not None else self._bank.verdicts[0]

    @property
    def explanation(self) -> Explanation | None:
        """After detection, how the tree matched."""
        return self._bank.explanation(0)


class Session:
    """Monitors that read the same events: `whole` of the tree, `parts` of its branches or kinds, by number or name.

    `recall` has when and where the events came that an explanation may name: of each event no more, and of events a bounded number.
    """

    def __init__(self, whole: Watched, parts: Mapping[str, Watched]) -> None:
        self.whole = whole
        self.parts = parts
        self.recall = Recall()
        self.events = 0
        """How many were read."""

    def fork(self) -> Self:
        """An independent session that has read the same events."""
        twin = type(self)(self.whole.fork(), {label: part.fork() for label, part in self.parts.items()})
        twin.recall.known.update(self.recall.known)
        twin.events = self.events
        return twin

    def read(self, event: Json, came: Json = None) -> None:
        """Read one event; `came` is how it came, where that was put otherwise."""
        self.events += 1
        if self.whole.read(event, self.events):
            self.recall.remember(self.events, places(event if came is None else came))
        for part in self.parts.values():
            part.read(event, self.events)


def session(tree: RVAFT, semantics: Semantics | str = Semantics.PROJECTED, *, per: Per = Per.TREE) -> Session:
    """A session that has read nothing; the tree may be the part for one branch or kind.

    A part without a feasible scenario has no monitor. Raises what `rvaft.monitoring.columns.columns` raises.
    """
    whole, *parts = columns(tree, per)
    return Session(watched(whole, semantics), {part.label: watched(part, semantics) for part in parts})


def watched(column: Column, semantics: Semantics | str, *, limit: int = DEFAULT_LIMIT) -> Watched:
    """The monitor of a column that has read nothing; it gives up beyond `limit` partial matches."""
    meaning = one_of(Semantics, semantics)
    return Watched(Bank([column], lambda part: monitor(part, semantics=meaning, limit=limit), meaning))
