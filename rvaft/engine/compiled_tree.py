"""A property compiled to numbers, for look-ups per event.

Nodes are numbered in tree order, parents first; sets of nodes are bit masks. The children of a
sequence are in time order. A node joins a part of the property with its unshared condition and its
own event.

A tree without shared nodes is one *part*. Otherwise shared nodes and their ancestors form the
*core*. Every other child of a core node is the root of a *part*, a read-once tree.

A guard over variables of its own event only is a *filter*. Other variables are *exported*: a
partial match keeps their values until the guards are decided.
"""

from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice
from typing import Any, Final, NamedTuple

from rvaft.core import property as core
from rvaft.core.guard_table import GuardTable, guard_table
from rvaft.core.letters import EventTest, Letter, Reader, reader
from rvaft.core.part_numbers import op_of
from rvaft.core.pattern_index import PatternIndex
from rvaft.core.property import Part, PartKind, Property, Source, fewest
from rvaft.core.times import Extreme, TimeDifference, differences
from rvaft.model.expressions import without_text
from rvaft.model.guards import (
    Guard,
    Operator,
    Predicate,
    TimePoint,
    conjuncts,
    predicate,
    renamed,
    substitute,
    time_points,
)
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Pattern, Variable, rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.support.bits import bits, mask_of, union


class _Node(NamedTuple):
    """A node of the engine; `event_first`: whether its own event precedes its children."""

    part: Part
    event: core.Event | None
    event_first: bool | None
    guard: Guard | None
    op: PartKind
    children: tuple[Part, ...]
    need: int
    window: int | None = None
    ends: bool = False
    """Whether the children end in order."""
    absence: core.WithoutEvent | None = None
    points: tuple[int, ...] = ()
    """The nodes whose `start` or `end` the guard has."""


def _all_nodes(prop: Property) -> tuple[list[_Node], list[tuple[int, ...]]]:
    """Return the nodes and their children; alternatives made by a pass share no nodes."""
    found, children, roots = list[_Node](), list[tuple[int, ...]](), list[int]()
    alternatives = prop.alternatives
    if len(alternatives) != 1:
        found.append(_Node(prop.root, None, None, None, PartKind.ONE, prop.root.parts, 1))
        children.append(())
    for alternative in alternatives:
        direction = next((one.event_first for one in found if one.event_first is not None), None)
        nodes, first = _nodes(alternative, direction), len(found)
        number = {one.part: node for node, one in enumerate(nodes, first)}
        named: dict[str, int] = {}
        for node, one in enumerate(nodes, first):
            if one.part.source is not None:
                named.setdefault(one.part.source.node, node)  # the outermost comes first
        roots.append(first)
        found += (_with_registers(one, named) for one in nodes)
        children += (tuple(number[child] for child in one.children) for one in nodes)
    if len(alternatives) != 1:
        children[0] = tuple(roots)
    return found, children


def _with_registers(node: _Node, named: Mapping[str, int]) -> _Node:
    """Return the node with registers in place of the `start` and `end` of nodes with choices."""
    points = [point for point in time_points(node.guard) if point.point != "at"]
    if node.guard is None or not points:
        return node
    found = {point.name: named[point.node] for point in points if point.node in named}
    values: dict[str, Guard] = {}
    for point in points:
        if point.name in found:
            register = Register.of(found[point.name])
            values[point.name] = Variable(register.least if point.point == "start" else register.greatest)
    return node._replace(guard=substitute(node.guard, values), points=tuple(sorted({*found.values()})))


def _nodes(prop: Property, direction: bool | None) -> list[_Node]:
    found: list[_Node] = []
    taken: set[Part] = set()
    for part in reversed(prop.parts):
        if part not in taken:
            node = _joined(part, prop.shared, direction)
            direction = node.event_first if direction is None else direction
            found.append(node)
            below = set(node.children)
            agenda = [inner for inner in part.parts if inner not in below]
            while agenda:
                inner = agenda.pop()
                taken.add(inner)
                agenda += [one for one in inner.parts if one not in below]
    return found


def _joined(part: Part, shared: frozenset[Part], direction: bool | None) -> _Node:
    guard: Guard | None = None
    rest, current = part.parts, part
    if isinstance(part, core.All) and len(rest) > 1 and isinstance(last := rest[-1], core.Condition):
        if last not in shared and last.source == part.source:
            guard, rest = last.guard, rest[:-1]
        if guard is not None and len(rest) == 1 and _belongs(rest[0], part, shared):
            current, rest = rest[0], rest[0].parts
    match current:
        case core.Event():
            return _Node(part, current, None, guard, op_of(current), (), 0)
        case core.Within(parts=parts, duration=duration):
            return _Node(part, None, None, guard, PartKind.ALL, parts, 1, window=duration)
        case core.WithoutEvent(parts=parts):
            return _Node(part, None, None, guard, PartKind.ALL, parts, 1, absence=current)
        case core.Condition() if guard is None:
            return _Node(part, None, None, current.guard, op_of(current), (), 0)
        case core.Sequence(parts=(core.Event() as event, below)) if direction is not False:
            first = True
        case core.Sequence(parts=(below, core.Event() as event)) if direction is not True:
            first = False
        case _:
            ends = isinstance(current, core.EndInOrder)
            return _Node(part, None, None, guard, _op(current), rest, _need(current, rest), ends=ends)
    if _belongs(event, part, shared) and _belongs(below, part, shared) and _is_gate(below):
        ends = isinstance(below, core.EndInOrder)
        return _Node(part, event, first, guard, _op(below), below.parts, fewest(below), ends=ends)
    return _Node(part, None, None, guard, op_of(current), rest, len(rest))


def _op(part: Part) -> PartKind:
    return PartKind.ALL if isinstance(part, core.EndInOrder) else op_of(part)


def _belongs(inner: Part, part: Part, shared: frozenset[Part]) -> bool:
    same = inner.source is not None and part.source is not None and inner.source.node == part.source.node
    return same and inner not in shared


def _is_gate(part: Part) -> bool:
    own = any(isinstance(one, core.Condition) and _belongs(one, part, frozenset()) for one in part.parts)
    return bool(part.parts) and not own and not isinstance(part, core.Within | core.WithoutEvent)


def _need(part: Part, rest: tuple[Part, ...]) -> int:
    return len(rest) if isinstance(part, core.All) else fewest(part)


class CompiledTree:
    """The structure of a property, mostly as tuples by node; `parent` and `slot` are -1 outside of
    parts.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> compiled = CompiledTree(build(rvaft.loads("top sand a b; a or c d;")))
    >>> compiled.names, compiled.children[0], compiled.need[1]
    (('top', 'a', 'c', 'd', 'b'), (1, 4), 1)
    """

    root: Final = 0

    def __init__(self, prop: Property, *, kept: Collection[str] = ()) -> None:
        self.prop = prop
        self.kept = frozenset(kept)
        """The variables whose values partial matches keep, whether needed or not."""
        nodes, inner = _all_nodes(prop)
        self.names = tuple("" if one.part.source is None else one.part.source.node for one in nodes)
        """The name in the tree; several nodes may share a name."""
        self.events = tuple(None if one.event is None else one.event.source for one in nodes)
        self.ops = tuple(one.op for one in nodes)
        self.children = tuple(inner)
        self.child_masks = tuple(map(mask_of, inner))
        self.need = tuple(one.need for one in nodes)
        """The minimum number of children in a scenario."""
        choosing = (node for node, one in enumerate(nodes) if len(one.children) > one.need)
        self.chooses = mask_of(choosing)
        """The nodes that may keep fewer than all children."""
        self.certain = 1 << self.root
        """The nodes of every scenario."""
        for node, children in enumerate(self.children):
            if self.certain >> node & ~self.chooses >> node & 1:
                self.certain |= mask_of(children)
        self.own = tuple(one.event is not None for one in nodes)
        self.events_mask = mask_of(node for node, own in enumerate(self.own) if own)
        self.top_down = next((one.event_first for one in nodes if one.event_first is not None), True)
        """Whether events of nodes precede the events below them."""
        self.patterns = tuple(None if one.event is None else one.event.pattern for one in nodes)
        self.clauses = {
            node: AbsenceClause(node, inner[node][0], part, prop.tree)
            for node, one in enumerate(nodes)
            if (part := one.absence)
        }
        """The silent nodes with an absent event."""
        self.point_nodes = frozenset(point for one in nodes for point in one.points)
        """The nodes whose `start` or `end` a guard has."""
        self._note_variables(nodes)
        seen = Counter(chain(*self.children))
        self._note_parts({child for child, count in seen.items() if count > 1})
        self.ends = mask_of(node for node, one in enumerate(nodes) if one.ends)
        """The gates whose children end in order; they are above no shared node."""
        assert not self.ends & mask_of(self.core), "such trees have alternatives instead"
        self.windows = {node: one.window for node, one in enumerate(nodes) if one.window is not None}
        """The silent nodes that bound how far the events below are apart, with durations."""
        self._note_absences(len(nodes))
        self._note_registers()
        self._note_points(nodes)
        waiting = (node for node in range(len(nodes)) if self.needs[node])
        self.closed = (1 << len(nodes)) - 1 ^ mask_of(waiting)
        """The nodes without a guard that waits for variables."""
        self.explained: dict[Hashable, Any] = {}
        """The explained matches of earlier detections, by what they depend on (see `explanation`)."""

    def times_of(self, node: int) -> tuple[str, ...]:
        """Return the variables that have the time of a node's event: its own, and the present."""
        time = self.time_of[node]
        return (*(() if time is None else (time,)), *((NOW,) if self.registers[node] else ()))

    def some(self, nodes: Iterable[int]) -> str:
        """Return the names of the first nodes, for a message."""
        first = [self.names[node] for node in islice(nodes, 11)]
        return ", ".join([*first[:10], *("…" for _ in first[10:])])

    @cached_property
    def occurrences(self) -> Mapping[Source, int]:
        """The node of each occurrence."""
        return {source: node for node, source in enumerate(self.events) if source is not None}

    @cached_property
    def choices(self) -> Mapping[str, Sequence[int]]:
        """The nodes of each `or` gate of the tree, in several alternatives several."""
        found: dict[str, list[int]] = {}
        for node, name in enumerate(self.names):
            if name and self.ops[node] is PartKind.ONE:
                found.setdefault(name, []).append(node)
        return found

    def decided_by(self, nodes: Iterable[int]) -> dict[int, Guard]:
        """Return the guards, by node, that an event of these nodes decides alone."""
        found: dict[int, Guard] = {}
        for node in nodes:
            own = set(self.exported[node])
            for waiting in dict.fromkeys(one for name in self.exported[node] for one in self.guarded_by.get(name, ())):
                guard = self.guards[waiting]
                if guard is not None and own.issuperset(self.needs[waiting]):
                    found[waiting] = guard
        return found

    def child(self, gate: int, name: str) -> int:
        """Return the child of a node with this name, or -1."""
        return next((child for child in self.children[gate] if self.names[child] == name), -1)

    def _note_variables(self, nodes: Sequence[_Node]) -> None:
        guards = [one.guard for one in nodes]
        self.times = frozenset(point.name for guard in guards for point in time_points(guard))
        points = [None if one.event is None else TimePoint.of("at", *one.event.source).name for one in nodes]
        self.time_of = tuple(name if name in self.times else None for name in points)
        """The variable of the time of a node's event, if a guard uses it."""
        bound = [() if pattern is None else rigid_variables(pattern) for pattern in self.patterns]
        bound = [names if time is None else (*names, time) for names, time in zip(bound, self.time_of, strict=True)]
        needs = [guard_variables(guard) for guard in guards]
        mentioned = Counter(name for both in zip(bound, needs, strict=True) for name in {*both[0], *both[1]})
        mentioned.update(self.kept)
        self.absent_with: dict[str, list[int]] = {}
        """By variable, the nodes with an absent event that shares it."""
        for clause in self.clauses.values():
            for name in clause.part.shared:
                self.absent_with.setdefault(name, []).append(clause.node)
                mentioned[name] += 1
        private = [{name for name in names if mentioned[name] == 1 and name not in self.times} for names in bound]
        filters = [bool(names) and private[node].issuperset(names) for node, names in enumerate(needs)]
        self.filters = tuple(guard if only else None for guard, only in zip(guards, filters, strict=True))
        """The guards that a node's event alone decides."""
        self.guards = tuple(None if only else guard for guard, only in zip(guards, filters, strict=True))
        """The guards that wait for remembered variables, or are constant."""
        self.needs = tuple(() if only else names for names, only in zip(needs, filters, strict=True))
        """The variables of `guards`."""
        self.exported = tuple(
            tuple(name for name in names if name not in private[node] or name in self.needs[node])
            for node, names in enumerate(bound)
        )
        """The variables of a node's event that a partial match keeps."""
        self.predicates = tuple(None if guard is None else predicate(guard) for guard in self.guards)
        self.guarded_by: dict[str, list[int]] = {}
        """By variable, the nodes whose guard waits for it."""
        self.mentions: dict[str, int] = {}
        """By variable, the nodes whose event has it."""
        for node in range(len(nodes)):
            for name in self.needs[node]:
                self.guarded_by.setdefault(name, []).append(node)
            for name in self.exported[node]:
                self.mentions[name] = self.mentions.get(name, 0) | 1 << node

    @cached_property
    def conjuncts(self) -> tuple[tuple["Conjunct", ...], ...]:
        """The conjuncts of each node's guard."""
        return tuple(tuple(Conjunct.of(part, self.times) for part in conjuncts(guard)) for guard in self.guards)

    def _note_parts(self, core: set[int]) -> None:
        size = len(self.names)
        picks = bytearray(size)
        for node in range(size - 1, -1, -1):
            if not core.isdisjoint(self.children[node]):
                core.add(node)
            picks[node] = self.ops[node] is PartKind.ONE or any(picks[child] for child in self.children[node])
        self.picks = mask_of(node for node in range(size) if picks[node])
        """The nodes that keep one child, and their ancestors."""
        self.core, self.members = tuple(sorted(core)), frozenset(core)
        self.parent, self.slot, self.part_of = [-1] * size, [-1] * size, list(range(size))
        self.freezer = [-1] * size
        """The nearest node upwards in its part that a later event can end, or -1.

        Such a node is a child of a sequence, but not the last, or of a gate whose own event follows
        its children.
        """
        for node, children in enumerate(self.children):
            ends = self.own[node] and not self.top_down
            for slot, child in enumerate(children if node not in core else ()):
                self.parent[child], self.slot[child], self.part_of[child] = node, slot, self.part_of[node]
                later = self.ops[node] is PartKind.SEQUENCE and slot + 1 < len(children)
                self.freezer[child] = child if later or ends else self.freezer[node]
        self.parts = tuple(node for node in range(size) if node not in core and self.parent[node] < 0)

    def _note_absences(self, size: int) -> None:
        self.inside: list[int] = [0] * size
        """If there are absent events, for each node the nodes at and below it."""
        for node in range(size - 1, -1, -1) if self.clauses else ():
            self.inside[node] = 1 << node | union(self.inside[child] for child in self.children[node])
        targets = {clause.target: None for clause in self.clauses.values()}
        found = list[int]()
        for node in range(size if self.clauses else 0):
            found.append(mask_of(target for target in targets if self.inside[target] >> node & 1))
        self.absent_around = found
        """If there are absent events, for each node the parts around it that have one."""
        self.clauses_of: dict[int, list[AbsenceClause]] = {}
        """The clauses of each such part."""
        for clause in self.clauses.values():
            self.clauses_of.setdefault(clause.target, []).append(clause)

    def events_inside(self, node: int) -> int:
        """Return the nodes with an event at and below a part with an absent event."""
        return self.inside[node] & self.events_mask

    def clauses_around(self, node: int) -> list["AbsenceClause"]:
        """Return the clauses of parts with a node, inner ones first."""
        parts = [*bits(self.absent_around[node])] if self.clauses else []
        return [clause for part in reversed(parts) for clause in self.clauses_of[part]]

    def surely_below(self, window: int) -> frozenset[int]:
        """Return the core nodes and parts that are below a window in every scenario."""
        found = self._surely_below.get(window)
        if found is None:
            agenda, seen = [window] if self.certain >> window & 1 else [], set[int]()
            while agenda:
                node = agenda.pop()
                seen.add(node)
                if node in self.members and not self.chooses >> node & 1:
                    agenda += self.children[node]
            found = self._surely_below[window] = frozenset(seen)
        return found

    def register(self, node: int) -> "Register":
        """Return the register of a window, of a node with time points, or of an element of the core."""
        return Register.of(node)

    def _note_points(self, nodes: Sequence[_Node]) -> None:
        self.pointed: dict[int, PointGuard] = {}
        """The guards with a `start` or `end` of a node with choices, by their nodes."""
        for node, one in enumerate(nodes):
            if one.points and self.guards[node] is not None:
                names = self.needs[node]
                others = tuple(name for name in names if name not in self.register_of)
                times = tuple(name for name in names if name in self.register_of)
                top = self._lowest_common((node, *one.points))
                self.pointed[node] = PointGuard(node, one.points, times, others, top)
        self.pointed_from: dict[int, list[int]] = {}
        """The same by the lowest node of a part above the guard and its time points; -1 is the core."""
        for guard in self.pointed.values():
            self.pointed_from.setdefault(guard.top, []).append(guard.node)

    def _lowest_common(self, nodes: Iterable[int]) -> int:
        """Return the lowest node of a part above some nodes, or -1 if only the core is above all."""
        paths = []
        for node in nodes:
            path = [node]
            while self.parent[path[-1]] >= 0:
                path.append(self.parent[path[-1]])
            paths.append(path)
        common = set(paths[0]).intersection(*paths[1:]).difference(self.members)
        return max(common, default=-1)

    def _note_registers(self) -> None:
        size = len(self.names)
        self.below = [int(self.own[node]) << node for node in range(size)] if self.windows else []
        """If there are windows, for each node the events at and below it."""
        for node in range(size - 1, -1, -1) if self.windows else ():
            self.below[node] |= union(self.below[child] for child in self.children[node])
        self.over_core = tuple(node for node in self.windows if node in self.members)
        """The windows over shared nodes."""
        found = list[tuple[Register, ...]]()
        for node, own in enumerate(self.own):
            above = dict[int, None]()
            parent = node if own and (self.windows or self.point_nodes) else -1
            while parent >= 0:
                if (parent in self.windows and parent not in self.members) or parent in self.point_nodes:
                    above[parent] = None
                parent = self.parent[parent]
            if own and any(self.below[window] >> node & 1 for window in self.over_core):
                above[self.part_of[node]] = None
            for clause in self.clauses_around(node) if own else ():
                if clause.part.duration is not None:
                    above[clause.target] = None
            found.append(tuple(map(self.register, above)))
        self.registers = tuple(found)
        """For each node with an event, the registers of its time."""
        self._surely_below: dict[int, frozenset[int]] = {}
        self.register_of = {name: one for some in found for one in some for name in one[1:]}
        """The register of each of its variables."""
        self.times |= frozenset(self.register_of)


NOW: Final = "now"
"""The variable of the time of the present event."""


class Register(NamedTuple):
    """The variables with the least and the greatest time of the events taken at and below a node.

    The node is a window, a node whose `start` or `end` a guard has, or a part or core node below a
    window over shared nodes.
    """

    node: int
    least: str
    greatest: str

    @classmethod
    def of(cls, node: int) -> "Register":
        """Return the register of a node."""
        return cls(node, f"start[{node}]", f"end[{node}]")

    def noted(self, binding: dict[str, Json], now: Json) -> None:
        """Note the time of one more event; an undefined time makes both undefined."""
        for name, extreme in ((self.least, min), (self.greatest, max)):
            before = binding.get(name, now)
            binding[name] = None if before is None or now is None else extreme(before, now)


class PointGuard(NamedTuple):
    """A guard with the `start` or `end` of nodes with choices.

    Their parts may have further events in one scenario and not in another, so whether the guard holds
    may change with each event, until no part can have another one.
    """

    node: int
    points: tuple[int, ...]
    """The nodes with the time points."""
    times: tuple[str, ...]
    """The variables of registers."""
    others: tuple[str, ...]
    """The other variables."""
    top: int
    """The lowest node of a part above the guard and these nodes, or -1 if only the core is."""


def window_over(registers: Iterable[Register], duration: int) -> TimeDifference:
    """Return the condition on the times in some registers and on the present time."""
    registers = tuple(registers)
    last = Extreme(Operator.MAX, (*[one.greatest for one in registers], NOW))
    return TimeDifference(last, Extreme(Operator.MIN, (*[one.least for one in registers], NOW)), duration)


class AbsenceClause(NamedTuple):
    """An absent event: its silent node, the node of its part, and what must be absent."""

    node: int
    target: int
    part: core.WithoutEvent
    tree: RVAFT

    @property
    def event(self) -> str:
        """The absent event with its guard, as text."""
        source, number = self.place
        written = self.tree.nodes[source].without[number - 1]
        return without_text(replace(written, side=Side.DURING, duration=None)).removeprefix("without ")

    @property
    def place(self) -> tuple[str, int]:
        """The node in the tree, and the number of its clause."""
        return self.part.source.node, self.part.number

    @property
    def decided_by_event(self) -> bool:
        """Whether the guard needs the variables of the absent event only."""
        return set(guard_variables(self.part.guard)) <= set(rigid_variables(self.part.pattern))


class Conjunct(NamedTuple):
    """A conjunct of a guard with its variables and the differences that it bounds."""

    guard: Guard
    names: tuple[str, ...]
    over_times: bool
    differences: tuple[TimeDifference, ...] | None

    @classmethod
    def of(cls, guard: Guard, times: frozenset[str]) -> "Conjunct":
        """Return the conjunct with its variables and differences."""
        names = guard_variables(guard)
        over_times = times.issuperset(names)
        return cls(guard, names, over_times, differences(guard) if over_times else None)


class Hit(NamedTuple):
    """A letter that matches an event, its nodes, and the values of its variables."""

    letter: int
    nodes: tuple[int, ...]
    values: Mapping[str, Json]


class Reading(NamedTuple):
    """The meaning of an event; `hits` depends on the strategy, and is empty without a match."""

    relevant: bool
    hits: Sequence[Any]


_new: Final = tuple.__new__  # twice as fast as the constructors of the classes
NOTHING: Final = Reading(relevant=False, hits=())
"""An event that matches no pattern."""
QUIET: Final = Reading(relevant=False, hits=(None,))
"""Under `scattered`, an event that matches but changes nothing."""


class Admission(NamedTuple):
    """A letter: its nodes, whether it makes an event relevant, and its reader."""

    letter: int
    nodes: tuple[int, ...]
    relevant: bool
    reader: Reader
    times: tuple[str, ...]
    """The variables that have the time of the event."""
    decided: tuple[tuple[int, Guard | EventTest], ...]
    """The guards that the event alone decides, by node bit."""
    own: tuple[tuple[int, Predicate], ...] = ()
    """These guards for a letter with several ways to match; each way decides them."""
    breaks: tuple[int, ...] = ()
    """The nodes whose absent event this is."""


@dataclass(frozen=True, slots=True, eq=False)
class EventClass:
    """Events for which the same letters match and the same guards hold."""

    serving: tuple[Admission, ...] = ()
    """The letters that match and serve a node."""
    relevant: bool = False
    held: tuple[int, ...] = ()
    """The decided guards that hold, as bits, for each serving letter."""
    timed: bool = False
    """Whether a letter needs the time of the event, or may match in several ways."""
    breaking: tuple[Admission, ...] = ()
    """The letters of absent events that match."""


class Inert(NamedTuple):
    """The events of a class that change nothing in the current state.

    `letters` pairs each letter that may change something with its relevant fields (None if
    unknown). An event changes nothing if the values of these fields are in `known`.
    """

    letters: Sequence[tuple[int, Collection[str] | None]]
    known: Collection[Hashable]


class Occurrences(NamedTuple):
    """The patterns of occurrences, and the guards that their events alone decide."""

    prop: Property
    patterns: tuple[Pattern, ...]
    filters: tuple[Guard | None, ...]

    clauses: Mapping[int, "AbsenceClause"] = {}
    """The absent events."""

    def times_of(self, node: int) -> tuple[str, ...]:  # noqa: ARG002
        """Return no names: the strategy reads the time."""
        return ()

    def decided_by(self, nodes: Iterable[int]) -> dict[int, Guard]:  # noqa: ARG002
        """Return no guards: each waits for no other event."""
        return {}


class TreeLetters:
    """The letters of a tree.

    Equal patterns with equal guards are one letter. With `decide`, a class includes the guards that
    the event alone decides.
    """

    def __init__(self, compiled: CompiledTree | Occurrences, *, decide: bool = False) -> None:
        prop = compiled.prop
        self._time = None if prop.time is None else prop.time.reader()
        serves: dict[tuple[Letter, tuple[str, ...]], list[int]] = {}
        for node, pattern in enumerate(compiled.patterns):
            if pattern is not None:
                letter = Letter(pattern, compiled.filters[node])
                serves.setdefault((letter, compiled.times_of(node)), []).append(node)
        alphabet = dict.fromkeys((Letter(entry.pattern, entry.when), ()) for entry in prop.alphabet)
        breaks: dict[tuple[Letter, tuple[str, ...]], list[int]] = {}
        for clause in compiled.clauses.values():
            absent = Letter(clause.part.pattern, clause.part.guard if clause.decided_by_event else None)
            breaks.setdefault((absent, ()), []).append(clause.node)
        found = tuple(dict.fromkeys([*serves, *alphabet, *breaks]))
        self.letters = tuple(letter for letter, _ in found)
        self.serves = tuple(tuple(serves.get(one, ())) for one in found)
        self._admissions: dict[Pattern, list[Admission]] = {}
        for number, (letter, times) in enumerate(found):
            nodes, own = self.serves[number], reader(number, letter)
            broken = tuple(breaks.get((letter, times), ()))
            plain = Admission(number, nodes, (letter, times) in alphabet, own, times, (), (), broken)
            guards = compiled.decided_by(nodes).items() if decide else ()
            if own.ways is None:
                tests = tuple((1 << node, self._test(plain, guard)) for node, guard in guards)
                plain = plain._replace(decided=tests)
            else:
                plain = plain._replace(own=tuple((1 << n, predicate(guard)) for n, guard in guards))
            self._admissions.setdefault(own.pattern, []).append(plain)
        self._ignored = [
            reader(number, Letter(one.pattern, one.when)) for number, one in enumerate(prop.ignored, len(found))
        ]
        self.patterns = (*self._admissions, *(one.pattern for one in self._ignored))
        self._shapes = PatternIndex(
            self.patterns, lambda decided: self.table({self.patterns[one] for one in chain(*decided)})
        )

    def classify(self, event: Mapping[str, Json]) -> EventClass:
        """Return the class of an event."""
        return self._shapes.of(event).of(event)

    def _test(self, admission: Admission, guard: Guard) -> Guard | EventTest:
        fields = admission.reader.fields
        if fields is not None and fields.keys() >= set(guard_variables(guard)):
            return renamed(guard, fields)
        admits, holds = admission.reader.admits, predicate(guard)
        name = (admission.reader.pattern, admission.times, guard)
        return EventTest(name, lambda event: admits(event) and holds(self.values(admission, event)))

    def time(self, event: Mapping[str, Json]) -> int | None:
        """Return the time of an event; None if it has none."""
        return None if self._time is None else self._time(event)

    def values(self, admission: Admission, event: Mapping[str, Json]) -> dict[str, Json]:
        """Return the values of a letter's variables."""
        found = admission.reader.values(event)
        if admission.times:
            found.update(dict.fromkeys(admission.times, self.time(event)))
        return found

    def ways(self, admission: Admission, event: Mapping[str, Json], time: int | None) -> list[dict[str, Json]]:
        """Return the values of a letter's variables for each way in which the event matches.

        `time` is the time of the event.
        """
        found = [admission.reader.values(event)] if admission.reader.ways is None else admission.reader.ways(event)
        return [{**one, **dict.fromkeys(admission.times, time)} for one in found] if admission.times else found

    def table(self, possible: Collection[Pattern]) -> GuardTable[EventClass]:
        """Return the table from events to classes."""
        found = (one for pattern in possible for one in self._admissions.get(pattern, ()))
        letters = sorted(found, key=lambda one: one.letter)  # all letters in turn take too long in a large tree
        ignored = [one for one in self._ignored if one.pattern in possible]
        decided = [test for one in letters for _, test in one.decided]
        first = len(letters) + len(ignored)

        def derive(holds: Sequence[bool]) -> EventClass:
            relevant, serving, held, place = False, list[Admission](), list[int](), first
            for number, one in enumerate(letters):
                if holds[number]:
                    relevant = relevant or one.relevant
                    if one.nodes:
                        serving.append(one)
                        held.append(sum([bit for at, (bit, _) in enumerate(one.decided, place) if holds[at]]))
                place += len(one.decided)
            if any(holds[len(letters) : first]):
                relevant = False
            timed = any(one.times or one.reader.ways is not None for one in serving)
            breaking = tuple(one for number, one in enumerate(letters) if holds[number] and one.breaks)
            return EventClass(tuple(serving), relevant, tuple(held), timed, breaking)

        return guard_table([*(one.reader.test for one in letters), *(one.test for one in ignored), *decided], derive)

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the reading of an event."""
        serving = event_class.serving
        if not event_class.timed:
            hits = [_new(Hit, (one[0], one[1], one[3].values(event))) for one in serving]
            return _new(Reading, (event_class.relevant, hits))
        time = self.time(event)
        hits = [Hit(one.letter, one.nodes, values) for one in serving for values in self.ways(one, event, time)]
        return Reading(event_class.relevant, hits)
