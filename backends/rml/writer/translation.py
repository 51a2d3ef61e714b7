"""From a tree to an RML text: gate by gate where that is safe, else determinised into equations."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from backends.rml.writer.composition import Composition, Plain
from backends.rml.writer.conditions import ALWAYS, NEVER, Inexpressible, when_true
from backends.rml.writer.determinise import Automaton, GuardRefused, Letters, equations, minimised
from backends.rml.writer.event_types import Types
from backends.rml.writer.observations import (
    Call,
    Observations,
    Registers,
    closed,
    closed_call,
    implies,
    overlaps,
    pattern,
)
from backends.rml.writer.scenarios import bits, feasible_scenarios
from backends.rml.writer.terms import Term, filtered, let, symbols, written
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model.guards import Guard
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

# The event type that the filter of `projected` asks for: relevant to some node of the whole tree and not ignored.


def relevant(tree: RVAFT, types: Types) -> str:
    """The name of the type, declared in `types`; raises `GuardRefused`."""
    whole = tree.part_of.tree if tree.part_of is not None else tree
    entries = [(name, *closed_call(whole.nodes[name], whole)) for name in whole.occurrences]
    wanted: dict[str, None] = {}
    for position, covered in enumerate(_covered(whole, [(call, guard) for _, call, guard in entries])):
        name, call, guard = entries[position]
        if not covered:
            wanted.update(dict.fromkeys(_parents(types, call, guard, name, f"relevant_{name}")))
    unwanted: dict[str, None] = {}
    for ignore in whole.ignores:
        call, guard = closed(ignore.on, ignore.when)
        unwanted.update(dict.fromkeys(_parents(types, call, guard, "ignore", f"ignored_{ignore.on.event}")))
    if not wanted:
        return types.neither(["any"], "relevant")
    if not unwanted:
        return types.union(wanted, "relevant")
    return types.neither([types.neither(wanted, "irrelevant"), *unwanted], "relevant")


def _covered(tree: RVAFT, entries: list[tuple[Call, Guard | None]]) -> Iterator[bool]:
    """Of each entry, whether another one that asks for nothing more than its pattern covers it."""
    patterns = [pattern(tree, call) for call, _ in entries]
    for i, near in enumerate(overlaps(patterns)):
        guarded = entries[i][1] is not None
        yield any(
            entries[j][1] is None
            and implies(patterns[i], patterns[j], frozenset())
            and (guarded or j < i or not implies(patterns[j], patterns[i], frozenset()))
            for j in bits(near & ~(1 << i))
        )


def _parents(types: Types, call: Call, guard: Guard | None, node: str, hint: str) -> list[str]:
    try:
        condition = ALWAYS if guard is None else when_true(guard)
    except Inexpressible as error:
        raise GuardRefused(node, str(error)) from None
    return [] if condition == NEVER else types.checked(call, condition, hint)


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
