"""What an automaton can do on events: a guard holds until its variables have values, and only events give values.

A letter on which a guard fails although no events on the way there, and not its own, give a value to each variable of the guard
never occurs. States that only such letters lead to are never reached.
"""

from collections import deque
from collections.abc import Sequence

from backends.automaton.letters import Atoms, bits
from backends.automaton.structure import Structure
from backends.automaton.subsets import DETECTED, HOPELESS, Automaton, Row
from rvaft.guards import variables
from rvaft.patterns import rigid_variables


def possible(automaton: Automaton, structure: Structure) -> Automaton:
    """The automaton with the same states, without letters that never occur and guards that never fail where they are asked."""
    return _Search(automaton, structure).result()


class _Search:
    """Finds for each state the variables that may have a value there, from the start on until nothing is added."""

    def __init__(self, automaton: Automaton, structure: Structure) -> None:
        self._automaton = automaton
        self._binds = [frozenset(rigid_variables(pattern)) for pattern in structure.patterns]
        self._needs: Sequence[frozenset[str]] = [frozenset(variables(guard)) for guard in structure.guards]
        self._valued: dict[int, frozenset[str]] = {automaton.start: frozenset()}

    def result(self) -> Automaton:
        todo = deque([self._automaton.start])
        while todo:
            state = todo.popleft()
            row = self._automaton.rows[state]
            for (atoms, holding), target in row.targets.items():
                valued = self._with(state, atoms)
                if self._never_fails(valued, row.guards[atoms]) & ~holding:
                    continue
                before = self._valued.get(target)
                if before is None or not valued <= before:
                    self._valued[target] = valued | (before or frozenset())
                    todo.append(target)
        rows = [self._reduced(state, row) for state, row in enumerate(self._automaton.rows)]
        return Automaton(self._automaton.start, rows)

    def _reduced(self, state: int, row: Row) -> Row:
        if state in (DETECTED, HOPELESS) or state not in self._valued:
            return row
        never = {atoms: self._never_fails(self._with(state, atoms), asked) for atoms, asked in row.guards.items()}
        targets = {
            (atoms, holding & ~never[atoms]): target
            for (atoms, holding), target in row.targets.items()
            if not never[atoms] & ~holding
        }
        return Row(row.sees, {atoms: asked & ~never[atoms] for atoms, asked in row.guards.items()}, targets)

    def _with(self, state: int, atoms: Atoms) -> frozenset[str]:
        return self._valued[state].union(*(self._binds[atom] for atom in bits(atoms)))

    def _never_fails(self, valued: frozenset[str], asked: int) -> int:
        """The guards among those asked for with a variable that has no value yet."""
        return sum(1 << guard for guard in bits(asked) if not self._needs[guard] <= valued)
