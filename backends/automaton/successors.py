"""Where the letters of one state lead: the configurations of each atom found once, then put together as bit sets.

Letters that make several atoms true lead where their atoms lead together. Where a state has many overlapping atoms there are
exponentially many such letters, so what concerns a pair of configurations is looked at once for the state, not once for a letter.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

from backends.automaton.configurations import Configuration, Move, Moves
from backends.automaton.letters import Atoms, bits


class Successors:
    """The successors of one state.

    `kept` are configurations that stay whatever happens, none of which dominates another one (under `scattered`, where an event
    may be left out); with them, a configuration that another one dominates is dropped. `step` is told how much is done.
    """

    def __init__(
        self,
        moves: Moves,
        by_atom: Mapping[int, Sequence[Move]],
        kept: Sequence[Configuration],
        *,
        dominating: bool,
        step: Callable[[int], None],
    ) -> None:
        self._moves = moves
        self._by_atom = by_atom
        self._kept = kept
        self._dominating = dominating
        self._step = step
        self._guards = {atom: _guards(own) for atom, own in by_atom.items()}
        self._found = list(kept)
        self._bit: dict[Configuration, int] = {}
        self._worse = [0] * len(kept)
        """For each configuration found, those that it dominates, as bits."""
        self._of: dict[tuple[int, int], int | None] = {}
        self._best: dict[int, frozenset[Configuration]] = {}

    def guards(self, atoms: Atoms) -> int:
        """The guards that matter when these atoms are true."""
        guards = 0
        for atom in bits(atoms):
            guards |= self._guards[atom]
        return guards

    def of(self, atoms: Atoms, holding: int) -> frozenset[Configuration] | None:
        """The configurations after a letter, or None where one of them is complete."""
        together = (1 << len(self._kept)) - 1
        for atom in bits(atoms):
            reached = self._reached(atom, holding & self._guards[atom])
            if reached is None:
                return None
            together |= reached
        self._step(1)
        if together not in self._best:
            self._best[together] = frozenset(self._undominated(together))
        return self._best[together]

    def _undominated(self, together: int) -> Iterable[Configuration]:
        worse = 0
        for index in bits(together):
            worse |= self._worse[index]
        return (self._found[index] for index in bits(together & ~worse))

    def _reached(self, atom: int, holding: int) -> int | None:
        """What the moves of one atom lead to, or None where one of them is complete."""
        if (atom, holding) not in self._of:
            self._of[atom, holding] = self._lead(atom, holding)
        return self._of[atom, holding]

    def _lead(self, atom: int, holding: int) -> int | None:
        moves = self._by_atom[atom]
        self._step(len(moves))
        moved = [self._moves.breaking(move, holding) for move in moves if not move.needed & ~holding]
        if any(self._moves.complete(configuration) for configuration in moved):
            return None
        reached = 0
        for configuration in moved:
            if configuration not in self._bit:
                self._bit[configuration] = self._new(configuration)
            reached |= self._bit[configuration]
        return reached

    def _new(self, configuration: Configuration) -> int:
        """The bit of a configuration; none where one that is kept dominates it."""
        dominates = self._moves.dominates
        bit, worse = 1 << len(self._found), 0
        if self._dominating:
            self._step(len(self._found))
            if any(dominates(other, configuration) for other in self._kept):
                return 0
            for index, other in enumerate(self._found):
                if dominates(other, configuration):
                    self._worse[index] |= bit
                elif dominates(configuration, other):
                    worse |= 1 << index
        self._found.append(configuration)
        self._worse.append(worse)
        return bit


def _guards(moves: Iterable[Move]) -> int:
    guards = 0
    for move in moves:
        guards |= move.needed | move.noted
    return guards
