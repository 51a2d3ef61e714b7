"""A tree as a graph of parts: single events, single guards, and four ways to put parts together.

Causality becomes sequence (a gate's event, then what is below it; the other way round under `bottom_up`), a constant guard
disappears or takes its node with it, and parts that are nested for no reason are flattened, so that a chain of thousands
of gates is one sequence. A node that several parents share stays one part.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from itertools import combinations
from math import comb
from typing import TypeAlias, assert_never

from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, holds, variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.model.tree import RVAFT

Part: TypeAlias = int
"""A part is known by its index in `Structure.parts`."""


class How(Enum):
    """What becomes of the children: all in any order, all in sequence, exactly one, at least K."""

    ALL = auto()
    SEQUENCE = auto()
    ONE = auto()
    SOME = auto()


@dataclass(frozen=True, slots=True)
class Event:
    """One occurrence; `atom` is the index of its pattern in `Structure.patterns`."""

    node: str
    atom: int


@dataclass(frozen=True, slots=True)
class Condition:
    """One guard over variables; `guard` is its index in `Structure.guards`."""

    guard: int


@dataclass(frozen=True, slots=True)
class Group:
    """Parts put together; `least` is the K of SOME."""

    how: How
    children: tuple[Part, ...]
    least: int = 0


Content: TypeAlias = Event | Condition | Group


@dataclass(frozen=True, slots=True)
class Structure:
    """The parts, children before parents, and the tables of patterns and guards they refer to.

    `root` is None when constant guards leave no feasible scenario; `names` gives, for each pattern, a node that has it.
    """

    root: Part | None
    parts: tuple[Content, ...]
    patterns: tuple[Pattern, ...]
    names: tuple[str, ...]
    guards: tuple[Guard, ...]

    def binders(self) -> tuple[frozenset[int], ...]:
        """For each guard the atoms with one of its variables."""
        bound = [set(rigid_variables(pattern)) for pattern in self.patterns]
        return tuple(
            frozenset(atom for atom, names in enumerate(bound) if names & set(variables(guard)))
            for guard in self.guards
        )


def structure(tree: RVAFT) -> Structure:
    """The parts of a tree."""
    return _Builder(tree).build()


class _Builder:
    """Builds parts bottom-up; a node whose every scenario is infeasible has no part."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.parts: list[Content] = []
        self.shared: set[Part] = set()
        self.patterns: dict[Pattern, int] = {}
        self.names: list[str] = []
        for name in tree.occurrences:
            pattern = tree.pattern(name)
            if pattern is not None and pattern not in self.patterns:
                self.patterns[pattern] = len(self.patterns)
                self.names.append(name)
        guards = (node.when for node in tree.top_down() if node.when is not None and variables(node.when))
        self.guards = {guard: number for number, guard in enumerate(dict.fromkeys(guards))}

    def build(self) -> Structure:
        of: dict[str, Part | None] = {}
        for node in self.tree.bottom_up():
            part = self._node(node, [of[child] for child in node.children])
            of[node.name] = part
            if part is not None and node.name in self.tree.shared:
                self.shared.add(part)
        return Structure(
            of[self.tree.root], tuple(self.parts), tuple(self.patterns), tuple(self.names), tuple(self.guards)
        )

    def _node(self, node: Node, children: Sequence[Part | None]) -> Part | None:
        below = None if node.gate is None else self._gate(node, children)
        if node.gate is not None and below is None:
            return None
        sequence = [part for part in (self._event(node), below) if part is not None]
        if self.tree.causality is Causality.BOTTOM_UP:
            sequence.reverse()
        match node.when:
            case None:
                return self._group(How.SEQUENCE, sequence)
            case guard if not variables(guard):
                return self._group(How.SEQUENCE, sequence) if holds(guard, {}) else None
            case guard:
                condition = self._new(Condition(self.guards[guard]))
                return self._group(How.SEQUENCE, [condition, *sequence])

    def _event(self, node: Node) -> Part | None:
        pattern = self.tree.pattern(node.name)
        return None if pattern is None else self._new(Event(node.name, self.patterns[pattern]))

    def _gate(self, node: Node, children: Sequence[Part | None]) -> Part | None:
        feasible = [part for part in children if part is not None]
        assert node.gate is not None
        match node.gate:
            case Gate.OR:
                return self._group(How.ONE, feasible) if feasible else None
            case Gate.VOT:
                return self._vote(feasible, node.threshold or 0)
            case Gate.AND | Gate.SAND | Gate.SAND_RL if len(feasible) < len(children):
                return None
            case Gate.AND:
                return self._group(How.ALL, feasible)
            case Gate.SAND:
                return self._group(How.SEQUENCE, feasible)
            case Gate.SAND_RL:
                return self._group(How.SEQUENCE, feasible[::-1])
            case _:
                assert_never(node.gate)

    def _vote(self, feasible: list[Part], least: int) -> Part | None:
        if len(feasible) < least:
            return None
        if len(feasible) == least:
            return self._group(How.ALL, feasible)
        return self._new(Group(How.SOME, tuple(feasible), least))

    def _group(self, how: How, children: Iterable[Part]) -> Part:
        flat: list[Part] = []
        for child in children:
            content = self.parts[child]
            if isinstance(content, Group) and content.how is how and child not in self.shared:
                flat.extend(content.children)
            else:
                flat.append(child)
        if how is not How.SEQUENCE:
            flat = list(dict.fromkeys(flat))
        return flat[0] if len(flat) == 1 else self._new(Group(how, tuple(flat)))

    def _new(self, content: Content) -> Part:
        self.parts.append(content)
        return len(self.parts) - 1


def below(content: Content) -> tuple[Part, ...]:
    """The children of a part."""
    return content.children if isinstance(content, Group) else ()


def reachable(root: Part, parts: Mapping[Part, Content] | Sequence[Content]) -> list[Part]:
    """The parts reachable from the root, parents before children and first children first."""
    order: list[Part] = []
    state: dict[Part, bool] = {}
    todo = [(root, False)]
    while todo:
        part, left = todo.pop()
        if left:
            order.append(part)
        elif part not in state:
            state[part] = True
            todo.append((part, True))
            todo.extend((child, False) for child in below(parts[part]) if child not in state)
    order.reverse()
    return order


# Decides beforehand the choices that cannot wait.
#
# A choice can wait when everything below each of its alternatives is reached through that alternative alone: then an
# event below it is the decision. Where an alternative reaches a part that is also reached otherwise, the decision may add an
# order between events that have happened by then, so it is taken before anything happens, each way in a graph of its own.

Graph: TypeAlias = dict[Part, Content]


def decided(structure: Structure, root: Part, *, at_least: bool, limit: int) -> list[Graph]:
    """The graphs, in a stable order, whose remaining choices can all wait; together they have the scenarios of the tree.

    `at_least` keeps the ways to choose more than K; raises `TooLarge` beyond `limit` graphs.
    """
    start = dict(enumerate(structure.parts))
    done: list[Graph] = []
    todo = [start]
    while todo:
        graph = todo.pop()
        order = reachable(root, graph)
        choice = _urgent(order, graph)
        if choice is None:
            done.append({part: graph[part] for part in order})
        else:
            content = graph[choice]
            assert isinstance(content, Group)
            ways = list(_ways(content, at_least=at_least, room=limit - len(done) - len(todo)))
            todo.extend({**graph, choice: Group(How.ALL, way)} for way in reversed(ways))
        if len(done) + len(todo) > limit:
            raise TooLarge("ways to decide choices between parts that share nodes", limit=limit)
    return done


def _ways(choice: Group, *, at_least: bool, room: int) -> Iterator[tuple[Part, ...]]:
    if choice.how is How.ONE:
        yield from ((child,) for child in choice.children)
        return
    most = len(choice.children) if at_least else choice.least
    seen: set[frozenset[Part]] = set()
    for size in range(choice.least, most + 1):
        for way in combinations(choice.children, size):
            kept = frozenset(way)
            if kept not in seen:
                seen.add(kept)
                yield tuple(dict.fromkeys(way))
            if len(seen) > room:
                return


def _urgent(order: list[Part], graph: Graph) -> Part | None:
    """The first choice with an alternative that reaches a part which is also reached otherwise."""
    references: dict[Part, int] = dict.fromkeys(order, 0)
    parents: dict[Part, int] = dict.fromkeys(order, 0)
    rank = {part: index for index, part in enumerate(order)}
    for part in order:
        for child in below(graph[part]):
            references[child] += 1
            parents[child] |= 1 << rank[part]
    if all(count <= 1 for count in references.values()):
        return None
    inside: dict[Part, int] = {}
    entered: dict[Part, int] = {}
    for part in reversed(order):
        inside[part], entered[part] = 1 << rank[part], 0
        for child in below(graph[part]):
            inside[part] |= inside[child]
            entered[part] |= entered[child] | parents[child]
    for part in order:
        content = graph[part]
        if isinstance(content, Group) and content.how in (How.ONE, How.SOME):
            for child in content.children:
                if references[child] > 1 or entered[child] & ~inside[child]:
                    return part
    return None


# A graph whose choices can all wait, laid out as tables of bit sets.
#
# Events, choices, alternatives and guards are numbered; a set of them is an integer. Everything here is computed once, bottom-up
# or top-down over the graph, so that a step of the construction is a handful of operations on integers.


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
