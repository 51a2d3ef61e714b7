"""Trees of every text, whether they keep the rules about scenarios or not: odd names, deep patterns, all guards."""

from typing import Any

from hypothesis import strategies as st

from rvaft import RVAFT, Causality, EventType, Gate, Ignore, Kind, Node, On, Semantics, Topic
from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.guards import (
    COMPARISONS,
    JUNCTIONS,
    OPERATORS,
    POINTS,
    Duration,
    Guard,
    Operation,
    Operator,
    TimePoint,
    substitute,
    time_points,
)
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable

WORDS = [
    "",
    "a b",
    *[
        "a",
        "b",
        "on",
        "or",
        "vot2",
        "spare",
        "times",
        "within",
        "time",
        "as",
        "at",
        "pand",
        "event",
        "topic",
        "type",
        "_",
        "_x",
        "A1",
        "true",
        "lambda",
        "2of3",
        "é",
    ],
    'q"',
]
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=6)
names = st.sampled_from(WORDS) | texts
numbers = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
literals = st.builds(Literal, st.none() | st.booleans() | numbers | texts)
variables = st.sampled_from(["X", "Y1", "Value_2"]).map(Variable)


def patterns(leaves: st.SearchStrategy[Any]) -> st.SearchStrategy[Pattern]:
    return st.recursive(
        leaves,
        lambda inner: (
            st.lists(inner, max_size=3).map(lambda items: ListPattern(tuple(items)))
            | inner.map(SomeItem)
            | st.dictionaries(names, inner, max_size=3).map(lambda fields: ObjectPattern(tuple(fields.items())))
        ),
        max_leaves=8,
    )


def _operations(inner: st.SearchStrategy[Guard]) -> st.SearchStrategy[Guard]:
    made = []
    for operator, facts in OPERATORS.items():
        operands = [inner] * (facts.arity or 2)
        if operator is Operator.IN:
            operands = [inner, literals, literals]
        elif operator is Operator.LIKE:
            operands = [inner, texts.map(Literal)]
        several = st.lists(operands[-1], max_size=2) if facts.arity is None else st.just([])
        parts = st.tuples(st.tuples(*operands), several).map(lambda parts: (*parts[0], *parts[1]))
        made.append(st.builds(Operation, st.just(operator), parts))
    return st.one_of(made)


values: st.SearchStrategy[Guard] = st.recursive(literals | variables, _operations, max_leaves=12)
durations = st.integers(0, 10**20).map(Duration)
points = st.builds(TimePoint.of, st.sampled_from(POINTS), names)
_sums = (
    points
    | st.builds(Operation, st.sampled_from([Operator.ADD, Operator.SUB]), st.tuples(points, durations))
    | st.builds(Operation, st.just(Operator.ADD), st.tuples(durations, points))
)
_spans = st.builds(Operation, st.just(Operator.SUB), st.tuples(_sums, _sums))
times: st.SearchStrategy[Guard] = st.builds(
    Operation,
    st.sampled_from(sorted(COMPARISONS)),
    st.tuples(_sums, _sums) | st.tuples(_spans, durations) | st.tuples(durations, _spans),
)
"""Conditions on time."""
_junctions = st.builds(Operation, st.sampled_from(sorted(JUNCTIONS)), st.tuples(times | values, times | values))
guards = values | times | _junctions | st.builds(Operation, st.just(Operator.NOT), st.tuples(_junctions))
event_times = st.builds(
    EventTime,
    st.lists(names, min_size=1, max_size=3).map(tuple),
    st.sampled_from(TimeFormat),
    st.none() | durations.map(lambda one: one.value),
)


@st.composite
def event_types(draw: st.DrawFn, name: str) -> EventType:
    parameters = tuple(draw(st.lists(st.sampled_from(["p", "q", "on", "x1"]), max_size=3, unique=True)))
    free = draw(st.dictionaries(names, patterns(literals | st.just(Anything())), max_size=3))
    used = {f"f{i}": Variable(parameter) for i, parameter in enumerate(parameters)}
    types = tuple(draw(st.sampled_from(ValueType)) for _ in parameters) if draw(st.booleans()) else ()
    return EventType(name, parameters, ObjectPattern(tuple((free | used).items())), types=types)


ros_names = st.from_regex(r"/?[A-Za-z_][A-Za-z0-9_]{0,4}(?:/[A-Za-z0-9_]{1,4}){0,2}", fullmatch=True) | st.sampled_from(
    ["topic", "from", "type", "event", "/or"]
)
message_types = st.from_regex(r"[a-z]{1,4}_msgs\.msg\.[A-Z][a-z0-9]{0,4}", fullmatch=True)
topics = st.lists(
    st.builds(Topic, ros_names, message_types, st.lists(ros_names, max_size=3, unique=True).map(tuple)),
    max_size=3,
    unique_by=lambda topic: topic.name.removeprefix("/"),
)


@st.composite
def trees(draw: st.DrawFn) -> RVAFT:
    """A tree with a valid structure; what its scenarios are is nobody's business here."""
    own = draw(st.lists(names, min_size=1, max_size=8, unique=True))
    events: list[EventType] = [draw(event_types(name)) for name in draw(st.lists(names, max_size=3, unique=True))]

    def call() -> On:
        event = draw(st.sampled_from(events))
        arguments = [draw(literals | variables | st.just(Anything())) for _ in event.parameters]
        return On(event.name, tuple(arguments))

    def guard() -> Guard | None:
        """A guard that asks for times of nodes that are there."""
        made: Guard | None = draw(st.none() | guards)
        points = () if made is None else time_points(made)
        there = {one.name: TimePoint.of(one.point, draw(st.sampled_from(own))) for one in points}
        return None if made is None else substitute(made, there)

    nodes = []
    for index, name in enumerate(own):
        later = own[index + 1 :]
        children = tuple(draw(st.lists(st.sampled_from(later), max_size=4, unique=True))) if later else ()
        gate = draw(st.sampled_from(list(Gate))) if children else None
        on = call() if events and bool(draw(st.booleans())) else None
        when = guard()
        counted = gate is None and (on is not None or when is None) and bool(draw(st.booleans()))
        nodes.append(
            Node(
                name,
                gate,
                children,
                draw(st.integers(1, len(children))) if gate is Gate.VOT else None,
                on,
                when,
                draw(st.none() | st.sampled_from(Kind)),
                draw(st.none() | texts),
                tuple(draw(st.lists(st.tuples(names, texts | st.sampled_from(["0.1", "a//b", "x;y"])), max_size=2))),
                draw(st.integers(1, 10**6)) if counted else 1,
                None if gate is None else draw(st.none() | st.integers(0, 10**20)),
                declared=draw(st.booleans()),
            )
        )
    ignores = [Ignore(call(), draw(st.none() | values)) for _ in range(draw(st.integers(0, 2)))] if events else []
    return RVAFT(
        own[0],
        nodes,
        events,
        ignores=ignores,
        topics=draw(topics),
        causality=draw(st.sampled_from(Causality)),
        time=draw(st.none() | event_times),
        semantics=draw(st.none() | st.sampled_from(Semantics)),
        assumes=draw(st.frozensets(st.sampled_from([one for one in Assumption if one is not Assumption.ORDER]))),
    )
