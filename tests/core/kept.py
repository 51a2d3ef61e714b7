"""Scenarios of a property and of the reference, turned into each other."""

from rvaft import RVAFT
from rvaft.core.property import Kept, Property
from rvaft.semantics import ReferenceScenario


def names(tree: RVAFT, kept: Kept) -> dict[str, tuple[str, ...]]:
    """The kept nodes with their kept children, as the reference has them."""
    edges = {
        (one.source.node, inner.source.node)
        for one, some in kept.items()
        for inner in some
        if one.source and inner.source
    }
    there = {part.source.node for part in kept if part.source}
    return {
        name: tuple(child for child in tree.nodes[name].children if (name, child) in edges)
        for name in tree.order
        if name in there
    }


def parts_of(prop: Property, scenario: ReferenceScenario) -> Kept:
    """The kept parts of a scenario of the reference, outer parts first."""
    wanted = {(name, child) for name, children in scenario.kept.items() for child in children}
    kept = {}
    for part in reversed(prop.parts):
        name = part.source.node if part.source else ""
        if name in scenario.kept:
            sources = [(inner, inner.source.node) for inner in part.parts if inner.source]
            kept[part] = tuple(inner for inner, child in sources if child == name or (name, child) in wanted)
    return kept
