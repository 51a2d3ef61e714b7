"""From a tree to an RML text: gate by gate where that is safe, else determinised into equations."""

from dataclasses import dataclass
from typing import Final

from backends.rml.translation.automaton import Automaton
from backends.rml.translation.composition import Composition
from backends.rml.translation.equations import equations
from backends.rml.translation.letters import GuardRefused, Letters
from backends.rml.translation.minimising import minimised
from backends.rml.translation.observations import Observations
from backends.rml.translation.plain import Plain
from backends.rml.translation.registers import Registers
from backends.rml.translation.relevance import relevant
from backends.rml.translation.scenarios import feasible_scenarios
from backends.rml.translation.terms import Term, filtered, let, symbols, written
from backends.rml.translation.types import Types
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model import Gate
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

_SMALL: Final = 120
"""A tree with a VOT is written as equations up to that many alternatives, which read better; and detection shows at once."""


SYMBOLS: Final = 10
"""How many symbols of the text the limit allows for each alternative it allows: a text has to be read in reasonable time."""


@dataclass(frozen=True, slots=True)
class Translation:
    """A text and its sizes; `states` is None where it was made gate by gate."""

    text: str
    symbols: int
    states: int | None


@dataclass(frozen=True, slots=True)
class _Property:
    main: Term
    equations: list[tuple[str, Term]]
    states: int | None = None


def translate(tree: RVAFT, semantics: Semantics, *, limit: int) -> Translation:
    """The tree as an RML text; raises `NotExpressible`, `TooLarge`, `TreeError`.

    `limit` bounds the scenarios, the alternatives of equations, and with `SYMBOLS` the length of the text.
    """
    observations = Observations(tree)
    if semantics is Semantics.SCATTERED and observations.remembered:
        names = sorted(observations.remembered)
        nodes = [n for n, own in zip(tree.occurrences, observations.variables, strict=True) if own & set(names)]
        reason = f"any event may be skipped, so {names[0]} can have any number of values at once, and RML follows one"
        raise NotExpressible(reason, backend="rml", semantics=semantics, nodes=nodes)
    types = Types(tree)
    letters = Letters(observations, types)
    try:
        made = _property(tree, semantics, letters, limit)
        main = filtered(relevant(tree, types), made.main) if semantics is Semantics.PROJECTED else made.main
    except GuardRefused as refused:
        raise NotExpressible(refused.reason, backend="rml", semantics=semantics, nodes=[refused.node]) from None
    body = "\n".join(f"{name} = {written(term)};" for name, term in [("Main", main), *made.equations])
    header = f"// The attack-fault tree {' '.join(tree.root.split())} under the semantics {semantics}."
    text = "\n".join([header, "", *types.lines, "", body, ""])
    size = symbols(body)
    if size + sum(map(symbols, types.lines)) > SYMBOLS * limit:
        raise TooLarge(f"symbols of the RML text, {SYMBOLS} allowed for each alternative", limit=limit)
    return Translation(text, size, made.states)


def _property(tree: RVAFT, semantics: Semantics, letters: Letters, limit: int) -> _Property:
    plain = Plain(tree, letters, semantics)
    if not plain.possible:
        return _determinised(tree, semantics, letters, limit)
    if any(plain.joined(node) is Gate.VOT for node in tree.top_down()):
        try:
            return _determinised(tree, semantics, letters, min(limit, _SMALL))
        except TooLarge:
            pass
    composition = Composition(plain, letters)
    main = composition.scattered() if semantics is Semantics.SCATTERED else composition.contiguous()
    return _Property(main, composition.equations.made)


def _determinised(tree: RVAFT, semantics: Semantics, letters: Letters, limit: int) -> _Property:
    scenarios = feasible_scenarios(tree, semantics, limit=limit)
    registers = Registers(letters.observations)
    automaton = Automaton(scenarios, letters, registers, semantics, limit=limit)
    classes = minimised(automaton.alternatives)
    main, made = equations(classes, letters)
    return _Property(let(tuple(registers.used), main), made, len(classes))
