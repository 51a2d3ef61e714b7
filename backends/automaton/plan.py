"""A graph whose choices can all wait, laid out as tables of bit sets.

Events, choices, alternatives and guards are numbered; a set of them is an integer. Everything here is computed once, bottom-up
or top-down over the graph, so that a step of the construction is a handful of operations on integers.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from math import comb

from backends.automaton.choices import Graph
from backends.automaton.structure import Condition, Content, Event, Group, How, Part, below, reachable
from rvaft.errors import TooLarge


@dataclass(frozen=True, slots=True)
class Inside:
    """What a part contains: events, choices, guards. For `mandatory`, without what is below a choice."""

    events: int = 0
    choices: int = 0
    guards: int = 0

    def __or__(self, other: "Inside") -> "Inside":
        return Inside(self.events | other.events, self.choices | other.choices, self.guards | other.guards)


@dataclass(frozen=True, slots=True)
class Alternative:
    """One child of a choice. `up` is the alternative that contains the choice, if any.

    `mandatory` comes with choosing it, `whole` is all that may; `first` are the events it can begin with, `silent` the
    smallest sets of guards with which it is complete without an event.
    """

    choice: int
    up: int | None
    mandatory: Inside
    whole: Inside
    first: int
    silent: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """A choice: its alternatives, how many of them at least, and whether more may be taken."""

    alternatives: tuple[int, ...]
    least: int
    more: bool
    mask: int


@dataclass(frozen=True, slots=True)
class Moment:
    """One occurrence: its atom, the alternative it is below, what comes before it, which events come after it."""

    atom: int
    alternative: int | None
    events_before: int
    choices_before: int
    events_after: int


@dataclass(frozen=True, slots=True)
class Plan:
    """The tables. `binders` gives for each guard the events that bind one of its variables."""

    start: Inside
    moments: tuple[Moment, ...]
    choices: tuple[Choice, ...]
    alternatives: tuple[Alternative, ...]
    binders: tuple[int, ...]
    bound: tuple[int, ...]
    """For each event the guards that have one of its variables."""


def plan(graph: Graph, root: Part, binders: Iterable[frozenset[int]], *, at_least: bool, limit: int) -> Plan:
    """Lay out a graph; raises `TooLarge` when a choice has too many ways to be made without an event."""
    return _Layout(graph, root, tuple(binders), at_least=at_least, limit=limit).plan()


class _Layout:
    def __init__(
        self, graph: Graph, root: Part, binders: tuple[frozenset[int], ...], *, at_least: bool, limit: int
    ) -> None:
        self.graph = graph
        self.root = root
        self.binders = binders
        self.at_least = at_least
        self.limit = limit
        self.order = reachable(root, graph)
        self.events: dict[Part, int] = {}
        self.choices: dict[Part, int] = {}
        for part in self.order:
            match graph[part]:
                case Event():
                    self.events[part] = len(self.events)
                case Group(how) if how in (How.ONE, How.SOME):
                    self.choices[part] = len(self.choices)
                case _:
                    pass
        self.whole: dict[Part, Inside] = {}
        self.mandatory: dict[Part, Inside] = {}
        self.first: dict[Part, int] = {}
        self.silent: dict[Part, tuple[int, ...]] = {}

    def plan(self) -> Plan:
        for part in reversed(self.order):
            self._up(part, self.graph[part])
        before, after = self._around(backwards=False), self._around(backwards=True)
        alternative_of, alternatives = self._alternatives()
        atoms = [content.atom for part in self.events if isinstance(content := self.graph[part], Event)]
        moments = tuple(
            Moment(atoms[index], alternative_of[part], before[part].events, before[part].choices, after[part].events)
            for part, index in self.events.items()
        )
        binders = tuple(_mask(index for index, atom in enumerate(atoms) if atom in of) for of in self.binders)
        bound = tuple(
            _mask(guard for guard, events in enumerate(binders) if events >> index & 1) for index in range(len(atoms))
        )
        choices = self._choices(alternatives)
        return Plan(self.mandatory[self.root], moments, choices, tuple(alternatives), binders, bound)

    def _up(self, part: Part, content: Content) -> None:
        children = below(content)
        match content:
            case Event():
                own = Inside(events=1 << self.events[part])
                self.whole[part] = self.mandatory[part] = own
                self.first[part], self.silent[part] = own.events, ()
            case Condition(guard):
                self.whole[part] = self.mandatory[part] = Inside(guards=1 << guard)
                self.first[part], self.silent[part] = 0, (1 << guard,)
            case Group(how):
                own = Inside(choices=1 << self.choices[part]) if part in self.choices else Inside()
                self.whole[part] = own | _together(self.whole[child] for child in children)
                self.mandatory[part] = own if own.choices else _together(self.mandatory[child] for child in children)
                self.first[part] = self._first(how, children)
                self.silent[part] = self._silent(content)

    def _first(self, how: How, children: tuple[Part, ...]) -> int:
        first = 0
        for child in children:
            first |= self.first[child]
            if how is How.SEQUENCE and not self.silent[child]:
                break
        return first

    def _silent(self, group: Group) -> tuple[int, ...]:
        ways = [self.silent[child] for child in group.children]
        match group.how:
            case How.ALL | How.SEQUENCE:
                return self._every(ways)
            case How.ONE:
                return smallest(guards for way in ways for guards in way)
            case How.SOME:
                able = [way for way in ways if way]
                if comb(len(able), group.least) > self.limit:
                    raise TooLarge("ways to decide choices by guards alone", limit=self.limit)
                chosen = combinations(able, group.least)
                return smallest(guards for some in chosen for guards in self._every(list(some)))

    def _every(self, ways: list[tuple[int, ...]]) -> tuple[int, ...]:
        if not all(ways):
            return ()
        found: tuple[int, ...] = (0,)
        for way in ways:
            if way != (0,):
                found = smallest(one | other for one in found for other in way)
            if len(found) > self.limit:
                raise TooLarge("ways to decide choices by guards alone", limit=self.limit)
        return found

    def _around(self, *, backwards: bool) -> dict[Part, Inside]:
        """What sequences put before each part, or after it."""
        around = {part: Inside() for part in self.order}
        for part in self.order:
            outside = around[part]
            content = self.graph[part]
            ordered = isinstance(content, Group) and content.how is How.SEQUENCE
            for child in reversed(below(content)) if backwards else below(content):
                around[child] |= outside
                if ordered:
                    outside |= self.whole[child]
        return around

    def _alternatives(self) -> tuple[dict[Part, int | None], list[Alternative]]:
        """The alternatives, and the innermost one that each part is below."""
        alternative_of: dict[Part, int | None] = dict.fromkeys(self.order, None)
        alternatives: list[Alternative] = []
        for part in self.order:
            for child in below(self.graph[part]):
                if part not in self.choices:
                    alternative_of[child] = alternative_of[part]
                else:
                    alternative_of[child] = len(alternatives)
                    alternatives.append(self._alternative(self.choices[part], alternative_of[part], child))
        return alternative_of, alternatives

    def _alternative(self, choice: int, up: int | None, child: Part) -> Alternative:
        return Alternative(choice, up, self.mandatory[child], self.whole[child], self.first[child], self.silent[child])

    def _choices(self, alternatives: list[Alternative]) -> tuple[Choice, ...]:
        own: list[list[int]] = [[] for _ in self.choices]
        for index, alternative in enumerate(alternatives):
            own[alternative.choice].append(index)
        made = []
        for part, index in self.choices.items():
            content = self.graph[part]
            assert isinstance(content, Group)
            several = content.how is How.SOME
            least = content.least if several else 1
            made.append(Choice(tuple(own[index]), least, several and self.at_least, _mask(own[index])))
        return tuple(made)


def smallest(guards: Iterable[int]) -> tuple[int, ...]:
    """The sets that contain no other of them, in a stable order."""
    kept: list[int] = []
    for one in sorted(set(guards), key=lambda mask: (mask.bit_count(), mask)):
        if not any(other & ~one == 0 for other in kept):
            kept.append(one)
    return tuple(kept)


def _together(parts: Iterable[Inside]) -> Inside:
    events = choices = guards = 0
    for part in parts:
        events |= part.events
        choices |= part.choices
        guards |= part.guards
    return Inside(events, choices, guards)


def _mask(indices: Iterable[int]) -> int:
    mask = 0
    for index in indices:
        mask |= 1 << index
    return mask
