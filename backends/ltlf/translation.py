"""From a tree to a header and a formula."""

from collections.abc import Mapping
from dataclasses import dataclass

from backends.ltlf.composition import Composer, settle, shape_of
from backends.ltlf.derivatives import Positions
from backends.ltlf.formulas import FALSE, Formulas, subformulas
from backends.ltlf.parts import Parts, parts_of, simplified
from backends.ltlf.reader import Header, Observation
from backends.ltlf.writer import Names, symbols, write
from rvaft.errors import TreeError
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics


@dataclass(frozen=True, slots=True)
class Translation:
    """The text of a tree, and its sizes."""

    text: str
    symbols: int
    subformulas: int


def translation(tree: RVAFT, semantics: Semantics, *, limit: int) -> Translation:
    """The tree in LTLf; raises `TooLarge` beyond that many distinct subformulas, `TreeError` without a feasible scenario."""
    return _Translator(tree, semantics, limit).translation()


class _Translator:
    """One translation."""

    def __init__(self, tree: RVAFT, semantics: Semantics, limit: int) -> None:
        self.tree = tree
        self.limit = limit
        self.names = Names()
        self.header = Header()
        self.formulas = Formulas(limit)
        self.atoms: dict[Observation, int] = {}
        self.patterns: Mapping[str, Pattern] = {name: _pattern(tree, name) for name in tree.occurrences}
        self.place = {node: place for place, node in enumerate(tree.order)}
        self.rank: dict[str, int] = {}
        """Of each atom the place of its node in the tree."""
        self.positions = Positions(self.formulas, semantics)

    def translation(self) -> Translation:
        parts = parts_of(self.tree)
        if self.positions.semantics is Semantics.PROJECTED:
            self.positions = Positions(self.formulas, Semantics.PROJECTED, self._relevance())
        monotone = self.positions.monotone
        settled = settle(parts, self.patterns, monotone=monotone, limit=self.limit)
        root = self.formulas.disjunction(self._formula(some.parts, some.guards) for some in settled)
        if root == FALSE:
            message = f"no scenario of {self.tree.root} is feasible"
            raise TreeError(message, rule="no-scenario", nodes=[self.tree.root])
        definitions, formula = write(self.formulas, root, self.names)
        self.header.definitions.update(definitions)
        used = {self.formulas.rows[number].name for number in self.formulas.reachable(root)}
        in_order = sorted(self.header.atoms, key=lambda name: self.rank[name])
        self.header.atoms = {name: self.header.atoms[name] for name in in_order if name in used}
        counted = subformulas(self.formulas, root)
        return Translation(f"{self.header}{formula}\n", symbols(definitions, formula), counted)

    def _formula(self, parts: Parts, guards: Mapping[str, tuple[Guard, ...]]) -> int:
        shape = shape_of(simplified(parts, monotone=self.positions.monotone), self.patterns)

        def event_of(part: int) -> int:
            node = shape.rows[part].node
            return self._atom(node, Observation(self.patterns[node], guards.get(node, ())))

        return Composer(shape, self.positions, event_of, limit=self.limit).whole()

    def _atom(self, node: str, observation: Observation) -> int:
        """The atom of an event under guards, named after the first node that observes it."""
        if observation not in self.atoms:
            name = self.names.fresh(node)
            self.header.atoms[name] = observation
            self.rank[name] = self.place[node]
            self.atoms[observation] = self.formulas.atom(name)
        return self.atoms[observation]

    def _relevance(self) -> int:
        wanted = "rel"
        while wanted in self.tree.nodes:  # nodes keep their own names
            wanted += "_"
        name = self.names.fresh(wanted)
        entries = [Observation(entry.pattern, _guards(entry.when)) for entry in self.tree.alphabet]
        ignored = [Observation(self.tree.instantiate(ignore.on), _guards(ignore.when)) for ignore in self.tree.ignores]
        self.header.relevant[name] = list(dict.fromkeys(entries))
        self.header.ignored = {name: list(dict.fromkeys(ignored))} if ignored else {}
        return self.formulas.atom(name)


def _pattern(tree: RVAFT, name: str) -> Pattern:
    pattern = tree.pattern(name)
    assert pattern is not None
    return pattern


def _guards(guard: Guard | None) -> tuple[Guard, ...]:
    return () if guard is None else (guard,)
