"""The verdicts of a formula by another road: Spot's own translation to automata."""

from importlib import import_module
from typing import Any

from backends.ltlf.reader import spot as spot_module

spot = spot_module()
buddy = import_module("buddy")  # comes with Spot, and is found once Spot is loaded

Letter = frozenset[str]


class Automaton:
    """A deterministic automaton for the formula and the end of the trace (`alive` turns false for ever)."""

    def __init__(self, text: str, atoms: tuple[str, ...]) -> None:
        self.automaton = spot.translate(
            spot.from_ltlf(spot.formula(text), "alive"), "parity", "deterministic", "complete"
        )
        self.atoms = atoms
        self.numbers = {name: self.automaton.register_ap(name) for name in (*atoms, "alive")}
        self.letters = [frozenset(a for i, a in enumerate(atoms) if n >> i & 1) for n in range(2 ** len(atoms))]
        states = range(self.automaton.num_states())
        self.moves = {(s, x): self._edge(s, x, alive=True)[0] for s in states for x in self.letters}
        self.accepts = {state: self._accepts_at_end(state) for state in states}

    def _edge(self, state: int, letter: Letter, *, alive: bool) -> tuple[int, Any]:
        cube = buddy.bddtrue
        for name, number in self.numbers.items():
            true = alive if name == "alive" else name in letter
            cube = buddy.bdd_and(cube, buddy.bdd_ithvar(number) if true else buddy.bdd_nithvar(number))
        edges = [edge for edge in self.automaton.out(state) if buddy.bdd_and(cube, edge.cond) != buddy.bddfalse]
        assert len(edges) == 1
        return edges[0].dst, edges[0].acc

    def _accepts_at_end(self, state: int) -> bool:
        seen: dict[int, int] = {}
        marks: list[Any] = []
        while state not in seen:
            seen[state] = len(marks)
            state, mark = self._edge(state, frozenset(), alive=False)
            marks.append(mark)
        union = spot.mark_t([])
        for mark in marks[seen[state] :]:
            union |= mark
        return bool(self.automaton.acc().accepting(union))

    def _futures(self, state: int) -> set[bool]:
        """Whether the trace is accepted now, and on every extension."""
        seen = {state}
        todo = [state]
        while todo:
            current = todo.pop()
            for letter in self.letters:
                after = self.moves[current, letter]
                if after not in seen:
                    seen.add(after)
                    todo.append(after)
        return {self.accepts[s] for s in seen}

    def verdicts(self, word: list[Letter]) -> str:
        """One sign for each letter."""
        state = self.automaton.get_init_state_number()
        signs = ""
        for letter in word:
            state = self.moves[state, letter]
            futures = self._futures(state)
            signs += "?" if len(futures) == 2 else "T" if futures == {True} else "F"
        return signs
