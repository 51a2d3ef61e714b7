"""A text of LTLf run by MONA's automaton instead of this project's own reading of formulas.

Both use Spot's parser and the meaning of atoms at an event; what a formula demands of a word, they find out in different ways.
"""

from collections.abc import Hashable, Mapping
from functools import lru_cache
from typing import Final

from backends.ltlf.atoms import Atom, atoms_of
from backends.ltlf.formulas import Formulas, Op
from backends.ltlf.header import split
from backends.ltlf.mona.automaton import Automaton, automaton
from backends.ltlf.mona.translating import program
from backends.ltlf.program import root_of
from rvaft.errors import NotExpressible, TooLarge
from rvaft.monitors import Monitor
from rvaft.patterns import Pattern
from rvaft.values import Json
from rvaft.verdict import Verdict

ATOMS: Final = 8
"""The most atoms: the automaton has a transition for every set of them in the worst case."""


def read(text: str, given: Mapping[str, Pattern]) -> Monitor:
    """A monitor of the text; raises as `Backend.read_with` says."""
    return MonaMonitor(*_made(text, tuple(sorted(given.items(), key=lambda item: item[0]))))


@lru_cache(maxsize=32)
def _made(text: str, given: tuple[tuple[str, Pattern], ...]) -> tuple[Automaton, Mapping[str, Atom]]:
    """The automaton, and the atoms by their names in it."""
    header, rest = split(text)
    formulas = Formulas()
    root = root_of(header, rest, formulas)
    rows = (formulas.rows[number] for number in formulas.reachable(root))
    names = sorted(row.name for row in rows if row.op is Op.ATOM)
    atoms = atoms_of(header, names, dict(given))
    if variables := sorted(frozenset[str]().union(*(atom.mentions for atom in atoms.values()))):
        reason = f"its automata have no variables ({', '.join(variables)})"
        raise NotExpressible(reason, backend="ltlf-mona", semantics="any semantics")
    if len(names) > ATOMS:
        raise TooLarge(f"a formula with {len(names)} atoms for mona", limit=ATOMS)
    symbols = {name: f"p{number}" for number, name in enumerate(names)}  # ltlf2dfa writes symbols in upper case
    made = automaton(program(formulas, root, symbols))
    return made, {symbol.upper(): atoms[name] for name, symbol in symbols.items()}


class MonaMonitor(Monitor):
    """⊤ where the word and all its extensions are accepted, ⊥ where none of them is, else ?; ? before any event."""

    def __init__(self, automaton: Automaton, atoms: Mapping[str, Atom]) -> None:
        super().__init__()
        self._automaton = automaton
        self._atoms = atoms
        self._at = automaton.start

    @property
    def state(self) -> Hashable:
        """The automaton, its state, the verdict."""
        return self._automaton, self._at, self._verdict

    def _advance(self, event: Json) -> Verdict:
        letter = frozenset(name for name in self._automaton.names if self._atoms[name].holds(event, {}))
        self._at = self._automaton.step(self._at, letter)
        return self._automaton.verdicts[self._at]
