"""How large a tree and a trace are together: tuples of natural numbers, compared from the left.

Where two have the same beginning they have the same length, so they have no infinite descent, and whatever only ever takes a smaller pair comes to an end. The numbers are, in turn:

1. nodes, and two more for every parent of a node beyond its first: sharing costs more than a further leaf
2. events in the trace
3. parts of the tree: gates by how much they ask for, thresholds, runtime events, guards, patterns, kinds, labels, attributes
4. literals of the tree that are not 0, 1 or empty, by the length of what is written
5. nodes and event types that do not have the name that is due to their position
6. objects, lists and values in the events of the trace
7. values of the trace, by how soon a simpler one would have been tried, in sum
8. the same one by one, as many as the sixth number says: of two orders of the same values one is smaller
"""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, TypeAlias

from rvaft.guards import Guard, Operation
from rvaft.model import Causality, EventType, Gate, Ignore, Node, On
from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, walk
from rvaft.values import Json, Scalar

Measure: TypeAlias = tuple[int, ...]

GATES: Final = (Gate.OR, Gate.AND, Gate.SAND, Gate.SAND_RL, Gate.VOT)
"""The gates, simplest first."""
PLAIN: Final[tuple[Scalar, ...]] = (0, 1, "")
"""The literals that need no simplification, simplest first."""


def measure(
    root: str,
    nodes: Mapping[str, Node],
    events: Mapping[str, EventType],
    ignores: Sequence[Ignore],
    *,
    causality: Causality,
    trace: Sequence[Json],
) -> Measure:
    """The size of the parts of a tree and a trace."""
    parents = Counter(child for node in nodes.values() for child in node.children)
    parts = sum(map(_node, nodes.values())) + sum(map(_event_type, events.values())) + sum(map(_ignore, ignores))
    due = names(root, nodes)
    simple = {written(value): rank for rank, value in enumerate(simple_values(nodes, events, ignores))}
    values = [value_size(value, simple) for event in trace for _, value in places(event)]
    return (
        len(nodes) + 2 * sum(count - 1 for count in parents.values()),
        len(trace),
        parts + (causality is not Causality.TOP_DOWN),
        sum(map(literal_size, literals(nodes, events, ignores))),
        sum(due.get(name) != name for name in nodes) + sum(new != old for old, new in event_names(events).items()),
        len(values),
        sum(values),
        *values,
    )


# -- the tree ---------------------------------------------------------------------------------------------------


def names(root: str, nodes: Mapping[str, Node]) -> dict[str, str]:
    """The name due to each reachable node: a, b, …, z, n26, … from the root down, children in order, level by level."""
    due: dict[str, str] = {}
    level = [root]
    while level:
        for name in level:
            number = len(due)
            due.setdefault(name, chr(ord("a") + number) if number < 26 else f"n{number}")
        level = list(dict.fromkeys(c for name in level for c in nodes[name].children if c not in due))
    return due


def event_names(events: Iterable[str]) -> dict[str, str]:
    """The name due to each event type: e, f, …, z, then e22 and so on."""
    return {old: chr(ord("e") + number) if number < 22 else f"e{number}" for number, old in enumerate(events)}


def _node(node: Node) -> int:
    gate = 0 if node.gate is None else 1 + GATES.index(node.gate)
    texts = (node.kind is not None) + (node.label is not None) + len(node.attributes)
    on = 0 if node.on is None else call_size(node.on)
    return gate + (node.threshold or 0) + on + (0 if node.when is None else 1 + guard_size(node.when)) + texts


def _ignore(ignore: Ignore) -> int:
    return 1 + call_size(ignore.on) + (0 if ignore.when is None else 1 + guard_size(ignore.when))


def _event_type(event: EventType) -> int:
    return 1 + len(event.parameters) + pattern_size(event.pattern)


def call_size(on: On) -> int:
    """A runtime event counts one and its arguments: `_`, a literal, a variable in this order."""
    return 1 + sum(map(pattern_size, on.arguments))


def pattern_size(pattern: Pattern) -> int:
    """Fields and items count too, so a pattern is larger than any part of it."""
    return sum(_part_size(part) for part in walk(pattern))


def _part_size(part: Pattern) -> int:
    match part:
        case Anything():
            return 1
        case Literal():
            return 2
        case Variable():
            return 3
        case ObjectPattern(fields):
            return 1 + len(fields)
        case ListPattern(items):
            return 1 + len(items)


def guard_size(guard: Guard) -> int:
    """Operators and operands; a variable counts more than a literal."""
    match guard:
        case Literal():
            return 1
        case Variable():
            return 2
        case Operation(_, operands):
            return 1 + sum(map(guard_size, operands))


# -- literals and values ----------------------------------------------------------------------------------------


def written(value: Json) -> str:
    """A value as text that tells 1 from 1.0 and from true."""
    return json.dumps(value, sort_keys=True)


def literals(nodes: Mapping[str, Node], events: Mapping[str, EventType], ignores: Iterable[Ignore]) -> list[Scalar]:
    """The literals of a tree in the order of its parts, repeated ones too."""
    calls = [(node.on, node.when) for node in nodes.values()] + [(ignore.on, ignore.when) for ignore in ignores]
    patterns = [event.pattern for event in events.values()]
    patterns += [argument for on, _ in calls if on is not None for argument in on.arguments]
    found = [part.value for pattern in patterns for part in walk(pattern) if isinstance(part, Literal)]
    return found + [constant for _, when in calls if when is not None for constant in _constants(when)]


def _constants(guard: Guard) -> Iterator[Scalar]:
    match guard:
        case Literal(value):
            yield value
        case Operation(_, operands):
            for operand in operands:
                yield from _constants(operand)
        case _:
            pass


def literal_size(value: Scalar) -> int:
    """Truth values and null are what they are; anything else could be 0."""
    if value is None or isinstance(value, bool):
        return 0
    ranks = [written(simple) for simple in PLAIN]
    text = written(value)
    return ranks.index(text) if text in ranks else len(ranks) + len(text)


def simple_values(
    nodes: Mapping[str, Node], events: Mapping[str, EventType], ignores: Iterable[Ignore]
) -> tuple[Scalar, ...]:
    """What a value of the trace may be replaced by, the simplest first: 0, "", what the tree itself speaks of."""
    own = [node.name for node in nodes.values() if node.has_event and node.on is None]
    everything = [0, "", *own, *literals(nodes, events, ignores)]
    return tuple({written(value): value for value in everything}.values())


def value_size(value: Json, simple: Mapping[str, int]) -> int:
    """The rank among the simple values, or more than any of them has; what is in an object or list counts by itself."""
    if isinstance(value, (dict, list)):
        return len(simple) + 1
    text = written(value)
    return simple.get(text, len(simple) + len(text))


# -- places in an event -----------------------------------------------------------------------------------------

Step: TypeAlias = str | int
Path: TypeAlias = tuple[Step, ...]


def places(event: Json) -> Iterator[tuple[Path, Json]]:
    """Every value inside an event with its path, outer ones first, in order; the event itself has no place."""
    agenda: list[tuple[Path, Json]] = [((), event)]
    while agenda:
        path, value = agenda.pop()
        if path:
            yield path, value
        inner: list[tuple[Step, Json]] = []
        if isinstance(value, dict):
            inner = list(value.items())
        elif isinstance(value, list):
            inner = list(enumerate(value))
        agenda.extend(((*path, step), part) for step, part in reversed(inner))
