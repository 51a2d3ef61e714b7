"""Random trees to compare, reproducible from a seed."""

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import product
from random import Random
from typing import Final, TypeAlias

from cross_check.comparison import Comparison, Roster, raised
from cross_check.generate.trees import Shape, random_tree
from cross_check.results import Job, Result, Status
from cross_check.traces import Effort
from rvaft.analysis.branches import restrict
from rvaft.errors import TreeError
from rvaft.language.parser import parse_guard
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Scalar
from rvaft.rules import require_valid
from rvaft.support.processes import Killed, in_processes

# The trees of the run without arguments, built here so that an installed package has them.
#
# Every gate with one to four children and every threshold, each without and with an event of its own under both causalities; every
# ordered pair of gates nested once, and an order or a choice three gates deep; a node shared under each gate, also where a choice adds
# an order; two children with the same event, or that begin with the same event; one monitor per branch and per kind; a vote with more
# orders than can be written out; a guard in every place where one can be; and literals that only their type tells apart.

EFFORT: Final = Effort(words=200, traces=32, recheck=False)
"""Enough to notice every fault that the tests plant in translations and readers, and no more."""

LEAVES: Final = ("a", "b", "c", "d")
SEEN: Final = EventType("seen", ("what",), ObjectPattern((("event", Variable("what")),)))
AT: Final = EventType("at", ("place", "time"), ObjectPattern((("at", Variable("place")), ("time", Variable("time")))))
READ: Final = EventType("read", ("value",), ObjectPattern((("value", Variable("value")),)))
GUARDS: Final = {
    "a bound": "T > 3",
    "a bound that counts": "T >= 3",
    "a sum": "T >= S + 2",
    "an inequality": "Q != P",
    "a string": 'Q != "home"',
    "two conditions": "T > 1 and T <= 3",
    "a negation": "not (T == S or Q == P)",
    "a negated order": "not (T < 3)",
}
LITERALS: Final[tuple[Scalar, ...]] = (1, 1.0, "1", True)
"""The first two are equal."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A tree with a name, and the part of it to compare, if not all."""

    name: str
    tree: RVAFT
    branch: int | None = None
    kind: Kind | None = None


@dataclass(frozen=True, slots=True)
class GateOver:
    """A gate with a threshold, if it has one."""

    gate: Gate
    threshold: int | None = None

    def __str__(self) -> str:
        return str(self.gate) if self.threshold is None else f"{self.threshold}of"

    def node(self, name: str, children: Sequence[str], on: On | None = None) -> Node:
        """A node with this gate."""
        return Node(name, self.gate, tuple(children), self.threshold, on)


def gates(children: int) -> Iterator[GateOver]:
    """Every gate that can have so many children, VOT with every threshold."""
    for gate in Gate:
        if gate is Gate.VOT:
            yield from (GateOver(gate, k) for k in range(1, children + 1))
        else:
            yield GateOver(gate)


def catalogue() -> Iterator[Entry]:
    """All trees of the run without arguments: small ones first, and early those that tell most."""
    yield from _single(1, 2)
    yield from _valued()
    yield from _parts()
    yield from _same_event()
    yield from _alike()
    yield from _shared()
    yield from _deep()
    yield from _guarded()
    yield from _votes()
    yield from _nested()
    yield from _single(3, 4)


def _single(*counts: int) -> Iterator[Entry]:
    for count in counts:
        leaves = LEAVES[:count]
        for gate in gates(count):
            name = f"{gate}/{count}" if gate.threshold is None else f"{gate}{count}"
            yield Entry(name, RVAFT("r", [gate.node("r", leaves), *map(Node, leaves)]))
            for causality in Causality:
                # below another gate: what comes before and after the gate's own event has to show
                top = Node("t", Gate.SAND, ("r", "z"))
                own = gate.node("r", leaves, On("seen", (Literal("r"),)))
                nodes = [top, own, *map(Node, (*leaves, "z"))]
                yield Entry(f"{name} with its own event, {causality}", RVAFT("t", nodes, [SEEN], causality=causality))


def _same_event() -> Iterator[Entry]:
    """Two children that one event can serve, and a third; only one of them takes it."""
    on = On("seen", (Literal("e"),))
    for gate in gates(3):
        nodes = [gate.node("r", ("a", "b", "c")), Node("a", on=on), Node("b", on=on), Node("c")]
        yield Entry(f"{_named(gate, 3)}, two children with one event", RVAFT("r", nodes, [SEEN]))


def _alike() -> Iterator[Entry]:
    """Two children that begin with the same event and go on differently: whoever decides at that event decides too early."""
    on = On("seen", (Literal("e"),))
    for gate in gates(2):
        first, second = Node("p", Gate.SAND, ("a", "b")), Node("q", Gate.SAND, ("c", "d"))
        leaves = [Node("a", on=on), Node("b"), Node("c", on=on), Node("d")]
        nodes = [gate.node("r", ("p", "q")), first, second, *leaves]
        yield Entry(f"{_named(gate, 2)}, two children that begin alike", RVAFT("r", nodes, [SEEN]))


def _shared() -> Iterator[Entry]:
    """A node below two nodes; the gate joins them. The `or` leaves an ordered gate a feasible scenario."""
    for gate in gates(2):
        nodes = [
            gate.node("r", ("p", "q")),
            Node("p", Gate.OR, ("a", "s")),
            Node("q", Gate.SAND, ("b", "s")),
            *map(Node, ("a", "b", "s")),
        ]
        yield Entry(f"{_named(gate, 2)} over a shared node", RVAFT("r", nodes))

    for gate in (GateOver(Gate.AND), GateOver(Gate.VOT, 2)):
        nodes = [
            gate.node("r", ("o", "x", "s")),
            Node("o", Gate.OR, ("q", "c")),
            Node("q", Gate.SAND, ("x", "s")),
            *map(Node, ("c", "x", "s")),
        ]
        yield Entry(f"{_named(gate, 3)} with an order that a choice adds", RVAFT("r", nodes))


def _nested() -> Iterator[Entry]:
    for outer, inner in product(Gate, repeat=2):
        above = GateOver(outer, 2 if outer is Gate.VOT else None)
        below = GateOver(inner, 2 if inner is Gate.VOT else None)
        upper = ("a", "g", "d") if outer is Gate.VOT else ("g", "a")
        lower = ("b", "c", "e") if inner is Gate.VOT else ("b", "c")
        leaves = [name for name in (*upper, *lower) if name != "g"]
        nodes = [above.node("r", upper), below.node("g", lower), *map(Node, leaves)]
        yield Entry(f"{_named(above, len(upper))} over {_named(below, len(lower))}", RVAFT("r", nodes))


def _deep() -> Iterator[Entry]:
    """An order of, or a choice between, a gate and a leaf, below each gate."""
    for outer, middle in product(Gate, (Gate.SAND, Gate.OR)):
        gate = GateOver(outer, 2 if outer is Gate.VOT else None)
        upper = ("a", "s", "e") if outer is Gate.VOT else ("a", "s")
        leaves = [name for name in (*upper, "b", "c", "d") if name != "s"]
        nodes = [gate.node("r", upper), Node("s", middle, ("g", "d")), Node("g", Gate.AND, ("b", "c"))]
        yield Entry(f"{_named(gate, len(upper))} over {middle} over and", RVAFT("r", [*nodes, *map(Node, leaves)]))
    nodes = [Node("r", Gate.SAND, ("v", "y", "z")), GateOver(Gate.VOT, 1).node("v", ("a", "b"))]
    yield Entry("1of2 with two to follow", RVAFT("r", [*nodes, *map(Node, "abyz")]))


def _votes() -> Iterator[Entry]:
    """A vote over sequences and a leaf, with something after it: more orders than anybody writes out one by one."""
    pairs = ("ab", "cd", "ef")
    nodes = [
        Node("r", Gate.SAND, ("v", "z")),
        GateOver(Gate.VOT, 2).node("v", (*pairs, "g")),
        *(Node(pair, Gate.SAND, tuple(pair)) for pair in pairs),
        *map(Node, "abcdefgz"),
    ]
    yield Entry("2of4 over sequences", RVAFT("r", nodes))


def _parts() -> Iterator[Entry]:
    """Branches and kinds: events of other branches stay relevant."""
    nodes = [
        Node("r", Gate.OR, ("p", "q")),
        Node("p", Gate.SAND, ("a", "b")),
        Node("q", Gate.SAND, ("a", "t")),
        Node("t", Gate.OR, ("c", "d")),
        Node("a"),
        Node("b"),
        Node("c", kind=Kind.FAULT),
        Node("d", kind=Kind.ATTACK),
    ]
    tree = RVAFT("r", nodes)
    for number, _ in enumerate(tree.branches(), 1):
        yield Entry("branches", tree, branch=number)
    for kind in Kind:
        yield Entry("branches", tree, kind=kind)


def _valued() -> Iterator[Entry]:
    """A variable bound twice, guards on one event, `ignore`, literals."""
    own = Node("b", on=_on(READ, "V"), when=parse_guard("V > 2"))
    nodes = [Node("r", Gate.SAND, ("b", "c")), own, Node("c")]
    yield Entry("a guard that decides relevance", RVAFT("r", nodes, [READ]))
    nodes = [
        Node("r", Gate.SAND, ("a", "c", "b")),
        Node("a", on=_on(READ, "V")),
        Node("b", on=_on(READ, "W")),
        Node("c"),
    ]
    ignored = Ignore(On("read", (Variable("X"),)), parse_guard("X <= 2"))
    yield Entry("an `ignore` with a guard", RVAFT("r", nodes, [READ], ignores=[ignored]))
    nodes = [Node("r", Gate.SAND, ("a", "b")), _FIRST, Node("b", on=_on(READ, "P"))]
    yield Entry("a variable bound twice", RVAFT("r", nodes, [AT, READ]))
    for gate in (Gate.SAND, Gate.SAND_RL, Gate.AND):
        few = Node("b", on=_on(READ, "V"), when=parse_guard("V >= 0 and V <= 1"))  # so that 1, 1.0 and true meet
        nodes = [Node("r", gate, ("a", "b")), Node("a", on=_on(SEEN, "V")), few]
        yield Entry(f"{gate}, a variable bound twice", RVAFT("r", nodes, [SEEN, READ]))
    nodes = [
        Node("r", Gate.OR, ("p", "q")),
        Node("p", Gate.SAND, ("a", "b", "c", "d")),
        *(Node(name, on=On("read", (Literal(one),))) for name, one in zip("abcd", LITERALS, strict=True)),
        Node(
            "q", Gate.SAND, ("v", "w")
        ),  # the values of variables are never all tried, so what follows is tested, not proved
        Node("v", on=_on(AT, "P", "S")),
        Node("w", on=_on(AT, "P", "T")),
    ]
    yield Entry("literals of several types", RVAFT("r", nodes, [AT, READ]))


def _guarded() -> Iterator[Entry]:
    """Guards over two events: at their binder, on a gate, on a choice."""
    for name, guard in GUARDS.items():
        for gate in (Gate.SAND, Gate.AND):
            second = Node("b", on=_on(AT, "Q", "T"), when=parse_guard(guard))
            nodes = [Node("r", gate, ("a", "b")), _FIRST, second]
            yield Entry(f"{gate}, a guard with {name}", RVAFT("r", nodes, [AT]))
    late = parse_guard("T > S + 2")
    nodes = [Node("r", Gate.SAND, ("a", "b", "c"), when=late), _FIRST, Node("b", on=_on(AT, "Q", "T")), Node("c")]
    yield Entry("a guard on a gate", RVAFT("r", nodes, [AT]))
    high, low = (Node(name, when=parse_guard(when)) for name, when in (("h", "S >= 3"), ("l", "S < 3")))
    nodes = [
        Node("r", Gate.SAND, ("a", "o")),
        _FIRST,
        Node("o", Gate.OR, ("p", "q")),
        Node("p", Gate.AND, ("h", "c")),
        Node("q", Gate.AND, ("l", "d")),
        *(high, low, Node("c"), Node("d")),
    ]
    yield Entry("guards on choices", RVAFT("r", nodes, [AT]))


def _on(event: EventType, *variables: str) -> On:
    return On(event.name, tuple(map(Variable, variables)))


_FIRST: Final = Node("a", on=_on(AT, "P", "S"))


def _named(gate: GateOver, children: int) -> str:
    return str(gate) if gate.threshold is None else f"{gate}{children}"


MAX_NODES: Final = 9
_PARTS: Final = 0.2
"""How often one branch of a tree is compared instead of the whole."""


def campaign(number: int, seed: int, max_nodes: int = MAX_NODES) -> Iterator[Entry]:
    """So many trees of every shape; the i-th depends on the seed, the size and i alone."""
    shape = Shape(max_nodes=max_nodes)
    for index in range(1, number + 1):
        random = Random(f"{seed} {max_nodes} {index}")  # noqa: S311 (no secret)
        tree = random_tree(random, shape)
        branch = _feasible_branch(random, tree) if random.random() < _PARTS else None
        yield Entry(f"random {index} of seed {seed}", tree, branch)


def _feasible_branch(random: Random, tree: RVAFT) -> int | None:
    """The number of some branch that can be monitored by itself."""
    number = random.randint(1, sum(1 for _ in tree.branches()))
    try:
        require_valid(restrict(tree, branch=number))
    except TreeError:
        return None
    return number


# Many comparisons, one after the other or in several processes, always reported in the order they were given.


@dataclass(frozen=True, slots=True)
class Task:
    """One comparison to make: of what, by whom, how hard."""

    tree: RVAFT
    job: Job
    roster: Roster
    effort: Effort

    def run(self) -> list[Result]:
        """Compare; a tree that has no such part is a result too."""
        try:
            return Comparison(self.tree, self.job, self.effort).run(self.roster.candidates(self.tree, self.job))
        except Exception as error:  # noqa: BLE001 (whatever it is, the other comparisons go on)
            return [Result(self.job, "tree", Status.COULD_NOT_RUN, why=str(raised(error)))]


Done: TypeAlias = tuple[Task, list[Result]]
"""A comparison and what it has found."""


def run(tasks: Iterable[Task], *, jobs: int = 1) -> Generator[Done, None, None]:
    """The results of each comparison, in order; close the iterator to stop early."""
    if jobs == 1:
        yield from ((task, task.run()) for task in tasks)
        return
    with closing(in_processes(lambda task: task.run(), tasks, jobs=jobs)) as running:
        for task, found in running:
            killed = Result(task.job, "tree", Status.COULD_NOT_RUN, why="a process that compares was killed")
            yield task, [killed] if isinstance(found, Killed) else found
