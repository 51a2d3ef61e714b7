"""The general way to monitor: follow the set of all partial matches."""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable
from copy import copy
from typing import Any, Self

from rvaft.engine.compiled_tree import Plan
from rvaft.engine.configuration import Configuration, packed, unpacked
from rvaft.engine.event_index import Letters, Reading, Sketch
from rvaft.engine.steps import Matching
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict


class Following(ABC):
    """The configurations that the events so far leave; raises `TooLarge` beyond `limit` of them."""

    def __init__(self, plan: Plan, letters: Letters, *, limit: int) -> None:
        self.plan = plan
        self.limit = limit
        self.matching = Matching(plan, limit=limit)
        self.letters = letters
        self.noted = True
        """Whether the last event may be part of a partial match that is followed."""
        self.matches: list[Configuration] = []
        """After detection, the configurations that are matches."""
        self.lost: list[Configuration] = []
        """After ⊥, the configurations before the event that ended them; a step of theirs may belong to that event."""
        self._empty_match, self._alive = self.matching.standing(self.matching.start())

    @abstractmethod
    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Follow these, and nothing else."""

    @property
    @abstractmethod
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""

    @abstractmethod
    def fork(self) -> Self:
        """An independent copy."""

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        return frozenset(configuration.key for configuration in self.partial)

    def snapshot(self) -> object:
        """What `restore` needs to bring a fresh strategy of the same tree into this state."""
        return packed((self.fork().partial, self.matches, self.lost))

    def restore(self, snapshot: Any) -> None:
        """Take over a snapshot."""
        partial, self.matches, self.lost = unpacked(snapshot)
        self.follow(partial)

    def read(self, event: Json, sketch: Sketch | None = None) -> Reading:
        """What an event means; `sketch` is what its shape says, where that is known."""
        return self.letters.read(event, sketch)

    @abstractmethod
    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""

    def _beginning(self) -> list[Configuration]:
        """What to follow before any event."""
        return [self.matching.start()] if self._alive else []

    def _at_once(self) -> Verdict:
        """The verdict where no event has to come."""
        self.matches = [self.matching.start()]
        return Verdict.TRUE

    def _bound(self, count: int) -> None:
        """Refuse to follow that many."""
        if count > self.limit:
            raise TooLarge(f"partial matches to follow; {self._what_grows}", limit=self.limit)

    @property
    def _what_grows(self) -> str:
        """The variables, or without any the nodes, that the partial matches differ in."""
        bound = {name for configuration in self.partial for name in configuration.binding}
        if bound:
            return f"the variables {', '.join(sorted(bound))} keep too many values"
        taken = 0
        for configuration in self.partial:
            taken |= configuration.taken
        names = [name for node, name in enumerate(self.plan.names) if taken >> node & 1]
        return f"too many ways to serve {', '.join(names[:10])}{', …' if len(names) > 10 else ''}"


# `strict` and `projected`: every event that counts is used up, or ends the partial match.


class Consuming(Following):
    """All partial matches have used up the same events."""

    def __init__(self, plan: Plan, letters: Letters, semantics: Semantics, *, limit: int) -> None:
        super().__init__(plan, letters, limit=limit)
        self._projected = semantics is Semantics.PROJECTED
        self.follow(self._beginning())

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Follow these, and nothing else."""
        self._configurations = list(configurations)

    @property
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""
        return list(self._configurations)

    def fork(self) -> Self:
        """An independent copy; a step may change a configuration in place."""
        twin = copy(self)
        twin.follow(configuration.copy() for configuration in self._configurations)
        return twin

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        if self._empty_match:
            return self._at_once()
        if self._projected and not reading.relevant:
            return self._verdict()
        steps = [(node, hit.values) for hit in reading.hits for node in hit.nodes]
        found: dict[Hashable, Configuration] = {}
        reuse = len(steps) == 1
        for configuration in self._configurations:
            for node, values in steps:
                new = self.matching.extended(configuration, node, values, position, reuse=reuse)
                if new is not None:
                    found.setdefault(new.key, new)
            self._bound(len(found))
        self.matches = [new for new in found.values() if self.matching.standing(new)[0]]
        if self.matches:
            self.follow([])
            return Verdict.TRUE
        if not found:
            self.lost = self.partial
        self.follow(found.values())
        return self._verdict()

    def _verdict(self) -> Verdict:
        return Verdict.UNKNOWN if self._configurations else Verdict.FALSE
