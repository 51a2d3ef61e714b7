"""Small trees: random ones of every shape that the rules look at, and all there are of a few nodes."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product
from random import Random

from rvaft import RVAFT, Causality, EventType, Gate, Node, On
from rvaft.core.build import build
from rvaft.core.property import EndInOrder, Times
from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.guards import POINTS, Duration, Guard, Operation, Operator, TimePoint
from rvaft.model.nodes import Argument
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Variable

_EVENTS = (
    EventType("one", ("x",), ObjectPattern((("kind", Literal("one")), ("value", Variable("x"))))),
    EventType("two", ("x", "y"), ObjectPattern((("value", Variable("x")), ("other", ListPattern((Variable("y"),)))))),
    EventType(
        "three", ("x",), ObjectPattern((("kind", Variable("x")), ("inner", ObjectPattern((("b", Variable("x")),)))))
    ),
    EventType("four", (), ObjectPattern((("kind", Literal("four")), ("inner", ObjectPattern((("a", Literal(1)),)))))),
)
_VALUES = (1, 2, "a", "one", True)
_SIGNS = (Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE)


def is_plain(tree: RVAFT) -> bool:
    """Whether a tree has no counted leaf, no order of ends and no condition on time."""
    prop = build(tree)
    return not prop.timed and not any(isinstance(part, Times | EndInOrder) for part in prop.parts)


def random_tree(random: Random, *, guards: float = 0.3, constants: float = 0.2) -> RVAFT:
    """A tree of two to nine nodes, many of them shared."""
    size = random.randint(2, 9)
    names = [f"n{index}" for index in range(size)]
    gates = {0} | {index for index in range(1, size - 1) if random.random() < 0.55}
    below: dict[int, list[int]] = {index: [] for index in gates}
    for index in range(1, size):
        below[random.choice([gate for gate in gates if gate < index])].append(index)
    for index in gates:
        for other in range(index + 1, size):
            if other not in below[index] and random.random() < 0.2:
                below[index].append(other)
    nodes = []
    for index, name in enumerate(names):
        children = tuple(names[child] for child in random.sample(below.get(index, []), len(below.get(index, []))))
        gate = random.choice([Gate.OR, Gate.OR, *Gate]) if children else None
        threshold = random.randint(1, len(children)) if gate is Gate.VOT else None
        on = _on(random) if random.random() < (0.2 if children else 0.6) else None
        when = _guard(random, constants) if random.random() < guards else None
        nodes.append(Node(name, gate, children, threshold, on, when))
    return RVAFT(names[0], nodes, _EVENTS, causality=random.choice(list(Causality)))


def _on(random: Random) -> On:
    event = random.choice(_EVENTS)
    return On(event.name, tuple(_argument(random) for _ in event.parameters))


def _argument(random: Random) -> Argument:
    return random.choice((Variable("X"), Variable("Y"), Anything(), Literal(random.choice(_VALUES))))


def _guard(random: Random, constants: float) -> Guard:
    if random.random() < constants:
        return Operation(random.choice([Operator.LT, Operator.GT]), (Literal(1), Literal(2)))
    sides: list[Guard] = [Variable("X"), Variable("Y"), Literal(random.choice(_VALUES))]
    comparison = Operation(random.choice(_SIGNS), (Variable(random.choice("XYZ")), random.choice(sides)))
    match random.randrange(4):
        case 0:
            return Operation(Operator.NOT, (comparison,))
        case 1 if constants:
            return Operation(Operator.OR, (comparison, _guard(random, 0)))
        case _:
            return comparison


def with_times(random: Random, tree: RVAFT) -> RVAFT:
    """The tree with counted leaves, windows, and guards on times, some of nodes without events."""

    def point() -> Guard:
        return TimePoint.of(random.choice(POINTS), random.choice(tree.order))

    nodes = []
    for node in tree.nodes.values():
        times = 2 if node.leaf and node.has_event and random.random() < 0.2 else 1
        within = random.randint(0, 3) if not node.leaf and random.random() < 0.3 else None
        later = Operation(Operator.ADD, (point(), Duration(random.randint(0, 3))))
        asked = Operation(random.choice(_SIGNS), (point(), random.choice((point(), later))))
        when = asked if node.has_event and random.random() < 0.2 else node.when
        on = node.on or (On("four", ()) if node.has_event else None)
        nodes.append(replace(node, times=times, within=within, on=on, when=when))
    time = EventTime(("t",), TimeFormat.NANOSECONDS)
    return RVAFT(tree.root, nodes, tree.events.values(), causality=tree.causality, time=time)


_E = EventType("e", ("n",), ObjectPattern((("event", Variable("n")),)))
_FALSE: Guard = Operation(Operator.LT, (Literal(2), Literal(1)))
_OPEN: Guard = Operation(Operator.LT, (Variable("X"), Literal(1)))


def small_trees(size: int) -> Iterator[RVAFT]:
    """Every tree of so many nodes where a child comes after its parents (but for names); of guards
    and events every kind in turn.
    """
    turn = 0
    later = [
        [chosen for count in range(size - own) for chosen in permutations(range(own + 1, size), count)]
        for own in range(size)
    ]
    for below in product(*later):
        reached = {0}
        for own in range(size):
            if own in reached:
                reached.update(below[own])
        if len(reached) < size:
            continue
        ways = [_gates(len(children)) if children else [(None, None)] for children in below]
        for joined in product(*ways):
            turn += 1
            nodes = [
                _node(own, gate, children, threshold, turn * 7 + own * 3)
                for own, ((gate, threshold), children) in enumerate(zip(joined, below, strict=True))
            ]
            yield RVAFT("n0", nodes, [_E], causality=list(Causality)[turn % 2])


def _gates(children: int) -> list[tuple[Gate | None, int | None]]:
    return [(gate, need) for gate in Gate for need in (range(1, children + 1) if gate is Gate.VOT else (None,))]


def _node(own: int, gate: Gate | None, children: tuple[int, ...], threshold: int | None, turn: int) -> Node:
    has_event = turn % 5 in (0, 1) or (gate is None and turn % 5 in (2, 3))
    when = {0: _FALSE, 3: _OPEN, 6: _OPEN}.get(turn % 11)
    on = On("e", (Literal(f"n{own}"),)) if has_event else None
    return Node(f"n{own}", gate, tuple(f"n{child}" for child in children), threshold, on, when)
