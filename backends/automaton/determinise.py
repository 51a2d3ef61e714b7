"""The deterministic automaton: a state is the set of configurations that a prefix may have led to.

Under `strict` every event must be a move; under `projected` every relevant one; under `scattered` an event may also be
left out, and a configuration that another one dominates is dropped. Apart from loops the graph has no cycle: every move leaves less
to happen.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from backends.automaton.configurations import Configuration, Move, Moves, Successors
from backends.automaton.letters import Atoms, Letters
from rvaft.errors import TooLarge
from rvaft.model.verdict import Semantics

DETECTED: Final = 0
HOPELESS: Final = 1
"""The two states that every automaton has."""

EDGES: Final = 10
STEPS: Final = 1000
"""How many edges, and how many steps of the construction, the limit allows for each state it allows."""

Letter: TypeAlias = tuple[Atoms, int]
"""The atoms that are true, of those a state sees, and the guards that hold, of those that matter then."""


@dataclass(frozen=True, slots=True)
class Row:
    """One state: the atoms it sees, the guards that matter for each set of true atoms, where each letter leads."""

    sees: Atoms
    guards: dict[Atoms, int]
    targets: dict[Letter, int]

    def target(self, atoms: Atoms, holding: int) -> int | None:
        """Where a letter over more atoms and guards leads, or None where no event makes it true."""
        seen = atoms & self.sees
        return self.targets.get((seen, holding & self.guards.get(seen, 0)))


DETECTED_ROW: Final = Row(0, {0: 0}, {(0, 0): DETECTED})
HOPELESS_ROW: Final = Row(0, {0: 0}, {(0, 0): HOPELESS})


@dataclass(slots=True)
class Automaton:
    """The rows by state, and the state before any event."""

    start: int
    rows: list[Row] = field(default_factory=lambda: [DETECTED_ROW, HOPELESS_ROW])


State: TypeAlias = frozenset[Configuration]


class Subsets:
    """Builds the automaton; raises `TooLarge` beyond `limit` states, or what goes with them."""

    def __init__(self, moves: Moves, letters: Letters, semantics: Semantics, limit: int) -> None:
        self.moves = moves
        self.letters = letters
        self.scattered = semantics is Semantics.SCATTERED
        self.limit = limit
        self.edges = 0
        self.steps = 0
        self.number: dict[State, int] = {}
        self.waiting: list[State] = []

    def build(self) -> Automaton:
        """The automaton of the configurations that `moves` starts with."""
        start = frozenset(self.moves.start())
        if any(self.moves.complete(configuration) for configuration in start):
            return Automaton(DETECTED)
        automaton = Automaton(self._state(frozenset(self._best(start)) if self.scattered else start))
        done = 0
        while done < len(self.waiting):
            automaton.rows.append(self._row(self.waiting[done]))
            done += 1
        return automaton

    def _state(self, state: State) -> int:
        if not state:
            return HOPELESS
        if state not in self.number:
            self.number[state] = len(self.number) + 2
            self.waiting.append(state)
            self._count(len(self.number), 1, "states of the automaton")
        return self.number[state]

    def _best(self, start: State) -> list[Configuration]:
        """The configurations at the start without those that another one dominates."""
        best: list[Configuration] = []
        for one in sorted(start, key=_rank):
            self._step(len(best))
            if not any(self.moves.dominates(other, one) for other in best):
                best = [*(other for other in best if not self.moves.dominates(one, other)), one]
        return best

    def _row(self, state: State) -> Row:
        ordered = sorted(state, key=_rank)
        by_atom: dict[int, list[Move]] = {}
        for configuration in ordered:
            for move in self.moves.of(configuration):
                by_atom.setdefault(move.atom, []).append(move)
        kept = ordered if self.scattered else []
        successors = Successors(self.moves, by_atom, kept, dominating=self.scattered, step=self._step)
        row = Row(sum(1 << atom for atom in by_atom), {}, {})
        for atoms in self.letters.over(row.sees):
            row.guards[atoms] = successors.guards(atoms)
            for holding in _subsets(row.guards[atoms]):
                after = successors.of(atoms, holding)
                row.targets[atoms, holding] = DETECTED if after is None else self._state(after)
                self.edges += 1
                self._count(self.edges, EDGES, f"edges of the automaton, {EDGES} allowed for each state")
        return row

    def _step(self, many: int) -> None:
        self.steps += many
        self._count(self.steps, STEPS, f"steps of the construction, {STEPS} allowed for each state")

    def _count(self, reached: int, each: int, what: str) -> None:
        if reached > self.limit * each:
            raise TooLarge(what, limit=self.limit)


def _rank(configuration: Configuration) -> tuple[int, ...]:
    c = configuration
    return (c.plan, c.waiting, c.undecided, c.taken, c.required, c.broken)


def _subsets(mask: int) -> Iterator[int]:
    """All subsets, the whole first."""
    subset = mask
    while True:
        yield subset
        if not subset:
            return
        subset = (subset - 1) & mask
