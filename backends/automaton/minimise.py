"""Merges the states that no feasible word can tell apart.

The automaton has no cycles but loops, so one pass from the end suffices: when a state is looked at, the classes of its other
successors are known, and it either equals one of those, or a class with the same edges, or is a class of its own.
Two states may see different atoms; they are compared on the letters over both.
"""

from collections.abc import Iterator
from typing import Final, TypeAlias

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, Letter, Row
from backends.automaton.letters import Letters, bits

SELF: Final = -1
"""Stands for the class of the state that an edge leaves."""

Signature: TypeAlias = frozenset[tuple[int, int]]


def minimised(automaton: Automaton, letters: Letters, *, looping: bool) -> Automaton:
    """The minimal automaton over the feasible letters, its states in breadth-first order.

    `looping` says where an event leads that a state does not see: back to it, or to the state without hope.
    """
    return _Classes(automaton, letters, looping=looping).automaton()


class _Classes:
    """The classes found so far; each keeps the row of its first state, with classes as targets."""

    def __init__(self, automaton: Automaton, letters: Letters, *, looping: bool) -> None:
        self.given = automaton
        self.letters = letters
        self.default = SELF if looping else HOPELESS
        self.rows: list[Row] = []
        self.by_signature: dict[Signature, list[int]] = {}
        self.of: dict[int, int] = {}

    def automaton(self) -> Automaton:
        for state in (DETECTED, HOPELESS):
            self._new(state, self.given.rows[state], frozenset())
        for state in _from_the_end(self.given):
            if state not in self.of:
                self._classify(state)
        return self._renumbered()

    def _classify(self, state: int) -> None:
        given = self.given.rows[state]
        targets = {letter: SELF if to == state else self.of[to] for letter, to in given.targets.items()}
        row = Row(given.sees, given.guards, targets)
        for successor in dict.fromkeys(targets.values()):
            if successor not in (SELF, self.of[DETECTED]) and self._equals(row, successor):
                self.of[state] = successor
                return
        signature = self._signature(row)
        for known in self.by_signature.get(signature, ()):
            if self._same(row, self.rows[known]):
                self.of[state] = known
                return
        self._new(state, row, signature)

    def _equals(self, row: Row, successor: int) -> bool:
        """Whether a row is that of a class which its state leads to."""
        theirs = self.rows[successor]
        either = {SELF, successor}
        if set(row.targets.values()) | either != set(theirs.targets.values()) | either:
            return False
        return self._same(_looped(row, successor), _looped(theirs, successor))

    def _new(self, state: int, row: Row, signature: Signature) -> None:
        self.of[state] = len(self.rows)
        self.by_signature.setdefault(signature, []).append(len(self.rows))
        self.rows.append(row)

    def _signature(self, row: Row) -> Signature:
        """Where the least letter of each atom leads, where that is not what a state does with an event it does not see."""
        atoms = 0
        for atom in bits(row.sees):
            atoms |= self.letters.implying(atom)
        return frozenset(
            (atom, to)
            for atom in bits(atoms)
            if (to := row.target(self.letters.closure(1 << atom) or 0, -1)) is not None and to != self.default
        )

    def _same(self, one: Row, other: Row) -> bool:
        if one.sees == other.sees and one.targets == other.targets:
            return True
        if set(one.targets.values()) != set(other.targets.values()):
            return False
        return all(one.target(*letter) == other.target(*letter) for letter in self._joint(one, other))

    def _joint(self, one: Row, other: Row) -> Iterator[Letter]:
        for atoms in self.letters.over(one.sees | other.sees):
            guards = one.guards.get(atoms & one.sees, 0) | other.guards.get(atoms & other.sees, 0)
            holding = guards
            while True:
                yield atoms, holding
                if not holding:
                    break
                holding = (holding - 1) & guards

    def _renumbered(self) -> Automaton:
        """The reachable classes in breadth-first order after the two that are always there."""
        order = [self.of[self.given.start]]
        seen = set(order)
        for one in order:
            for to in self.rows[one].targets.values():
                if to != SELF and to not in seen:
                    seen.add(to)
                    order.append(to)
        fixed = [self.of[DETECTED], self.of[HOPELESS]]
        order = [*fixed, *(one for one in order if one not in fixed)]
        new = {one: index for index, one in enumerate(order)}
        rows = [
            Row(row.sees, row.guards, {letter: new[one if to == SELF else to] for letter, to in row.targets.items()})
            for one in order
            for row in [self.rows[one]]
        ]
        return Automaton(new[self.of[self.given.start]], rows)


def _looped(row: Row, known: int) -> Row:
    """The row with a class taken for the state's own."""
    return Row(row.sees, row.guards, {letter: SELF if to == known else to for letter, to in row.targets.items()})


def _from_the_end(automaton: Automaton) -> Iterator[int]:
    """The reachable states, each after its other successors."""
    begun: set[int] = {DETECTED, HOPELESS}
    todo = [(automaton.start, False)]
    while todo:
        state, left = todo.pop()
        if left:
            yield state
        elif state not in begun:
            begun.add(state)
            todo.append((state, True))
            todo.extend((to, False) for to in automaton.rows[state].targets.values() if to not in begun)
