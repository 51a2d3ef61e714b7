"""Independent parts of an AND (also of nested ANDs): no common variable, guard or event.

Their partial matches are followed separately, so that their numbers add instead of multiplying. All
parts with choices are joined, because the branch depends on all choices.
"""

from collections.abc import Sequence
from typing import NamedTuple

from rvaft.core.part_numbers import PartKind
from rvaft.core.patterns import Overlaps
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.support.bits import bits, union


class IndependentPart(NamedTuple):
    """Some children of the root's conjunction, and all nodes below them."""

    children: tuple[int, ...]
    nodes: int
    chooses: bool


def independent_parts(compiled: CompiledTree, letters: TreeLetters) -> tuple[IndependentPart, ...]:
    """Return the independent parts of a tree, or an empty tuple if there is only one."""
    if compiled.core:
        return ()
    joins, below, part_of = set[int](), dict[int, int](), dict[int, int]()
    for node, children in enumerate(compiled.children):  # parents come first
        if node == compiled.root or compiled.parent[node] in joins:
            silent = compiled.guards[node] is None and not compiled.own[node]
            if silent and children and compiled.ops[node] is PartKind.ALL:
                joins.add(node)
                continue
            part_of[node], below[node] = node, 0
        else:
            part_of[node] = part_of[compiled.parent[node]]
        below[part_of[node]] |= 1 << node
    if len(below) < 2:
        return ()
    together = {child: child for child in below}

    def first(child: int) -> int:
        while together[child] != child:
            child = together[child]
        return child

    ties: dict[str, list[int]] = {"": [node for node in part_of if compiled.chooses >> node & 1]}
    for node in part_of:
        for name in (*compiled.exported[node], *compiled.needs[node]):
            ties.setdefault(name, []).append(node)
    serving = [(letter.pattern, nodes) for letter, nodes in zip(letters.letters, letters.serves, strict=True) if nodes]
    overlaps = Overlaps([pattern for pattern, _ in serving]).pairs()
    tied: list[Sequence[int]] = [*ties.values(), *(nodes for _, nodes in serving)]
    tied += [(serving[one][1][0], serving[other][1][0]) for one, other in overlaps]
    for nodes in tied:
        for node in nodes[1:]:
            together[first(part_of[node])] = first(part_of[nodes[0]])
    groups: dict[int, list[int]] = {}
    for child in below:
        groups.setdefault(first(child), []).append(child)
    masks = [(tuple(children), union(below[child] for child in children)) for children in groups.values()]
    remembering = [one for one in masks if any(compiled.exported[node] for node in bits(one[1]))]
    others = [one for one in masks if one not in remembering]
    if len(remembering) < 2:
        return ()
    first_children, first_nodes = remembering[0]  # parts without variables do not multiply
    remembering[0] = (
        first_children + tuple(child for children, _ in others for child in children),
        first_nodes | union(nodes for _, nodes in others),
    )
    return tuple(IndependentPart(children, nodes, bool(nodes & compiled.chooses)) for children, nodes in remembering)
