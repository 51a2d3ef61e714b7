"""Rules about events that two occurrences want, and nodes that two parents want."""

from collections.abc import Iterator

import networkx as nx

from rvaft.analysis.normal_form import Op, body
from rvaft.analysis.scenarios import ScenarioSpace, inevitable, path
from rvaft.analysis.unification import Overlaps
from rvaft.model.patterns import Pattern
from rvaft.rules.rule import RuleReport, branch_of, listing
from rvaft.support.bits import bits as members
from rvaft.support.bits import mask_of, union
from rvaft.support.budget import Budget

# Rules about whether anything can be detected at all (semantics, section 2).

_EVENT, _NEVER = 1, 2


def no_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Some scenario must be feasible."""
    if not space.is_empty:
        return
    tree = space.tree
    place = tree.nodes[tree.root].place()
    if not space.resolutions:
        dead = tuple(name for name in tree.order if name in space.dead)
        why = f"the guard of {listing(dead)} never holds; mend the guard or take the node out"
        yield RuleReport(place, f"the tree has no feasible scenario: {why}", (tree.root, *dead))
        return
    why = "some event always has to come before itself; do not share a node between the children of an ordered gate"
    yield RuleReport(place, f"the tree has no feasible scenario: {why}", (tree.root,))


def silent_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every feasible scenario must have an occurrence; one without is feasible when its guards are: it orders nothing."""
    tree = space.tree
    if all(node.has_event for node in tree.top_down() if node.leaf):
        return
    marks = dict.fromkeys(tree.occurrences, _EVENT) | dict.fromkeys(space.dead, _EVENT | _NEVER)
    if inevitable(tree, marks, _EVENT | _NEVER)[tree.root]:
        return
    kept = space.feasible(space.budget(), without=frozenset(tree.occurrences))
    assert kept is not None
    guards = tuple(name for name in kept if tree.nodes[name].when is not None)
    message = f"{branch_of(tree, kept)}, has no runtime event and would be detected before anything happened"
    mend = f"; give {listing(guards[:3] or (tree.root,), 'or')} an event with `on`"
    place = tree.nodes[guards[0] if guards else tree.root].place()
    yield RuleReport(place, message.replace(", has", " has") + mend, guards or (tree.root,))


def infeasible_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Scenarios that no trace can match are dropped, which is worth knowing."""
    if not space.resolutions:
        return
    tree = space.tree
    for name in tree.order:
        if name in space.dead:
            message = f"the guard of {name} never holds, so every scenario with {name} is dropped"
            yield RuleReport(tree.nodes[name].place("when"), message, (name,))
    if space.acyclic or space.is_empty:
        return
    budget = space.budget()
    for component in nx.strongly_connected_components(space.order):
        if len(component) == 1:
            continue
        found = space.cyclic(budget, frozenset(component))
        if found is not None:
            kept, cycle = found
            nodes = tuple(dict.fromkeys(cycle))
            message = (
                f"{listing(nodes)} would have to come before itself in {branch_of(tree, kept)}, so that scenario is "
                "dropped; let no event be part of two children of one ordered gate"
            )
            yield RuleReport(tree.nodes[nodes[0]].place(), message, nodes)


_SHOWN = 50


def ambiguous_event(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Two occurrences that no order separates, and an event that could be either."""
    tree, budget = space.tree, space.budget()
    found = 0
    for one, other in _rivals(space, budget):
        if not _unordered(space, one, other, budget):
            continue
        found += 1
        if found > _SHOWN:
            place = tree.nodes[one].place("on")
            yield RuleReport(
                place, f"more than {_SHOWN} pairs of unordered nodes share events; the others are not listed"
            )
            return
        message = (
            f"{one} and {other} are not ordered and one event can serve either (never both); "
            "order them with `sand`, or tell their events apart"
        )
        yield RuleReport(tree.nodes[one].place("on"), message, (one, other))


def _unordered(space: ScenarioSpace, one: str, other: str, budget: Budget) -> bool:
    """Whether some feasible scenario contains both nodes and orders neither before the other."""
    apart: tuple[str, str] | None = (one, other)
    if not space.tree.shared:
        apart = None  # What orders two nodes of a tree without shared nodes orders them in every scenario.
    else:
        budget.spend(5 * len(space.tree.order))
        if not (path(space.order, one, other) or path(space.order, other, one)):
            apart = None
    if apart is None and space.acyclic:
        return space.resolutions.possible((one, other), budget)
    return space.feasible(budget, (one, other), apart=apart) is not None


def _rivals(space: ScenarioSpace, budget: Budget) -> Iterator[tuple[str, str]]:
    """Pairs of occurrences with overlapping events that may be unordered in a common scenario, in a stable order."""
    tree = space.tree
    names = [name for name in tree.occurrences if name in space.resolutions]
    having: dict[Pattern, list[int]] = {}
    for index, name in enumerate(names):
        having.setdefault(_event(space, name), []).append(index)
    others = Overlaps(list(having)).exact(budget)
    if len(having) == len(names) and not others:
        return
    nodes = [mask_of(having[pattern]) for pattern in having]
    # A pattern overlaps itself, so the nodes that have it are rivals of each other too.
    matching = {
        pattern: nodes[number] | union(nodes[other] for other in members(others.get(number, 0)))
        for number, pattern in enumerate(having)
    }
    bits = {name: 1 << index for index, name in enumerate(names)}
    ordered = _surely_ordered(space, bits)
    exclusive = _surely_exclusive(space, bits)
    for index, name in enumerate(names):
        later = matching[_event(space, name)] >> (index + 1) << (index + 1)
        rest = later & ~ordered[name] & ~exclusive[name]
        while rest:
            budget.spend(1)
            lowest = rest & -rest
            rest ^= lowest
            yield name, names[lowest.bit_length() - 1]


def _event(space: ScenarioSpace, name: str) -> Pattern:
    pattern = space.tree.pattern(name)
    assert pattern is not None
    return pattern


def _only_parent(space: ScenarioSpace) -> dict[str, str]:
    """The nodes that have one parent in the space, with it: where such a node is, its parent is, and keeps it."""
    parents: dict[str, list[str]] = {}
    for name, children in space.resolutions.union.items():
        for child in children:
            parents.setdefault(child, []).append(name)
    return {child: above[0] for child, above in parents.items() if len(above) == 1}


def _parts(space: ScenarioSpace, bits: dict[str, int], parent: dict[str, str]) -> dict[str, int]:
    """For each node its own bit and those of the nodes that can only be where it is."""
    parts: dict[str, int] = {}
    for name in reversed(space.resolutions.union):
        parts[name] = parts.get(name, 0) | bits.get(name, 0)
        if name in parent:
            parts[parent[name]] = parts.get(parent[name], 0) | parts[name]
    return parts


def _surely_ordered(space: ScenarioSpace, bits: dict[str, int]) -> dict[str, int]:
    """For each node, occurrences that are before or after its event in every scenario that contains both."""
    tree, parent = space.tree, _only_parent(space)
    parts = _parts(space, bits, parent)
    beside: dict[str, int] = {}  # what is surely before or after the whole part of a node, not its ancestors' events
    above: dict[str, int] = {}
    ordered: dict[str, int] = {}
    for name in space.resolutions.union:
        if name in parent:
            over = parent[name]
            beside[name] = beside[over]
            if body(tree.nodes[over]).op is Op.SEQUENCE:
                beside[name] |= parts[over] & ~bits.get(over, 0) & ~parts[name]
            above[name] = above[over] | bits.get(over, 0)
        else:
            beside[name] = above[name] = 0
        ordered[name] = beside[name] | above[name] | parts[name]
    return ordered


def _surely_exclusive(space: ScenarioSpace, bits: dict[str, int]) -> dict[str, int]:
    """For each node, occurrences that no scenario contains with it: those below other children of an `or` above it."""
    tree, parent = space.tree, _only_parent(space)
    parts = _parts(space, bits, parent)
    exclusive: dict[str, int] = {}
    for name in space.resolutions.union:
        over = parent.get(name)
        exclusive[name] = 0 if over is None else exclusive[over]
        if over is not None and body(tree.nodes[over]).op is Op.ONE:
            exclusive[name] |= parts[over] & ~bits.get(over, 0) & ~parts[name]
    return exclusive


def shared_under_order(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A node with two parents in one scenario whose possible places in the sequences of ordered gates differ."""
    tree, budget = space.tree, space.budget()
    if not tree.shared:
        return
    slots: dict[str, int] = {}
    owners: list[str] = []
    for node in tree.top_down():
        if node.name not in space.resolutions:
            continue
        sides: dict[str, int] = {}
        for parent in tree.parents(node.name):
            if parent in space.resolutions and node.name in space.resolutions.union[parent]:
                sides[parent] = slots[parent]
                if body(tree.nodes[parent]).op is Op.SEQUENCE:
                    sides[parent] |= 1 << len(owners)
                    owners.append(parent)
        slots[node.name] = 0
        for side in sides.values():
            slots[node.name] |= side
        pair = _together(space, node.name, sides, budget)
        if pair is not None:
            one, other = pair
            slot = (sides[one] ^ sides[other]).bit_length() - 1
            by, too = (one, other) if sides[one] >> slot & 1 else (other, one)
            message = (
                f"{node.name} is shared by {one} and {other} and happens once, so the order that {owners[slot]} asks for "
                f"by way of {by} also binds it below {too}; use two nodes if two events are meant"
            )
            yield RuleReport(node.place(), message, (node.name, one, other))


def _together(space: ScenarioSpace, name: str, sides: dict[str, int], budget: Budget) -> tuple[str, str] | None:
    """Two parents on different sides of an ordered gate that keep the node in one scenario."""
    parents = list(sides)
    for index, one in enumerate(parents):
        for other in parents[index + 1 :]:
            if sides[one] != sides[other]:
                budget.spend(1)
                if space.resolutions.possible((), budget, edges=[(one, name), (other, name)]):
                    return one, other
    return None
