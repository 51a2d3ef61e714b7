"""The nodes of units as rows of C tables, and the places of their matches in an instance.

An instance keeps matches of each child of a gate without order, and for each child of a sequence but the last
one those of the children up to it. Where times never decrease, that is the match that starts last. It has
*levels*: its start, and those of the matches that had to be complete before its first event, one for each
sequence around it. Where times may decrease, that is a *front* of matches, none within another.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, assert_never

from rvaft.core.units import Op, PositionUse, Unit, UnitLeaf

NONE: Final = "NONE"
NEVER: Final = "UINT64_MAX"
_MOST: Final = (1 << 64) - 1


class InstanceKind(NamedTuple):
    """The instances of a unit, or those with the last events of a leaf that has variables of its own."""

    names: tuple[str, ...]
    slots: int
    starts: int
    rings: int
    order: int
    window: int | None
    events: int
    """The number of places of events that the matches of an instance may need."""


class PlacedLeaf(NamedTuple):
    """A leaf with its node, unit and kind as numbers, and the places of what it needs and keeps."""

    leaf: UnitLeaf
    node: int
    unit: int
    after: int | None
    levels: int
    names: tuple[str, ...]
    """The variables that name its instance, and those of its own."""
    kind: int
    """The kind of the instance that has its last events."""
    ring: int
    room: int
    settled: bool
    """Whether no event is of use once the leaf, or a node above, is complete."""


@dataclass
class UnitTables:
    """The tables of some units."""

    kinds: list[InstanceKind] = field(default_factory=list)
    leaves: list[PlacedLeaf] = field(default_factory=list)
    """The leaves of each unit, the last one first: an event that serves two leaves of a sequence follows those before
    it at both."""
    nodes: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    """The names of the nodes."""
    levels: int = 1
    depth: int = 1
    """The greatest number of events of a match."""
    need: int = 1
    """The greatest number of siblings that a match needs."""
    siblings: int = 1
    """The greatest number of children of a gate without order."""
    fronts: bool = False
    """Whether times may decrease within a window."""

    @property
    def timed(self) -> bool:
        """Whether a window depends on times."""
        return any(one.leaf.timed for one in self.leaves)

    @property
    def starts(self) -> int:
        """The greatest number of starts in an instance."""
        return max(kind.starts for kind in self.kinds)


def tables_of(units: Sequence[Unit], *, fronts: bool = False) -> UnitTables:
    """Return the tables of units, with `fronts` of matches or with the match of each node that starts last.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> from rvaft.core.units import units
    >>> made = tables_of(units(build(rvaft.loads("top sand a b c;"))) or ())
    >>> made.starts, [one.after for one in made.leaves]
    (2, [1, 0, None])
    """
    made, own = UnitTables(fronts=fronts), list[InstanceKind]()
    for number, unit in enumerate(units):
        placing = _Fronts if fronts else _Starts
        own += placing(unit, number, made, len(units) + len(own)).own
    made.kinds += own
    return made


class _Placing(ABC):
    """Places the nodes of one unit; `own` are the kinds of its leaves with variables of their own."""

    def __init__(self, unit: Unit, number: int, made: UnitTables, free: int) -> None:
        self._unit, self._number = unit, number
        self._base = len(made.nodes)
        size = len(unit.places)
        self._slots = dict[int, int]()
        self._order, order = dict[int, int](), 0
        slots = self._place()
        for node, below in enumerate(unit.children):
            if below and unit.places[below[0]].op in (Op.ALL, Op.AT_LEAST):
                self._order[node] = order
                order += len(below)
                made.need = max(made.need, unit.places[below[0]].need - 1)
                made.siblings = max(made.siblings, len(below))
        weights = [*self._weights()]
        events = sum(2 * weights[0] * self._levels(node) for node in self._slots)
        self.own = list[InstanceKind]()
        starts, rings = slots, 0
        leaves = list[PlacedLeaf]()
        for leaf in unit.leaves:
            leaves.append(self._leaf(leaf, number, free + len(self.own), starts, rings))
            levels = leaves[-1].levels
            room = self._room(leaf, levels)
            needed = 4 * leaf.number + 2 * weights[0] * (levels - 1) * leaf.number if leaf.number > 1 else 0
            if leaf.own:
                names = (*unit.key, *leaf.own)
                self.own.append(InstanceKind(names, 0, room, 1, 0, unit.limits[leaf.node], needed))
            elif leaf.number > 1:
                starts, rings, events = starts + room, rings + 1, events + needed
        made.leaves += reversed(leaves)
        made.names += unit.names
        made.nodes += [self._row(node) for node in range(size)]
        made.kinds.append(InstanceKind(unit.key, slots, starts, rings, order, unit.window, events))
        made.levels = max(made.levels, *map(self._levels, range(size)), *(one.levels for one in leaves))
        made.depth = max(made.depth, weights[0])

    @abstractmethod
    def _place(self) -> int:
        """Place the nodes whose matches are kept, and return the number of places."""

    @abstractmethod
    def _levels(self, node: int) -> int:
        """Return the levels of a match when its gate takes it."""

    @abstractmethod
    def _room(self, leaf: UnitLeaf, levels: int) -> int:
        """Return the number of places that the last events of a leaf take."""

    @abstractmethod
    def _row(self, node: int) -> str:
        """Return the row of a node."""

    @abstractmethod
    def _after(self, node: int) -> str:
        """Return the role of a child of a sequence but the first one."""

    def _role(self, node: int) -> str:
        """Return the role of a node in its gate."""
        gate, op, before, *_ = self._unit.places[node]
        match op:
            case _ if gate < 0:
                return "ROOT"
            case Op.ONE:
                return "ONLY"
            case Op.ALL | Op.AT_LEAST:
                return "BESIDE"
            case Op.SEQUENCE | Op.ENDS:
                return "FIRST" if before < 0 else self._after(node)
            case Op.LEAF:
                raise AssertionError("a leaf has no children")
            case _:
                assert_never(op)

    def _is_kept(self, node: int) -> bool:
        """Whether the matches of a node are kept."""
        return (
            node > 0
            and self._unit.places[node].op is not Op.ONE
            and not (self._ordered(node) and self._unit.places[node].last)
        )

    def _ordered(self, node: int) -> bool:
        return self._unit.places[node].op in (Op.SEQUENCE, Op.ENDS)

    def _weights(self) -> Iterator[int]:
        """Yield the greatest number of events of a match of each node."""
        unit = self._unit
        found = [0] * len(unit.places)
        for leaf in unit.leaves:
            found[leaf.node] = leaf.number
        for node in range(len(found) - 1, -1, -1):
            if below := unit.children[node]:
                some = sorted((found[child] for child in below), reverse=True)
                place = unit.places[below[0]]
                found[node] = some[0] if place.op is Op.ONE else sum(some[: place.need])
        yield from found

    def _leaf(self, leaf: UnitLeaf, number: int, own: int, starts: int, ring: int) -> PlacedLeaf:
        after = None if leaf.after < 0 else self._slots[leaf.after]
        kind, ring, room = (own, 0, 0) if leaf.own else (number, ring, starts)
        levels, names = self._leaf_levels(leaf), (*self._unit.key, *leaf.own)
        settled = self._unit.settled[leaf.node]
        ring, room = (ring, room) if leaf.number > 1 else (0, 0)
        return PlacedLeaf(leaf, self._base + leaf.node, number, after, levels, names, kind, ring, room, settled)

    def _leaf_levels(self, leaf: UnitLeaf) -> int:  # noqa: ARG002 (fronts have no levels)
        """Return the levels of an event of a leaf."""
        return 1

    def _gate(self, node: int) -> int:
        return self._base + max(0, self._unit.places[node].gate)

    def _again(self, node: int) -> int:
        gate = self._unit.places[node].gate
        return int(gate >= 0 and self._unit.again[gate])


class _Starts(_Placing):
    """The places of the match of each node that starts last."""

    def _place(self) -> int:
        unit, size, slots = self._unit, len(self._unit.places), 0
        self._depth = [0] * size
        """The number of matches that had to be complete before the first event of a match."""
        for node in range(1, size):
            self._depth[node] = self._depth[unit.places[node].gate] + self._pops(node)
            if self._is_kept(node):
                self._slots[node] = slots
                slots += self._levels(node)
        return slots

    def _pops(self, node: int) -> bool:
        """Whether the children before must be complete at the first event of a match."""
        place = self._unit.places[node]
        return place.before >= 0 and (place.op is Op.SEQUENCE or self._unit.direct[node])

    def _levels(self, node: int) -> int:
        return 1 + self._depth[max(0, self._unit.places[node].gate)]

    def _leaf_levels(self, leaf: UnitLeaf) -> int:
        return 1 + self._depth[leaf.node]

    def _room(self, leaf: UnitLeaf, levels: int) -> int:
        return leaf.number * levels if leaf.number > 1 else 0

    def _after(self, node: int) -> str:
        return "AFTER" if self._pops(node) else "ENDING"

    def _row(self, node: int) -> str:
        gate, _, before, _, siblings, need = self._unit.places[node]
        role, place = self._role(node), self._slots.get(node, NONE)
        elder = self._slots[before] if role == "ENDING" else NONE
        order = self._order[gate] if role == "BESIDE" else 0
        numbers = self._gate(node), place, elder, order, max(1, len(siblings)), max(1, need)
        levels = self._levels(node)
        within = duration(self._unit.windows[node])
        return f"{{{within}, {', '.join(map(str, numbers))}, {levels}, {role}, {self._again(node)}}}"


class _Fronts(_Placing):
    """The places of fronts; those of the children of a gate without order follow each other."""

    def _place(self) -> int:
        for below in self._unit.children:
            for node in below:
                if self._is_kept(node):
                    self._slots[node] = len(self._slots)
        self._positions = PositionUse.of(self._unit)
        return len(self._slots)

    def _levels(self, node: int) -> int:  # noqa: ARG002 (none)
        return 1

    def _room(self, leaf: UnitLeaf, levels: int) -> int:  # noqa: ARG002 (none)
        return 1 if leaf.number > 1 else 0

    def _after(self, node: int) -> str:  # noqa: ARG002 (the same for all)
        return "AFTER"

    def _row(self, node: int) -> str:
        unit = self._unit
        _, op, before, _, siblings, need = unit.places[node]
        role, place = self._role(node), self._slots.get(node, NONE)
        elder = self._slots[before] if role == "AFTER" else NONE
        beside = self._slots[siblings[0]] if role == "BESIDE" else 0
        numbers = self._number, self._gate(node), place, elder, beside, max(1, len(siblings)), max(1, need)
        apart = op is Op.SEQUENCE and before >= 0 and not unit.direct[node]
        flags = self._again(node), self._positions.inside[node], self._positions.followed[node], apart
        durations = f"{duration(unit.windows[node])}, {duration(unit.limits[node])}"
        return f"{{{durations}, {', '.join(map(str, numbers))}, {role}, {', '.join(str(int(one)) for one in flags)}}}"


def duration(window: int | None) -> str:
    """Return a duration in C."""
    return NEVER if window is None or window >= _MOST else f"UINT64_C({window})"
