"""Independent parts: parts of a tree whose partial matches are followed separately.

*Joints* are the silent AND and SAND gates from the root on; the subtrees below them are *units*. Units
form one *part* if they share a node, if an event can serve both, if a guard relates their times, or
if both have choices, because the branch depends on all choices. No event of one part can be used by
another. So the numbers of their partial matches add instead of multiplying.

Parts with common variables or guards form a *component*. Its matches join matches of its parts that
agree. What one component does has no effect on another, so the first match of a component serves all
later events. If a component must end before another begins, its first match is the best.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, permutations
from typing import NamedTuple

from rvaft.core.overlaps import Overlaps
from rvaft.core.property import PartKind
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.support.bits import DisjointSets, bits, mask_of, union


class IndependentPart(NamedTuple):
    """The nodes of some units, and those of them that have an event."""

    nodes: int
    events: int


class Component(NamedTuple):
    """Parts with common variables or guards; one with choices has one part."""

    parts: tuple[IndependentPart, ...]
    nodes: int
    chooses: bool


def components(compiled: CompiledTree, letters: TreeLetters) -> tuple[Component, ...]:
    """Return the components of a tree, or an empty tuple if fewer than two parts have variables."""
    nodes, before = _units(compiled)
    units_of: dict[int, list[int]] = {}
    for unit, below in enumerate(nodes):
        for node in bits(below):
            units_of.setdefault(node, []).append(unit)
    parts, whole = DisjointSets(len(nodes)), DisjointSets(len(nodes))
    for tied in _ties(compiled, letters, units_of):
        parts.unite(tied)
    sharing: dict[str, list[int]] = {}
    for node, units in units_of.items():
        for name in (*compiled.exported[node], *compiled.needs[node]):
            sharing.setdefault(name, []).extend(units)
    for together in chain(sharing.values(), map(bits, parts.masks())):
        whole.unite(together)
    remembering = mask_of(node for node in units_of if compiled.exported[node])
    if sum(any(nodes[unit] & remembering for unit in bits(one)) for one in parts.masks()) < 2:
        return ()
    events = mask_of(node for node, own in enumerate(compiled.own) if own)
    chooses = mask_of(unit for unit, below in enumerate(nodes) if below & compiled.chooses)
    _keep_orders(whole, before, chooses)
    found = []
    for component in whole.masks():
        some = [one & component for one in parts.masks() if one & component]
        for one, other in permutations(some, 2):
            if component & chooses or any(before[unit] & one for unit in bits(other)):
                parts.unite((*bits(one), *bits(other)))
        with_events = [unit for unit in bits(component) if nodes[unit] & events]
        if with_events:  # conditions on events of this component belong to any part
            parts.unite((with_events[0], *(unit for unit in bits(component) if unit not in with_events)))
            made = (union(nodes[unit] for unit in bits(one)) for one in parts.masks() if one & component)
            all_ = tuple(IndependentPart(below, below & events) for below in made)
            found.append(Component(all_, union(one.nodes for one in all_), bool(component & chooses)))
    return tuple(found) if sum(len(one.parts) for one in found) > 1 else ()


def _units(compiled: CompiledTree) -> tuple[list[int], list[int]]:
    """Return the nodes of each unit, and the units that must precede each one."""
    joints, roots, agenda = set[int](), list[int](), [compiled.root]
    below = [1 << node for node in range(len(compiled.names))]
    for node in range(len(below) - 1, -1, -1):  # parents come first
        below[node] |= union(below[child] for child in compiled.children[node])
    while agenda:
        node = agenda.pop()
        free = node not in compiled.windows and not compiled.ends >> node & 1
        children, silent = compiled.children[node], free and compiled.guards[node] is None and not compiled.own[node]
        if silent and children and compiled.ops[node] in (PartKind.ALL, PartKind.SEQUENCE):
            agenda += [child for child in children if child not in joints]
            joints.add(node)
        elif node not in roots:
            roots.append(node)
    units = [0] * len(below)
    for unit, node in enumerate(roots):
        units[node] = 1 << unit
    for node in sorted(joints, reverse=True):
        units[node] = union(units[child] for child in compiled.children[node])
    before = [0] * len(roots)
    for node in joints:
        earlier = 0
        for child in compiled.children[node] if compiled.ops[node] is PartKind.SEQUENCE else ():
            for unit in bits(units[child]):
                before[unit] |= earlier
            earlier |= units[child]
    return [below[node] for node in roots], before


def _ties(compiled: CompiledTree, letters: TreeLetters, units_of: Mapping[int, list[int]]) -> Iterator[list[int]]:
    """Iterate over units of one part."""
    yield from units_of.values()
    yield [units[0] for node, units in units_of.items() if compiled.chooses >> node & 1]
    exporting: dict[str, list[int]] = {}
    for node, units in units_of.items():
        for name in compiled.exported[node]:
            exporting.setdefault(name, []).append(units[0])
    for node, units in units_of.items():
        if not compiled.times.isdisjoint(compiled.needs[node]):
            yield [units[0], *(one for name in compiled.needs[node] for one in exporting.get(name, ()))]
    serving = [(letter.pattern, nodes) for letter, nodes in zip(letters.letters, letters.serves, strict=True) if nodes]
    for _, nodes in serving:
        yield [units_of[node][0] for node in nodes]
    for one, other in Overlaps([pattern for pattern, _ in serving]).pairs():
        yield [units_of[serving[one][1][0]][0], units_of[serving[other][1][0]][0]]


def _keep_orders(whole: DisjointSets, before: Sequence[int], chooses: int) -> None:
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
