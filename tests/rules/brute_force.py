"""Scenarios by enumeration, as section 2 of the semantics reads, for small trees; shares nothing with the rules."""

from collections.abc import Iterator
from itertools import combinations, product

from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT

Scenario = dict[str, tuple[str, ...]]


def scenarios(tree: RVAFT) -> Iterator[Scenario]:
    """Every scenario, feasible or not: the kept nodes, each with the children it keeps."""
    todo: list[Scenario] = [{}]
    while todo:
        kept = todo.pop()
        wanted = {tree.root} | {child for children in kept.values() for child in children}
        missing = sorted(wanted - kept.keys())
        if not missing:
            yield kept
            continue
        todo.extend({**kept, missing[0]: choice} for choice in choices(tree.nodes[missing[0]]))


def choices(node: Node) -> list[tuple[str, ...]]:
    if node.gate is Gate.OR:
        return [(child,) for child in node.children]
    if node.gate is Gate.VOT:
        assert node.threshold is not None
        sizes = range(node.threshold, len(node.children) + 1)
        return [chosen for size in sizes for chosen in combinations(node.children, size)]
    return [node.children]


def part(kept: Scenario, name: str) -> set[str]:
    """A node and its descendants in the scenario."""
    found = {name}
    for _ in kept:
        found |= {child for inner in found for child in kept[inner]}
    return found


def before(tree: RVAFT, kept: Scenario) -> set[tuple[str, str]]:
    """All pairs of the precedence, transitively closed."""
    events = {name for name in kept if tree.nodes[name].has_event}
    pairs: set[tuple[str, str]] = set()
    for name in events:
        for other in (part(kept, name) - {name}) & events:
            pairs.add((name, other) if tree.causality is Causality.TOP_DOWN else (other, name))
    for name, children in kept.items():
        gate = tree.nodes[name].gate
        if gate in (Gate.SAND, Gate.SAND_RL):
            for first, second in combinations(children, 2):
                early, late = (first, second) if gate is Gate.SAND else (second, first)
                pairs |= set(product(part(kept, early) & events, part(kept, late) & events))
    for middle in events:
        into = [a for a, b in pairs if b == middle]
        out = [b for a, b in pairs if a == middle]
        pairs |= set(product(into, out))
    return pairs


def dead(tree: RVAFT, kept: Scenario) -> set[str]:
    guards = {name: tree.nodes[name].when for name in kept}
    return {n for n, g in guards.items() if g is not None and not guard_variables(g) and not holds(g, {})}


def cyclic(tree: RVAFT, kept: Scenario) -> bool:
    return any(a == b for a, b in before(tree, kept))


def feasible(tree: RVAFT) -> list[Scenario]:
    return [kept for kept in scenarios(tree) if not dead(tree, kept) and not cyclic(tree, kept)]
