"""A tree compiled to numbers: what the engine looks up while events come in.

Nodes are numbered in the order of the tree, parents before children; sets of nodes are bit masks. The children of an ordered gate
stand in the order of time. Where no node is shared the tree is one *part*. Otherwise the ancestors of shared nodes (and the
shared nodes) form the *core*, and every other child of a core node roots a part: a read-once tree that only the core relates to
the rest.
"""

from collections import Counter
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from rvaft.model.guards import Guard, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.patterns import rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, key

# Which variables tie the nodes of a tree together, and which concern one event alone.
#
# A variable that only one node's event and that node's own guard mention is no variable of the tree at all: whether the event fits
# can be said from the event. The guard then is a *filter* of the event; what remains are the *exported* variables, which a
# configuration has to remember, and the guards that wait for them.

_PLAIN: Final = (str, int, float, bool, type(None))


class Uses:
    """Who mentions which variable in a tree."""

    def __init__(self, tree: RVAFT) -> None:
        self._bound: dict[str, tuple[str, ...]] = {}
        mentioned: Counter[str] = Counter()
        for node in tree.top_down():
            pattern = tree.pattern(node.name)
            self._bound[node.name] = () if pattern is None else rigid_variables(pattern)
            mentioned.update({*self._bound[node.name], *_of_guard(node)})
        self._mentioned = mentioned

    def _private(self, node: Node) -> frozenset[str]:
        """The variables that nothing but this node mentions."""
        return frozenset(name for name in self._bound[node.name] if self._mentioned[name] == 1)

    def filter(self, node: Node) -> Guard | None:
        """The node's guard where its event alone decides it."""
        names = _of_guard(node)
        return node.when if names and names <= self._private(node) else None

    def waiting(self, node: Node) -> Guard | None:
        """The node's guard where it is constant or needs variables that a configuration remembers."""
        return None if self.filter(node) is not None else node.when

    def exported(self, node: Node) -> tuple[str, ...]:
        """The variables of the node's event that a configuration has to remember."""
        waits = self.waiting(node)
        local = self._private(node) - (frozenset() if waits is None else frozenset(guard_variables(waits)))
        return tuple(name for name in self._bound[node.name] if name not in local)


def _of_guard(node: Node) -> frozenset[str]:
    return frozenset() if node.when is None else frozenset(guard_variables(node.when))


def fingerprint(binding: Mapping[str, Json]) -> Hashable:
    """A hashable stand-in for a binding. Finer than equality of values: a guard may tell 2**60 from 2.0**60, since whole
    numbers are exact and the rest are IEEE doubles.
    """  # noqa: D205
    return frozenset((name, exact(value)) for name, value in binding.items())


def exact(value: Json) -> Hashable:
    """The same for one value."""
    kind = type(value)
    return (kind, value) if kind in _PLAIN else (key(value), _kinds(value))


def _kinds(value: Json) -> Hashable:
    """The types of the numbers in a value."""
    if not isinstance(value, (Mapping, list)):
        return (type(value),)
    found: list[Hashable] = []
    agenda = [value]
    while agenda:
        part = agenda.pop()
        if isinstance(part, Mapping):
            agenda.extend(part[name] for name in sorted(part))
        elif isinstance(part, list):
            agenda.extend(part)
        else:
            found.append(type(part))
    return tuple(found)


@dataclass(frozen=True)
class Plan:
    """The structure of a tree; `parent` and `slot` are -1 for the root of a part and for the nodes of the core."""

    names: tuple[str, ...]
    gates: tuple[Gate | None, ...]
    children: tuple[tuple[int, ...], ...]
    thresholds: tuple[int, ...]
    own: tuple[bool, ...]
    guards: tuple[Guard | None, ...]
    exported: tuple[tuple[str, ...], ...]
    filters: tuple[Guard | None, ...]
    top_down: bool
    core: tuple[int, ...]
    parts: tuple[int, ...]
    part_of: tuple[int, ...]
    parent: tuple[int, ...]
    slot: tuple[int, ...]

    @property
    def root(self) -> int:
        """The root of the tree: the first node of the order."""
        return 0

    def least(self, node: int) -> int:
        """The least number of children that a scenario with a node keeps."""
        match self.gates[node]:
            case Gate.OR:
                return 1
            case Gate.VOT:
                return self.thresholds[node]
            case _:
                return len(self.children[node])

    @cached_property
    def closed(self) -> int:
        """The nodes without a guard that waits for variables."""
        return sum(1 << node for node, guard in enumerate(self.guards) if not guard or not guard_variables(guard))

    @cached_property
    def dead(self) -> int:
        """The nodes that a constant guard rules out."""
        constant = ((n, g) for n, g in enumerate(self.guards) if g is not None and not guard_variables(g))
        return sum(1 << node for node, guard in constant if not holds(guard, {}))

    @cached_property
    def guarded_by(self) -> dict[str, tuple[int, ...]]:
        """The nodes whose guard waits for a variable."""
        found: dict[str, list[int]] = {}
        for node, guard in enumerate(self.guards):
            for name in guard_variables(guard) if guard is not None else ():
                found.setdefault(name, []).append(node)
        return {name: tuple(nodes) for name, nodes in found.items()}

    @cached_property
    def needs(self) -> tuple[tuple[str, ...], ...]:
        """The variables of each node's guard."""
        return tuple(() if guard is None else guard_variables(guard) for guard in self.guards)

    @cached_property
    def mentions(self) -> dict[str, int]:
        """The occurrences that bind or compare a variable."""
        found: dict[str, int] = {}
        for node, names in enumerate(self.exported):
            for name in names:
                found[name] = found.get(name, 0) | 1 << node
        return found

    @cached_property
    def freezer(self) -> tuple[int, ...]:
        """The nearest of a node and its ancestors (in its part) that something later can end: a child of an ordered gate
        that is not the last, or of a gate whose own event comes after its children; -1 where there is none.
        """  # noqa: D205
        found: list[int] = []
        for node, parent in enumerate(self.parent):
            if parent < 0:
                found.append(-1)
            elif self._freezes(parent, self.slot[node]):
                found.append(node)
            else:
                found.append(found[parent])
        return tuple(found)

    def _freezes(self, gate: int, slot: int) -> bool:
        if self.own[gate] and not self.top_down:
            return True
        kind = self.gates[gate]
        return kind is not None and kind.ordered and slot + 1 < len(self.children[gate])

    @cached_property
    def chooses(self) -> int:
        """The nodes that are an `or` or have one below."""
        found = 0
        for node in range(len(self.names) - 1, -1, -1):
            if self.gates[node] is Gate.OR or any(found >> child & 1 for child in self.children[node]):
                found |= 1 << node
        return found


def plan_of(tree: RVAFT) -> Plan:
    """Compile a tree."""
    number = {name: index for index, name in enumerate(tree.order)}
    nodes = [tree.nodes[name] for name in tree.order]
    uses = Uses(tree)
    core = _core(tree)
    children = [
        tuple(number[c] for c in (reversed(node.children) if node.gate is Gate.SAND_RL else node.children))
        for node in nodes
    ]
    parent, slot, part_of = [-1] * len(nodes), [-1] * len(nodes), list(range(len(nodes)))
    for index, node in enumerate(nodes):
        if node.name not in core:
            for place, child in enumerate(children[index]):
                parent[child], slot[child], part_of[child] = index, place, part_of[index]
    return Plan(
        names=tuple(tree.order),
        gates=tuple(node.gate for node in nodes),
        children=tuple(children),
        thresholds=tuple(node.threshold or 0 for node in nodes),
        own=tuple(node.has_event for node in nodes),
        guards=tuple(uses.waiting(node) for node in nodes),
        exported=tuple(uses.exported(node) for node in nodes),
        filters=tuple(uses.filter(node) for node in nodes),
        top_down=tree.causality is Causality.TOP_DOWN,
        core=tuple(index for index, node in enumerate(nodes) if node.name in core),
        parts=tuple(i for i, node in enumerate(nodes) if node.name not in core and parent[i] < 0),
        part_of=tuple(part_of),
        parent=tuple(parent),
        slot=tuple(slot),
    )


def _core(tree: RVAFT) -> frozenset[str]:
    """The shared nodes and their ancestors."""
    found, agenda = set(tree.shared), sorted(tree.shared)
    while agenda:
        new = [name for name in tree.parents(agenda.pop()) if name not in found]
        found.update(new)
        agenda.extend(new)
    return frozenset(found)
