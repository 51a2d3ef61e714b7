"""Rules about events that two occurrences want, and nodes that two parents want."""

from collections.abc import Iterator

from rvaft.findings import Severity
from rvaft.model import Gate
from rvaft.patterns import Pattern
from rvaft.precedence import path
from rvaft.rules.context import Context
from rvaft.rules.overlap import rivals
from rvaft.rules.rule import Budget, Report, Rule

_SHOWN = 50


def ambiguous_event(context: Context) -> Iterator[Report]:
    """Two occurrences that no order separates, and an event that could be either."""
    tree, budget = context.tree, context.budget()
    found = 0
    for one, other in _rivals(context, budget):
        if not _unordered(context, one, other, budget):
            continue
        found += 1
        if found > _SHOWN:
            place = tree.nodes[one].place("on")
            yield Report(place, f"more than {_SHOWN} pairs of unordered nodes share events; the others are not listed")
            return
        message = (
            f"{one} and {other} are not ordered and one event can serve either (never both); "
            "order them with `sand`, or tell their events apart"
        )
        yield Report(tree.nodes[one].place("on"), message, (one, other))


def _unordered(context: Context, one: str, other: str, budget: Budget) -> bool:
    """Whether some feasible scenario contains both nodes and orders neither before the other."""
    apart: tuple[str, str] | None = (one, other)
    if not context.tree.shared:
        apart = None  # What orders two nodes of a tree without shared nodes orders them in every scenario.
    else:
        budget.spend(5 * len(context.tree.order))
        if not (path(context.order, one, other) or path(context.order, other, one)):
            apart = None
    if apart is None and context.acyclic:
        return context.space.possible((one, other), budget)
    return context.feasible(budget, (one, other), apart=apart) is not None


def _rivals(context: Context, budget: Budget) -> Iterator[tuple[str, str]]:
    """Pairs of occurrences with overlapping events that may be unordered in a common scenario, in a stable order."""
    tree = context.tree
    names = [name for name in tree.occurrences if name in context.space]
    bits = {name: 1 << index for index, name in enumerate(names)}
    masks: dict[Pattern, int] = {}
    for name in names:
        pattern = _event(context, name)
        masks[pattern] = masks.get(pattern, 0) | bits[name]
    # A pattern overlaps itself, so the nodes that have it are rivals of each other too.
    matching = {pattern: mask | masks[pattern] for pattern, mask in rivals(masks, budget).items()}
    if all(mask.bit_count() == 1 for mask in matching.values()):
        return
    ordered = _surely_ordered(context, bits)
    exclusive = _surely_exclusive(context, bits)
    for index, name in enumerate(names):
        later = matching[_event(context, name)] >> (index + 1) << (index + 1)
        rest = later & ~ordered[name] & ~exclusive[name]
        while rest:
            budget.spend(1)
            lowest = rest & -rest
            rest ^= lowest
            yield name, names[lowest.bit_length() - 1]


def _event(context: Context, name: str) -> Pattern:
    pattern = context.tree.pattern(name)
    assert pattern is not None
    return pattern


def _only_parent(context: Context) -> dict[str, str]:
    """The nodes that have one parent in the space, with it: where such a node is, its parent is, and keeps it."""
    parents: dict[str, list[str]] = {}
    for name, children in context.space.union.items():
        for child in children:
            parents.setdefault(child, []).append(name)
    return {child: above[0] for child, above in parents.items() if len(above) == 1}


def _parts(context: Context, bits: dict[str, int], parent: dict[str, str]) -> dict[str, int]:
    """For each node its own bit and those of the nodes that can only be where it is."""
    parts: dict[str, int] = {}
    for name in reversed(context.space.union):
        parts[name] = parts.get(name, 0) | bits.get(name, 0)
        if name in parent:
            parts[parent[name]] = parts.get(parent[name], 0) | parts[name]
    return parts


def _surely_ordered(context: Context, bits: dict[str, int]) -> dict[str, int]:
    """For each node, occurrences that are before or after its event in every scenario that contains both."""
    tree, parent = context.tree, _only_parent(context)
    parts = _parts(context, bits, parent)
    beside: dict[str, int] = {}  # what is surely before or after the whole part of a node, not its ancestors' events
    above: dict[str, int] = {}
    ordered: dict[str, int] = {}
    for name in context.space.union:
        if name in parent:
            over = parent[name]
            gate = tree.nodes[over].gate
            siblings = 0
            if gate is not None and gate.ordered:
                for_all = parts[over] & ~bits.get(over, 0)
                siblings = for_all & ~parts[name]
            beside[name] = beside[over] | siblings
            above[name] = above[over] | bits.get(over, 0)
        else:
            beside[name] = above[name] = 0
        ordered[name] = beside[name] | above[name] | parts[name]
    return ordered


def _surely_exclusive(context: Context, bits: dict[str, int]) -> dict[str, int]:
    """For each node, occurrences that no scenario contains with it: those below other children of an `or` above it."""
    tree, parent = context.tree, _only_parent(context)
    parts = _parts(context, bits, parent)
    exclusive: dict[str, int] = {}
    for name in context.space.union:
        over = parent.get(name)
        exclusive[name] = 0 if over is None else exclusive[over]
        if over is not None and tree.nodes[over].gate is Gate.OR:
            exclusive[name] |= parts[over] & ~bits.get(over, 0) & ~parts[name]
    return exclusive


def shared_under_order(context: Context) -> Iterator[Report]:
    """A node with two parents in one scenario whose possible places in the sequences of ordered gates differ."""
    tree, budget = context.tree, context.budget()
    if not tree.shared:
        return
    slots: dict[str, int] = {}
    owners: list[str] = []
    for node in tree.top_down():
        if node.name not in context.space:
            continue
        sides: dict[str, int] = {}
        for parent in tree.parents(node.name):
            if parent in context.space and node.name in context.space.union[parent]:
                sides[parent] = slots[parent]
                gate = tree.nodes[parent].gate
                if gate is not None and gate.ordered:
                    sides[parent] |= 1 << len(owners)
                    owners.append(parent)
        slots[node.name] = 0
        for side in sides.values():
            slots[node.name] |= side
        pair = _together(context, node.name, sides, budget)
        if pair is not None:
            one, other = pair
            slot = (sides[one] ^ sides[other]).bit_length() - 1
            by, too = (one, other) if sides[one] >> slot & 1 else (other, one)
            message = (
                f"{node.name} is shared by {one} and {other} and happens once, so the order that {owners[slot]} asks for "
                f"by way of {by} also binds it below {too}; use two nodes if two events are meant"
            )
            yield Report(node.place(), message, (node.name, one, other))


def _together(context: Context, name: str, sides: dict[str, int], budget: Budget) -> tuple[str, str] | None:
    """Two parents on different sides of an ordered gate that keep the node in one scenario."""
    parents = list(sides)
    for index, one in enumerate(parents):
        for other in parents[index + 1 :]:
            if sides[one] != sides[other]:
                budget.spend(1)
                if context.space.possible((), budget, edges=[(one, name), (other, name)]):
                    return one, other
    return None


RULES = (
    Rule(
        "ambiguous-event",
        Severity.WARNING,
        "two unordered occurrences that one event can serve",
        ambiguous_event,
        "Two occurrences never share an event. Where two nodes of one scenario are not ordered and one event matches both, the "
        "tree asks for two such events, and a monitor has to keep both ways open. Guards are not looked at.",
        'event goal(wp) = { goal: wp };\ntop and a b;\na on goal(_);\nb on goal("entrance");\n',
        'event goal(wp) = { goal: wp };\ntop sand a b;\na on goal(_);\nb on goal("entrance");\n',
    ),
    Rule(
        "shared-under-order",
        Severity.WARNING,
        "node shared under an ordered gate",
        shared_under_order,
        "A shared node happens once. Where two of its parents are in one scenario and the places they can have in the sequences of ordered gates "
        "differ, the order asked for by way of one parent also binds the node below the other. Where the node is in the parts of two children "
        "of one ordered gate and has an event, it precedes itself and the scenario is infeasible. Sharing within one child of an ordered gate is harmless.",
        "top and s t;\ns sand a b;\nt sand b c;\na;\nb;\nc;\n",
        "top sand a b c;\na;\nb;\nc;\n",
    ),
)
