"""A property compiled to numbers: what the engine looks up while events come in.

Nodes are numbered in the order of the tree, parents before children; sets of nodes are bit masks.
The children of a sequence stand in the order of time. Where no node is shared the tree is one
*part*. Otherwise the ancestors of shared nodes (and the shared nodes) form the *core*, and every
other child of a core node roots a part: a read-once tree that only the core relates to the rest.

A node of the engine is a part of the property, together with a condition on it and with the event
right before it (or right after it), where nothing else refers to these.

A variable that only one node's event and that node's own guard mention is no variable of the tree
at all: whether the event fits can be said from the event. The guard then is a *filter* of the
event; what remains are the *exported* variables, which a configuration has to remember, and the
guards that wait for them.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple, TypeAlias

from rvaft.core import property as core
from rvaft.core.classifier import GuardTable, Letter, PatternIndex, Reader, guard_table, reader
from rvaft.core.part_numbers import PartKind, op_of
from rvaft.core.property import Part, Property, Source, fewest
from rvaft.core.times import TimeDifference, differences
from rvaft.model.guards import Guard, Predicate, TimePoint, conjuncts, predicate, time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.model.values import Json
from rvaft.support.bits import mask_of


class _Node(NamedTuple):
    """A node of the engine: its part, an event of its own with whether that comes first, its guard,
    and what is below.
    """

    part: Part
    event: core.Event | None
    event_first: bool | None
    guard: Guard | None
    op: PartKind
    children: tuple[Part, ...]
    need: int


def _nodes(prop: Property) -> list[_Node]:
    """The nodes, parents before children, in the order of the tree."""
    found: list[_Node] = []
    taken: set[Part] = set()
    direction: bool | None = None
    for part in reversed(prop.parts):
        if part not in taken:
            node = _joined(part, prop.shared, direction)
            direction = node.event_first if direction is None else direction
            found.append(node)
            below = set(node.children)
            agenda = [inner for inner in part.parts if inner not in below]
            while agenda:  # what has become one node with the part
                inner = agenda.pop()
                taken.add(inner)
                agenda += [one for one in inner.parts if one not in below]
    return found


def _joined(part: Part, shared: frozenset[Part], direction: bool | None) -> _Node:
    """A part as a node, with the condition and the event at its side that only it refers to."""
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
        case core.Condition() if guard is None:
            return _Node(part, None, None, current.guard, op_of(current), (), 0)
        case core.Sequence(parts=(core.Event() as event, below)) if direction is not False:
            first = True
        case core.Sequence(parts=(below, core.Event() as event)) if direction is not True:
            first = False
        case _:
            return _Node(part, None, None, guard, op_of(current), rest, _need(current, rest))
    if _belongs(event, part, shared) and _belongs(below, part, shared) and _is_gate(below):
        return _Node(part, event, first, guard, op_of(below), below.parts, fewest(below))
    return _Node(part, None, None, guard, op_of(current), rest, len(rest))


def _belongs(inner: Part, part: Part, shared: frozenset[Part]) -> bool:
    """Whether a part comes from the same node of the tree, and stands in one place alone."""
    same = inner.source is not None and part.source is not None and inner.source.node == part.source.node
    return same and inner not in shared


def _is_gate(part: Part) -> bool:
    """Whether a part is made of others, and no condition is among them that comes from the same node."""
    own = any(isinstance(one, core.Condition) and _belongs(one, part, frozenset()) for one in part.parts)
    return bool(part.parts) and not own


def _need(part: Part, rest: tuple[Part, ...]) -> int:
    return len(rest) if isinstance(part, core.All) else fewest(part)


class CompiledTree:
    """The structure of a property; `parent` and `slot` are -1 for the root of a part and for the nodes of the core.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> compiled = CompiledTree(build(rvaft.loads("top sand a b; a or c d;")))
    >>> compiled.names, compiled.children[0], compiled.need[1]
    (('top', 'a', 'c', 'd', 'b'), (1, 4), 1)
    """

    root: Final = 0

    def __init__(self, prop: Property) -> None:
        self.prop = prop
        nodes = _nodes(prop)
        number = {one.part: node for node, one in enumerate(nodes)}
        self.names = tuple("" if one.part.source is None else one.part.source.node for one in nodes)
        """The node of the tree that each comes from; several may come from one."""
        self.events = tuple(None if one.event is None else one.event.source for one in nodes)
        """The occurrence that each observes."""
        self.ops = tuple(one.op for one in nodes)
        self.children = tuple(tuple(number[child] for child in one.children) for one in nodes)
        self.need = tuple(one.need for one in nodes)
        """The least number of children that a scenario with a node keeps."""
        choosing = (node for node, one in enumerate(nodes) if len(one.children) > one.need)
        self.chooses = mask_of(choosing)
        """The nodes that need not keep all of their children."""
        self.certain = 1 << self.root
        """The nodes that every scenario has, whatever is chosen."""
        for node, children in enumerate(self.children):
            if self.certain >> node & ~self.chooses >> node & 1:
                self.certain |= mask_of(children)
        self.own = tuple(one.event is not None for one in nodes)
        self.top_down = next((one.event_first for one in nodes if one.event_first is not None), True)
        """Whether the event of a node comes before what is below the node, or after it."""
        self.patterns = tuple(None if one.event is None else one.event.pattern for one in nodes)
        self._note_variables(nodes)
        seen = Counter(child for children in self.children for child in children)
        self._note_parts({child for child, count in seen.items() if count > 1})
        self.dead = 0
        """The nodes that are ruled out from the start: none, since passes remove what a false condition rules out."""
        waiting = (node for node in range(len(nodes)) if self.needs[node])
        self.closed = (1 << len(nodes)) - 1 ^ mask_of(waiting)
        """The nodes without a guard that waits for variables."""

    @cached_property
    def occurrences(self) -> Mapping[Source, int]:
        """The node of each occurrence."""
        return {source: node for node, source in enumerate(self.events) if source is not None}

    @cached_property
    def choices(self) -> Mapping[str, int]:
        """The node of each `or` gate of the tree."""
        return {name: node for node, name in enumerate(self.names) if name and self.ops[node] is PartKind.ONE}

    def child(self, gate: str, name: str) -> int:
        """The child of an `or` gate that comes from a node of the tree, or -1 where the gate does not have it."""
        return next((child for child in self.children[self.choices[gate]] if self.names[child] == name), -1)

    def _note_variables(self, nodes: Sequence[_Node]) -> None:
        guards = [one.guard for one in nodes]
        self.times = frozenset(point.name for guard in guards for point in time_points(guard))
        """The variables that the times of events bind."""
        points = [None if one.event is None else TimePoint.of("at", *one.event.source).name for one in nodes]
        self.time_of = tuple(name if name in self.times else None for name in points)
        """For each node the variable that the time of its event binds, where a guard asks for it."""
        bound = [() if pattern is None else rigid_variables(pattern) for pattern in self.patterns]
        bound = [names if time is None else (*names, time) for names, time in zip(bound, self.time_of, strict=True)]
        needs = [guard_variables(guard) for guard in guards]
        mentioned = Counter(name for both in zip(bound, needs, strict=True) for name in {*both[0], *both[1]})
        private = [{name for name in names if mentioned[name] == 1 and name not in self.times} for names in bound]
        filters = [bool(names) and private[node].issuperset(names) for node, names in enumerate(needs)]
        self.filters = tuple(guard if only else None for guard, only in zip(guards, filters, strict=True))
        """For each node the guard that its event alone decides."""
        self.guards = tuple(None if only else guard for guard, only in zip(guards, filters, strict=True))
        """For each node the guard that is constant or waits for variables that are remembered."""
        self.needs = tuple(() if only else names for names, only in zip(needs, filters, strict=True))
        """The variables of these guards."""
        self.exported = tuple(
            tuple(name for name in names if name not in private[node] or name in self.needs[node])
            for node, names in enumerate(bound)
        )
        """For each node the variables of its event that have to be remembered."""
        self.predicates = tuple(None if guard is None else predicate(guard) for guard in self.guards)
        self.guarded_by: dict[str, list[int]] = {}
        """For each variable the nodes whose guard waits for it."""
        self.mentions: dict[str, int] = {}
        """For each variable the nodes whose event binds or compares it."""
        for node in range(len(nodes)):
            for name in self.needs[node]:
                self.guarded_by.setdefault(name, []).append(node)
            for name in self.exported[node]:
                self.mentions[name] = self.mentions.get(name, 0) | 1 << node

    @cached_property
    def conditions(self) -> tuple[tuple["Condition", ...], ...]:
        """For each node what its guard asks for: that all of these hold."""
        return tuple(tuple(Condition.of(part, self.times) for part in conjuncts(guard)) for guard in self.guards)

    def _note_parts(self, core: set[int]) -> None:
        """The shared nodes with their ancestors, and the parts below them."""
        size = len(self.names)
        picks = bytearray(size)
        for node in range(size - 1, -1, -1):
            if not core.isdisjoint(self.children[node]):
                core.add(node)
            picks[node] = self.ops[node] is PartKind.ONE or any(picks[child] for child in self.children[node])
        self.picks = mask_of(node for node in range(size) if picks[node])
        """The nodes that keep one child, or have such a node below."""
        self.core, self.members = tuple(sorted(core)), frozenset(core)
        self.parent, self.slot, self.part_of = [-1] * size, [-1] * size, list(range(size))
        self.freezer = [-1] * size
        """The nearest of a node and its ancestors in its part that something later can end, or -1:
        a child of a sequence that is not the last, or of a gate whose own event comes after its
        children.
        """
        for node, children in enumerate(self.children):
            ends = self.own[node] and not self.top_down
            for slot, child in enumerate(children if node not in core else ()):
                self.parent[child], self.slot[child], self.part_of[child] = node, slot, self.part_of[node]
                later = self.ops[node] is PartKind.SEQUENCE and slot + 1 < len(children)
                self.freezer[child] = child if later or ends else self.freezer[node]
        self.parts = tuple(node for node in range(size) if node not in core and self.parent[node] < 0)


class Condition(NamedTuple):
    """A guard, its variables, and whether these are times; then the differences that it asks for, or None."""

    guard: Guard
    names: tuple[str, ...]
    over_times: bool
    differences: tuple[TimeDifference, ...] | None

    @classmethod
    def of(cls, guard: Guard, times: frozenset[str]) -> "Condition":
        """What there is to know of a guard."""
        names = guard_variables(guard)
        over_times = times.issuperset(names)
        return cls(guard, names, over_times, differences(guard) if over_times else None)


class Hit(NamedTuple):
    """A letter that an event is, the nodes whose runtime event that is, and the values it gives to their variables."""

    letter: int
    nodes: tuple[int, ...]
    values: Mapping[str, Json]


class Reading(NamedTuple):
    """What one event means to a tree; `hits` is what a strategy makes of the letters, empty where
    the event fits no node.
    """

    relevant: bool
    hits: Sequence[Any]


_new: Final = tuple.__new__  # half the time of the classes' own; they add nothing
NOTHING: Final = Reading(relevant=False, hits=())
"""What an event means that fits no pattern."""
QUIET: Final = Reading(relevant=False, hits=(None,))
"""What an event means to `scattered` that fits some node and changes nothing."""


_Values: TypeAlias = Callable[[Mapping[str, Json]], dict[str, Json] | None]


class Admission(NamedTuple):
    """How an event that may be some letter becomes a hit: what is asked of it beside its shape, and
    what gives the values.

    The values are None where the event is not this letter after all.
    """

    letter: int
    nodes: tuple[int, ...]
    relevant: bool
    test: Predicate | None
    values: _Values
    reader: Reader
    """How it is read off an event."""
    timed: bool
    """Whether one of the values is the time."""


@dataclass(slots=True, eq=False)
class EventClass:
    """Events that are alike to a tree: they have the same shape or, in a *refined* class, the same
    guards hold of them, too.

    A class by shape has the letters that its events may be. If the fields of an event say the rest,
    `refined` gives its refined class, and `followed` the one that also says which guards of nodes
    the event alone decides. A refined class has the letters that its events are.
    """

    letters: tuple[Admission, ...]
    serving: tuple[Admission, ...]
    """The letters that serve a node."""
    ignored: tuple[Reader, ...] = ()
    """The declarations by which events may be ignored."""
    relevant: bool = False
    """Whether all events of a refined class are relevant."""
    held: tuple[int, ...] = ()
    """In a class that is followed, for each letter that serves a node the guards that hold, as bits."""
    refined: "GuardTable[EventClass] | None" = None
    followed: "GuardTable[EventClass] | None" = None


class Effect(NamedTuple):
    """What events of one kind can do to a monitor now: whether they fit a node, and the letters
    that may change something.

    Each letter has the fields that matter. It changes nothing if it is `inert` with the values there.
    """

    fits: bool
    letters: Sequence[tuple[int, tuple[str, ...]]]


def _refined(found: EventClass) -> GuardTable[EventClass]:
    """From an event of a class by shape to its refined class."""
    letters = len(found.letters)

    def derive(holds: Callable[[int], bool]) -> EventClass:
        own = tuple(one for place, one in enumerate(found.letters) if holds(place))
        ignored = any(holds(letters + place) for place in range(len(found.ignored)))
        relevant = not ignored and any(one.relevant for one in own)
        return EventClass(own, tuple(one for one in own if one.nodes), relevant=relevant)

    return guard_table([one.asked for one in (*(one.reader for one in found.letters), *found.ignored)], derive)


class TreeLetters:
    """The letters of a tree, equal patterns with equal guards: those of its occurrences, its
    alphabet, and what it ignores.

    What the shape of an event decides is worked out once for each shape, so an event that concerns
    nothing costs one look-up.
    """

    def __init__(self, compiled: CompiledTree) -> None:
        prop, event_time = compiled.prop, compiled.prop.time
        serves: dict[tuple[Letter, str | None], list[int]] = {}
        for node, pattern in enumerate(compiled.patterns):
            if pattern is not None:
                letter = Letter(pattern, compiled.filters[node])
                serves.setdefault((letter, compiled.time_of[node]), []).append(node)
        alphabet = dict.fromkeys((Letter(entry.pattern, entry.when), None) for entry in prop.alphabet)
        told = tuple(dict.fromkeys([*serves, *alphabet]))
        self.letters = tuple(letter for letter, _ in told)
        self.serves = tuple(tuple(serves.get(one, ())) for one in told)
        """For each letter the nodes whose runtime event it is."""
        ignored = [Letter(one.pattern, one.when) for one in prop.ignored]
        readers = [reader(number, letter) for number, letter in enumerate((*self.letters, *ignored))]

        def values_of(one: Reader, time: str | None) -> _Values:
            values = one.values if one.plain else one.read
            if time is None or event_time is None:
                return values
            first = self.letters[one.number] not in shared
            last, read = shared.setdefault(self.letters[one.number], [None, None]), event_time.read

            def timed(event: Mapping[str, Json]) -> dict[str, Json] | None:
                # of letters that are alike but for the variable of the time the first is read, and
                # the others at once after it
                if first:
                    last[0] = values(event)
                    last[1] = None if last[0] is None else read(event)
                return None if last[0] is None else {**last[0], time: last[1]}

            return timed

        shared: dict[Letter, list[Any]] = {}
        """The values and the time in the last event that was a letter."""
        values = [values_of(readers[number], time) for number, (_, time) in enumerate(told)]

        self._admissions: list[Admission] = []
        for one in readers[: len(self.letters)]:
            test, relevant = one.holds if one.plain else None, told[one.number] in alphabet
            time = told[one.number][1] is not None and event_time is not None
            nodes = self.serves[one.number]
            self._admissions.append(Admission(one.number, nodes, relevant, test, values[one.number], one, time))
        self._ignored = readers[len(self.letters) :]
        self.patterns = tuple(one.pattern for one in readers)
        """The patterns of the letters, and of what is ignored."""
        self.classify = PatternIndex(self.patterns, lambda decided: self._class({*decided.fits, *decided.open})).of
        """The class of an event by its shape."""

    def class_of(self, possible: Collection[Pattern]) -> EventClass:
        """The class by shape of events that can match these patterns, of all the `patterns`."""
        return self._class({number for number, pattern in enumerate(self.patterns) if pattern in possible})

    def _class(self, numbers: Collection[int]) -> EventClass:
        letters = tuple(one for one in self._admissions if one.letter in numbers)
        serving = tuple(one for one in letters if one.nodes)
        found = EventClass(letters, serving, tuple(one for one in self._ignored if one.number in numbers))
        plain = all(one.reader.plain for one in letters) and all(one.plain for one in found.ignored)
        if plain and not any(one.timed for one in letters):
            found.refined = _refined(found)
        return found

    def read(self, event: Mapping[str, Json], event_class: EventClass | None = None) -> Reading:
        """What an event means; `event_class` is what its shape says, where that is known."""
        if event_class is None:
            event_class = self.classify(event)
        if not event_class.letters:
            return NOTHING
        hits: list[Hit] = []
        if event_class.refined is not None:
            told = event_class.refined.of(event)
            for number, nodes, _, _, values_of, _, _ in told.serving:
                values = values_of(event)
                if values is not None:
                    hits.append(_new(Hit, (number, nodes, values)))
            return _new(Reading, (told.relevant, hits))
        relevant = False
        for number, nodes, matters, test, values_of, _, _ in event_class.letters:
            if test is None or test(event):
                values = values_of(event)
                if values is not None:
                    relevant = relevant or matters
                    if nodes:
                        hits.append(_new(Hit, (number, nodes, values)))
        if relevant and event_class.ignored:
            relevant = not any(one.admits(event) for one in event_class.ignored)
        return _new(Reading, (relevant, hits))
