"""`strict` and `projected`: every event that counts is used up, or ends the partial match."""

from collections.abc import Hashable, Iterable
from copy import copy
from typing import Self

from rvaft.engine.configuration import Configuration
from rvaft.engine.following import Following
from rvaft.engine.letters import Letters, Reading
from rvaft.engine.plan import Plan
from rvaft.verdict import Semantics, Verdict


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
