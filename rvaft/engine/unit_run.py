"""The steps of one unit on the state of an instance, if times never decrease.

A *match* of a node has its first position, the time of its first event, its steps, and the match of
the sequence before it. Steps are nested tuples; the innermost are a node, a position and values, or
for a counted leaf the node, a list of its events, and how many of them came.

A *state* has the time of the last event, the remembered events, the values of the key unless they
are texts and integers, the minimum time of later events if known, and a value for each node: for a
child of a gate without order its match, for a child of a sequence that of the children up to it.
Then follow the events of counted leaves.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, TypeAlias, assert_never

from rvaft.core.property import Source
from rvaft.core.units import Op, Unit, UnitLeaf
from rvaft.engine.explanation import Step
from rvaft.model.values import Json, is_finite, key

TIME: Final = 0
"""The places of the first values of a state."""
EVENTS: Final = 1
KEY: Final = 2
WATERMARK: Final = 3
HEAD: Final = 4
"""The number of values of a state before those of nodes."""
Match: TypeAlias = tuple[Any, ...]
State: TypeAlias = list[Any]
Remembered: TypeAlias = tuple[int, Any, int, Any]
"""An event that a branch may need: position, time, node and values."""
CountedEvent: TypeAlias = tuple[int, Any, Any, Any]
"""An event of a counted leaf: position, time, the match of the sequence before it, and values.

If times may decrease, the third value is another one (see `UnorderedRun`).
"""


Complete: TypeAlias = Callable[[State, Match, Any], Match | None]
"""Complete a node by a match at a time, and what it completes above; return a match of the unit."""
Take: TypeAlias = Callable[[State, int, Any, Any], Match | None]
"""Take an event by its position, time and values; return a match of the unit that it completes."""


class UnitRun(ABC):
    """The steps of a unit."""

    def __init__(self, unit: Unit) -> None:
        self.unit = unit
        counted = [leaf for leaf in unit.leaves if leaf.number > 1]
        size = HEAD + len(unit.places)
        self.places = {leaf.node: size + place for place, leaf in enumerate(counted)}
        """The places of the events of counted leaves in a state."""
        self.size = size + len(counted)
        self.leaves = {leaf.node: leaf for leaf in unit.leaves}
        self.remembers = bool(unit.choices)

    def start(self) -> State:
        """Return the state of a new instance."""
        return [None] * self.size

    takes: Mapping[int, Take]
    """The function of each leaf that takes an event if it may be in a match."""

    @abstractmethod
    def kept(self, state: State) -> int:
        """Return the number of matches and events of a state, if times may decrease."""

    def expires(self, state: State, watermark: int) -> bool:  # noqa: ARG002 (most expire by their windows alone)
        """Drop the matches that later events cannot complete; return whether none is left."""
        return False

    @abstractmethod
    def concerning(self, state: State) -> Iterable[Remembered]:
        """Return the remembered events with which a branch may have a match where this one ends."""

    @abstractmethod
    def future(self, state: State) -> Hashable:
        """Return what later detections depend on."""

    @abstractmethod
    def alive(self, found: Any, least: int) -> bool:
        """Whether the value of a node has a match that starts at this time or later."""

    def again(self, events: Iterable[Remembered], without: frozenset[int]) -> tuple[State, Match | None]:
        """Return the state after these events, but for those of some leaves, and the last match."""
        state, match = self.start(), None
        for position, time, node, values in events:
            if node not in without:
                match = self.takes[node](state, position, time, values) or match
        return state, match

    def is_over(self, state: State, node: int) -> bool:
        """Whether a node or one above it is complete for good."""
        places = self.unit.places
        while node > 0:
            gate, op, *_ = places[node]
            if op is not Op.ONE and state[HEAD + node] is not None:
                return True
            node = gate
        return False

    def awaits(self, state: State, without: frozenset[int], watermark: int | None, *, begun: bool) -> Iterator[str]:
        """Iterate over the nodes whose event may come next, but for some leaves.

        If `begun`, only after some other event, or one of the same counted leaf.
        """
        unit = self.unit
        for leaf in unit.leaves:
            before = None if leaf.after < 0 else state[HEAD + leaf.after]
            if leaf.node in without or (leaf.after >= 0 and before is None):
                continue
            if unit.settled[leaf.node] and self.is_over(state, leaf.node):
                continue
            if begun and leaf.after < 0 and not self._has_begun_beside(state, leaf):
                continue
            limit = None if leaf.after < 0 else unit.limits[unit.places[leaf.after].gate]
            if limit is None or watermark is None or self.alive(before, watermark - limit):
                yield leaf.source

    def _has_begun_beside(self, state: State, leaf: UnitLeaf) -> bool:
        """Whether there are events of nodes without an order to a leaf, or of the counted leaf."""
        places, node = self.unit.places, leaf.node
        agenda = list[int]()
        if leaf.number > 1 and state[self.places[node]]:
            return True
        while node > 0:
            gate, op, _, _, siblings, _ = places[node]
            if op in (Op.ALL, Op.AT_LEAST, Op.ENDS):
                agenda += [sibling for sibling in siblings if sibling != node]
            node = gate
        while agenda:
            node = agenda.pop()
            if state[HEAD + node] or (node in self.places and state[self.places[node]]):
                return True
            agenda += self.unit.children[node]
        return False

    def steps(self, match: Match, names: Mapping[str, Json]) -> list[tuple[int, Step]]:
        """Return the leaves and steps of a match in order; `names` are the values of the key."""
        found, agenda = list[tuple[int, Step]](), [match[2]]
        while agenda:
            steps = agenda.pop()
            if type(steps[0]) is not int:
                agenda.extend(steps)
                continue
            node, second, third = steps
            leaf = self.leaves[node]
            events = [(second, third)]
            if leaf.number > 1:
                events = sorted((one[0], one[3]) for one in second[third - leaf.number : third])
            for number, (position, values) in enumerate(events, 1):
                found.append((node, Step(Source(leaf.source, number), position, names if values is None else values)))
        return sorted(found, key=lambda one: one[1].position)

    def place_of(self, state: State, leaf: UnitLeaf, values: Any) -> tuple[Any, Hashable]:
        """Return where the events of a counted leaf are: a container and their name in it."""
        place = self.places[leaf.node]
        if not leaf.own:
            return state, place
        if state[place] is None:
            state[place] = {}
        return state[place], tuple([plain_key(values[name]) for name in leaf.own])

    def events_of(self, state: State, leaf: UnitLeaf) -> Mapping[Hashable, Any]:
        """Return the events of a counted leaf by the variables in which they agree."""
        found = state[self.places[leaf.node]]
        return (found or {}) if leaf.own else {(): found or []}


class FrontRun(UnitRun):
    """The steps if a node keeps several matches: its *front*."""

    def _rise(self, state: State, node: int, matches: list[Match]) -> Match | None:
        """Complete a node and what it completes above; return a match of the unit."""
        while True:
            matches = self._completed(node, matches)
            if not matches:
                return None
            gate, op, _, last, siblings, need = self.unit.places[node]
            if gate < 0:
                return matches[0]
            if op is Op.SEQUENCE or op is Op.ENDS:
                matches = self._in_turn(state, node, matches)
                if not last:
                    for one in matches:
                        self._add(state, node, one)
                    return None
            elif op is not Op.ONE:
                added = [one for one in matches if self._add(state, node, one)]
                if not self.unit.again[gate]:
                    matches = added
                beside = [front for sibling in siblings if sibling != node and (front := state[HEAD + sibling])]
                if not matches or len(beside) < need - 1:
                    return None
                matches = self._chosen(matches, beside, need - 1, node)
            node = gate

    @abstractmethod
    def _completed(self, node: int, matches: list[Match]) -> list[Match]:
        """Return the matches of a node that satisfy its window and bounds."""

    @abstractmethod
    def _in_turn(self, state: State, node: int, matches: list[Match]) -> list[Match]:
        """Join the matches of a child of a sequence with those of the children before it."""

    @abstractmethod
    def _chosen(self, matches: list[Match], fronts: Sequence[Any], need: int, node: int) -> list[Match]:
        """Join the matches of a node with matches of `need` siblings."""

    @abstractmethod
    def _add(self, state: State, node: int, match: Match) -> bool:
        """Add a match to the front of a node unless another one replaces it."""


def copied(state: State) -> State:
    """Return an independent copy of a state."""
    time, events, values, *others = state
    return [time, _copied(events), values, *map(_copied, others)]


def _copied(value: Any) -> Any:
    if type(value) is list:
        return value.copy()
    if type(value) is dict:
        return {name: one if type(one) is tuple else one.copy() for name, one in value.items()}
    return value


def plain_key(value: Json) -> Hashable:
    """Return a hashable value that is equal for equal values; texts and integers are their own."""
    if type(value) is str or type(value) is int:
        return value
    found = key(value)
    return int(found) if isinstance(found, float) and found.is_integer() else found


class OrderedRun(UnitRun):
    """The steps if times never decrease, or no window asks for them.

    Each node and each leaf has a function of its own, since most of a step is known beforehand.
    """

    def __init__(self, unit: Unit) -> None:
        super().__init__(unit)
        self._replaces = frozenset(
            leaf.node for leaf in unit.leaves if not leaf.own and unit.limits[leaf.node] == unit.window
        )
        """The leaves of which a later event can replace an earlier one."""
        done: list[Complete] = []
        for node in range(len(unit.places)):
            done.append(_within(unit.windows[node], self._above(node, done)))
        self.takes = {leaf.node: self._taking(leaf, done[leaf.node]) for leaf in unit.leaves}

    def _above(self, node: int, done: Sequence[Complete]) -> Complete:
        """Return what the completion of a node means to its gate."""
        gate, op, before, last, siblings, need = self.unit.places[node]
        match op:
            case Op.SEQUENCE | Op.ENDS:
                up = done[gate] if last else _stored(HEAD + node)
                if before < 0:
                    return _first_part(up)
                return _next_part(up, HEAD + before if op is Op.ENDS or self.unit.direct[node] else None)
            case Op.ALL | Op.AT_LEAST:
                others = [HEAD + sibling for sibling in siblings if sibling != node]
                chosen = _all_of(others) if op is Op.ALL else _most_recent(others, need - 1)
                return _joined(done[gate], HEAD + node, chosen, again=self.unit.again[gate])
            case Op.ONE:
                return done[gate] if gate >= 0 else lambda _state, match, _time: match
            case Op.LEAF:
                raise AssertionError("a leaf has no children")
            case _:
                assert_never(op)

    def _taking(self, leaf: UnitLeaf, done: Complete) -> Take:
        node, slot = leaf.node, HEAD + leaf.after if leaf.after >= 0 else 0
        settled, remembers, counts = self.unit.settled[node], self.remembers, leaf.number > 1
        distinct = bool(leaf.distinct)

        def take(state: State, position: int, time: Any, values: Any) -> Match | None:
            before = None
            if slot:
                before = state[slot]
                if before is None:
                    return None
            state[TIME] = time
            if remembers:
                self._remember(state, leaf, (position, time, node, values))
            if settled and self.is_over(state, node):
                return None
            if distinct:
                match = self._different(state, leaf, (position, time, before, values))
                return match and done(state, match, time)
            if counts:
                match = self._counted(state, leaf, (position, time, before, values))
                return match and done(state, match, time)
            return done(state, (position, time, (node, position, values), before), time)

        return take

    def _remember(self, state: State, leaf: UnitLeaf, event: Remembered) -> None:
        """Remember an event with which some branch may have a match.

        Without windows an event serves as the one before it, unless another came that must precede
        it. With a window at the root, it serves instead of an earlier one, unless another came that
        must follow.
        """
        unit, node, count = self.unit, leaf.node, leaf.number
        events = state[EVENTS]
        if events is None:
            state[EVENTS] = [event]
            return
        window = unit.window
        if window is not None and events[0][1] < event[1] - window:
            place = next((place for place, one in enumerate(events) if one[1] >= event[1] - window), len(events))
            del events[:place]
        if window is None or node in self._replaces:
            others = unit.elders[node] if window is None else unit.younger[node]
            for place in range(len(events) - 1, -1, -1):
                one = events[place][2]
                if one == node:
                    count -= 1
                    if not count:
                        if window is None and not leaf.own:
                            return
                        del events[place]
                        break
                elif others >> one & 1:
                    break
        events.append(event)

    def _counted(self, state: State, leaf: UnitLeaf, event: CountedEvent) -> Match | None:
        """Add an event to those of a counted leaf; return the match of the last ones."""
        count, (container, name) = leaf.number, self.place_of(state, leaf, event[3])
        events = container.get(name) if leaf.own else container[name]
        if events is None:
            events = container[name] = []
        elif len(events) >= 2 * count:  # matches keep the list that they refer to
            events = container[name] = events[1 - count :]
        events.append(event)
        if len(events) < count:
            return None
        first = events[-count]
        return first[0], first[1], (leaf.node, events, len(events)), first[2]

    def _different(self, state: State, leaf: UnitLeaf, event: CountedEvent) -> Match | None:
        """Add an event to the last one of each value; return the match of the last different ones.

        The events of a leaf are in the order of their values' last events, at most as many as it counts.
        """
        value = event[3][leaf.distinct]
        if not is_finite(value):  # it differs from no other
            return None
        container, name = self.place_of(state, leaf, event[3])
        events: dict[Hashable, CountedEvent] | None = container.get(name) if leaf.own else container[name]
        if events is None:
            events = container[name] = {}
        own = plain_key(value)
        events.pop(own, None)
        events[own] = event
        if len(events) > leaf.number:
            del events[next(iter(events))]
        if len(events) < leaf.number:
            return None
        first, limit = next(iter(events.values())), self.unit.limits[leaf.node]
        if limit is not None and event[1] - first[1] > limit:
            return None
        return first[0], first[1], (leaf.node, [*events.values()], leaf.number), first[2]

    def kept(self, state: State) -> int:  # noqa: ARG002
        """Return 0: what a state keeps depends on the tree alone."""
        return 0

    def concerning(self, state: State) -> Iterable[Remembered]:
        """Return the remembered events."""
        return state[EVENTS] or ()

    def alive(self, found: Match, least: int) -> bool:
        """Whether a match starts at this time or later."""
        return bool(found[1] >= least)

    def future(self, state: State) -> Hashable:
        """Return the times of matches and counted events."""
        matches = [_times(state[HEAD + node]) for node in range(len(self.unit.places))]
        counted = [
            frozenset(
                (name, tuple([(value, one[1], _times(one[2])) for value, one in _kept(leaf, events)]))
                for name, events in self.events_of(state, leaf).items()
            )
            for leaf in self.unit.leaves
            if leaf.number > 1
        ]
        return tuple(matches), tuple(counted)


def _kept(leaf: UnitLeaf, events: Any) -> Iterable[tuple[Hashable, CountedEvent]]:
    """Return the events of a counted leaf on which later detections depend, with their different values."""
    return events.items() if leaf.distinct else [(None, one) for one in events[1 - leaf.number :]]


def _first(match: Match) -> int:
    return int(match[0])


def _within(window: int | None, done: Complete) -> Complete:
    if window is None:
        return done

    def complete(state: State, match: Match, time: Any) -> Match | None:
        return done(state, match, time) if time - match[1] <= window else None

    return complete


def _stored(slot: int) -> Complete:
    def complete(state: State, match: Match, time: Any) -> None:  # noqa: ARG001
        old = state[slot]
        if old is None or match[0] > old[0]:
            state[slot] = match

    return complete


def _first_part(done: Complete) -> Complete:
    def complete(state: State, match: Match, time: Any) -> Match | None:
        return done(state, (match[0], match[1], (match[2],), match[3]), time)

    return complete


def _next_part(done: Complete, slot: int | None) -> Complete:
    """Join a match with that of the parts before, at a slot of the state or as it was before the match."""

    def complete(state: State, match: Match, time: Any) -> Match | None:
        before = match[3] if slot is None else state[slot]
        if before is None:
            return None
        least = match if match[0] < before[0] else before
        return done(state, (least[0], least[1], (*before[2], match[2]), least[3]), time)

    return complete


def _joined(done: Complete, slot: int, chosen: Callable[[State], list[Match] | None], *, again: bool) -> Complete:
    """Join a match with those of other children."""

    def complete(state: State, match: Match, time: Any) -> Match | None:
        old = state[slot]
        if old is None or match[0] > old[0]:
            state[slot] = match
        elif not again:
            return None
        others = chosen(state)
        if others is None:
            return None
        least = match
        for other in others:
            if other[0] < least[0]:
                least = other
        return done(state, (least[0], least[1], (match[2], *[other[2] for other in others]), least[3]), time)

    return complete


def _all_of(slots: Sequence[int]) -> Callable[[State], list[Match] | None]:
    def chosen(state: State) -> list[Match] | None:
        found = []
        for slot in slots:
            match = state[slot]
            if match is None:
                return None
            found.append(match)
        return found

    return chosen


def _most_recent(slots: Sequence[int], number: int) -> Callable[[State], list[Match] | None]:
    def chosen(state: State) -> list[Match] | None:
        found = [match for slot in slots if (match := state[slot]) is not None]
        if len(found) <= number:
            return found if len(found) == number else None
        found.sort(key=_first, reverse=True)
        return found[:number]

    return chosen


def _times(match: Match | None) -> Hashable:
    """Return the times on which the effect of a match depends."""
    found = list[int | None]()
    while match is not None:
        found.append(match[1])
        match = match[3]
    return tuple(found)
