"""Small random trees in which much happens at once: few letters, many ordered and threshold gates, much sharing.

Unlike `rvaft.random_trees` most of their events fit several occurrences, so that a few random
letters lead deep into a tree.
"""

from dataclasses import dataclass
from random import Random
from typing import Any, Final

from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft.engine import Engine
from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.guards import Duration, Guard, Operation, Operator, TimePoint
from rvaft.model.nodes import Causality, EventType, Gate, Kind, Node, On, Side, Without
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict

EVENTS: Final = (
    EventType("letter", ("l",), ObjectPattern((("l", Variable("l")),))),
    EventType("pair", ("l", "v"), ObjectPattern((("l", Variable("l")), ("v", Variable("v"))))),
    EventType(
        "triple", ("l", "v", "w"), ObjectPattern((("l", Variable("l")), ("v", Variable("v")), ("w", Variable("w"))))
    ),
)
LETTERS: Final = "abcdef"
VALUES: Final = (0, 1, 2, "x")
GUARDED: Final = (Operator.EQ, Operator.NE, Operator.LT, Operator.GE)


COMPARED: Final = (Operator.LE, Operator.LT, Operator.GE, Operator.GT, Operator.EQ)
SECOND: Final = 10**9
CHOOSING: Final = (Gate.OR, Gate.OR, Gate.VOT, Gate.VOT, Gate.AND, Gate.AND, Gate.SAND, Gate.SAND_RL)
LONG_ENDS: Final = (Gate.PAND, Gate.AND, Gate.AND, Gate.OR, Gate.VOT)
ENDING: Final = (Gate.PAND, Gate.PAND, Gate.PAND, Gate.OR, Gate.VOT, Gate.VOT, Gate.AND, Gate.SAND)


@dataclass(frozen=True, slots=True)
class Dense:
    """What the trees have; probabilities between 0 and 1, and how often each gate is drawn."""

    nodes: int = 9
    letters: int = 3
    sharing: float = 0.0
    shares_gate: bool = False
    """Whether a gate is the only shared node."""
    gate_events: float = 0.3
    variables: float = 0.0
    guards: float = 0.1
    gates: tuple[Gate, ...] = (Gate.OR, Gate.AND, Gate.SAND, Gate.SAND_RL, Gate.VOT, Gate.VOT, Gate.SAND)
    windows: float | None = None
    """The share of gates with a window; None for events without times."""
    points: float = 0.0
    """The share of nodes with a guard over time points."""
    absences: float = 0.0
    """The share of nodes with an absent event."""
    counted: float = 0.0
    """The share of leaves that count events with values of their own."""


def dense_tree(random: Random, shape: Dense) -> RVAFT:
    """A tree; it may break the rules about scenarios."""
    names = [f"n{index}" for index in range(shape.nodes)]
    children = _with_shared_gate(random, shape) if shape.shares_gate else _children(random, shape)
    nodes = []
    for index, name in enumerate(names):
        below = children.get(index, [])
        random.shuffle(below)
        nodes.append(_node(random, shape, name, tuple(names[child] for child in below), is_root=index == 0))
    time = None
    if shape.windows is not None:
        time = EventTime(("t",), TimeFormat.SECONDS, random.choice((None, None, 0, SECOND, 3 * SECOND)))
    return RVAFT("n0", nodes, EVENTS, causality=random.choice(list(Causality)), time=time)


def _children(random: Random, shape: Dense) -> dict[int, list[int]]:
    gates = random.randint(1, max(1, shape.nodes // 2))
    children: dict[int, list[int]] = {index: [] for index in range(gates)}
    for index in range(1, shape.nodes):
        above = list(range(min(index, gates)))
        children[random.choice(above)].append(index)
        for parent in above:
            if index not in children[parent] and random.random() < shape.sharing / len(above):
                children[parent].append(index)
    return children


def _with_shared_gate(random: Random, shape: Dense) -> dict[int, list[int]]:
    gates = random.randint(4, 5)
    children: dict[int, list[int]] = {0: [1, 2], 1: [2], **{index: [] for index in range(2, gates)}}
    for index in range(3, shape.nodes):
        below_shared = [*range(2, min(index, gates))] * 3
        children[random.choice([0, 1, *below_shared])].append(index)
    return children


def _node(random: Random, shape: Dense, name: str, below: tuple[str, ...], *, is_root: bool) -> Node:
    gate = random.choice(shape.gates) if below else None
    threshold = random.randint(1, len(below)) if gate is Gate.VOT else None
    has_event = random.random() < shape.gate_events and not is_root if below else random.random() < 0.85
    when = _guard(random, shape) if random.random() < shape.guards or not (below or has_event) else None
    kind = random.choice((None, None, Kind.FAULT, Kind.ATTACK))
    within = None
    if below and shape.windows is not None and random.random() < shape.windows:
        within = random.choice((0, 1, 1, 2, 2, 3, 5)) * SECOND
    if random.random() < shape.points:
        when = _time_guard(random, name, below, shape)
    if not below and shape.counted and random.random() < shape.counted:
        return _counted(random, shape, name)
    without = tuple(_absent(random, shape) for _ in range(2) if shape.absences and random.random() < shape.absences)
    on = _on(random, shape) if has_event else None
    return Node(name, gate, below, threshold, on, when, kind, within=within, without=without)


def _counted(random: Random, shape: Dense, name: str) -> Node:
    own = f"V{name}"
    letter, other = Literal(random.choice(LETTERS[: shape.letters])), random.choice((Variable("X"), Anything()))
    on = On("triple", (letter, Variable(own), other))
    than = random.choice((Literal(0), Literal(1), other if isinstance(other, Variable) else Literal(2)))
    when = Operation(random.choice(GUARDED), (Variable(own), than)) if random.random() < 0.4 else None
    times, distinct = random.choice((2, 2, 3)), random.random() < 0.7
    return Node(name, on=on, when=when, times=times, distinct=(own,) * distinct, each=(own,) * (not distinct))


def _absent(random: Random, shape: Dense) -> Without:
    letter, side = Literal(random.choice(LETTERS[: shape.letters])), random.choice(list(Side))
    timed = side is Side.AFTER or (side is Side.BEFORE and random.random() < 0.6)
    if timed and shape.windows is None:
        side, timed = Side.DURING, False
    duration = random.choice((0, 1, 1, 2, 3)) * SECOND if timed else None
    if random.random() >= shape.variables:
        return Without(On("letter", (letter,)), None, side, duration)
    value = random.choice((Variable("X"), Variable("Q"), Variable("Q"), Anything(), Literal(1)))
    when = None
    if value == Variable("Q") and random.random() < 0.7:
        than = random.choice((Literal(1), Variable("X"), Variable("Y")))
        when = Operation(random.choice(GUARDED), (value, than))
    return Without(On("pair", (letter, value)), when, side, duration)


def _time_guard(random: Random, name: str, below: tuple[str, ...], shape: Dense) -> Guard:
    near = [name, *below, *below, *below]
    names = [random.choice(near) if random.random() < 0.8 else f"n{random.randrange(shape.nodes)}" for _ in range(2)]
    points = [TimePoint.of(random.choice(("at", "start", "end", "start", "end")), one) for one in names]
    bound = Duration(random.randint(-1, 3) * SECOND)
    return Operation(random.choice(COMPARED), (Operation(Operator.SUB, tuple(points)), bound))


def _on(random: Random, shape: Dense) -> On:
    letter = Literal(random.choice(LETTERS[: shape.letters]))
    if random.random() >= shape.variables:
        return On("letter", (letter,))
    return On("pair", (letter, random.choice((Variable("X"), Variable("Y"), Variable("Z"), Anything(), Literal(1)))))


def _guard(random: Random, shape: Dense) -> Guard:
    if random.random() >= shape.variables:
        return Operation(Operator.EQ, (Literal(1), Literal(random.choice((1, 1, 1, 2)))))
    left = Variable(random.choice("XYZ"))
    right = random.choice((Variable("X"), Variable("Y"), Literal(1), Literal("x")))
    return Operation(random.choice(GUARDED), (left, right))


def dense_trace(random: Random, shape: Dense, length: int, *, clock: int = 0) -> list[dict[str, Any]]:
    """A trace over the letters of a shape; one of its events in twenty fits nothing.

    Times sometimes go back, and sometimes lack.
    """
    letters = [*(LETTERS[: shape.letters] * 7), "noise"]
    values, events = random.sample(VALUES, 2), list[dict[str, Any]]()
    for _ in range(length):
        event = {"l": random.choice(letters), "v": random.choice(values)}
        if shape.counted:
            event["w"] = random.choice(values)
        if shape.windows is not None:
            clock += random.choice((-2, -1, 0, 0, 1, 1, 1, 2))
            event |= {"t": clock} if random.random() < 0.96 else {}
        events.append(event)
    return events


SHAPES: Final = {
    "plain": Dense(),
    "few letters": Dense(letters=2, nodes=8),
    "many letters": Dense(letters=6, nodes=9, gate_events=0.2),
    "shared": Dense(sharing=0.5, letters=4, nodes=8),
    "heavily shared": Dense(sharing=1.5, letters=4, nodes=8, gate_events=0.15),
    "shared order": Dense(sharing=0.8, letters=5, nodes=9, gates=(Gate.OR, Gate.SAND, Gate.SAND_RL, Gate.OR, Gate.AND)),
    "shared thresholds": Dense(sharing=1.0, letters=5, nodes=9, gates=(Gate.VOT, Gate.OR, Gate.SAND, Gate.AND)),
    "shared without order": Dense(sharing=1.5, letters=5, nodes=10, gate_events=0, gates=(Gate.VOT, Gate.OR, Gate.AND)),
    "silent": Dense(guards=0.35, gate_events=0.15, letters=4),
    "variables": Dense(variables=0.7, guards=0.3, nodes=8),
    "choices of variables": Dense(
        letters=2, variables=0.6, guards=0, gate_events=0.15, gates=(Gate.OR, Gate.OR, Gate.AND, Gate.AND, Gate.SAND)
    ),
    "shared variables": Dense(variables=0.6, guards=0.3, sharing=0.6, nodes=8),
    "windows": Dense(windows=0.5, gates=CHOOSING),
    "small windows": Dense(windows=0.5, letters=3, nodes=6, guards=0, gates=CHOOSING),
    "windows and values": Dense(windows=0.5, variables=0.6, guards=0.2, nodes=8, gates=CHOOSING),
    "shared windows": Dense(windows=0.6, sharing=0.7, letters=4, nodes=8, gates=CHOOSING),
    "heavily shared windows": Dense(windows=0.6, sharing=1.5, letters=4, nodes=8, gates=CHOOSING),
    "ends": Dense(windows=0.1, nodes=8, letters=2, gates=ENDING),
    "many ends": Dense(windows=0.1, nodes=11, letters=3, guards=0, gate_events=0.1, gates=LONG_ENDS),
    "ends and values": Dense(windows=0.2, variables=0.5, nodes=8, gates=ENDING),
    "shared ends": Dense(windows=0.1, sharing=0.6, nodes=8, gates=ENDING),
    "shared gate": Dense(shares_gate=True, windows=0.1, nodes=8, letters=4, gate_events=0.1, guards=0.05, gates=ENDING),
    "different values": Dense(counted=0.5, variables=0.3, letters=2, nodes=5, guards=0, windows=0.2),
    "absent events": Dense(absences=0.2, guards=0, nodes=6, windows=0.1, gates=CHOOSING),
    "absent values": Dense(absences=0.25, variables=0.6, guards=0.05, nodes=5, letters=2, windows=0.1),
    "shared absences": Dense(absences=0.15, sharing=0.6, nodes=6, guards=0, windows=0.2, gates=CHOOSING),
    "absences and ends": Dense(absences=0.2, windows=0.1, guards=0, nodes=6, letters=2, gates=ENDING),
    "time points": Dense(windows=0.2, points=0.3, nodes=8, gates=(*CHOOSING, Gate.PAND)),
}


def living_trace(random: Random, tree: RVAFT, shape: str, semantics: str, length: int = 9) -> list[dict[str, Any]]:
    """A trace for a dense tree that avoids ⊥ for as long as it easily can, and ends with detection
    if it comes there.
    """
    trace: list[dict[str, Any]] = []
    monitor = Engine(tree, semantics)
    while len(trace) < length and not monitor.verdict.final:
        clock = max((event["t"] for event in trace if "t" in event), default=0)
        for _ in range(6):
            (event,) = dense_trace(random, SHAPES[shape], 1, clock=clock)
            ahead = monitor.fork()
            if ahead.step(event) is not Verdict.FALSE:
                break
        trace.append(event)
        monitor = ahead
    return trace


WILD: Final = {
    "any": Shape(),
    "shared trees": Shape(sharing=0.6, variables=0.3),
    "only variables": Shape(sharing=0.1, variables=1, typed_events=0.9, guards=0.5),
    "wide": Shape(max_nodes=13, max_children=6, typed_events=0.3),
}


def tree_of(random: Random, shape: str) -> RVAFT:
    """A random tree, dense or wild; it may break the rules about scenarios."""
    return dense_tree(random, SHAPES[shape]) if shape in SHAPES else random_tree(random, WILD[shape])


def trace_of(random: Random, tree: RVAFT, shape: str, semantics: str) -> list[dict[str, Any]]:
    """A trace that goes deep into the tree, and then goes on anyhow."""
    if shape in SHAPES:
        return [*living_trace(random, tree, shape, semantics, 6), *dense_trace(random, SHAPES[shape], 3)]
    return random_trace(random, tree)[:12]
