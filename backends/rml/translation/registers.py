"""Which register remembers a variable that the next event may bind.

In RML a variable is bound once. A register is called after the first variable it is for, with a number where that name is bound already on
the way here, or where one event could have to bind it in two places at once.
"""

from collections.abc import Iterable, Set

from backends.rml.translation.names import Names, identifier
from backends.rml.translation.observations import Observations
from backends.rml.translation.overlap import disjoint
from rvaft.patterns import Anything, Pattern, Variable, substitute, variables

Where = tuple[str, int]
"""An event type and the position of a parameter."""


class Registers:
    """Gives registers to variables; `used` lists all of them in order of need."""

    def __init__(self, observations: Observations) -> None:
        self.observations = observations
        tree = observations.tree
        names = Names()
        ordered = [name for name in tree.variables if name in observations.remembered]
        self._wanted = {name: names.fresh(identifier(name, otherwise="v")) for name in ordered}
        self._rank = {name: position for position, name in enumerate(ordered)}
        self.used: dict[str, None] = {}

    def choose(self, waiting: Iterable[tuple[int, Set[str]]], bound: Set[str]) -> dict[Where, str]:
        """A register for each place where an occurrence (with the variables it already knows) would bind a variable."""
        here: dict[Where, tuple[list[str], list[int]]] = {}
        for index, known in waiting:
            for position, argument in enumerate(self.observations.templates[index]):
                if isinstance(argument, Variable) and argument.name not in known:
                    names, occurrences = here.setdefault((self._event(index), position), ([], []))
                    names.append(argument.name)
                    occurrences.append(index)
        chosen: dict[Where, str] = {}
        takers: dict[str, list[int]] = {}
        for where, (names, occurrences) in here.items():
            wanted = self._wanted[min(names, key=self._rank.__getitem__)]
            chosen[where] = next(
                name
                for name in _numbered(wanted)
                if name not in bound and not self._together(occurrences, takers.get(name, []))
            )
            takers.setdefault(chosen[where], []).extend(occurrences)
            self.used.setdefault(chosen[where])
        return chosen

    def assign(self, index: int, known: dict[str, str], chosen: dict[Where, str]) -> dict[str, str]:
        """The registers of all remembered variables of an occurrence."""
        found = dict(known)
        for position, argument in enumerate(self.observations.templates[index]):
            if isinstance(argument, Variable) and argument.name not in found:
                found[argument.name] = chosen[self._event(index), position]
        return found

    def _event(self, index: int) -> str:
        on = self.observations.tree.nodes[self.observations.tree.occurrences[index]].on
        assert on is not None
        return on.event

    def _together(self, some: list[int], others: list[int]) -> bool:
        return any(not disjoint(self._loose(one), self._loose(other)) for one in some for other in others)

    def _loose(self, index: int) -> Pattern:
        tree = self.observations.tree
        pattern = tree.pattern(tree.occurrences[index])
        assert pattern is not None
        return substitute(pattern, {name: Anything() for name in variables(pattern)})


def _numbered(name: str) -> Iterable[str]:
    yield name
    number = 2
    while True:
        yield f"{name}_{number}"
        number += 1
