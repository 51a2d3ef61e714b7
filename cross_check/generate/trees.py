"""Random valid trees, reproducible from a seed.

They cover all gates, shared nodes, events on gates, overlapping patterns, both causalities,
variables, guards with values of wrong types, `ignore`, kinds and topics. Some also get times,
windows, conditions on time, counted leaves, `pand`, functions, a semantics, types and assumptions.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from random import Random
from typing import Any, Final

from cross_check.generate.times import FORMATS
from rvaft.errors import TreeError
from rvaft.model import guards
from rvaft.model.assumptions import places
from rvaft.model.event_time import EventTime
from rvaft.model.guards import OPERATORS, Duration, Guard, Operation, Operator, TermSort, TimePoint
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import (
    Argument,
    Assumption,
    Causality,
    EventType,
    Gate,
    Ignore,
    Kind,
    Node,
    On,
    Side,
    Topic,
    ValueType,
    Without,
)
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.rules.validity import loads, require_valid

DECLARED: Final = loads("""
n0;
event px(p) = { x: p };
event py(p) = { y: p };
event pxy(p, q) = { x: p, y: q };
event same(p) = { x: p, y: p };
event nested(p, q) = { n: { l: [p, _], x: q } };
event kx(p) = { k: "kx", x: p };
event ky(p, q) = { k: "ky", x: p, y: q };
topic "/command" type "robot_msgs.msg.Command" from agent;
topic "sensor/0" type "std_msgs.msg.Float32";
topic "/goal" type "move_base_msgs.msg.MoveBaseActionGoal" from "/ns/planner", "topic";
""")
EVENTS: Final = (*DECLARED.events.values(),)
TOPICS: Final = (*DECLARED.topics.values(),)
LITERALS: Final = (0, 1, 2, "a", True, None, 1.5)
VARIABLES: Final = ("X", "Y", "Z")
COMPARISONS: Final = tuple(operator for operator in OPERATORS if operator in guards.COMPARISONS)
_CALCULATIONS: Final = tuple(one for one in OPERATORS if one in guards.ARITHMETIC)
_FUNCTIONS: Final = tuple(one for one in OPERATORS if one in guards.FUNCTIONS or one is Operator.IN)
_OPERANDS: Final[Mapping[TermSort, Sequence[Json]]] = {
    TermSort.TEXT: ("a", "A", "ab", "", "a*", "?", "*a?"),
    TermSort.NUMBER: (0, 1, 2, 1.5),
    TermSort.TRUTH: (True, False),
}
"""Constants beside a variable of this sort; a text may be a glob."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The probabilities of constructs, and sizes."""

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
    times: float = 0.25
    """The tree has times, with windows and other conditions on them, sometimes `late`."""
    counted: float = 0.06
    """A leaf is counted."""
    pand: float = 0.2
    """A `sand` or `and` becomes a `pand`."""
    functions: float = 0.3
    """A guard on variables gets a function."""
    assumptions: float = 0.15
    """Parameters have types, and the tree states assumptions."""
    absences: float = 0.1
    """Some nodes have absent events."""
    lists: float = 0.1
    """Event types look for some item of a list."""


PLAIN: Final = Shape(**{part.name: 0 for part in fields(Shape) if isinstance(part.default, float)})
"""Trees over default events, without sharing."""

VARIABLE_FREE: Final = Shape(variables=0, times=0, lists=0, absences=0)
"""Everything except variables, times and absent events; guards are constant."""


def random_tree(random: Random, shape: Shape = Shape(), *, attempts: int = 200) -> RVAFT:
    """Return a valid random tree; each failed attempt reduces guards."""
    for attempt in range(attempts):
        guards = shape.guards * (1 - attempt / attempts)
        with suppress(TreeError):
            tree = _Growth(random, shape, guards).tree()
            require_valid(tree)
            return _in_practice(random, tree, shape)
    return RVAFT("n0", [Node("n0", Gate("and"), ("n1",)), Node("n1")])


class _Growth:
    def __init__(self, random: Random, shape: Shape, guards: float) -> None:
        self.random = random
        self.shape = shape
        self.guards = guards
        self.with_variables = random.random() < shape.variables
        self.nodes: list[Node] = []
        self.waiting: list[str] = []

    def tree(self) -> RVAFT:
        """Return a tree grown from the root; with `sharing`, gates may share children."""
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
        apart = _apart(self.random)
        lists = apart.random() < self.shape.lists
        events = [
            replace(event, pattern=_with_lists(apart, event.pattern)) if lists else event
            for event in EVENTS
            if event.name in used
        ]
        return RVAFT("n0", self.nodes, events, ignores=ignores, topics=self._topics(), causality=causality)

    def _topics(self) -> list[Topic]:
        apart = _apart(self.random)
        return apart.sample(TOPICS, apart.randint(1, len(TOPICS))) if apart.random() < self.shape.topics else []

    def _node(self, name: str, index: int, size: int) -> Node:
        r = self.random
        kind = r.choice(list(Kind)) if r.random() < self.shape.kinds else None
        room = size - self.count
        if index == 0 or (room > 0 and r.random() < 0.5):
            children = self._children(index, max(room, 1))
            gate = r.choice([gate for gate in Gate if gate != "pand"])
            threshold = r.randint(1, len(children)) if gate.counts else None
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
        own = on.variables if on else ()
        names = own if own and self.random.random() < 0.5 else VARIABLES
        return self._comparison(names if self.with_variables else ())

    def _comparison(self, names: Sequence[str]) -> Guard:
        r = self.random
        left: Guard = Variable(r.choice(names)) if names else Literal(r.choice(LITERALS))
        right: Guard = Variable(r.choice(names)) if names and r.random() < 0.4 else Literal(r.choice(LITERALS))
        if r.random() < 0.2:
            operator = r.choice(_CALCULATIONS)
            left = Operation(operator, (left, Literal(2))[: OPERATORS[operator].arity])
        guard: Guard = Operation(r.choice(COMPARISONS), (left, right))
        if r.random() < 0.2:
            guard = Operation(Operator.NOT, (guard,))
        if r.random() < 0.2:
            guard = Operation(r.choice((Operator.AND, Operator.OR)), (guard, self._comparison(names)))
        return guard

    def _ignore(self) -> Ignore:
        event = self.random.choice(EVENTS)
        names = VARIABLES[: len(event.parameters)]
        on = On(event.name, tuple(map(Variable, names)))
        return Ignore(on, self._comparison(names) if self.random.random() < 0.8 else None)


def _with_lists(random: Random, pattern: Pattern) -> Pattern:
    """Return a pattern of a list in place of some values and objects."""
    if isinstance(pattern, ObjectPattern):
        pattern = ObjectPattern(tuple((name, _with_lists(random, inner)) for name, inner in pattern.fields))
        return ObjectPattern((("x", SomeItem(pattern)),)) if random.random() < 0.4 else pattern
    return SomeItem(pattern) if isinstance(pattern, Variable) and random.random() < 0.4 else pattern


# Additions for real logs, drawn separately from the tree.

_TYPED: Final[tuple[tuple[ValueType, tuple[Json, ...]], ...]] = (
    (ValueType.TEXT, ("a", "A", "ab")),
    (ValueType.INTEGER, (0, 1, 2)),
    (ValueType.NUMBER, (0, 1, 1.5)),
    (ValueType.BOOLEAN, (True, False)),
)
_ASSUMED: Final = (Assumption.PRESENT, Assumption.CASE, Assumption.EXACT)
_DURATIONS: Final = (0, 1, 1_000_000, 1_000_000_000, 2_000_000_000, 5_000_000_000, 90_000_000_000)
_FIELDS: Final = (("t",), ("t",), ("header", "stamp"), ("x",), ("@timestamp",))
_SIMPLER: Final = 6
"""Number of attempts to add constructs, fewer constructs each time."""


def _apart(random: Random) -> Random:
    apart = Random()  # noqa: S311 (no secret)
    apart.setstate(random.getstate())
    return apart


def _in_practice(random: Random, tree: RVAFT, shape: Shape) -> RVAFT:
    apart = _apart(random)
    for attempt in range(_SIMPLER):
        with suppress(TreeError):
            found = _Additions(apart, tree, shape, 1 - attempt / _SIMPLER).tree()
            require_valid(found)
            return _assuming(apart, found) if apart.random() < shape.assumptions else found
    return tree


def _types(event: EventType, type_: ValueType) -> tuple[ValueType, ...]:
    """Return the type for each parameter that does not stand inside of lists of some item alone."""
    outside = {part.name for _, part, _ in places(event.pattern) if isinstance(part, Variable)}
    return tuple(type_ if name in outside else ValueType.ANY for name in event.parameters)


def _assuming(random: Random, tree: RVAFT) -> RVAFT:
    """Return the tree with types and assumptions, and literals of the type; itself if it is then not
    valid.
    """
    type_, literals = random.choice(_TYPED)
    assumes = {Assumption.TYPES, *(one for one in _ASSUMED if random.random() < 0.7)}

    def typed(guard: Guard) -> Guard:
        match guard:
            case Literal() if not isinstance(guard, Duration) and guard.value not in literals:
                return Literal(random.choice(literals))
            case Operation(Operator.LIKE, (text, glob)):
                return Operation(Operator.LIKE, (typed(text), glob))
            case Operation(operator, operands):
                return Operation(operator, tuple(map(typed, operands)))
            case _:
                return guard

    def called(on: On | None) -> On | None:
        if on is None:
            return None
        choose = lambda one: Literal(random.choice(literals)) if isinstance(one, Literal) else one  # noqa: E731
        return On(on.event, tuple(map(choose, on.arguments)))

    nodes = [
        replace(node, on=called(node.on), when=None if node.when is None else typed(node.when))
        for node in tree.nodes.values()
    ]
    events = [replace(event, types=_types(event, type_)) for event in tree.events.values()]
    with suppress(TreeError):
        found = tree.changed(nodes=nodes, events=events, assumes=frozenset(assumes))
        require_valid(found)
        return found
    return tree


class _Additions:
    """One attempt; `share` scales the probabilities."""

    def __init__(self, random: Random, tree: RVAFT, shape: Shape, share: float) -> None:
        self.random = random
        self.old = tree
        self.shape = shape
        self.share = share
        self.timed = self._so(shape.times)

    def _so(self, probability: float) -> bool:
        return self.random.random() < probability * self.share

    def tree(self) -> RVAFT:
        r, old = self.random, self.old
        nodes = [self._node(node) for node in old.nodes.values()]
        apart = _apart(r)
        if apart.random() < self.shape.absences * self.share:
            for place in apart.sample(range(len(nodes)), min(2, len(nodes))):
                nodes[place] = replace(nodes[place], without=(self._absent(apart),))
        if not self.timed and nodes == [*old.nodes.values()]:
            return old
        late = r.choice(_DURATIONS) if self._so(0.3) else None
        time = EventTime(r.choice(_FIELDS), r.choice(FORMATS), late) if self.timed else None
        meant = r.choice(list(Semantics)) if self._so(0.1) else None
        return old.changed(nodes=nodes, time=time, semantics=meant)

    def _node(self, node: Node) -> Node:
        r = self.random
        changes: dict[str, Any] = {}
        if node.gate in ("sand", "and") and self._so(self.shape.pand):
            changes["gate"] = Gate("pand")
        if node.leaf and node.has_event and self._so(self.shape.counted):
            changes["times"] = r.choice((2, 2, 3))
            changes |= self._own_values(node)
        if node.gate is not None and self.timed and self._so(0.4):
            changes["within"] = r.choice(_DURATIONS)
        guards: list[Guard] = []
        if node.on is not None and node.on.variables and self._so(self.shape.functions):
            guards.append(self._function(Variable(r.choice(node.on.variables))))
        if self.timed and (node.has_event or node.gate is not None) and self._so(0.25):
            guards.append(self._condition())
        if guards:
            guards[:0] = [] if node.when is None else [node.when]
            changes["when"] = guards[0] if len(guards) == 1 else Operation(r.choice(_JUNCTIONS), tuple(guards))
        return replace(node, **changes)

    def _own_values(self, node: Node) -> dict[str, tuple[str, ...]]:
        """Return variables with a value of their own in each counted event, sometimes."""
        apart, others = _apart(self.random), [one for one in self.old.nodes.values() if one is not node]
        used = {name for one in others for name in (one.on.variables if one.on is not None else ())}
        used |= {name for one in others for name in guard_variables(one.when)}
        free = [name for name in (node.on.variables if node.on is not None else ()) if name not in used]
        if not free or apart.random() < 0.4:
            return {}
        return {apart.choice(("distinct", "distinct", "each")): (free[0],)}

    def _absent(self, r: Random) -> Without:
        """Return an absent event, often one that the tree observes, with variables of its own or of the tree."""
        event = r.choice([*self.old.events.values()] or EVENTS)
        names = (*VARIABLES, "Q", "Q", "Q")
        arguments: list[Argument] = [
            r.choice((Variable(r.choice(names)), Anything(), Literal(r.choice(LITERALS)))) for _ in event.parameters
        ]
        on = On(event.name, tuple(arguments))
        side = r.choice([*Side]) if self.timed else r.choice((Side.DURING, Side.BEFORE))
        timed = side is Side.AFTER or (self.timed and side is Side.BEFORE and r.random() < 0.5)
        when = None
        if "Q" in on.variables and r.random() < 0.5:
            when = Operation(r.choice(COMPARISONS), (Variable("Q"), Literal(r.choice(LITERALS))))
        return Without(on, when, side, r.choice(_DURATIONS) if timed else None)

    def _condition(self) -> Guard:
        r, nodes = self.random, self.old.nodes
        left, right = (
            TimePoint.of(r.choice(("at", "at", "start", "end") if nodes[name].has_event else ("start", "end")), name)
            for name in (r.choice([*nodes]), r.choice([*nodes]))
        )
        by = Duration(r.choice(_DURATIONS))
        shapes: list[tuple[Guard, Guard]] = [
            (Operation(Operator.SUB, (left, right)), by),
            (left, Operation(Operator.ADD, (right, by))),
            (left, right),
        ]
        guard: Guard = Operation(r.choice(COMPARISONS), r.choice(shapes))
        return Operation(Operator.NOT, (guard,)) if r.random() < 0.2 else guard

    def _function(self, variable: Variable) -> Guard:
        r, operator = self.random, self.random.choice(_FUNCTIONS)
        facts = OPERATORS[operator]
        others = r.choice((1, 2)) if facts.arity is None else facts.arity - 1
        sorts = [sort for sort in _OPERANDS if facts.takes is not None and sort in facts.takes]
        operands = [r.choice(_OPERANDS[r.choice(sorts)] if sorts else LITERALS) for _ in range(others)]
        guard = Operation(operator, (variable, *map(Literal, operands)))
        if facts.gives is not TermSort.TRUTH:
            guard = Operation(r.choice(COMPARISONS), (guard, Literal(r.choice(_OPERANDS[facts.gives]))))
        return Operation(Operator.NOT, (guard,)) if r.random() < 0.2 else guard


_JUNCTIONS: Final = (Operator.AND, Operator.AND, Operator.OR)
