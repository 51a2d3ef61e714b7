"""Letters: what one event has to be for a partial match to go on, and how that is written."""

from collections.abc import Iterable
from dataclasses import dataclass

from backends.rml.translation.conditions import NEVER, Condition, Inexpressible, conjuncts, when_true
from backends.rml.translation.observations import Call, Observations
from backends.rml.translation.types import Types
from rvaft.guards import Guard


@dataclass(frozen=True, slots=True)
class Letter:
    """An event that matches the call and fulfils the guards."""

    call: Call
    guards: frozenset[Guard] = frozenset()


class GuardRefused(Exception):
    """The guard of a node cannot be written."""

    def __init__(self, node: str, reason: str) -> None:
        self.node = node
        self.reason = reason
        super().__init__(reason)


class Letters:
    """The letters of one translation; each is called after the node that it was first needed for."""

    def __init__(self, observations: Observations, types: Types) -> None:
        self.observations = observations
        self.types = types
        self._rank = {name: position for position, name in enumerate(observations.tree.order)}
        self._nodes: dict[Call, str] = {}
        self._guards: dict[Guard, tuple[str, tuple[Condition, ...]]] = {}
        self._texts: dict[Letter, tuple[str, ...]] = {}

    def letter(self, index: int, registers: dict[str, str], guards: Iterable[str]) -> Letter | None:
        """The letter of an occurrence with the guards of some nodes, or None where no event can fulfil it."""
        tree = self.observations.tree
        call = self.observations.call(index, registers)
        self._nodes.setdefault(call, tree.occurrences[index])
        instances: set[Guard] = set()
        for node in guards:
            when = tree.nodes[node].when
            assert when is not None
            instance = self.observations.instance(when, index, registers)
            conditions = self._conditions(instance, node)
            if NEVER in conditions:
                return None
            if conditions:
                instances.add(instance)
        return Letter(call, frozenset(instances))

    def _conditions(self, guard: Guard, node: str) -> tuple[Condition, ...]:
        if guard not in self._guards:
            try:
                self._guards[guard] = (node, conjuncts(when_true(guard)))
            except Inexpressible as error:
                raise GuardRefused(node, str(error)) from None
        return self._guards[guard][1]

    def texts(self, letter: Letter) -> tuple[str, ...]:
        """The event types, applied, that an event has to match all at once; the first one binds."""
        if letter not in self._texts:
            node = self._nodes[letter.call]
            guards = sorted((self._guards[guard] for guard in letter.guards), key=self._place)
            conditions = [(condition, name) for name, found in guards for condition in found]
            self._texts[letter] = tuple(self.types.observed(letter.call, conditions, node))
        return self._texts[letter]

    def _place(self, guard: tuple[str, tuple[Condition, ...]]) -> tuple[int, str]:
        return self._rank[guard[0]], repr(guard[1])
