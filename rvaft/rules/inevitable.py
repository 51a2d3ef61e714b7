"""Marks that no scenario can avoid, for all marks at once: one bit per mark, two passes over the tree.

For a single mark let `avoid(v)` say that some way to resolve the choices below v bears no marked node. Since a choice
belongs to a node and not to a path, `avoid` is found bottom-up even where nodes are shared, and some scenario
contains v and no marked node exactly when v can avoid the mark and is the root or has a parent of which the same is true
(take the choices along that path, and elsewhere those that avoid). The passes below compute the complement. Order among events is not looked at.
"""

from collections.abc import Mapping

from rvaft.model import Gate
from rvaft.tree import RVAFT


def inevitable(tree: RVAFT, marks: Mapping[str, int], full: int) -> dict[str, int]:
    """For each reachable node the marks borne in every scenario that contains it.

    `full` has the bits of all marks; a node marked `full` can be in no scenario, and a node that is in no scenario has
    `full` as its result.
    """
    below: dict[str, int] = {}
    for node in tree.bottom_up():
        below[node.name] = marks.get(node.name, 0) | _of_children(
            node.gate, node.threshold, [below[child] for child in node.children], full
        )
    result: dict[str, int] = {}
    for node in tree.top_down():
        above = full if tree.parents(node.name) else 0
        for parent in tree.parents(node.name):
            above &= result[parent]
        result[node.name] = below[node.name] | above
    return result


def _of_children(gate: Gate | None, threshold: int | None, children: list[int], full: int) -> int:
    match gate:
        case Gate.OR:
            common = full
            for bits in children:
                common &= bits
            return common
        case Gate.VOT:
            assert threshold is not None
            return at_least(len(children) - threshold + 1, children)
        case _:
            union = 0
            for bits in children:
                union |= bits
            return union


def at_least(count: int, sets: list[int]) -> int:
    """The bits that are set in at least `count` of the sets, by counting in binary, all bits side by side."""
    planes: list[int] = []
    for bits in sets:
        carry = bits
        for index, plane in enumerate(planes):
            planes[index], carry = plane ^ carry, plane & carry
        if carry:
            planes.append(carry)
    while len(planes) < count.bit_length():
        planes.append(0)
    everything = 0
    for bits in sets:
        everything |= bits
    greater, same = 0, everything
    for index in reversed(range(len(planes))):
        if count >> index & 1:
            same &= planes[index]
        else:
            greater |= same & planes[index]
            same &= ~planes[index]
    return greater | same
