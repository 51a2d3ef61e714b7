"""`strict` and `projected`: every event that counts is used up, or ends the partial match."""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping
from copy import copy
from typing import Self

from rvaft.engine.compiled_tree import CompiledTree, Reading, Sketch, TreeLetters
from rvaft.engine.configuration import Configuration, Snapshot
from rvaft.engine.steps import Matching
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict


class Following(ABC):
    """The general way to monitor: follow the set of all partial matches that the events so far leave.

    Raises `TooLarge` beyond `limit` of them.
    """

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, *, limit: int) -> None:
        self.compiled = compiled
        self.limit = limit
        self.matching = Matching(compiled, limit=limit)
        self.letters = letters
        self.noted = True
        """Whether the last event may be part of a partial match that is followed."""
        self.matches: list[Configuration] = []
        """After detection, the configurations that are matches."""
        self.lost: list[Configuration] = []
        """After ⊥, the configurations before the event that ended them; a step of theirs may belong to that event."""
        self._empty_match, alive = self.matching.standing(self.matching.start())
        self._beginning = [self.matching.start()] if alive else []

    @abstractmethod
    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Follow these, and nothing else."""

    @property
    @abstractmethod
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""

    @abstractmethod
    def read(self, event: Mapping[str, Json], sketch: Sketch | None = None) -> Reading:
        """What an event means; `sketch` is what its shape says, where that is known."""

    @abstractmethod
    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        twin.follow(self.partial)
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        return frozenset(configuration.key for configuration in self.partial)

    def snapshot(self) -> Snapshot:
        """What `restore` needs to bring a fresh strategy of the same tree into this state."""
        return Snapshot.of((self.partial, self.matches, self.lost))

    def restore(self, snapshot: Snapshot) -> None:
        """Take over a snapshot."""
        partial, self.matches, self.lost = snapshot.groups_again()
        self.follow(partial)

    def _at_once(self) -> Verdict:
        """The verdict where no event has to come."""
        self.matches = [self.matching.start()]
        return Verdict.TRUE

    def _bound(self, count: int) -> None:
        """Refuse to follow that many, with the variables, or without any the nodes, that the partial matches differ in."""
        if count <= self.limit:
            return
        bound = {name for configuration in self.partial for name in configuration.binding}
        if bound:
            grows = f"the variables {', '.join(sorted(bound))} keep too many values"
        else:
            taken = 0
            for configuration in self.partial:
                taken |= configuration.taken
            names = [name for node, name in enumerate(self.compiled.names) if taken >> node & 1]
            grows = f"too many ways to serve {', '.join(names[:10])}{', …' if len(names) > 10 else ''}"
        raise TooLarge(f"partial matches to follow; {grows}", limit=self.limit)


class Contiguous(Following):
    """Under `strict` and `projected` all partial matches have used up the same events."""

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, semantics: Semantics, *, limit: int) -> None:
        super().__init__(compiled, letters, limit=limit)
        self._projected = semantics is Semantics.PROJECTED
        self.follow(self._beginning)

    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Follow these, and nothing else."""
        self._configurations = list(configurations)

    @property
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""
        return self._configurations

    def fork(self) -> Self:
        """An independent copy; a step may change a configuration in place."""
        twin = copy(self)
        twin.follow(configuration.copy() for configuration in self._configurations)
        return twin

    def read(self, event: Mapping[str, Json], sketch: Sketch | None = None) -> Reading:
        """What an event means."""
        return self.letters.read(event, sketch)

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        if self._empty_match:
            return self._at_once()
        relevant, hits = reading
        before = self._configurations
        if self._projected and not relevant:
            return Verdict.UNKNOWN if before else Verdict.FALSE
        steps = [(node, hit.values) for hit in hits for node in hit.nodes]
        reuse = len(steps) == 1
        found: dict[Hashable, Configuration] = {}
        for configuration in before:
            for node, values in steps:
                new = self.matching.extended(configuration, node, values, position, reuse=reuse)
                if new is not None:
                    found.setdefault(None if reuse and len(before) == 1 else new.key, new)
            self._bound(len(found))
        standing = self.matching.standing
        self.matches = [new for new in found.values() if standing(new)[0]]
        if self.matches:
            self._configurations = []
            return Verdict.TRUE
        if not found:
            self.lost = before
            self._configurations = []
            return Verdict.FALSE
        self._configurations = list(found.values())
        return Verdict.UNKNOWN
