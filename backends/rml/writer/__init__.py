"""Properties to RML texts: by composition if that is safe, else by determinisation."""

from contextlib import suppress
from typing import Final, TypeAlias

from backends.rml.writer.composition import Composition
from backends.rml.writer.determinise import Determinised, equations, feasible_scenarios, minimised, refined
from backends.rml.writer.event_types import ALWAYS, NEVER, Call, RmlTypes
from backends.rml.writer.letters import RmlLetters, closed
from backends.rml.writer.terms import Written, around, symbols
from rvaft.core.overlaps import Overlaps, implies
from rvaft.core.property import Property
from rvaft.errors import NotExpressible, TooLarge, unwritten
from rvaft.model.guards import Guard
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits
from rvaft.support.terminal import visible

SMALL: Final = 120
"""A tree with a VOT is determinised if it has at most so many scenarios and alternatives.

The published monitors then report `true` at the completing event; with optional children beside a
count, one event later. The user's limit does not affect this choice.
"""
SYMBOLS: Final = 10
"""Symbols of the text per alternative of the limit, which bounds the reading time."""
RmlProperty: TypeAlias = tuple[Written, list[tuple[str, Written]]]


def translate(prop: Property, semantics: Semantics, *, limit: int) -> tuple[str, int, int]:
    """Return the RML text, its number of symbols, and its number of equations including `Main`.

    Raises `NotExpressible`, `TooLarge`, `TreeError`. `limit` bounds scenarios, alternatives of
    equations, and with `SYMBOLS` the length of the text.
    """
    types = RmlTypes(prop.tree)
    letters = RmlLetters(prop, types)
    if semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE) and letters.remembered:
        names = sorted(letters.remembered)
        nodes = [n for n, own in zip(letters.nodes, letters.variables, strict=True) if own & set(names)]
        why = "any event may be skipped" if semantics is Semantics.SCATTERED else "a match may begin at any event"
        reason = f"{why}, so {names[0]} may have several values at once, and RML tracks one"
        raise NotExpressible(unwritten(reason), nodes=nodes)
    main, made = _property(letters, semantics, limit)
    main = around(main, ">>", _relevant(letters)) if semantics.projects else main
    body = "\n".join(f"{name} = {term};" for name, term in [("Main", main), *made])
    header = f"// The attack-fault tree {visible(' '.join(prop.tree.root.split()))} under the semantics {semantics}."
    size = symbols(body)
    if size + sum(map(symbols, types.lines)) > SYMBOLS * limit:
        raise TooLarge(f"symbols of the RML text, {SYMBOLS} allowed for each alternative", limit=limit)
    return "\n".join([header, "", *types.lines, "", body, ""]), size, 1 + len(made)


def _property(letters: RmlLetters, semantics: Semantics, limit: int) -> RmlProperty:
    if letters.prop.absences:
        return _determinised(letters, semantics, limit)
    composition = Composition(letters, semantics)
    if not composition.possible or semantics is Semantics.CONSECUTIVE:
        return _determinised(letters, semantics, limit)
    if composition.has_votes:
        with suppress(TooLarge):
            return _determinised(letters, semantics, SMALL)
    return composition.written(), composition.equations


def _determinised(letters: RmlLetters, semantics: Semantics, limit: int) -> RmlProperty:
    scenarios = feasible_scenarios(letters, semantics, limit=limit)
    automaton = Determinised(scenarios, letters, semantics, limit=limit)
    classes = (refined if automaton.cyclic else minimised)(automaton.alternatives)
    main, made = equations(classes, letters, cyclic=automaton.cyclic)
    return around(main, "let", ", ".join(automaton.registers)) if automaton.registers else main, made


# The filter of `projected`: events that are relevant to a node of the whole tree and not ignored.


def _relevant(letters: RmlLetters) -> str:
    """Declare the event type of relevant events, and return its name."""
    whole, types = letters.tree, letters.types
    entries: list[tuple[str, Call, Guard | None]] = []
    for name in whole.occurrences:
        node = whole.nodes[name]
        default = Call(None, (), name), node.when
        entries.append((name, *(default if node.on is None else closed(node.on, node.when))))
    patterns = [call.pattern(whole) for _, call, _ in entries]
    overlaps = Overlaps(patterns)

    def is_covered(i: int) -> bool:
        return any(
            entries[j][2] is None
            and implies(patterns[i], patterns[j])
            and (entries[i][2] is not None or j < i or not implies(patterns[j], patterns[i]))
            for j in bits(overlaps.compatible(i) & ~(1 << i))
        )

    def parents(call: Call, guard: Guard | None, node: str, hint: str) -> list[str]:
        condition = ALWAYS if guard is None else letters.condition(guard, node)
        return [] if condition == NEVER else types.checked(call, condition, hint)

    wanted: dict[str, None] = {}
    for i, (name, call, guard) in enumerate(entries):
        if not is_covered(i):
            wanted.update(dict.fromkeys(parents(call, guard, name, f"relevant_{name}")))
    unwanted: dict[str, None] = {}
    for ignore in whole.ignores:
        found = parents(*closed(ignore.on, ignore.when), "ignore", f"ignored_{ignore.on.event}")
        unwanted.update(dict.fromkeys(found))
    if not wanted:
        return types.neither(["any"], "relevant")
    if not unwanted:
        return types.union(wanted, "relevant")
    return types.neither([types.neither(wanted, "irrelevant"), *unwanted], "relevant")
