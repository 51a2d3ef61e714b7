"""Trees of every text, whether they keep the rules about scenarios or not: odd names, deep patterns, all guards."""

from typing import Any

from hypothesis import strategies as st

from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Topic
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT

WORDS = [
    "",
    "a b",
    *["a", "b", "on", "or", "vot2", "spare", "event", "topic", "type", "_", "_x", "A1", "true", "lambda", "2of3", "é"],
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
            | st.dictionaries(names, inner, max_size=3).map(lambda fields: ObjectPattern(tuple(fields.items())))
        ),
        max_leaves=8,
    )


def _operations(inner: st.SearchStrategy[Guard]) -> st.SearchStrategy[Guard]:
    unary = st.builds(Operation, st.sampled_from([Operator.NOT, Operator.NEGATE]), st.tuples(inner))
    two = [o for o in Operator if o not in (Operator.NOT, Operator.NEGATE, Operator.AND, Operator.OR)]
    binary = st.builds(Operation, st.sampled_from(two), st.tuples(inner, inner))
    operands = st.lists(inner, min_size=2, max_size=4).map(tuple)
    return unary | binary | st.builds(Operation, st.sampled_from([Operator.AND, Operator.OR]), operands)


guards: st.SearchStrategy[Guard] = st.recursive(literals | variables, _operations, max_leaves=12)


@st.composite
def event_types(draw: st.DrawFn, name: str) -> EventType:
    parameters = tuple(draw(st.lists(st.sampled_from(["p", "q", "on", "x1"]), max_size=3, unique=True)))
    free = draw(st.dictionaries(names, patterns(literals | st.just(Anything())), max_size=3))
    used = {f"f{i}": Variable(parameter) for i, parameter in enumerate(parameters)}
    return EventType(name, parameters, ObjectPattern(tuple((free | used).items())))


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

    nodes = []
    for index, name in enumerate(own):
        later = own[index + 1 :]
        children = tuple(draw(st.lists(st.sampled_from(later), max_size=4, unique=True))) if later else ()
        gate = draw(st.sampled_from(list(Gate))) if children else None
        nodes.append(
            Node(
                name,
                gate,
                children,
                draw(st.integers(1, len(children))) if gate is Gate.VOT else None,
                call() if events and bool(draw(st.booleans())) else None,
                draw(st.none() | guards),
                draw(st.none() | st.sampled_from(Kind)),
                draw(st.none() | texts),
                tuple(draw(st.lists(st.tuples(names, texts | st.sampled_from(["0.1", "a//b", "x;y"])), max_size=2))),
                declared=draw(st.booleans()),
            )
        )
    ignores = [Ignore(call(), draw(st.none() | guards)) for _ in range(draw(st.integers(0, 2)))] if events else []
    return RVAFT(
        own[0], nodes, events, ignores=ignores, topics=draw(topics), causality=draw(st.sampled_from(Causality))
    )
