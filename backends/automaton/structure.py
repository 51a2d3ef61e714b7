"""A tree laid out for the construction of its automaton: a graph of parts, and tables of bit sets over it.

The parts are those of the normal form; what is nested for no reason is flattened, so that a chain of thousands of gates is one sequence.
A node that several parents share stays one part.

A choice can wait when everything below each of its alternatives is reached through that alternative alone: then an event below
it is the decision. Where an alternative reaches a part that is also reached otherwise, the decision may add an order between
events that have happened by then, so it is taken before anything happens, each way in a graph of its own.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import comb
from typing import Final, NamedTuple, TypeAlias, assert_never

from rvaft.analysis.normal_form import Op, Part, normal_form
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.support.bits import bits, mask_of, union

EDGES: Final = 10
STEPS: Final = 1000
"""How many edges, and how many steps of the construction, the limit allows for each state it allows."""
QUICK: Final = 10_000_000
"""So many steps take a few seconds, and are allowed under any limit."""


class Work:
    """What is built and done, counted; raises `TooLarge` beyond `limit` states, and what goes with them."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._edges = 0
        self._steps = 0

    def states(self, many: int) -> None:
        """There are so many states now."""
        self.check(many, "states of the automaton")

    def edge(self) -> None:
        """There is one more edge."""
        self._edges += 1
        self.check(self._edges, f"edges of the automaton, {EDGES} allowed for each state", EDGES)

    def step(self, many: int) -> None:
        """So many more steps are done; each takes about a fifth of a microsecond."""
        self._steps += many
        if self._steps > QUICK:
            self.check(self._steps, f"steps of the construction, {STEPS} allowed for each state", STEPS)

    def check(self, reached: int, what: str, each: int = 1) -> None:
        """Refuse more of something than `each` for each state."""
        if reached > self.limit * each:
            raise TooLarge(what, limit=self.limit)


Graph: TypeAlias = dict[int, Part]
"""Parts by number, each before the parts it is made of."""


@dataclass(frozen=True)
class Structure:
    """The parts of a tree, and its propositions: first the patterns of events (*atoms*), then the guards, each a bit.

    `root` is None when constant guards leave no feasible scenario; `names` gives, for each pattern, a node that has it, `atoms` the
    number of each node's pattern.
    """

    root: int | None
    parts: Graph
    atoms: Mapping[str, int]
    patterns: tuple[Pattern, ...]
    names: tuple[str, ...]
    guards: tuple[Guard, ...]

    @cached_property
    def guard_bits(self) -> Mapping[Guard, int]:
        """The number of each guard among the propositions."""
        return {guard: number for number, guard in enumerate(self.guards, len(self.patterns))}

    @cached_property
    def bound(self) -> tuple[int, ...]:
        """For each atom the guards that have one of its variables."""
        needs = [(number, set(variables(guard))) for guard, number in self.guard_bits.items()]
        return tuple(
            mask_of(number for number, names in needs if not names.isdisjoint(rigid_variables(pattern)))
            for pattern in self.patterns
        )


def structure(tree: RVAFT) -> Structure:
    """The parts and propositions of a tree."""
    form = normal_form(tree)
    shared = {form.whole[name] for name in tree.shared if name in form.whole}
    kept: set[int] = set()  # what several parents share is not flattened
    parts: dict[int, Part] = {}
    of: list[int] = []
    for number, part in enumerate(form.parts):
        children = [of[child] for child in part.parts]
        match part.op:
            case Op.EVENT | Op.CONDITION | Op.AT_LEAST:
                pass
            case Op.ALL | Op.SEQUENCE | Op.ONE:
                children = _flattened(part.op, children, parts, kept)
            case _:
                assert_never(part.op)
        if len(children) == 1 and part.op is not Op.AT_LEAST:
            of.append(children[0])
        else:
            parts[number] = replace(part, parts=tuple(children))
            of.append(number)
        if number in shared:
            kept.add(of[-1])
    names: dict[Pattern, str] = {}
    numbers: dict[Pattern, int] = {}
    atoms: dict[str, int] = {}
    for name in tree.occurrences:
        if (pattern := tree.pattern(name)) is not None:
            names.setdefault(pattern, name)
            atoms[name] = numbers.setdefault(pattern, len(numbers))
    guards = (node.when for node in tree.top_down() if node.when is not None and variables(node.when))
    root = of[-1] if form.feasible else None
    return Structure(root, parts, atoms, tuple(names), tuple(names.values()), tuple(dict.fromkeys(guards)))


def _flattened(op: Op, children: list[int], parts: Graph, kept: set[int]) -> list[int]:
    flat: list[int] = []
    for child in children:
        below = parts[child]
        if below.op is op and child not in kept:
            flat.extend(below.parts)
        else:
            flat.append(child)
    return flat if op is Op.SEQUENCE else list(dict.fromkeys(flat))


# The choices that cannot wait.


def decided(structure: Structure, root: int, *, at_least: bool, work: Work) -> list[Graph]:
    """The graphs, in a stable order, whose remaining choices can all wait; together they have the scenarios of the tree.

    `at_least` keeps the ways to choose more than K; raises `TooLarge` beyond so many graphs as states are allowed.
    """
    done: list[Graph] = []
    todo = [structure.parts]
    while todo:
        graph = _reached(root, todo.pop())
        choice = _urgent(graph, work)
        if choice is None:
            done.append(graph)
        else:
            room = work.limit - len(done) - len(todo)
            ways = list(_ways(graph[choice], at_least=at_least, room=room))
            todo.extend({**graph, choice: Part(Op.ALL, parts=way)} for way in reversed(ways))
        work.check(len(done) + len(todo), "ways to decide choices between parts that share nodes")
    return done


def _reached(root: int, parts: Graph) -> Graph:
    reached = {root}
    for number in sorted((number for number in parts if number <= root), reverse=True):
        if number in reached:
            reached.update(parts[number].parts)
    return {number: parts[number] for number in sorted(reached, reverse=True)}


def _ways(choice: Part, *, at_least: bool, room: int) -> Iterator[tuple[int, ...]]:
    most = len(choice.parts) if at_least and choice.op is Op.AT_LEAST else choice.need
    seen: set[frozenset[int]] = set()
    for size in range(choice.need, most + 1):
        for way in combinations(choice.parts, size):
            if frozenset(way) not in seen:
                seen.add(frozenset(way))
                yield tuple(dict.fromkeys(way))
            if len(seen) > room:
                return


def _urgent(graph: Graph, work: Work) -> int | None:
    """The first choice with an alternative that reaches a part which is also reached otherwise."""
    references = dict.fromkeys(graph, 0)
    parents = dict.fromkeys(graph, 0)
    rank = {number: index for index, number in enumerate(graph)}
    for number, part in graph.items():
        for child in part.parts:
            references[child] += 1
            parents[child] |= 1 << rank[number]
    if all(count <= 1 for count in references.values()):
        return None
    work.step(len(graph))
    inside: dict[int, int] = {}
    entered: dict[int, int] = {}
    for number in reversed(graph):
        below = graph[number].parts
        inside[number] = 1 << rank[number] | union(inside[child] for child in below)
        entered[number] = union(entered[child] | parents[child] for child in below)
    for number, part in graph.items():
        if part.chooses and any(references[child] > 1 or entered[child] & ~inside[child] for child in part.parts):
            return number
    return None


# A graph whose choices can all wait, as tables: a step of the construction is a handful of operations on integers.


class Alternative(NamedTuple):
    """One child of a choice. `up` is the alternative that contains the choice, if any.

    `mandatory` comes with choosing it, `whole` is all that may; `first` are the events it can begin with, `silent` the
    smallest sets of guards with which it is complete without an event.
    """

    choice: int
    up: int | None
    mandatory: int
    whole: int
    first: int
    silent: tuple[int, ...]


class Choice(NamedTuple):
    """A choice: its alternatives, those of them that can be complete without an event, how many at least, and whether more may be taken."""

    mask: int
    silent: int
    least: int
    more: bool


class Moment(NamedTuple):
    """One occurrence: its atom, the guards on its variables, the alternative it is below, what comes before it and what after."""

    atom: int
    bound: int
    alternative: int | None
    before: int
    after: int


@dataclass(frozen=True)
class Plan:
    """The tables. Guards (the bits of their propositions), choices and events have one numbering, in this order."""

    start: int
    guards: int
    choices: Mapping[int, Choice]
    moments: Mapping[int, Moment]
    alternatives: tuple[Alternative, ...]

    @cached_property
    def choosing(self) -> int:
        """All choices."""
        return mask_of(self.choices)

    @cached_property
    def events(self) -> int:
        """All events."""
        return mask_of(self.moments)

    @cached_property
    def binders(self) -> Mapping[int, int]:
        """For each guard the events that bind one of its variables."""
        return {
            guard: mask_of(event for event, moment in self.moments.items() if moment.bound >> guard & 1)
            for guard in bits(self.guards)
        }


def plan(structure: Structure, graph: Graph, *, at_least: bool, work: Work) -> Plan:
    """Lay out a graph; raises `TooLarge` when a choice has too many ways to be made without an event."""
    propositions = len(structure.patterns) + len(structure.guards)
    choosing = [number for number, part in graph.items() if part.chooses]
    happening = [number for number, part in graph.items() if part.op is Op.EVENT]
    bit = {number: index for index, number in enumerate(choosing + happening, propositions)}
    whole: dict[int, int] = {}
    mandatory: dict[int, int] = {}
    first: dict[int, int] = {}
    silent: dict[int, tuple[int, ...]] = {}
    for number in reversed(graph):
        part = graph[number]
        own = 1 << bit[number] if number in bit else 0
        match part.op:
            case Op.EVENT:
                whole[number] = mandatory[number] = first[number] = own
                silent[number] = ()
            case Op.CONDITION:
                assert part.guard is not None
                whole[number] = mandatory[number] = guard = 1 << structure.guard_bits[part.guard]
                first[number], silent[number] = 0, (guard,)
            case Op.ALL | Op.SEQUENCE | Op.ONE | Op.AT_LEAST:
                whole[number] = own | union(whole[child] for child in part.parts)
                mandatory[number] = own or union(mandatory[child] for child in part.parts)
                silent[number] = _silent([silent[child] for child in part.parts], part, work)
                first[number] = 0
                for child in part.parts:
                    first[number] |= first[child]
                    if part.op is Op.SEQUENCE and not silent[child]:
                        break
            case _:
                assert_never(part.op)
    before, after = _around(graph, whole, backwards=False), _around(graph, whole, backwards=True)
    alternative_of: dict[int, int | None] = dict.fromkeys(graph, None)
    alternatives: list[Alternative] = []
    choices: dict[int, Choice] = {}
    for number, part in graph.items():
        start, up = len(alternatives), alternative_of[number]
        for child in part.parts:
            alternative_of[child] = len(alternatives) if part.chooses else up
            if part.chooses:
                known = (mandatory[child], whole[child], first[child], silent[child])
                alternatives.append(Alternative(bit[number], up, *known))
        if part.chooses:
            mask = mask_of(range(start, len(alternatives)))
            quiet = mask_of(one for one in bits(mask) if alternatives[one].silent)
            choices[bit[number]] = Choice(mask, quiet, part.need, at_least and part.op is Op.AT_LEAST)
    moments: dict[int, Moment] = {}
    for number in happening:
        atom = structure.atoms[graph[number].node]
        moments[bit[number]] = Moment(
            atom, structure.bound[atom], alternative_of[number], before[number], after[number]
        )
    guards = mask_of(structure.guard_bits.values())
    return Plan(mandatory[next(iter(graph))], guards, choices, moments, tuple(alternatives))


def _silent(ways: list[tuple[int, ...]], part: Part, work: Work) -> tuple[int, ...]:
    """The smallest sets of guards with which a part is complete without an event, given those of its parts."""
    able = [way for way in ways if way]
    need = part.need if part.chooses else len(ways)
    if part.chooses and need > 1:
        work.check(comb(len(able), need), "ways to decide choices by guards alone")
    found: set[int] = set()
    for chosen in combinations(able, need):
        together: tuple[int, ...] = (0,)
        for way in chosen:
            if way != (0,):
                together = smallest(one | other for one in together for other in way)
            work.check(len(together), "ways to decide choices by guards alone")
        found.update(together)
    return smallest(found)


def _around(graph: Graph, whole: Mapping[int, int], *, backwards: bool) -> dict[int, int]:
    """What sequences put before each part, or after it."""
    around = dict.fromkeys(graph, 0)
    for number, part in graph.items():
        outside = around[number]
        for child in reversed(part.parts) if backwards else part.parts:
            around[child] |= outside
            if part.op is Op.SEQUENCE:
                outside |= whole[child]
    return around


def smallest(sets: Iterable[int]) -> tuple[int, ...]:
    """The sets that contain no other of them, in a stable order.

    >>> smallest([0b110, 0b011, 0b010, 0b101])
    (2, 5)
    """
    kept: list[int] = []
    for one in sorted(set(sets), key=lambda mask: (mask.bit_count(), mask)):
        if not any(other & ~one == 0 for other in kept):
            kept.append(one)
    return tuple(kept)
