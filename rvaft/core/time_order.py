"""Passes for orders of ends, windows and time points, which become sequences, guards and variables.

Where the result depends on choices, there is an alternative for each way to make them.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import count, product
from math import prod
from typing import Final, assert_never

from rvaft.core.passes import LIMIT, Pass, expand_times, simplify
from rvaft.core.precedence import later_events
from rvaft.core.property import (
    IMPOSSIBLE,
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    Kept,
    One,
    Part,
    Property,
    Sequence,
    Source,
    Times,
    Within,
    WithoutEvent,
    chooses,
    parts_below,
    with_parts,
)
from rvaft.core.scenarios import is_empty, most_events, resolutions
from rvaft.core.times import timed
from rvaft.errors import TooLarge
from rvaft.model.guards import Duration, Guard, Operation, Operator, TimePoint, substitute, time_points
from rvaft.model.patterns import Literal, Variable


class OpenChoice(Exception):
    """The result depends on an open choice."""


def chosen(prop: Property, limit: int = LIMIT) -> Iterator[Property]:
    """Iterate over the properties for each way to make the choices; raises `TooLarge`.

    A `One` keeps the chosen part.
    """
    for kept in resolutions(prop, limit=limit):

        def change(part: Part, parts: tuple[Part, ...], kept: Kept = kept) -> Part:
            if part not in kept or not isinstance(part, One | AtLeast):
                return with_parts(part, parts)
            new = dict(zip(part.parts, parts, strict=True))
            left = tuple(new[inner] for inner in kept[part])
            return One(part.source, left) if isinstance(part, One) else All(part.source, left)

        wholes = {source: whole for source, whole in prop.wholes.items() if whole in kept}
        yield replace(prop, wholes=wholes).rewritten(change)


def by_choices(prop: Property, limit: int, made: Callable[[Property, int], Iterator[Property]]) -> Property:
    """Return the feasible alternatives that `made` gives for each way to make the choices."""
    found: dict[Part, Property] = {}
    for each in chosen(prop, limit):
        with suppress(OpenChoice):  # a time point of an absent node: no such scenario is feasible
            for alternative in made(each, limit - len(found)):
                if not is_empty(alternative):
                    found[alternative.root] = alternative
    roots = tuple(found)
    if not roots:
        return prop.with_root(IMPOSSIBLE)
    return found[roots[0]] if len(roots) == 1 else prop.with_root(One(None, roots))


class _Ends:
    def __init__(self, prop: Property) -> None:
        most = most_events(prop.parts)
        self.silent = {part for part, events in most.items() if events == 0}
        self.single = {part for part, events in most.items() if events < 2}
        self._shared = bool(prop.shared)
        self._open: set[Part] = set()
        self._lasts: dict[Part, tuple[Event, ...]] = {}
        for part in prop.parts:
            if chooses(part) or not self._open.isdisjoint(part.parts):
                self._open.add(part)
            self._lasts[part] = self._last_of(part)

    def _last_of(self, part: Part) -> tuple[Event, ...]:
        busy = [inner for inner in part.parts if inner not in self.silent]
        match part:
            case Event():
                return (part,)
            case Times():
                raise AssertionError("counted leaves are expanded before")
            case Condition():
                return ()
            case Sequence() | EndInOrder():
                return self._lasts[busy[-1]] if busy else ()
            case All() | One() | AtLeast() | Within() | WithoutEvent():
                return tuple(dict.fromkeys(last for inner in busy for last in self._lasts[inner]))
            case _:
                assert_never(part)

    def last(self, part: Part) -> tuple[Event, ...]:
        """Return the possible last events of a part; none if the precedence among them is cyclic.

        Raises `OpenChoice` if they depend on choices.
        """
        lasts = self._lasts[part]
        if part in self._open:
            raise OpenChoice
        if len(lasts) < 2 or not self._shared:
            return lasts
        later = later_events(part)
        return tuple(event for event in lasts if later[event].isdisjoint(set(lasts) - {event}))


def with_single_ends(prop: Property) -> Property:
    """Return the property with a sequence for each `EndInOrder` of parts with at most one event.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> type(with_single_ends(build(rvaft.loads("top pand a b;"))).root).__name__
    'Sequence'
    """
    if not any(isinstance(part, EndInOrder) for part in prop.parts):
        return prop
    most = most_events(prop.parts)

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        if isinstance(part, EndInOrder) and all(most[inner] < 2 for inner in part.parts):
            return Sequence(part.source, parts)
        return with_parts(part, parts)

    return prop.rewritten(change)


def with_ends(prop: Property, chosen_ends: Mapping[tuple[Event, ...], Event] | None) -> Property:
    """Return the property with ends in order as sequences; raises `OpenChoice`.

    `chosen_ends` names the last event of a part that may end with several.
    """
    prop = with_single_ends(prop)
    ends = _Ends(prop)

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        if not isinstance(part, EndInOrder):
            return with_parts(part, parts)
        busy = [inner for inner in part.parts if inner not in ends.silent]
        new = dict(zip(part.parts, parts, strict=True))
        ended, more = list[Part](), list[Part]()
        for inner in busy:
            if inner in ends.single:
                ended.append(new[inner])
                continue
            lasts = ends.last(inner)
            if not lasts:
                return IMPOSSIBLE
            if len(lasts) > 1 and chosen_ends is None:
                raise OpenChoice
            last = lasts[0] if chosen_ends is None or len(lasts) == 1 else chosen_ends[lasts]
            ended.append(last)
            more += [Sequence(None, (other, last)) for other in lasts if other is not last]
        if len(set(ended)) < len(ended):
            return IMPOSSIBLE
        return All(part.source, tuple(dict.fromkeys((*parts, *more, Sequence(None, tuple(ended))))))

    return prop.rewritten(change)


def _order_ends(prop: Property, limit: int) -> Property:
    if not any(isinstance(part, EndInOrder) for part in prop.parts):
        return prop
    prop = expand_times(prop)
    try:
        return with_ends(prop, None)
    except OpenChoice:
        pass

    def made(each: Property, left: int) -> Iterator[Property]:
        ends = _Ends(each)
        ordered = [part for part in each.parts[::-1] if isinstance(part, EndInOrder)]
        # parts with the same last events end with the same one
        ways = {ends.last(inner): None for part in ordered for inner in part.parts if inner not in ends.silent}
        ways = {lasts: None for lasts in ways if len(lasts) > 1}
        if prod(map(len, ways)) > left:
            raise TooLarge("ways to make the choices and to end the parts of `pand` gates", limit=limit)
        for last in product(*ways):
            yield with_guards(with_ends(each, dict(zip(ways, last, strict=True))), windows=False)

    return by_choices(prop, limit, made)


order_ends: Final = Pass("order_ends", frozenset({EndInOrder}), _order_ends)
"""Ends in order become sequences, or alternatives if choices or several last events decide.

Counted leaves below are expanded.
"""


def _windows_to_guards(prop: Property, limit: int) -> Property:
    if not prop.timed:
        return prop
    prop = _windows_of_alternatives(order_ends(expand_times(prop), limit))
    try:
        return with_guards(prop)
    except OpenChoice:
        return by_choices(prop, limit, lambda each, _: iter([with_guards(each)]))


def _windows_of_alternatives(prop: Property) -> Property:
    """Return the property with a window of each alternative in place of a window over a choice."""

    def window(of: Within, part: Part, new: Part) -> Part:
        if part in prop.shared or part.source is None:
            return Within(of.source, (new,), of.duration)
        match part:
            case One():
                ways = zip(part.parts, new.parts, strict=True)
                return One(part.source, tuple(alternative(of, *way) for way in ways))
            case All(parts=(One() as choice, Condition() as condition)) if choice not in prop.shared:
                return All(part.source, (window(of, choice, new.parts[0]), condition))
            case _:
                return Within(of.source, (new,), of.duration)

    def alternative(of: Within, part: Part, new: Part) -> Part:
        found = window(of, part, new)
        child = part.source and Source(part.source.node)
        return All(child, (found,)) if isinstance(found, Within) else found

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        return window(part, part.parts[0], parts[0]) if isinstance(part, Within) else with_parts(part, parts)

    return prop.rewritten(change)


def with_guards(
    prop: Property, *, windows: bool = True, only_fixed: bool = False, open_points: bool = False
) -> Property:
    """Return the property without `start` and `end`, with `windows` as guards; raises `OpenChoice`.

    If `only_fixed`, windows over choices stay; with `open_points`, so do time points of parts with choices
    in which no part is shared.
    """
    below: dict[Part, tuple[Part, ...]] = {}
    rank = prop.tree.rank

    def point(time_point: TimePoint) -> Guard:
        if time_point.point == "at":
            return TimePoint.of("at", time_point.node, max(time_point.number, 1))
        whole = prop.wholes.get(Source(time_point.node, time_point.number))
        if whole is None:  # no scenario of this property has the node
            raise OpenChoice
        if whole not in below:
            below[whole] = parts_below(whole)
        if open_points and any(map(chooses, below[whole])) and prop.shared.isdisjoint(below[whole]):
            return TimePoint.of(time_point.point, time_point.node)
        return extreme(time_point.point, whole)

    def extreme(which: str, whole: Part) -> Guard:
        if whole not in below:
            below[whole] = parts_below(whole)
        if any(map(chooses, below[whole])):
            raise OpenChoice
        found = (part.source for part in below[whole] if isinstance(part, Event))
        events = sorted(found, key=lambda source: (rank[source.node], source.number))
        if not events:  # undefined
            return Operation(Operator.DIV, (Literal(0), Literal(0)))
        times = tuple(TimePoint.of("at", source.node, source.number) for source in events)
        return times[0] if len(times) == 1 else Operation(Operator.MIN if which == "start" else Operator.MAX, times)

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        match part:
            case Condition(guard=guard) if points := {
                time_point.name: point(time_point) for time_point in time_points(guard)
            }:
                return replace(part, guard=substitute(_differences(guard), points), written=part.written or guard)
            case Within(parts=(whole,)) if windows and only_fixed and any(map(chooses, parts_below(whole))):
                return with_parts(part, parts)
            case Within(source=source, parts=(whole,), duration=duration) if windows:
                span = Operation(Operator.SUB, (extreme("end", whole), extreme("start", whole)))
                window = Condition(source, Operation(Operator.LE, (span, Literal(duration))), window=duration)
                return All(source, (*parts, window))
            case _:
                return with_parts(part, parts)

    return prop.with_root(prop.with_root(prop.root).rewritten(change).root)


def _differences(guard: Guard) -> Guard:
    """Return the guard with durations as numbers, and with equalities of times as differences.

    Undefined times are null, and null equals null; a difference of undefined times equals nothing.
    """
    if not isinstance(guard, Operation):
        return Literal(guard.value) if isinstance(guard, Duration) else guard
    if guard.operator in (Operator.EQ, Operator.NE) and time_points(guard):
        difference = Operation(Operator.SUB, tuple(map(_differences, guard.operands)))
        return Operation(guard.operator, (difference, Literal(0)))
    return Operation(guard.operator, tuple(map(_differences, guard.operands)))


windows_to_guards: Final = Pass("windows_to_guards", frozenset({Within}), _windows_to_guards)
"""Windows, `start` and `end` become guards over single events, or alternatives."""


def time_names(prop: Property) -> Iterator[str]:
    """Yield names for times of events that no part uses: T1, T2 and so on."""
    taken = prop.variables
    return (name for number in count(1) if (name := f"T{number}") not in taken)


def _bind_times(prop: Property, _: int) -> Property:
    used = {point.name for part in prop.parts if isinstance(part, Condition) for point in time_points(part.guard)}
    free = time_names(prop)
    points = (TimePoint.of("at", *event.source).name for event in prop.events)
    used_points = dict.fromkeys((*(name for name in points if name in used), *sorted(used)))
    names = {name: next(free) for name in used_points}

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        match part:
            case Event(source, pattern) if (name := TimePoint.of("at", *source).name) in names:
                return Event(source, timed(pattern, names[name]))
            case Condition(guard=guard) if points := time_points(guard):
                new = {point.name: Variable(names[point.name]) for point in points}
                return replace(part, guard=substitute(guard, new), written=part.written or guard)
            case _:
                return with_parts(part, parts)

    made = prop.with_root(prop.root).rewritten(change)
    late = prop.time is not None and prop.time.late is not None
    return replace(made, time=prop.time if names or late or prop.times_absences else None)


bind_times: Final = Pass("bind_times", frozenset(), _bind_times)
"""The times that guards use become variables of the events' patterns (`rvaft.core.times.timed`).

It follows `windows_to_guards`. A property without used times loses its `time`.
"""
GUARDED_EVENTS: Final = (expand_times, order_ends, windows_to_guards, bind_times)
"""The passes to events, guards over their variables, sequences and choices."""


def reduced(prop: Property, limit: int = LIMIT) -> Property:
    """Return the property as events, guards over events, sequences and choices."""
    return simplify(windows_to_guards(order_ends(expand_times(prop), limit), limit))
