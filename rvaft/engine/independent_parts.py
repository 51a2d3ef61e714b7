"""The parts of an AND that nothing ties together: no variable, no guard, and no event that may serve two of them.

Their partial matches are followed side by side, so that their numbers add up where they would multiply. Together the parts have what they need when
each has: any match of the one goes with any match of the other. Those that leave choices are one part, for the branch of a match depends
on all choices.
"""

from collections.abc import Sequence
from typing import NamedTuple

from rvaft.analysis.normal_form import Op
from rvaft.analysis.unification import Overlaps
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.support.bits import bits, union


class IndependentPart(NamedTuple):
    """Some children of the root, and all nodes below them."""

    children: tuple[int, ...]
    nodes: int
    chooses: bool


def independent_parts(compiled: CompiledTree, letters: TreeLetters) -> tuple[IndependentPart, ...]:
    """The independent parts of a tree, none where it is one."""
    root = compiled.root
    waits = compiled.guards[root] is not None or compiled.own[root]
    if compiled.core or waits or compiled.ops[root] is not Op.ALL or len(compiled.children[root]) < 2:
        return ()
    below = {child: 1 << child for child in compiled.children[root]}
    part_of: dict[int, int] = {}
    for node in range(1, len(compiled.names)):  # parents come first
        above = compiled.parent[node]
        part_of[node] = node if above == root else part_of[above]
        below[part_of[node]] |= 1 << node
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
