"""Scenarios as joins of events, for the languages that query tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice
from typing import Final, TypeAlias, TypeVar

from backends.tables import Path
from rvaft.core.branches import branches, number_of
from rvaft.core.overlaps import compatible
from rvaft.core.property import Event, Kept, One, Property, WithoutEvent
from rvaft.core.scenarios import scenarios
from rvaft.core.times import untimed
from rvaft.errors import TooLarge
from rvaft.model.assumptions import places
from rvaft.model.guards import Guard, Operation, Operator, variables
from rvaft.model.patterns import Literal, Pattern, Variable, rigid_variables
from rvaft.support.bits import bits

S = TypeVar("S", bound="JoinedScenario")
Choices: TypeAlias = Mapping[str, str]
"""The child that each `or` gate of a scenario keeps."""
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


@dataclass(frozen=True)
class JoinedScenario:
    """The predecessors of each event in topological order, guards with variables, and absent events,
    each with the events of its part.
    """

    branch: int
    before: Mapping[Event, frozenset[Event]]
    guards: tuple[Guard, ...]
    absences: tuple[tuple[WithoutEvent, tuple[Event, ...]], ...] = ()
    counts_of: Mapping[Event, CountedEvents] = field(default_factory=dict)
    """The leaves that are one row, by the last event; the events between the first and the last are left out."""

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
    results, numbered, joined = list[S](), list[Choices](), 0
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
        results.append(kind(0, order, guards, tuple(absences)))
    numbers = _branch_numbers(prop, numbered)
    return tuple(replace(one, branch=number) for number, one in zip(numbers, results, strict=True))


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
