"""The general way to monitor: follow the set of all partial matches."""

from collections.abc import Hashable
from copy import copy
from typing import Any, Self

from rvaft.engine.commitment import commits
from rvaft.engine.configuration import Configuration
from rvaft.engine.letters import Letters
from rvaft.engine.matching import Matching
from rvaft.engine.packing import packed, unpacked
from rvaft.engine.plan import Plan
from rvaft.errors import TooLarge
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict


class Following:
    """The configurations that the events so far leave; raises `TooLarge` beyond `limit` of them."""

    def __init__(self, plan: Plan, letters: Letters, semantics: Semantics, *, limit: int) -> None:
        self.plan = plan
        self.semantics = semantics
        self.limit = limit
        self.matching = Matching(plan, limit=limit)
        self.letters = letters
        self.matches: list[Configuration] = []
        """After detection, the configurations that are matches."""
        self.lost: list[Configuration] = []
        """After ⊥, the configurations before the event that ended them; a step of theirs may belong to that event."""
        start = self.matching.start()
        self._empty_match, alive = self.matching.standing(start)
        self._configurations: dict[Hashable, Configuration] = {start.key: start} if alive else {}

    def fork(self) -> Self:
        """An independent copy; a step may change a configuration in place."""
        twin = copy(self)
        copies = {key: configuration.copy() for key, configuration in self._configurations.items()}
        vars(twin).update(_configurations=copies)
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        return frozenset(self._configurations)

    @property
    def partial(self) -> list[Configuration]:
        """The partial matches that are followed."""
        return list(self._configurations.values())

    def snapshot(self) -> object:
        """What `restore` needs to bring a fresh strategy of the same tree into this state."""
        return packed((self.fork().partial, self.matches, self.lost))

    def restore(self, snapshot: Any) -> None:
        """Take over a snapshot."""
        partial, self.matches, self.lost = unpacked(snapshot)
        self._configurations = {configuration.key: configuration for configuration in partial}

    def advance(self, event: Json, position: int) -> Verdict:
        """The verdict after one more event."""
        if self._empty_match:
            self.matches = [self.matching.start()]
            return Verdict.TRUE
        reading = self.letters.read(event)
        if self.semantics is Semantics.PROJECTED and not reading.relevant:
            return self._verdict()
        steps = [(node, hit.values) for hit in reading.hits for node in hit.nodes]
        scattered = self.semantics is Semantics.SCATTERED
        found: dict[Hashable, Configuration] = dict(self._configurations) if scattered else {}
        reuse = not scattered and len(steps) == 1
        for key, configuration in self._configurations.items():
            for node, values in steps:
                new = self.matching.extended(configuration, node, values, position, reuse=reuse)
                if new is None:
                    continue
                found.setdefault(new.key, new)
                if scattered and commits(self.matching, configuration, new, node):
                    found.pop(key, None)
            if len(found) > self.limit:
                raise TooLarge(f"partial matches to follow; {self._what_grows}", limit=self.limit)
        self.matches = [c for c in found.values() if self.matching.standing(c)[0]] if found else []
        if self.matches:
            self._configurations = {}
            return Verdict.TRUE
        if not found:
            self.lost = self.partial
        self._configurations = found
        return self._verdict()

    def _verdict(self) -> Verdict:
        open_ended = self._configurations or self.semantics is Semantics.SCATTERED
        return Verdict.UNKNOWN if open_ended else Verdict.FALSE

    @property
    def _what_grows(self) -> str:
        """The variables, or without any the nodes, that the partial matches differ in."""
        bound = {name for configuration in self._configurations.values() for name in configuration.binding}
        if bound:
            return f"the variables {', '.join(sorted(bound))} keep too many values"
        taken = 0
        for configuration in self._configurations.values():
            taken |= configuration.taken
        names = [name for node, name in enumerate(self.plan.names) if taken >> node & 1]
        return f"too many ways to serve {', '.join(names[:10])}{', …' if len(names) > 10 else ''}"
