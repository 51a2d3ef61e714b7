"""The parts of an AND, also through ANDs below it, that nothing ties together: no variable, no
guard, and no event that may serve two of them.

Their partial matches are followed side by side, so that their numbers add up where they would
multiply. Together the parts have what they need when each has: any match of the one goes with any
match of the other. Those that leave choices are one part, for the branch of a match depends on all
choices.
"""

from collections.abc import Sequence
from typing import NamedTuple

from rvaft.core.part_numbers import PartKind
from rvaft.core.patterns import Overlaps
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.support.bits import bits, union


class IndependentPart(NamedTuple):
    """Some of what the root joins, and all nodes below them."""

    children: tuple[int, ...]
    nodes: int
    chooses: bool


def independent_parts(compiled: CompiledTree, letters: TreeLetters) -> tuple[IndependentPart, ...]:
    """The independent parts of a tree, none where it is one."""
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
    first_children, first_nodes = remembering[0]  # what remembers nothing multiplies nothing
    remembering[0] = (
        first_children + tuple(child for children, _ in others for child in children),
        first_nodes | union(nodes for _, nodes in others),
    )
    return tuple(IndependentPart(children, nodes, bool(nodes & compiled.chooses)) for children, nodes in remembering)
