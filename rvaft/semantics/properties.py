"""The second reference: the verdicts of a property, by its scenarios (definition, sections 2 to 4).

It imports only the parts of a property from `rvaft.core`. Tests compare the build of a property and
every pass with it.
"""

import json
from collections.abc import Hashable, Iterator, Mapping
from collections.abc import Sequence as Sequences
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations, pairwise, product
from typing import Any, NamedTuple

from rvaft.core.property import (
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    Property,
    Sequence,
    Source,
    Times,
    Within,
    WithoutEvent,
)
from rvaft.model.guards import TimePoint, walk
from rvaft.model.nodes import Side
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics.events import Binding, defined, holds, matches, names, same, time_of
from rvaft.semantics.reference import value_key

Occurrence = tuple[str, int]
"""A node and the number of its event, from 1."""
Chosen = Mapping[Part, tuple[Part, ...]]


def _choices(part: Part) -> list[tuple[Part, ...]]:
    if isinstance(part, One):
        return [(inner,) for inner in part.parts]
    if isinstance(part, AtLeast):
        sizes = range(part.need, len(part.parts) + 1)
        return list(chain.from_iterable(combinations(part.parts, size) for size in sizes))
    return [part.parts]


def _resolved(root: Part) -> Iterator[Chosen]:
    agenda: list[tuple[dict[Part, tuple[Part, ...]], list[Part]]] = [({}, [root])]
    while agenda:
        kept, reached = agenda.pop()
        waiting = [part for part in reached if part not in kept]
        if not waiting:
            yield kept
            continue
        agenda += [({**kept, waiting[0]: way}, [*waiting[1:], *way]) for way in _choices(waiting[0])]


@dataclass(frozen=True)
class _Scenario:
    """One way to make the choices."""

    prop: Property
    kept: Chosen

    def below(self, part: Part) -> dict[Occurrence, Pattern]:
        found: dict[Occurrence, Pattern] = {}
        agenda, seen = [part], {part}
        while agenda:
            current = agenda.pop()
            if isinstance(current, Event):
                found[current.source.node, current.source.number] = current.pattern
            if isinstance(current, Times):
                self.counted[current.source.node] = current
                found |= {(current.source.node, number): current.pattern for number in range(1, current.count + 1)}
            agenda += [inner for inner in self.kept[current] if inner not in seen]
            seen.update(self.kept[current])
        return found

    @cached_property
    def patterns(self) -> dict[Occurrence, Pattern]:
        return self.below(self.prop.root)

    @cached_property
    def orders(self) -> list[Mapping[Occurrence, frozenset[Occurrence]]]:
        """Each acyclic precedence: for every event, all events before it."""
        fixed = set[tuple[Occurrence, Occurrence]]()
        ways: list[list[set[tuple[Occurrence, Occurrence]]]] = []
        for part, kept in self.kept.items():
            events = [set(self.below(inner)) for inner in kept]
            if isinstance(part, Sequence):
                fixed |= {(a, b) for one, other in combinations(events, 2) for a in one for b in other}
            if isinstance(part, Times):
                numbered = [(part.source.node, number) for number in range(1, part.count + 1)]
                fixed |= set(pairwise(numbered))
            if isinstance(part, EndInOrder):
                busy = [sorted(inner) for inner in events if inner]
                ways.append(
                    [
                        {(one, last) for inner, last in zip(busy, lasts, strict=True) for one in inner if one != last}
                        | set(pairwise(lasts))
                        for lasts in product(*busy)
                    ]
                )
        found = [self._closed(fixed.union(*chosen)) for chosen in product(*ways)]
        return [order for order in found if all(occurrence not in order[occurrence] for occurrence in order)]

    def _closed(self, pairs: set[tuple[Occurrence, Occurrence]]) -> Mapping[Occurrence, frozenset[Occurrence]]:
        before = {occurrence: {a for a, b in pairs if b == occurrence} for occurrence in self.patterns}
        for earlier in before.values():
            agenda = list(earlier)
            while agenda:
                new = before[agenda.pop()] - earlier
                earlier.update(new)
                agenda += new
        return {occurrence: frozenset(found) for occurrence, found in before.items()}

    @cached_property
    def counted(self) -> dict[str, Times]:
        """The counted leaves met so far, by node."""
        return {}

    def _own(self, binding: Binding, times: Mapping[Occurrence, int | None], node: str) -> list[Binding]:
        """Return the values that each event there of a counted leaf has for itself, or one entry."""
        part = self.counted.get(node)
        if part is None or not part.own:
            return [{}]
        numbers = sorted(number for name, number in times if name == node)
        return [{name: binding[f"{name}#{number}"] for name in part.own} for number in numbers]

    @cached_property
    def conditions(self) -> list[Condition]:
        return [part for part in self.kept if isinstance(part, Condition)]

    @cached_property
    def windows(self) -> list[tuple[frozenset[Occurrence], int]]:
        return [(frozenset(self.below(part)), part.duration) for part in self.kept if isinstance(part, Within)]

    @cached_property
    def points(self) -> dict[str, tuple[str, frozenset[Occurrence]]]:
        """The time points of the guards by name, each with the events of its part."""
        found: dict[str, tuple[str, frozenset[Occurrence]]] = {}
        for condition in self.conditions:
            for term in walk(condition.guard):
                if isinstance(term, TimePoint):
                    found[term.name] = (term.point, self._events_of(term))
        return found

    def _events_of(self, point: TimePoint) -> frozenset[Occurrence]:
        if point.point == "at":
            return frozenset({(point.node, max(point.number, 1))} & self.patterns.keys())
        whole = self.prop.wholes.get(Source(point.node, point.number))
        return frozenset() if whole is None or whole not in self.kept else frozenset(self.below(whole))

    @cached_property
    def absences(self) -> list[tuple[WithoutEvent, frozenset[Occurrence]]]:
        """The absent events, each with the events of its part."""
        return [(part, frozenset(self.below(part))) for part in self.kept if isinstance(part, WithoutEvent)]

    @property
    def feasible(self) -> bool:
        """Whether it has an order, and every guard without variables and time points holds."""
        constant = [condition.guard for condition in self.conditions if not names(condition.guard)]
        return bool(self.orders) and all(holds(guard, {}) for guard in constant)

    def allows(self, binding: Binding, times: Mapping[Occurrence, int | None]) -> bool:
        """Whether all guards and windows with known values hold."""
        known = dict(binding)
        for name, (point, events) in self.points.items():
            if events and events <= times.keys():
                known[name] = _extreme(point, [times[event] for event in events])
        for condition in self.conditions:
            for own in ({}, *self._own(binding, times, condition.source.node)):
                every = {**known, **own}
                if names(condition.guard) <= every.keys() and not holds(condition.guard, every):
                    return False
        for node, part in self.counted.items():
            for one, other in combinations(self._own(binding, times, node), 2) if part.distinct else ():
                apart = [same(one[name], other[name]) for name in part.distinct]
                values = [defined(one[name]) and defined(other[name]) for name in part.distinct]
                first = apart.index(False) if False in apart else len(apart)
                if first == len(apart) or not all(values[: first + 1]):
                    return False
        for events, duration in self.windows:
            if events and events <= times.keys():
                inside = [times[event] for event in events]
                start, end = _extreme("start", inside), _extreme("end", inside)
                if start is None or end is None or end - start > duration:
                    return False
        return True


def _extreme(point: str, times: list[int | None]) -> int | None:
    defined = [time for time in times if time is not None]
    if len(defined) < len(times):
        return None
    return max(defined) if point == "end" else min(defined)


class _Read(NamedTuple):
    """One event of the trace, or None where only time has passed."""

    event: Any
    time: int | None
    late: bool


class _Absence(NamedTuple):
    """An absent event in a match: the indices of the first and last event of its part, and their times.

    `last` is None while events of the part are lacking.
    """

    clause: WithoutEvent
    first: int
    last: int | None
    times: list[int]
    timed: bool

    @property
    def length(self) -> int:
        return self.clause.duration or 0

    def decision(self, past: Sequences[_Read], late: int) -> int | None:
        """Return the index of the event that decides `after`."""
        if self.last is None or not self.times:
            return None
        limit = max(self.times) + self.length + late
        later = ((number, one.time) for number, one in enumerate(past) if number > self.last)
        return next((number for number, time in later if time is not None and time > limit), None)

    def covers(self, number: int, time: int | None, decision: int | None) -> bool:
        """Whether a matching event at this place breaks it."""
        side, timed = self.clause.side, time is not None and bool(self.times)
        if side is Side.DURING:
            return number > self.first and (self.last is None or number < self.last)
        if side is Side.AFTER:
            waits = self.last is not None and number > self.last and (decision is None or number < decision)
            return waits and timed and time is not None and time - max(self.times) <= self.length
        near = timed and time is not None and min(self.times) - time <= self.length
        return number < self.first and (self.clause.duration is None or near)


class _Partial(NamedTuple):
    scenario: int
    order: int
    binding: Binding
    times: Mapping[Occurrence, int | None]
    places: Mapping[Occurrence, int] = {}

    @property
    def key(self) -> Hashable:
        values = frozenset((name, value_key(value)) for name, value in self.binding.items())
        return self.scenario, self.order, values, frozenset(self.times.items()), frozenset(self.places.items())


class PropertyReference(Monitor):
    """The verdict of a property after each prefix, by following every partial match."""

    def __init__(self, prop: Property, semantics: Semantics | str) -> None:
        super().__init__()
        self.prop = prop
        self.semantics = Semantics(semantics)
        every = [_Scenario(prop, kept) for kept in _resolved(prop.root)]
        self.scenarios = [scenario for scenario in every if scenario.feasible]
        self._starts = [
            _Partial(number, order, {}, {})
            for number, scenario in enumerate(self.scenarios)
            for order in range(len(scenario.orders))
        ]
        self._partials = {partial.key: partial for partial in self._starts}
        self._latest: int | None = None
        self._past: tuple[_Read, ...] = ()

    @property
    def state(self) -> Hashable:
        """The verdict, the partial matches, the maximum time so far, and the events that may matter."""
        return self.verdict, frozenset(self._partials), self._latest, json.dumps(self._past)

    def _advance(self, event: Any) -> Verdict:
        time = time_of(self.prop.time, event)
        late = self._is_late(time)
        found = {partial.key: partial for partial in self._after(event, time, late=late)}
        if self.prop.absences:
            self._past = (*self._past, _Read(event, time, late))
            found = {key: partial for key, partial in found.items() if self._unbroken(partial)}
        if any(self._is_whole(one) and self._decided(one) for one in found.values()):
            self._partials = {}
            return Verdict.TRUE
        self._partials = found
        lasting = self.semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
        return Verdict.UNKNOWN if found or lasting else Verdict.FALSE

    def _is_whole(self, partial: _Partial) -> bool:
        return len(partial.times) == len(self.scenarios[partial.scenario].patterns)

    def _absences(self, partial: _Partial) -> Iterator[_Absence]:
        for clause, events in self.scenarios[partial.scenario].absences:
            there = sorted(partial.places[event] for event in events if event in partial.places)
            times = [partial.times[event] for event in events if event in partial.times]
            if there:
                defined = [time for time in times if time is not None]
                last = there[-1] if len(there) == len(events) else None
                yield _Absence(clause, there[0], last, defined, len(defined) == len(times))

    def _unbroken(self, partial: _Partial) -> bool:
        used = set(partial.places.values())
        for absence in self._absences(partial):
            if absence.clause.duration is not None and absence.last is not None and not absence.timed:
                return False
            end = absence.decision(self._past, self._lateness)
            for number, (event, time, late) in enumerate(self._past):
                if not late and number not in used and absence.covers(number, time, end):
                    clause = absence.clause
                    ways = matches(clause.pattern, event, partial.binding, {})
                    if any(clause.guard is None or holds(clause.guard, way) for way in ways):
                        return False
        return True

    def _decided(self, partial: _Partial) -> bool:
        after = (one for one in self._absences(partial) if one.clause.side is Side.AFTER)
        return all(one.decision(self._past, self._lateness) is not None for one in after)

    @property
    def _lateness(self) -> int:
        time = self.prop.time
        return 0 if time is None else time.late or 0

    def _is_late(self, time: int | None) -> bool:
        allowed, greatest = self.prop.time.late if self.prop.time else None, self._latest
        if allowed is None or time is None:
            return False
        self._latest = time if greatest is None else max(time, greatest)
        return greatest is not None and greatest - time > allowed

    def _after(self, event: Any, time: int | None, *, late: bool) -> Iterator[_Partial]:
        takes = not late
        if self.semantics in (Semantics.PROJECTED, Semantics.CONSECUTIVE):
            takes = takes and self._relevant(event)
        skips = self.semantics is Semantics.SCATTERED or (self.semantics is not Semantics.STRICT and not takes)
        for partial in self._partials.values():
            if skips or (self.prop.absences and self._is_whole(partial)):
                yield partial
            if takes:
                yield from self._extended(partial, event, time)
        if self.semantics is Semantics.CONSECUTIVE:
            yield from self._starts

    def _extended(self, partial: _Partial, event: Any, time: int | None) -> Iterator[_Partial]:
        scenario = self.scenarios[partial.scenario]
        for one, before in scenario.orders[partial.order].items():
            if one in partial.times or not before <= partial.times.keys():
                continue
            times = {**partial.times, one: time}
            for found in matches(scenario.patterns[one], event, partial.binding, {}):
                part = scenario.counted.get(one[0])
                own = () if part is None else part.own
                binding = {name: value for name, value in found.items() if not name.startswith("_") or "#" in name}
                binding |= {f"{name}#{one[1]}": found[name] for name in own}
                if scenario.allows(binding, times):
                    places = {**partial.places, one: len(self._past)} if self.prop.absences else {}
                    yield _Partial(partial.scenario, partial.order, binding, times, places)

    def _relevant(self, event: Any) -> bool:
        for pattern, when in self.prop.ignored:
            found = matches(pattern, event, {}, {})
            if any(when is None or holds(when, one) for one in found):
                return False
        for entry in self.prop.alphabet:
            found = matches(entry.pattern, event, {}, {})
            if any(entry.when is None or holds(entry.when, one) for one in found):
                return True
        return False
