"""Settled choices: choices whose only remaining effect is the number of the branch.

A gate of the core (see `compiled_tree`) may keep one child, a part with all its events. Then no
other part below the gate can have an event. Partial matches that differ only in such a choice have
equal futures; the one with the lower branch is kept. One number encodes the choices, with the
digits of branch numbers.
"""

from collections.abc import Hashable

from rvaft.core.branches import or_gates
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import DONE, SURE, TOUCHED, Configuration, PartProgress, Witness
from rvaft.support.bits import mask_of


class SettledChoices:
    """The choices that may be settled; none for a kind, whose branches depend on more."""

    def __init__(self, compiled: CompiledTree) -> None:
        self.compiled = compiled
        self.weights: dict[int, int] = {}
        """The contribution of parts to the number."""
        self.firsts = 0
        """The parts with the lowest digit, of choices that every scenario makes."""
        self._gates: dict[int, int] = {}
        self._others: dict[int, int] = {}
        self._below = [0] * len(compiled.names)
        for node in range(len(compiled.names) - 1, -1, -1):
            self._below[node] |= 1 << node
            if compiled.parent[node] >= 0:
                self._below[compiled.parent[node]] |= self._below[node]
        tree, names = compiled.prop.tree, compiled.names
        if compiled.prop.kind is not None or compiled.clauses:
            return
        weights, weight = dict[str, int](), 1
        for name in or_gates(tree):
            weights[name] = weight
            weight *= len(tree.nodes[name].children)
        for gate in compiled.core:
            if gate not in compiled.choices.get(names[gate], ()):
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
        """Return a key that is equal for partial matches with equal futures up to values of
        variables, and whether choices are settled.
        """
        taken, dead, closed = configuration.taken, configuration.dead, configuration.closed
        unfit, owing = configuration.unfit, configuration.owing
        settled: dict[int, int] = {}
        for part, gate in self._gates.items():
            undecided = (configuration.held | configuration.failing) & self._below[part]
            if (
                taken & self._below[part]
                and not undecided
                and progress.flags(configuration, part) == TOUCHED | DONE | SURE
            ):
                settled[part] = -1 - gate
        for part in settled:
            others = self._others[part]
            taken, dead, closed = taken & ~others, dead & ~others, closed | others
            unfit, owing = unfit & ~others, owing & ~others
        broken = frozenset(
            (settled.get(one, one), settled.get(other, other)) for one, other in configuration.inversions
        )
        names = tuple(sorted(configuration.binding))
        absent = configuration.ended, configuration.unanswered, configuration.decided
        points = configuration.held, configuration.failing
        place = taken, dead, closed, broken, unfit, owing, configuration.broken, *absent, *points
        return (place, names, mask_of(-1 - one for one in settled.values())), bool(settled)

    def number(self, last: Witness | None) -> int:
        """Return the number of the choices of a partial match; lower numbers are lower branches."""
        parts = set[int]()
        while last is not None:
            parts.add(self.compiled.part_of[last.node])
            last = last.before
        return sum(self.weights.get(part, 0) for part in parts)
