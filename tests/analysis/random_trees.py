"""Small random trees of every shape that the rules look at: shared nodes, all gates, guards, overlapping events."""

from random import Random

from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Argument, Causality, EventType, Gate, Node, On
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT

_EVENTS = (
    EventType("one", ("x",), ObjectPattern((("kind", Literal("one")), ("value", Variable("x"))))),
    EventType("two", ("x", "y"), ObjectPattern((("value", Variable("x")), ("other", ListPattern((Variable("y"),)))))),
    EventType(
        "three", ("x",), ObjectPattern((("kind", Variable("x")), ("inner", ObjectPattern((("b", Variable("x")),)))))
    ),
    EventType("four", (), ObjectPattern((("kind", Literal("four")), ("inner", ObjectPattern((("a", Literal(1)),)))))),
)
_VALUES = (1, 2, "a", "one", True)


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
    arguments: list[Argument] = [Variable("X"), Variable("Y"), Anything(), Literal(random.choice(_VALUES))]
    return random.choice(arguments)


def _guard(random: Random, constants: float) -> Guard:
    if random.random() < constants:
        return Operation(random.choice([Operator.LT, Operator.GT]), (Literal(1), Literal(2)))
    sides: list[Guard] = [Variable("X"), Variable("Y"), Literal(random.choice(_VALUES))]
    comparison = Operation(
        random.choice([Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE]),
        (Variable(random.choice("XYZ")), random.choice(sides)),
    )
    match random.randrange(4):
        case 0:
            return Operation(Operator.NOT, (comparison,))
        case 1 if constants:
            return Operation(Operator.OR, (comparison, _guard(random, 0)))
        case _:
            return comparison
