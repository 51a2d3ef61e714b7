"""From a tree to a text: a header that says what the atoms are, and a formula in Spot's LTLf syntax."""

import re
from collections import Counter
from typing import Final

from backends.ltlf.composition import Composer, Positions
from backends.ltlf.formulas import FALSE, JUNCTIONS, Connective, Formulas
from backends.ltlf.parts import Anatomy, GuardsOf, settled, simplified
from backends.ltlf.reader import Header, Observation
from rvaft.analysis.normal_form import NormalForm, normal_form
from rvaft.backend import Metrics
from rvaft.errors import TreeError
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

_RESERVED: Final = ("true", "false", "xor", "rvaft", "atom", "relevant", "ignored")
_ILLEGAL: Final = re.compile(r"[^a-z0-9_]+")
_TOKEN: Final = re.compile(r"X\[!\]|[A-Za-z0-9_]+|[^\s]")
_LEAVES: Final = frozenset({Connective.TRUE, Connective.FALSE, Connective.ATOM})
_PREFIX: Final = frozenset({Connective.NOT, Connective.NEXT, Connective.EVENTUALLY})


def translation(tree: RVAFT, semantics: Semantics, *, limit: int) -> tuple[str, Metrics]:
    """The text of a tree; raises `TooLarge` beyond that many distinct subformulas, `TreeError` without a feasible scenario."""
    return _LtlfTranslator(tree, limit).translation(semantics)


class _LtlfTranslator:
    """One translation."""

    def __init__(self, tree: RVAFT, limit: int) -> None:
        self.tree = tree
        self.limit = limit
        self.header = Header()
        self.formulas = Formulas(limit)
        self.atoms: dict[Observation, int] = {}
        self.patterns = {name: pattern for name in tree.occurrences if (pattern := tree.pattern(name)) is not None}
        self.place = {node: place for place, node in enumerate(tree.order)}
        self.rank: dict[str, int] = {}
        """Of each atom the place of its node in the tree."""
        self._taken = set(_RESERVED)

    def translation(self, semantics: Semantics) -> tuple[str, Metrics]:
        """The text and its sizes."""
        if semantics is Semantics.PROJECTED:
            positions = Positions(self.formulas, semantics, self._relevance())
        else:
            positions = Positions(self.formulas, semantics)
        form = normal_form(self.tree)
        some = settled(form, self.patterns, monotone=positions.monotone, limit=self.limit) if form.feasible else ()
        root = self.formulas.disjunction(self._formula(parts, guards, positions) for parts, guards in some)
        if root == FALSE:
            message = f"no scenario of {self.tree.root} is feasible"
            raise TreeError(message, rule="no-scenario", nodes=[self.tree.root])
        formula = self._written(root)
        used = {self.formulas.rows[number].name for number in self.formulas.reachable(root)}
        in_order = sorted(self.header.atoms, key=lambda name: self.rank[name])
        self.header.atoms = {name: self.header.atoms[name] for name in in_order if name in used}
        texts = [formula, *(f"{name} = {text}" for name, text in self.header.definitions.items())]
        symbols = sum(len(_TOKEN.findall(text)) for text in texts)
        return f"{self.header}{formula}\n", Metrics(symbols=symbols, subformulas=self.formulas.size(root))

    def _formula(self, form: NormalForm, guards: GuardsOf, positions: Positions) -> int:
        anatomy = Anatomy(simplified(form, monotone=positions.monotone), self.patterns)

        def event_of(part: int) -> int:
            node = anatomy.parts[part].node
            return self._atom(node, Observation(self.patterns[node], guards.get(node, ())))

        return Composer(anatomy, positions, event_of, limit=self.limit).whole()

    def _atom(self, node: str, observation: Observation) -> int:
        """The atom of an event under guards, named after the first node that observes it."""
        if observation not in self.atoms:
            name = self._fresh(node)
            self.header.atoms[name] = observation
            self.rank[name] = self.place[node]
            self.atoms[observation] = self.formulas.atom(name)
        return self.atoms[observation]

    def _relevance(self) -> int:
        wanted = "rel"
        while wanted in self.tree.nodes:  # nodes keep their own names
            wanted += "_"
        name = self._fresh(wanted)
        entries = [(entry.pattern, entry.when) for entry in self.tree.alphabet]
        ignored = [(self.tree.instantiate(ignore.on), ignore.when) for ignore in self.tree.ignores]
        for observed, pairs in ((self.header.relevant, entries), (self.header.ignored, ignored)):
            of_name = (Observation(pattern, () if when is None else (when,)) for pattern, when in pairs)
            if pairs:
                observed[name] = list(dict.fromkeys(of_name))
        return self.formulas.atom(name)

    def _fresh(self, wanted: str) -> str:
        """A name `[a-z_][a-z0-9_]*` given to nothing else: the wanted one where it is legal and free, else one like it."""
        name = _ILLEGAL.sub("_", wanted.lower()) or "_"
        if name[0].isdigit():
            name = f"_{name}"
        candidate, number = name, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{name}_{number}"
        self._taken.add(candidate)
        return candidate

    def _written(self, root: int) -> str:
        """The formula as text; what is used more than once is written once, as a definition after those it uses."""
        rows = self.formulas.rows
        reachable = self.formulas.reachable(root)
        uses = Counter(operand for formula in reachable for operand in rows[formula].operands)
        defined: dict[int, str] = {}
        for formula in reachable:
            row = rows[formula]
            literal = row.op is Connective.NOT and rows[row.operands[0]].op is Connective.ATOM
            if uses[formula] > 1 and row.op not in _LEAVES and not literal:
                text = self._text(formula, defined)
                defined[formula] = self._fresh(f"s{len(defined) + 1}")
                self.header.definitions[defined[formula]] = text
        return self._text(root, defined)

    def _text(self, root: int, defined: dict[int, str]) -> str:
        out: list[str] = []
        todo: list[int | str] = [root]
        while todo:
            item = todo.pop()
            if isinstance(item, str) or item in defined:
                out.append(item if isinstance(item, str) else defined[item])
                continue
            row = self.formulas.rows[item]
            inner: list[list[int | str]] = []
            for operand in row.operands:
                op = self.formulas.rows[operand].op
                plain = operand in defined or op in _LEAVES | _PREFIX or (op is row.op and op in JUNCTIONS)
                inner.append([operand] if plain else ["(", operand, ")"])
            if row.op in _LEAVES:
                out.append(row.name or row.op.value)
            elif row.op in _PREFIX:
                spaced = row.op is not Connective.NOT and len(inner[0]) == 1
                todo.extend(reversed([f"{row.op.value} " if spaced else row.op.value, *inner[0]]))
            else:
                pieces = [piece for operand in inner for piece in (f" {row.op.value} ", *operand)]
                todo.extend(reversed(pieces[1:]))
        return "".join(out)
