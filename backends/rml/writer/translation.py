"""From a tree to an RML text: gate by gate where that is safe, else determinised into equations."""

from contextlib import suppress
from typing import Final, TypeAlias

from backends.rml.writer.composition import Composition, Plain
from backends.rml.writer.conditions import ALWAYS, NEVER, Inexpressible, when_true
from backends.rml.writer.determinise import Determinised, GuardRefused, RmlLetters, equations, minimised
from backends.rml.writer.event_types import RmlTypes
from backends.rml.writer.observations import Call, Observations, Registers, closed, closed_call
from backends.rml.writer.scenarios import feasible_scenarios
from backends.rml.writer.terms import Written, around, symbols
from rvaft.analysis.normal_form import Op
from rvaft.analysis.unification import Overlaps, implies
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model.guards import Guard
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits

_SMALL: Final = 120
"""A tree with a VOT is written as equations if these have so few alternatives: the published monitors then say `true` at the
event that completes a detection, and not one event later, as with optional children beside a count. No limit decides which it is."""
SYMBOLS: Final = 10
"""How many symbols of the text the limit allows for each alternative it allows: a text has to be read in reasonable time."""
Property: TypeAlias = tuple[Written, list[tuple[str, Written]]]
"""The expression of the whole, and the equations that it needs."""


def translate(tree: RVAFT, semantics: Semantics, *, limit: int) -> tuple[str, int, int]:
    """The tree as an RML text, its symbols, and how many equations it has, that of `Main` included; raises `NotExpressible`, `TooLarge`, `TreeError`.

    `limit` bounds the scenarios, the alternatives of equations, and with `SYMBOLS` the length of the text.
    """
    observations = Observations(tree)
    if semantics is Semantics.SCATTERED and observations.remembered:
        names = sorted(observations.remembered)
        nodes = [n for n, own in zip(tree.occurrences, observations.variables, strict=True) if own & set(names)]
        reason = f"any event may be skipped, so {names[0]} can have any number of values at once, and RML follows one"
        raise NotExpressible(reason, backend="rml", semantics=semantics, nodes=nodes)
    types = RmlTypes(tree)
    try:
        main, made = _property(tree, semantics, RmlLetters(observations, types), limit)
        main = around(main, ">>", _relevant(tree, types)) if semantics is Semantics.PROJECTED else main
    except GuardRefused as refused:
        node, reason = refused.args
        raise NotExpressible(reason, backend="rml", semantics=semantics, nodes=[node]) from None
    body = "\n".join(f"{name} = {term};" for name, term in [("Main", main), *made])
    header = f"// The attack-fault tree {' '.join(tree.root.split())} under the semantics {semantics}."
    text = "\n".join([header, "", *types.lines, "", body, ""])
    size = symbols(body)
    if size + sum(map(symbols, types.lines)) > SYMBOLS * limit:
        raise TooLarge(f"symbols of the RML text, {SYMBOLS} allowed for each alternative", limit=limit)
    return text, size, 1 + len(made)


def _property(tree: RVAFT, semantics: Semantics, letters: RmlLetters, limit: int) -> Property:
    plain = Plain(tree, letters, semantics)
    if not plain.possible:
        return _determinised(tree, semantics, letters, limit)
    if any(plain.joined(number) is Op.AT_LEAST for number in range(len(plain.form.parts))):
        with suppress(TooLarge):
            return _determinised(tree, semantics, letters, _SMALL)
    composition = Composition(plain, letters)
    main = composition.scattered() if semantics is Semantics.SCATTERED else composition.contiguous()
    return main, composition.equations.made


def _determinised(tree: RVAFT, semantics: Semantics, letters: RmlLetters, limit: int) -> Property:
    scenarios = feasible_scenarios(tree, semantics, limit=limit)
    registers = Registers(letters.observations)
    automaton = Determinised(scenarios, letters, registers, semantics, limit=limit)
    main, made = equations(minimised(automaton.alternatives), letters)
    return around(main, "let", ", ".join(registers.used)) if registers.used else main, made


# -- the filter of `projected`: events that are relevant to some node of the whole tree and not ignored ----------------


def _relevant(tree: RVAFT, types: RmlTypes) -> str:
    """The name of the event type, declared in `types`; raises `GuardRefused`."""
    whole = tree.part_of.tree if tree.part_of is not None else tree
    entries = [(name, *closed_call(whole.nodes[name], whole)) for name in whole.occurrences]
    patterns = [call.pattern(whole) for _, call, _ in entries]
    overlaps = Overlaps(patterns)

    def is_covered(i: int) -> bool:
        """Whether another entry that asks for nothing more than its pattern covers this one."""
        return any(
            entries[j][2] is None
            and implies(patterns[i], patterns[j])
            and (entries[i][2] is not None or j < i or not implies(patterns[j], patterns[i]))
            for j in bits(overlaps.compatible(i) & ~(1 << i))
        )

    wanted: dict[str, None] = {}
    for i, (name, call, guard) in enumerate(entries):
        if not is_covered(i):
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


def _parents(types: RmlTypes, call: Call, guard: Guard | None, node: str, hint: str) -> list[str]:
    try:
        condition = ALWAYS if guard is None else when_true(guard)
    except Inexpressible as error:
        raise GuardRefused(node, str(error)) from None
    return [] if condition == NEVER else types.checked(call, condition, hint)
