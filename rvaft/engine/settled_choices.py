"""Choices of which nothing is left but which child they kept: partial matches that differ in these
alone come to the same.

Where a gate of the core (see `compiled_tree`) keeps one child, and that child is a part with all
its events, nothing in this part and none of the other parts that the gate could have kept will have
an event any more, whichever of them it is: they stand at the same place in the tree. So one of the
partial matches is enough, and it is the one with the lower branch: all choices to come are open to
both. What it has chosen is one number, in which the digit of a gate counts as it does in the number
of a branch.
"""

from collections.abc import Hashable

from rvaft.core.branches import or_gates
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import DONE, SURE, TOUCHED, Configuration, PartProgress, Witness
from rvaft.support.bits import mask_of


class SettledChoices:
    """The choices of a tree that may be settled; of a part of a tree with some kind none, for its
    branches depend on more.
    """

    def __init__(self, compiled: CompiledTree) -> None:
        self.compiled = compiled
        self.weights: dict[int, int] = {}
        """For each part that a choice may keep what keeping it adds to the number."""
        self.firsts = 0
        """The parts that are kept with the lowest digit, of choices that every scenario makes."""
        self._gates: dict[int, int] = {}
        self._others: dict[int, int] = {}
        self._below = [0] * len(compiled.names)
        for node in range(len(compiled.names) - 1, -1, -1):
            self._below[node] |= 1 << node
            if compiled.parent[node] >= 0:
                self._below[compiled.parent[node]] |= self._below[node]
        tree, names = compiled.prop.tree, compiled.names
        if compiled.prop.kind is not None:
            return
        weights, weight = dict[str, int](), 1
        for name in or_gates(tree):
            weights[name] = weight
            weight *= len(tree.nodes[name].children)
        for gate in compiled.core:
            if compiled.choices.get(names[gate]) != gate:
                continue
            parts = [child for child in compiled.children[gate] if child not in compiled.members]
            others, digits = 0, tree.nodes[names[gate]].children
            for part in parts:
                others |= self._below[part]
            for part in parts:
                if names[part] in digits and not compiled.picks >> part & 1:
                    self.weights[part] = weights[names[gate]] * digits.index(names[part])
                    self._gates[part], self._others[part] = gate, others
                    if compiled.certain >> gate & 1 and names[part] == digits[0]:
                        self.firsts |= 1 << part

    def place(self, configuration: Configuration, progress: PartProgress) -> tuple[Hashable, bool]:
        """Equal for configurations with equal futures, whatever their values; and whether some choices are settled."""
        taken, dead, closed = configuration.taken, configuration.dead, configuration.closed
        settled: dict[int, int] = {}
        for part, gate in self._gates.items():
            if taken & self._below[part] and progress.flags(configuration, part) == TOUCHED | DONE | SURE:
                settled[part] = -1 - gate
        for part in settled:
            others = self._others[part]
            taken, dead, closed = taken & ~others, dead & ~others, closed | others
        broken = frozenset(
            (settled.get(one, one), settled.get(other, other)) for one, other in configuration.inversions
        )
        names = tuple(sorted(configuration.binding)) if settled else ()
        return (taken, dead, closed, broken, names, mask_of(-1 - one for one in settled.values())), bool(settled)

    def number(self, last: Witness | None) -> int:
        """What a partial match has chosen; of two that come to the same that with the lower number
        has the lower branch.
        """
        parts = set[int]()
        while last is not None:
            parts.add(self.compiled.part_of[last.node])
            last = last.before
        return sum(self.weights.get(part, 0) for part in parts)
