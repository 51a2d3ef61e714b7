"""Galileo's dynamic gates, translated to this language for *observed failures*.

A monitor observes which parts fail, and in which order. A warm or hot spare may fail before it is
used, so its gate becomes an `and`. A cold spare cannot, so its gate becomes a `sand`, as does
`seq`. `fdep T D …` replaces every D by `D or T`; T stays one node with one occurrence. `pand`
has its own module, `priority_and.py`, and so have spares that gates share, `shared_spares.py`. Gates with
probabilities are refused, because failures do not determine them.
"""

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from rvaft.errors import LanguageError
from rvaft.language.draft import DYNAMIC_GATES, Draft, DraftNode, GateUse, Located, Reading
from rvaft.model.nodes import Gate, Place
from rvaft.model.tree import find_cycle

if TYPE_CHECKING:
    from rvaft.language.shared_spares import SpareGate

ATTACK_TREES: Final = ".at"
"""The extension of ATTop's attack trees, in which `sor` is a gate that attempts its children in turn."""
SUFFIXES: Final = (".dft", ".galileo", ATTACK_TREES)
"""Extensions of Galileo files, in which `pand` is a dynamic gate, too, and failures persist (`scattered`)."""
_WHY: Final = {
    "seq": "its parts fail from left to right",
    "csp": "a cold spare cannot fail before it is used",
    "wsp": "a warm spare may fail before it is used",
    "hsp": "a hot spare may fail before it is used",
    "sor": "any part attains it, and no event shows which ones were attempted before",
}
_IDLE: Final = "it has no parent, so other orders are detected, too"
_SHOWN: Final = 3
"""The maximum number of triggers in the name of a new node."""
_MOST: Final = 1_000_000
"""The maximum number of pairs of a node and a trigger."""
UNSUPPORTED: Final = "a tree asks for events that happen, and not that an event stays out"
"""Why a gate is refused that needs other failures to stay out."""
_REFUSED: Final = {
    "por": f"it needs its first child before the others; {UNSUPPORTED}; `or` drops the order",
    "mutex": UNSUPPORTED,
}
"""The dynamic gates that no monitor reads; analyses of risk read them."""
_SPARES: Final = ("csp", "wsp", "hsp", "spare")


def read_dynamic_gates(draft: Draft, *, strict: bool = False) -> None:
    """Translate the dynamic gates of a draft and record them in `dynamic_gates`.

    Raises `LanguageError` for unsupported gates, and with `strict` for all.
    """
    uses = [(node, located) for node in draft.nodes.values() for located in node.gates if located.value.dynamic]
    uses = [(n, located) for n, located in uses if located.value.dynamic != "pand" or is_galileo(located.place.file)]
    if not uses:
        return
    for node, (use, place) in uses:
        if use.dynamic in _REFUSED:
            raise _error(f"the gate `{use.dynamic}` of `{node.name}` is not supported: {_REFUSED[use.dynamic]}", place)
    if strict:
        node, (use, place) = min(uses, key=lambda found: found[1].place)
        raise _error(f"the dynamic gate `{use.dynamic}` of `{node.name}` is refused by strict Galileo", place)
    for node, (use, place) in uses:
        if use.dynamic == "sor" and not place.file.lower().endswith(ATTACK_TREES):
            why = "it needs failures at the same time; write `and` with `within 0 s`"
            raise _error(f"the gate `sor` of `{node.name}` is not supported: {why}", place)
    from rvaft.language.priority_and import read_priority_gates, unordered  # noqa: PLC0415 -- imported on use

    shared = _shared_spares(draft, uses)
    alone = [one for one in uses if not any(one[0].name == gate.name for group in shared for gate in group)]
    dependencies = [(node, located) for node, located in uses if located.value.is_dependency and len(node.gates) == 1]
    below = {child.value for node in draft.nodes.values() for child in node.children()}
    below.update(toplevel.value for toplevel in draft.toplevels)
    for node, (use, place) in alone:
        if not use.is_dependency and use.dynamic != "pand":
            idle = use.dynamic == "seq" and node.name not in below
            draft.dynamic_gates.append(_static(draft, node, Located(use, place), "; " + _IDLE if idle else ""))
    dependents = _read_dependencies(draft, dependencies) if dependencies else []
    ordered = {"seq", "csp", "spare"}
    _drop_order(draft, unordered(draft, [node.name for node, (use, _) in alone if use.dynamic in ordered], dependents))
    if shared:
        from rvaft.language.shared_spares import read_shared_spares  # noqa: PLC0415 -- imported on use

        warm = unordered(draft, [gate.name for group in shared for gate in group if gate.cold], dependents)
        read_shared_spares(
            draft,
            [
                [gate._replace(cold=gate.cold and not any(one.name in warm for one in group)) for gate in group]
                for group in shared
            ],
        )
    read_priority_gates(
        draft,
        [(node.name, located.place) for node, located in uses if located.value.dynamic == "pand"],
        frozenset(gate.name for group in shared for gate in group),
    )


def _drop_order(draft: Draft, names: list[str]) -> None:
    """Read the gates as `and` whose parts can fail together, or of which a trigger can fail a later part first."""
    for name in names:
        node = draft.nodes[name]
        use, place = node.gates[0]
        if use.gate is not Gate.SAND:
            continue
        node.gates = [Located(use._replace(gate=Gate.AND), place)]
        why = "its parts share or depend on events, and can fail in any order"
        sentence = f"`{use.dynamic}` of {name} is read as `and`: {why}"
        gates = draft.dynamic_gates
        gates[:] = [gate._replace(sentence=sentence) if gate.nodes == (name,) else gate for gate in gates]


def is_galileo(file: str) -> bool:
    """Whether a file is in the format of Galileo, by its name."""
    return file.lower().endswith(SUFFIXES)


def _error(message: str, place: Place) -> LanguageError:
    return LanguageError(message, file=place.file, line=place.line, column=place.column)


def _static(draft: Draft, node: DraftNode, located: Located[GateUse], note: str) -> Reading:
    use, place = located
    kind = use.dynamic
    if kind == "spare":
        kind = "csp" if _is_cold(draft, use) else "wsp"
        use = use._replace(gate=DYNAMIC_GATES[kind])
        node.gates = [Located(use, other.place) if other == located else other for other in node.gates]
    how = f"is read as `{use.gate}`: {_WHY[kind]}{note}"
    return Reading(place, f"`{use.dynamic}` of {node.name} {how}", (node.name,))


def _is_cold(draft: Draft, use: GateUse) -> bool:
    """Whether the spares of a gate cannot fail before they are taken."""
    if use.dynamic != "spare":
        return use.dynamic == "csp"
    spares = (draft.nodes.get(spare.value, DraftNode("")) for spare in use.children[1:])
    return all(any(key == "dorm" and _is(value, 0) for (key, value), _ in spare.attributes) for spare in spares)


def _is(text: str, number: float) -> bool:
    try:
        return float(text) == number
    except ValueError:
        return False


def _shared_spares(draft: Draft, uses: list[tuple[DraftNode, Located[GateUse]]]) -> "list[list[SpareGate]]":
    """Return the groups of gates that share spares."""
    spares = {node.name: (use, place) for node, (use, place) in uses if use.dynamic in _SPARES and len(node.gates) == 1}
    parts = [(name, list(dict.fromkeys(part.value for part in use.children))) for name, (use, _) in spares.items()]
    used = Counter(part for _, below in parts for part in below)
    if all(used[part] == 1 for _, below in parts for part in below[1:]):
        return []
    from rvaft.language.shared_spares import SpareGate, pools  # noqa: PLC0415 -- imported on use

    def gate(name: str) -> SpareGate:
        use, place = spares[name]
        return SpareGate(name, use.dynamic, place, _is_cold(draft, use))

    return [list(map(gate, group)) for group in pools(parts)]


def _read_dependencies(draft: Draft, dependencies: list[tuple[DraftNode, Located[GateUse]]]) -> list[str]:
    """Replace what depends on triggers, and return the names of the new nodes."""
    triggers: dict[str, dict[str, Located[str]]] = {}
    names = {node.name for node, _ in dependencies}
    for node, located in dependencies:
        _check_dependency(node, located, names)
        for child in located.value.children[1:]:
            triggers.setdefault(child.value, {}).setdefault(located.value.children[0].value, located.value.children[0])
        del draft.nodes[node.name]
    _drop(draft, names)
    used = {child.value for node in draft.nodes.values() for child in node.children()} | {draft.root or ""}
    used |= {toplevel.value for toplevel in draft.toplevels}
    new: dict[str, str] = {}
    made: dict[str, DraftNode] = {}
    size = 0
    for dependent in [name for name in triggers if name in used]:
        causes = _all_triggers(dependent, triggers)
        if not causes:
            continue
        size += len(causes)
        if size > _MOST:
            place = next(iter(triggers[dependent].values())).place
            raise _error(f"the dependencies have more than {_MOST:,} pairs of a node and a trigger; remove some", place)
        first, place = next((name, trigger.place) for name, trigger in causes.items())
        name = " or ".join([dependent, *(causes if len(causes) <= _SHOWN else [first, f"{len(causes) - 1} more"])])
        while name in draft.nodes or name in used or name in made:
            name += "'"
        new[dependent] = name
        use = GateUse(DYNAMIC_GATES["fdep"], (Located(dependent, place), *causes.values()))
        made[name] = DraftNode(name, statements=[place], gates=[Located(use, place)], made=True)
    for node in draft.nodes.values():
        for number, (use, place) in enumerate(node.gates):
            children = tuple([Located(new.get(child.value, child.value), child.place) for child in use.children])
            node.gates[number] = Located(use._replace(children=children), place)
    draft.toplevels = [Located(new.get(toplevel.value, toplevel.value), toplevel.place) for toplevel in draft.toplevels]
    draft.nodes.update(made)
    nodes = draft.nodes
    circle = find_cycle({name: [c.value for c in node.children() if c.value in nodes] for name, node in nodes.items()})
    if inside := [node for name, node in made.items() if name in circle]:
        named = [name for name in circle if name not in new.values()]
        why = f"{', '.join(named)} would bring about {'each other' if len(named) > 1 else 'itself'}"
        raise _error(f"the dependencies form a cycle, in which {why}; remove one of them", inside[0].place)
    for node, (use, place) in dependencies:
        if use.children:
            trigger, *dependents = (child.value for child in use.children)
            how = f"a failure of {trigger} counts as a failure of {', '.join(dependents)}, too"
            draft.dynamic_gates.append(Reading(place, f"`{use.dynamic}` of {node.name}: {how}", ()))
    return list(made)


def _check_dependency(node: DraftNode, located: Located[GateUse], names: set[str]) -> None:
    use, place = located
    kind, _, chance = use.dynamic.partition("=")
    if chance and not _is(chance, 1):
        why = "with a probability below 1, a failure of the trigger does not imply one of its dependents"
        raise _error(f"the gate `{use.dynamic}` of `{node.name}` cannot be read: {why}; leave it out", place)
    if len(use.children) == 1:
        raise _error(f"`{kind.strip()}` of {node.name} needs a trigger, followed by at least one dependent", place)
    for child in use.children:
        if child.value in names:
            raise _error(
                f"{child.value} is a dependency, which never fails: {node.name} cannot have it as a child", child.place
            )
    extra = [*node.ons, *node.whens, *node.kinds, *node.counts, *node.withins]
    if extra:
        message = f"{node.name} is a dependency, not an event: it cannot have `on`, `when`, `times`, `within` or a kind"
        raise _error(message, extra[0].place)


def _all_triggers(name: str, triggers: Mapping[str, Mapping[str, Located[str]]]) -> dict[str, Located[str]]:
    found: dict[str, Located[str]] = {}
    waiting = [name]
    while waiting:
        new = {cause: trigger for cause, trigger in triggers.get(waiting.pop(), {}).items() if cause not in found}
        found.update(new)
        waiting.extend(new)
    found.pop(name, None)
    return found


def _drop(draft: Draft, names: set[str]) -> None:
    for toplevel in draft.toplevels:
        if toplevel.value in names:
            raise _error(f"the root {toplevel.value} is a dependency, which never fails", toplevel.place)
    for node in draft.nodes.values():
        for place, (use, where) in enumerate(node.gates):
            gone = [child for child in use.children if child.value in names]
            if not gone:
                continue
            left = tuple(child for child in use.children if child.value not in names)
            if use.gate.counts or not left:
                why = f"{gone[0].value} is a dependency, which never fails"
                raise _error(f"{why}: the gate {node.name} needs this child", gone[0].place)
            node.gates[place] = Located(use._replace(children=left), where)
