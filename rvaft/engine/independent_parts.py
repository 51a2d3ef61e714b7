"""Independent parts: parts of a tree whose partial matches are followed separately.

*Joints* are the silent AND and SAND gates from the root on; the subtrees below them are *units*. Units
form one *part* if an event can serve both, if a guard relates their times, or if both have choices,
because the branch depends on all choices. No event of one part can be used by another. So the numbers
of their partial matches add instead of multiplying.

Parts with common variables or guards form a *component*. Its matches join matches of its parts that
agree. What one component does has no effect on another, so the first match of a component serves all
later events. If a component must end before another begins, its first match is the best.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, permutations
from typing import NamedTuple

from rvaft.core.part_numbers import PartKind
from rvaft.core.patterns import Overlaps
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.support.bits import bits, mask_of, union


class IndependentPart(NamedTuple):
    """Some units, and all nodes below them."""

    units: tuple[int, ...]
    nodes: int


class Component(NamedTuple):
    """Parts with common variables or guards; one with choices has one part."""

    parts: tuple[IndependentPart, ...]
    nodes: int
    chooses: bool


class _Sets:
    """Disjoint sets of numbers."""

    def __init__(self, size: int) -> None:
        self._above = list(range(size))

    def first(self, one: int) -> int:
        while self._above[one] != one:
            one = self._above[one]
        return one

    def unite(self, some: Iterable[int]) -> None:
        firsts = [self.first(one) for one in some]
        for one in firsts[1:]:
            self._above[self.first(one)] = self.first(firsts[0])

    def masks(self) -> list[int]:
        """Return the sets as bits."""
        found: dict[int, int] = {}
        for one in range(len(self._above)):
            found[self.first(one)] = found.get(self.first(one), 0) | 1 << one
        return list(found.values())


def components(compiled: CompiledTree, letters: TreeLetters) -> tuple[Component, ...]:
    """Return the components of a tree, or an empty tuple if fewer than two parts have variables."""
    if compiled.core:
        return ()
    units, unit_of, before = _units(compiled)
    parts, whole = _Sets(len(units)), _Sets(len(units))
    nodes = [0] * len(units)
    for node, unit in unit_of.items():
        nodes[unit] |= 1 << node
    for tied in _ties(compiled, letters, unit_of):
        parts.unite(tied)
    sharing: dict[str, list[int]] = {}
    for node, unit in unit_of.items():
        for name in (*compiled.exported[node], *compiled.needs[node]):
            sharing.setdefault(name, []).append(unit)
    for together in chain(sharing.values(), map(bits, parts.masks())):
        whole.unite(together)
    with_events = [any(compiled.own[node] for node in bits(one)) for one in nodes]
    chooses = mask_of(unit for unit, one in enumerate(nodes) if one & compiled.chooses)
    if (
        sum(any(compiled.exported[node] for unit in bits(one) for node in bits(nodes[unit])) for one in parts.masks())
        < 2
    ):
        return ()
    _keep_orders(whole, before, chooses)
    found = []
    for component in whole.masks():
        some = [one & component for one in parts.masks() if one & component]
        for one, other in permutations(some, 2):
            if component & chooses or any(before[unit] & one for unit in bits(other)):
                parts.unite((*bits(one), *bits(other)))
        eventless = [unit for unit in bits(component) if not with_events[unit]]
        if len(eventless) < component.bit_count():
            for unit in eventless:
                parts.unite((next(one for one in bits(component) if with_events[one]), unit))
            some = [one & component for one in parts.masks() if one & component]
            made = [
                IndependentPart(tuple(units[unit] for unit in bits(one)), union(nodes[u] for u in bits(one)))
                for one in some
            ]
            found.append(Component(tuple(made), union(one.nodes for one in made), bool(component & chooses)))
    return tuple(found) if sum(len(one.parts) for one in found) > 1 else ()


def _units(compiled: CompiledTree) -> tuple[list[int], dict[int, int], list[int]]:
    """Return the units, the unit of each node below, and the units that must precede each one."""
    joints, units, unit_of = set[int](), list[int](), dict[int, int]()
    for node, children in enumerate(compiled.children):  # parents come first
        if node == compiled.root or compiled.parent[node] in joints:
            silent = compiled.guards[node] is None and not compiled.own[node]
            if silent and children and compiled.ops[node] in (PartKind.ALL, PartKind.SEQUENCE):
                joints.add(node)
                continue
            unit_of[node] = len(units)
            units.append(node)
        else:
            unit_of[node] = unit_of[compiled.parent[node]]
    below = [1 << unit_of[node] if node in unit_of else 0 for node in range(len(compiled.names))]
    for node in sorted(joints, reverse=True):
        below[node] = union(below[child] for child in compiled.children[node])
    before = [0] * len(units)
    for node in joints:
        earlier = 0
        for child in compiled.children[node] if compiled.ops[node] is PartKind.SEQUENCE else ():
            for unit in bits(below[child]):
                before[unit] |= earlier
            earlier |= below[child]
    return units, unit_of, before


def _ties(compiled: CompiledTree, letters: TreeLetters, unit_of: dict[int, int]) -> Iterator[list[int]]:
    """Iterate over units of one part."""
    yield [unit for node, unit in unit_of.items() if compiled.chooses >> node & 1]
    exporting: dict[str, list[int]] = {}
    for node, unit in unit_of.items():
        for name in compiled.exported[node]:
            exporting.setdefault(name, []).append(unit)
    for node, unit in unit_of.items():
        if not compiled.times.isdisjoint(compiled.needs[node]):
            yield [unit, *(one for name in compiled.needs[node] for one in exporting.get(name, ()))]
    serving = [(letter.pattern, nodes) for letter, nodes in zip(letters.letters, letters.serves, strict=True) if nodes]
    for _, nodes in serving:
        yield [unit_of[node] for node in nodes]
    for one, other in Overlaps([pattern for pattern, _ in serving]).pairs():
        yield [unit_of[serving[one][1][0]], unit_of[serving[other][1][0]]]


def _keep_orders(whole: _Sets, before: Sequence[int], chooses: int) -> None:
    """Unite components until one precedes another as a whole or not at all.

    A component with choices precedes none, because a later match may have a lower branch.
    """
    united = True
    while united:
        united = False
        masks = whole.masks()
        for one, other in permutations(masks, 2):
            some = union(before[unit] for unit in bits(other))
            if some & one and (one & chooses or any(one & ~before[unit] for unit in bits(other))):
                whole.unite((*bits(one), *bits(other)))
                united = True
                break
