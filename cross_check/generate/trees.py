"""Random trees of every shape, reproducible from a seed.

Shapes: all gates, shared nodes, events on gates, overlapping patterns, both causalities, variables, guards on events, gates and
choices (wrong types among their values), `ignore`, kinds, topics. Every tree that comes out keeps the rules of `rvaft check`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Final

from rvaft.errors import TreeError
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Argument, Causality, EventType, Gate, Ignore, Kind, Node, On, Topic
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.rules import require_valid

P, Q = Variable("p"), Variable("q")
EVENTS: Final = (
    EventType("px", ("p",), ObjectPattern((("x", P),))),
    EventType("py", ("p",), ObjectPattern((("y", P),))),
    EventType("pxy", ("p", "q"), ObjectPattern((("x", P), ("y", Q)))),
    EventType("same", ("p",), ObjectPattern((("x", P), ("y", P)))),
    EventType(
        "nested", ("p", "q"), ObjectPattern((("n", ObjectPattern((("l", ListPattern((P, Anything()))), ("x", Q)))),))
    ),
    EventType("kx", ("p",), ObjectPattern((("k", Literal("kx")), ("x", P)))),
    EventType("ky", ("p", "q"), ObjectPattern((("k", Literal("ky")), ("x", P), ("y", Q)))),
)
TOPICS: Final = (
    Topic("/command", "robot_msgs.msg.Command", ("agent",)),
    Topic("sensor/0", "std_msgs.msg.Float32"),
    Topic("/goal", "move_base_msgs.msg.MoveBaseActionGoal", ("/ns/planner", "topic")),
)
LITERALS: Final = (0, 1, 2, "a", True, None, 1.5)
VARIABLES: Final = ("X", "Y", "Z")
COMPARISONS: Final = (Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE)


@dataclass(frozen=True, slots=True)
class Shape:
    """What the trees may have; probabilities between 0 and 1."""

    max_nodes: int = 9
    max_children: int = 4
    sharing: float = 0.25
    gate_events: float = 0.25
    typed_events: float = 0.5
    variables: float = 0.5
    guards: float = 0.25
    ignores: float = 0.2
    kinds: float = 0.2
    topics: float = 0.2


PLAIN: Final = Shape(sharing=0, gate_events=0, typed_events=0, variables=0, guards=0, ignores=0, kinds=0, topics=0)
"""Trees over default events only, without sharing."""

VARIABLE_FREE: Final = Shape(variables=0)
"""Everything but variables; guards are constant."""


def random_tree(random: Random, shape: Shape = Shape(), *, attempts: int = 200) -> RVAFT:
    """A valid random tree; the more attempts fail, the simpler the next one is."""
    for attempt in range(attempts):
        guards = shape.guards * (1 - attempt / attempts)
        try:
            tree = _Growth(random, shape, guards).tree()
            require_valid(tree)
        except TreeError:
            continue
        return tree
    return RVAFT("n0", [Node("n0", Gate.AND, ("n1",)), Node("n1")])


class _Growth:
    """One attempt."""

    def __init__(self, random: Random, shape: Shape, guards: float) -> None:
        self.random = random
        self.shape = shape
        self.guards = guards
        self.with_variables = random.random() < shape.variables
        self.nodes: list[Node] = []
        self.waiting: list[str] = []

    def tree(self) -> RVAFT:
        """Grow from the root; a child is a new node or, under `sharing`, one that still waits to be grown."""
        size = self.random.randint(2, self.shape.max_nodes)
        self.count = 1
        self.waiting = ["n0"]
        grown = 0
        while grown < len(self.waiting):
            self.nodes.append(self._node(self.waiting[grown], grown, size))
            grown += 1
        ignores = [self._ignore()] if self.random.random() < self.shape.ignores else []
        causality = self.random.choice(list(Causality))
        used = {node.on.event for node in self.nodes if node.on} | {ignore.on.event for ignore in ignores}
        events = [event for event in EVENTS if event.name in used]
        return RVAFT("n0", self.nodes, events, ignores=ignores, topics=self._topics(), causality=causality)

    def _topics(self) -> list[Topic]:
        """Some topics, drawn apart: since nothing depends on them, what is drawn afterwards must not either."""
        apart = Random()  # noqa: S311 (no secret)
        apart.setstate(self.random.getstate())
        return apart.sample(TOPICS, apart.randint(1, len(TOPICS))) if apart.random() < self.shape.topics else []

    def _node(self, name: str, index: int, size: int) -> Node:
        r = self.random
        kind = r.choice(list(Kind)) if r.random() < self.shape.kinds else None
        room = size - self.count
        if index == 0 or (room > 0 and r.random() < 0.5):
            children = self._children(index, max(room, 1))
            gate = r.choice(list(Gate))
            threshold = r.randint(1, len(children)) if gate is Gate.VOT else None
            on = self._on() if index and r.random() < self.shape.gate_events else None
            return Node(name, gate, children, threshold, on, self._guard(on), kind)
        on = self._on() if r.random() < self.shape.typed_events else None
        when = self._guard(on) if on is not None or r.random() < 0.5 else None
        return Node(name, on=on, when=when, kind=kind)

    def _children(self, index: int, room: int) -> tuple[str, ...]:
        wanted = self.random.randint(1, self.shape.max_children)
        children: list[str] = []
        for _ in range(wanted):
            old = [name for name in self.waiting[index + 1 :] if name not in children]
            if old and self.random.random() < self.shape.sharing:
                children.append(self.random.choice(old))
            elif room > 0:
                room -= 1
                children.append(f"n{self.count}")
                self.waiting.append(children[-1])
                self.count += 1
        if not children:
            return self._children(index, 1)
        return tuple(children)

    def _on(self) -> On:
        event = self.random.choice(EVENTS)
        return On(event.name, tuple(self._argument() for _ in event.parameters))

    def _argument(self) -> Argument:
        r = self.random
        if self.with_variables and r.random() < 0.6:
            return Variable(r.choice(VARIABLES))
        return Anything() if r.random() < 0.3 else Literal(r.choice(LITERALS))

    def _guard(self, on: On | None) -> Guard | None:
        if self.random.random() >= self.guards:
            return None
        own = [a.name for a in on.arguments if isinstance(a, Variable)] if on else []
        names = own if own and self.random.random() < 0.5 else VARIABLES
        return self._comparison(names if self.with_variables else ())

    def _comparison(self, names: Sequence[str]) -> Guard:
        r = self.random
        left: Guard = Variable(r.choice(names)) if names else Literal(r.choice(LITERALS))
        right: Guard = Variable(r.choice(names)) if names and r.random() < 0.4 else Literal(r.choice(LITERALS))
        if r.random() < 0.2:
            left = Operation(r.choice((Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV)), (left, Literal(2)))
        guard: Guard = Operation(r.choice(COMPARISONS), (left, right))
        if r.random() < 0.2:
            guard = Operation(Operator.NOT, (guard,))
        if r.random() < 0.2:
            guard = Operation(r.choice((Operator.AND, Operator.OR)), (guard, self._comparison(names)))
        return guard

    def _ignore(self) -> Ignore:
        event = self.random.choice(EVENTS)
        arguments = tuple(Variable(name) for name in VARIABLES[: len(event.parameters)])
        names = [argument.name for argument in arguments]
        return Ignore(On(event.name, arguments), self._comparison(names) if self.random.random() < 0.8 else None)
