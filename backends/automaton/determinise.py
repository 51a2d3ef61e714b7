"""The deterministic automaton: a state is the set of configurations that a prefix may have led to.

Under `strict` every event must be a move; under `projected` every relevant one; under `scattered` an event may also be
left out, and a configuration that another one dominates is dropped. Apart from loops the graph has no cycle: every move leaves less
to happen.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from backends.automaton.configurations import Moves, Remainder, Successors, undominated
from backends.automaton.letters import FeasibleLetters
from backends.automaton.structure import Work

DETECTED: Final = 0
HOPELESS: Final = 1
"""The two states that every automaton has."""


class StateRow(NamedTuple):
    """One state: the atoms it sees, the guards it asks for each set of true atoms, where each letter over these leads.

    A letter has the atoms that are true and the guards that hold, as bits of the propositions.
    """

    sees: int
    asks: dict[int, int]
    targets: dict[int, int]

    def target(self, letter: int) -> int | None:
        """Where a letter over more propositions leads, or None where no event makes it true."""
        seen = letter & self.sees
        return self.targets.get(seen | letter & self.asks.get(seen, 0))


@dataclass(slots=True)
class Automaton:
    """The rows by state, and the state before any event."""

    start: int
    rows: list[StateRow] = field(
        default_factory=lambda: [StateRow(0, {0: 0}, {0: state}) for state in (DETECTED, HOPELESS)]
    )

    def in_order(self) -> list[int]:
        """The reachable states in breadth-first order."""
        order = [self.start]
        seen = set(order)
        for state in order:
            for target in self.rows[state].targets.values():
                if target not in seen:
                    seen.add(target)
                    order.append(target)
        return order


def determinised(moves: Moves, letters: FeasibleLetters, work: Work, *, scattered: bool) -> Automaton:
    """The automaton of the configurations that `moves` starts with; raises `TooLarge`."""
    number: dict[frozenset[Remainder], int] = {}
    waiting: list[frozenset[Remainder]] = []

    def numbered(state: frozenset[Remainder]) -> int:
        if not state:
            return HOPELESS
        if state not in number:
            number[state] = len(number) + 2
            waiting.append(state)
            work.states(len(number))
        return number[state]

    start = frozenset(moves.start())
    if any(moves.is_complete(configuration) for configuration in start):
        return Automaton(DETECTED)
    automaton = Automaton(numbered(frozenset(undominated(start, moves, work)) if scattered else start))
    for state in waiting:
        successors = Successors(moves, sorted(state), scattered=scattered, work=work)
        row = StateRow(successors.sees, {}, {})
        for atoms in letters.over(row.sees):
            row.asks[atoms] = successors.asked(atoms)
            for holding in subsets(row.asks[atoms]):
                after = successors.of(atoms, holding)
                row.targets[atoms | holding] = DETECTED if after is None else numbered(after)
                work.edge()
        automaton.rows.append(row)
    return automaton


def subsets(mask: int) -> Iterator[int]:
    """All subsets, the whole first.

    >>> list(subsets(0b101))
    [5, 4, 1, 0]
    """
    subset = mask
    while True:
        yield subset
        if not subset:
            return
        subset = (subset - 1) & mask
