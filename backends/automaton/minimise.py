"""Merges the states that no feasible word can tell apart.

The automaton has no cycles but loops, so one pass from the end suffices: when a state is looked at, the classes of its other
successors are known, and it either equals one of those, or a class with the same edges, or is a class of its own.
Two states may see different atoms; they are compared on the letters over both.
"""

from collections.abc import Iterator, Mapping
from typing import Final, TypeAlias

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, StateRow, subsets
from backends.automaton.letters import FeasibleLetters
from rvaft.support.bits import bits, union

SELF: Final = -1
"""Stands for the class of the state that an edge leaves."""

Signature: TypeAlias = frozenset[tuple[int, int]]


def minimised(automaton: Automaton, letters: FeasibleLetters, *, looping: bool) -> Automaton:
    """The minimal automaton over the feasible letters, its states in breadth-first order.

    `looping` says where an event leads that a state does not see: back to it, or to the state without hope.
    """
    return _Classes(automaton, letters, looping=looping).automaton()


class _Classes:
    """The classes found so far; each keeps the row of its first state, with classes as targets."""

    def __init__(self, automaton: Automaton, letters: FeasibleLetters, *, looping: bool) -> None:
        self.given = automaton
        self.letters = letters
        self.default = SELF if looping else HOPELESS
        self.rows = automaton.rows[:2]
        self.by_signature: dict[Signature, list[int]] = {frozenset(): [DETECTED, HOPELESS]}
        self.of = {DETECTED: DETECTED, HOPELESS: HOPELESS}

    def automaton(self) -> Automaton:
        for state in _from_the_end(self.given):
            self.of[state] = self._class(state)
        rows = [_redirected(row, {SELF: number}) for number, row in enumerate(self.rows)]
        found = Automaton(self.of[self.given.start], rows)
        new = {one: index for index, one in enumerate(dict.fromkeys([DETECTED, HOPELESS, *found.in_order()]))}
        return Automaton(new[found.start], [_redirected(rows[one], new) for one in new])

    def _class(self, state: int) -> int:
        given = self.given.rows[state]
        targets = {letter: SELF if to == state else self.of[to] for letter, to in given.targets.items()}
        row = given._replace(targets=targets)
        for successor in dict.fromkeys(row.targets.values()):
            if successor not in (SELF, DETECTED) and self._equals(row, successor):
                return successor
        known = self.by_signature.setdefault(self._signature(row), [])
        for one in known:
            if self._same(row, self.rows[one]):
                return one
        known.append(len(self.rows))
        self.rows.append(row)
        return known[-1]

    def _equals(self, row: StateRow, successor: int) -> bool:
        """Whether a row is that of a class which its state leads to."""
        theirs = self.rows[successor]
        either = {SELF, successor}
        if set(row.targets.values()) | either != set(theirs.targets.values()) | either:
            return False
        return self._same(*(_redirected(one, {successor: SELF}) for one in (row, theirs)))

    def _signature(self, row: StateRow) -> Signature:
        """Where the least letter of each atom leads, where that is not what a state does with an event it does not see."""
        atoms = union(self.letters.implying(atom) for atom in bits(row.sees))
        leading = (
            (atom, row.target((self.letters.closure(1 << atom) or 0) | self.letters.guards)) for atom in bits(atoms)
        )
        return frozenset((atom, to) for atom, to in leading if to is not None and to != self.default)

    def _same(self, one: StateRow, other: StateRow) -> bool:
        if one.sees == other.sees and one.targets == other.targets:
            return True
        if set(one.targets.values()) != set(other.targets.values()):
            return False
        return all(one.target(letter) == other.target(letter) for letter in self._joint(one, other))

    def _joint(self, one: StateRow, other: StateRow) -> Iterator[int]:
        for atoms in self.letters.over(one.sees | other.sees):
            asked = one.asks.get(atoms & one.sees, 0) | other.asks.get(atoms & other.sees, 0)
            for holding in subsets(asked):
                yield atoms | holding


def _redirected(row: StateRow, new: Mapping[int, int]) -> StateRow:
    """The row with other targets."""
    return row._replace(targets={letter: new.get(to, to) for letter, to in row.targets.items()})


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
