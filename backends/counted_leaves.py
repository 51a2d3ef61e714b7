"""Counted leaves as single rows of the queries that join events.

Three or more events that a leaf counts are one row, that of the last event, if no other node can use
them, and if windows over them rely on times that do not go back. Of the sequences of such events with
the same last one, the latest has the latest first event, and no condition prefers another one:

| leaf | first event for a last one |
| --- | --- |
| `times N` | the event N - 1 events before, among those with equal shared values |
| `times N each X` | the same; X is not shared |
| `times N distinct X` | of the latest events of each value of X, the N-th latest |
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final, NamedTuple, TypeVar

from backends.joins import CountedEvents, JoinedScenario
from rvaft.core.overlaps import compatible
from rvaft.core.property import Event
from rvaft.core.times import untimed
from rvaft.model import patterns
from rvaft.model.guards import Guard, Operation, Operator, renamed, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Variable, rigid_variables

S = TypeVar("S", bound=JoinedScenario)
LONGEST_WINDOW: Final = 2**61
"""Nanoseconds below which a window has bounds of 64 bits."""


class _OwnVariables(NamedTuple):
    """The variables of each counted event alone: local names by name and event, and their guards."""

    names: Mapping[Event, Mapping[str, str]]
    guards: tuple[Guard, ...]
    distinct: tuple[str, ...]
    used: frozenset[Guard]
    """The guards of the scenario that these replace."""


def single_rows(scenario: S, lateness: int | None, *, values: Collection[str] | None = None, starts: bool = False) -> S:
    """Return the scenario with counted leaves as single rows, where that makes no difference.

    `lateness`: the D of `late` or `assume order`. `values`: the variables whose values rows may be
    grouped by, if not all. `starts`: keep each first event.
    """
    leaves: dict[str, list[Event]] = {}
    for event in scenario.before:
        leaves.setdefault(event.source.node, []).append(event)
    local_events, counts, dropped = dict[Event, Event](), dict[Event, CountedEvents](), set[Guard]()
    between = set[Event]()
    for events in leaves.values():
        own = _own_variables(scenario, events) if len(events) > 2 else None
        if own is None or (count := _as_one(scenario, events, own, lateness, starts=starts)) is None:
            continue
        if values is not None and not {*_grouped(events[0], own)} <= {*values}:
            continue
        between.update(events[1:-1] if count.first is not None else events[:-1])
        for event in {events[0], events[-1]}:
            local = {name: Variable(new) for name, new in own.names[event].items()}
            local_events[event] = Event(event.source, patterns.substitute(event.pattern, local))
        counts[local_events[events[-1]]] = replace(count, first=count.first and local_events[count.first])
        dropped |= own.used
        if count.first is None:
            dropped |= {guard for guard, (members, _) in scenario.windows.items() if members <= {*events}}
    if not counts:
        return scenario
    lost = {name for name, event in scenario.times.items() if event in between}

    def kept(guard: Guard) -> Guard:
        match guard:
            case Operation(operator, parts):
                names = (part for part in parts if not (isinstance(part, Variable) and part.name in lost))
                return Operation(operator, tuple(map(kept, names)))
            case _:
                return guard

    def named(events: Iterable[Event]) -> Iterable[Event]:
        return (local_events.get(event, event) for event in events if event not in between)

    before = {local_events.get(event, event): frozenset(named(scenario.before[event])) for event in scenario.before}
    before = {event: before[event] for event in named(scenario.before)}
    absences = tuple((clause, tuple(named(part))) for clause, part in scenario.absences)
    guards = tuple(kept(guard) for guard in scenario.guards if guard not in dropped)
    return replace(scenario, before=before, guards=guards, absences=absences, counts_of=counts)


def _grouped(event: Event, own: _OwnVariables) -> list[str]:
    """Return the variables that the events of a counted leaf share, and those with different values."""
    names = own.names[event]
    return [name for name in rigid_variables(untimed(event.pattern)[0]) if names.get(name) in (None, *own.distinct)]


def _own_variables(scenario: JoinedScenario, events: Sequence[Event]) -> _OwnVariables | None:
    """Return the variables of each of a leaf's events alone; None if their guards are not those of a count."""
    patterns_ = [untimed(event.pattern)[0] for event in events]
    first, *_ = order = [patterns.variables(pattern) for pattern in patterns_]
    if any(len(names) != len(first) for names in order):
        return None
    places = [place for place, name in enumerate(first) if any(names[place] != name for names in order)]
    taken = {*first}
    local = dict[int, str]()
    for place in places:
        name = f"_{re.sub('_1_*$', '', first[place])}"
        while name in taken:
            name += "_"
        taken.add(name)
        local[place] = name
    names = {event: {own[place]: local[place] for place in places} for event, own in zip(events, order, strict=True)}
    common = [
        patterns.substitute(pattern, {old: Variable(new) for old, new in names[event].items()})
        for event, pattern in zip(events, patterns_, strict=True)
    ]
    if any(pattern != common[0] for pattern in common):
        return None
    owner = {name: event for event, some in names.items() for name in some}
    by_event: dict[Event, set[Guard]] = {event: set() for event in events}
    pairs = set[Guard]()
    for guard in scenario.guards:
        of = {owner[name] for name in variables(guard) if name in owner}
        if len(of) > 1:
            pairs.add(guard)
        elif of and set(variables(guard)) <= {*patterns.variables(untimed((event := of.pop()).pattern)[0])}:
            by_event[event].add(guard)
        elif set(variables(guard)) & owner.keys():
            return None
    guards = [{renamed(guard, names[event]) for guard in some} for event, some in by_event.items()]
    distinct = _distinct(pairs, [names[event] for event in events])
    if distinct is None or any(some != guards[0] for some in guards):
        return None
    used = frozenset().union(pairs, *by_event.values())
    kept = tuple(dict.fromkeys(renamed(one, names[events[0]]) for one in scenario.guards if one in by_event[events[0]]))
    return _OwnVariables(names, kept, distinct, used)


def _distinct(pairs: Collection[Guard], names: Sequence[Mapping[str, str]]) -> tuple[str, ...] | None:
    """Return the local variables whose values guards demand to be different for each two events, if they do."""
    if not pairs:
        return ()
    local = [{new: old for old, new in some.items()} for some in names]
    columns = {new: [some[new] for some in local] for new in local[0]}
    shared = {name for guard in pairs for name in variables(guard)}
    distinct = tuple(new for new, olds in columns.items() if shared.intersection(olds))
    expected = set[Guard]()
    for a, b in combinations(range(len(names)), 2):
        differ = tuple(
            Operation(Operator.NE, (Variable(columns[new][a]), Variable(columns[new][b]))) for new in distinct
        )
        expected.add(differ[0] if len(differ) == 1 else Operation(Operator.OR, differ))
    return distinct if {*map(_sorted_choice, pairs)} == {*map(_sorted_choice, expected)} else None


def _as_one(
    scenario: JoinedScenario, events: Sequence[Event], own: _OwnVariables, lateness: int | None, *, starts: bool
) -> CountedEvents | None:
    """Return a leaf's events as one row, or None if its last events may not stand for others."""
    members, (first, *_) = frozenset(events), events
    pattern = untimed(first.pattern)[0]
    chained = all(scenario.before[event] == scenario.before[first] | {*events[:at]} for at, event in enumerate(events))
    others = [event for event in scenario.before if event not in members]
    apart = not any(compatible(pattern, event.pattern) for event in others)
    apart &= all(members <= scenario.before[event] or members.isdisjoint(scenario.before[event]) for event in others)
    clauses = [(clause, members <= {*part}) for clause, part in scenario.absences]
    unhurt = not any(
        compatible(clause.pattern, pattern) or (inside and clause.side is Side.BEFORE) for clause, inside in clauses
    )
    names = {name for name, event in scenario.times.items() if event in members}
    guards = [guard for guard in scenario.guards if names.intersection(variables(guard))]
    windows = all(guard in scenario.windows and members <= scenario.windows[guard][0] for guard in guards)
    windows &= all(scenario.windows[guard][1] < LONGEST_WINDOW for guard in guards if guard in scenario.windows)
    timed = bool(guards) or any(inside and clause.duration is not None for clause, inside in clauses)
    if not (chained and apart and unhurt and windows and (lateness == 0 or not timed)):
        return None
    alone = all(scenario.windows[guard][0] <= members for guard in guards)
    alone &= not scenario.before[first] and not any(inside for _, inside in clauses)
    length = min((scenario.windows[guard][1] for guard in guards), default=None)
    needed = None if own.distinct and alone and not starts else first
    return CountedEvents(needed, len(events), timed, own.distinct, own.guards, length)


def _sorted_choice(guard: Guard) -> Guard:
    """Return a disjunction with sorted operands."""
    match guard:
        case Operation(Operator.OR, parts):
            return Operation(Operator.OR, tuple(sorted(parts, key=repr)))
        case _:
            return guard
