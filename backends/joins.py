"""Scenarios as joins of events, for the languages that query tables.

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
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice
from typing import Final, NamedTuple, TypeAlias, TypeVar

from backends.tables import Path
from rvaft.core.branches import branches, number_of
from rvaft.core.overlaps import compatible
from rvaft.core.property import Event, One, Property, Without
from rvaft.core.scenarios import Kept, scenarios
from rvaft.core.times import untimed
from rvaft.errors import TooLarge
from rvaft.model import patterns
from rvaft.model.assumptions import places
from rvaft.model.guards import Guard, Operation, Operator, renamed, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Literal, Pattern, Variable, rigid_variables
from rvaft.support.bits import bits

S = TypeVar("S", bound="JoinedScenario")
Choices: TypeAlias = Mapping[str, str]
"""The child that each `or` gate of a scenario keeps."""
LONGEST: Final = 2**61
"""Nanoseconds below which a window has bounds of 64 bits."""
COUNTED: Final = 600
"""Maximum number of events of a scenario with counted leaves."""


@dataclass(frozen=True)
class CountedEvents:
    """A counted leaf as one row.

    `first` is None where only the last event concerns others. `timed` tells whether the times count.
    The variables of each event alone are local: the `guards` on them hold for each event, and the
    values of `distinct` are pairwise different. `length` is that of the shortest window.
    """

    first: Event | None
    count: int
    timed: bool
    distinct: tuple[str, ...] = ()
    guards: tuple[Guard, ...] = ()
    length: int | None = None


class _OwnVariables(NamedTuple):
    """The variables of each counted event alone: local names by name and event, and their guards."""

    names: Mapping[Event, Mapping[str, str]]
    guards: tuple[Guard, ...]
    distinct: tuple[str, ...]
    used: frozenset[Guard]
    """The guards of the scenario that these replace."""


@dataclass(frozen=True)
class JoinedScenario:
    """The predecessors of each event in topological order, guards with variables, and absent events,
    each with the events of its part.
    """

    branch: int
    before: Mapping[Event, frozenset[Event]]
    guards: tuple[Guard, ...]
    absences: tuple[tuple[Without, tuple[Event, ...]], ...] = ()
    counts_of: Mapping[Event, CountedEvents] = field(default_factory=dict)
    """The leaves that are one row, by the last event; the events between the first and the last are left out."""

    def counted(self: S, lateness: int | None, *, values: Collection[str] | None = None, starts: bool = False) -> S:
        """Return the scenario with counted leaves as single rows, where that makes no difference.

        `lateness`: the D of `late` or `assume order`. `values`: the variables whose values rows may be
        grouped by, if not all. `starts`: keep each first event.
        """
        leaves: dict[str, list[Event]] = {}
        for event in self.before:
            leaves.setdefault(event.source.node, []).append(event)
        made, found, dropped = dict[Event, Event](), dict[Event, CountedEvents](), set[Guard]()
        between = set[Event]()
        for events in leaves.values():
            own = self._own_variables(events) if len(events) > 2 else None
            if own is None or (count := self._as_one(events, own, lateness, starts=starts)) is None:
                continue
            if values is not None and not {*self._grouped(events[0], own)} <= {*values}:
                continue
            between.update(events[1:-1] if count.first is not None else events[:-1])
            for event in {events[0], events[-1]}:
                local = {name: Variable(new) for name, new in own.names[event].items()}
                made[event] = Event(event.source, patterns.substitute(event.pattern, local))
            found[made[events[-1]]] = replace(count, first=count.first and made[count.first])
            dropped |= own.used
            if count.first is None:
                dropped |= {guard for guard, (members, _) in self.windows.items() if members <= {*events}}
        if not found:
            return self
        lost = {name for name, event in self.times.items() if event in between}

        def kept(guard: Guard) -> Guard:
            match guard:
                case Operation(operator, parts):
                    names = (part for part in parts if not (isinstance(part, Variable) and part.name in lost))
                    return Operation(operator, tuple(map(kept, names)))
                case _:
                    return guard

        def named(events: Iterable[Event]) -> Iterable[Event]:
            return (made.get(event, event) for event in events if event not in between)

        before = {made.get(event, event): frozenset(named(self.before[event])) for event in self.before}
        before = {event: before[event] for event in named(self.before)}
        absences = tuple((clause, tuple(named(part))) for clause, part in self.absences)
        guards = tuple(kept(guard) for guard in self.guards if guard not in dropped)
        return replace(self, before=before, guards=guards, absences=absences, counts_of=found)

    @staticmethod
    def _grouped(event: Event, own: _OwnVariables) -> list[str]:
        """Return the variables that the events of a counted leaf share, and those with different values."""
        names = own.names[event]
        return [name for name in rigid_variables(untimed(event.pattern)[0]) if names.get(name) in (None, *own.distinct)]

    def _own_variables(self, events: Sequence[Event]) -> _OwnVariables | None:
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
        names = {
            event: {own[place]: local[place] for place in places} for event, own in zip(events, order, strict=True)
        }
        common = [
            patterns.substitute(pattern, {old: Variable(new) for old, new in names[event].items()})
            for event, pattern in zip(events, patterns_, strict=True)
        ]
        if any(pattern != common[0] for pattern in common):
            return None
        owner = {name: event for event, some in names.items() for name in some}
        by_event: dict[Event, set[Guard]] = {event: set() for event in events}
        pairs = set[Guard]()
        for guard in self.guards:
            of = {owner[name] for name in variables(guard) if name in owner}
            if len(of) > 1:
                pairs.add(guard)
            elif of and set(variables(guard)) <= {*patterns.variables(untimed((event := of.pop()).pattern)[0])}:
                by_event[event].add(guard)
            elif set(variables(guard)) & owner.keys():
                return None
        guards = [{renamed(guard, names[event]) for guard in some} for event, some in by_event.items()]
        distinct = self._distinct(pairs, [names[event] for event in events])
        if distinct is None or any(some != guards[0] for some in guards):
            return None
        used = frozenset().union(pairs, *by_event.values())
        kept = tuple(dict.fromkeys(renamed(one, names[events[0]]) for one in self.guards if one in by_event[events[0]]))
        return _OwnVariables(names, kept, distinct, used)

    @staticmethod
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
        self, events: Sequence[Event], own: _OwnVariables, lateness: int | None, *, starts: bool
    ) -> CountedEvents | None:
        """Return a leaf's events as one row, or None if its last events may not stand for others."""
        members, (first, *_) = frozenset(events), events
        pattern = untimed(first.pattern)[0]
        chained = all(self.before[event] == self.before[first] | {*events[:at]} for at, event in enumerate(events))
        others = [event for event in self.before if event not in members]
        apart = not any(compatible(pattern, event.pattern) for event in others)
        apart &= all(members <= self.before[event] or members.isdisjoint(self.before[event]) for event in others)
        clauses = [(clause, members <= {*part}) for clause, part in self.absences]
        unhurt = not any(
            compatible(clause.pattern, pattern) or (inside and clause.side is Side.BEFORE) for clause, inside in clauses
        )
        names = {name for name, event in self.times.items() if event in members}
        guards = [guard for guard in self.guards if names.intersection(variables(guard))]
        windows = all(guard in self.windows and members <= self.windows[guard][0] for guard in guards)
        windows &= all(self.windows[guard][1] < LONGEST for guard in guards if guard in self.windows)
        timed = bool(guards) or any(inside and clause.duration is not None for clause, inside in clauses)
        if not (chained and apart and unhurt and windows and (lateness == 0 or not timed)):
            return None
        alone = all(self.windows[guard][0] <= members for guard in guards)
        alone &= not self.before[first] and not any(inside for _, inside in clauses)
        length = min((self.windows[guard][1] for guard in guards), default=None)
        needed = None if own.distinct and alone and not starts else first
        return CountedEvents(needed, len(events), timed, own.distinct, own.guards, length)

    @cached_property
    def windows(self) -> dict[Guard, tuple[frozenset[Event], int]]:
        """The window guards, each with its occurrences and duration."""
        return {guard: found for guard, home in self.homes if home is None and (found := self._window(guard))}

    def _window(self, guard: Guard) -> tuple[frozenset[Event], int] | None:
        match guard:
            case Operation(Operator.LE, (Operation(Operator.SUB, (end, start)), Literal(int() as length))):
                match end, start:
                    case Operation(Operator.MAX, ends), Operation(Operator.MIN, starts) if ends == starts:
                        names = [one.name for one in ends if isinstance(one, Variable) and one.name in self.times]
                        if len(names) == len(ends):
                            return frozenset(map(self.times.__getitem__, names)), length
        return None

    @cached_property
    def binders(self) -> dict[str, list[Event]]:
        """The events that bind each variable."""
        found: dict[str, list[Event]] = {}
        for event in self.before:
            for variable in rigid_variables(event.pattern):
                found.setdefault(variable, []).append(event)
        return found

    def near(self, event: Event) -> list[Event]:
        """Return the direct predecessors of an event."""
        before = self.before[event]
        return [other for other in self.before if other in before and not any(other in self.before[c] for c in before)]

    @cached_property
    def apart(self) -> list[tuple[Event, Event]]:
        """Unordered pairs of events that one event can match."""
        pairs = ((a, b) for a, b in combinations(self.before, 2) if a not in self.before[b] and b not in self.before[a])
        return [(a, b) for a, b in pairs if compatible(a.pattern, b.pattern)]

    @cached_property
    def homes(self) -> list[tuple[Guard, Event | None]]:
        """Each guard with the occurrence that binds all its variables, if any.

        Among equal values the earliest counts (1 or 1.0).
        """
        found: list[tuple[Guard, Event | None]] = []
        for guard in self.guards:
            binders = {name: self.binders.get(name, []) for name in variables(guard)}
            every = {name: None for names in binders.values() for name in names}
            own = (name for name in every if all(name in names for names in binders.values()))
            home = (name for name in own if all(name == other or name in self.before[other] for other in every))
            found.append((guard, next(home, None)))
        return found

    @cached_property
    def times(self) -> dict[str, Event]:
        """The variables of times, each with its event."""
        return {time: event for event in self.before if (time := untimed(event.pattern)[1]) is not None}


def joined_scenarios(kind: type[S], prop: Property, limit: int, *, most: int, minimal: bool = True) -> tuple[S, ...]:
    """Return the feasible scenarios; raises `TooLarge` for more than `most` events in one, or
    `limit` in all.
    """
    found, numbered, joined = list[S](), list[Choices](), 0
    for scenario in scenarios(prop, minimal=minimal, limit=limit):
        joined += max(len(scenario.events), 1)
        if joined > limit or len(scenario.events) > most:
            what = "events joined in the scenarios" if joined > limit else "events joined in a scenario"
            raise TooLarge(what, limit=limit if joined > limit else most)
        before = {
            event: frozenset(scenario.events[one] for one in bits(earlier))
            for event, earlier in zip(scenario.events, scenario.before, strict=True)
        }
        order = {event: before[event] for event in sorted(before, key=lambda event: len(before[event]))}
        guards = tuple(condition.guard for condition in scenario.conditions)
        numbered.append(_choices(scenario.kept))
        rank = {event: place for place, event in enumerate(order)}
        absences = ((clause, tuple(sorted(part, key=rank.__getitem__))) for clause, part in scenario.absences)
        found.append(kind(0, order, guards, tuple(absences)))
    numbers = _branch_numbers(prop, numbered)
    return tuple(replace(one, branch=number) for number, one in zip(numbers, found, strict=True))


def _sorted_choice(guard: Guard) -> Guard:
    """Return a disjunction with sorted operands."""
    match guard:
        case Operation(Operator.OR, parts):
            return Operation(Operator.OR, tuple(sorted(parts, key=repr)))
        case _:
            return guard


def _choices(kept: Kept) -> Choices:
    gates = [part for part in kept if isinstance(part, One) and part.source is not None]
    chosen = ((gate.source, kept[gate][0].source) for gate in gates)
    return {gate.node: child.node for gate, child in chosen if gate is not None and child is not None}


def _branch_numbers(prop: Property, every: Sequence[Choices]) -> list[int]:
    """Return the branch of each scenario.

    Most branches have a scenario, so the first ones are listed once; others are counted one by one.
    """
    if prop.branch is not None:
        return [prop.branch] * len(every)
    first = islice(branches(prop.tree), 2 * len(every))
    listed = {
        frozenset(one.choices.items()): one.number for one in first if prop.kind is None or prop.kind in one.kinds
    }
    return [
        listed.get(frozenset(choices.items())) or number_of(prop.tree, choices, kind=prop.kind) or 0
        for choices in every
    ]


def variable_paths(pattern: Pattern) -> dict[str, Path]:
    """Return the first place of each variable in a pattern."""
    found: dict[str, Path] = {}
    for path, part, _ in places(pattern):
        if isinstance(part, Variable):
            found.setdefault(part.name, path)
    return found
