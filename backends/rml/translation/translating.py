"""From a tree to an RML text: gate by gate where that is safe, else determinised into equations."""

from contextlib import suppress
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
"""A tree with a VOT is written as equations if these have so few alternatives: the published monitors then say `true` at the
event that completes a detection, and not one event later, as with optional children beside a count. No limit decides which it is."""

SYMBOLS: Final = 10
"""How many symbols of the text the limit allows for each alternative it allows: a text has to be read in reasonable time."""


@dataclass(frozen=True, slots=True)
class Translation:
    """A text, its symbols, and how many equations it has, that of `Main` included."""

    text: str
    symbols: int
    equations: int


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
        main, made = _property(tree, semantics, letters, limit)
        main = filtered(relevant(tree, types), main) if semantics is Semantics.PROJECTED else main
    except GuardRefused as refused:
        raise NotExpressible(refused.reason, backend="rml", semantics=semantics, nodes=[refused.node]) from None
    body = "\n".join(f"{name} = {written(term)};" for name, term in [("Main", main), *made])
    header = f"// The attack-fault tree {' '.join(tree.root.split())} under the semantics {semantics}."
    text = "\n".join([header, "", *types.lines, "", body, ""])
    size = symbols(body)
    if size + sum(map(symbols, types.lines)) > SYMBOLS * limit:
        raise TooLarge(f"symbols of the RML text, {SYMBOLS} allowed for each alternative", limit=limit)
    return Translation(text, size, 1 + len(made))


def _property(tree: RVAFT, semantics: Semantics, letters: Letters, limit: int) -> tuple[Term, list[tuple[str, Term]]]:
    """The term of the whole, and the equations that it needs."""
    plain = Plain(tree, letters, semantics)
    if not plain.possible:
        return _determinised(tree, semantics, letters, limit)
    if any(plain.joined(node) is Gate.VOT for node in tree.top_down()):
        with suppress(TooLarge):
            return _determinised(tree, semantics, letters, _SMALL)
    composition = Composition(plain, letters)
    main = composition.scattered() if semantics is Semantics.SCATTERED else composition.contiguous()
    return main, composition.equations.made


def _determinised(
    tree: RVAFT, semantics: Semantics, letters: Letters, limit: int
) -> tuple[Term, list[tuple[str, Term]]]:
    scenarios = feasible_scenarios(tree, semantics, limit=limit)
    registers = Registers(letters.observations)
    automaton = Automaton(scenarios, letters, registers, semantics, limit=limit)
    classes = minimised(automaton.alternatives)
    main, made = equations(classes, letters)
    return let(tuple(registers.used), main), made
