"""Steps that make a tree and a trace smaller together: each yields smaller candidates, and does not know what they are for."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from typing import Final, TypeAlias, cast

from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Argument, Causality, EventType, Gate, Ignore, Node, On, Place
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    match,
    substitute,
    walk,
)
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, Scalar

# How large a tree and a trace are together: tuples of natural numbers, compared from the left.
#
# Where two have the same beginning they have the same length, so they have no infinite descent, and whatever only ever takes a smaller pair comes to an end. The numbers are, in turn:
#
# 1. nodes, and two more for every parent of a node beyond its first: sharing costs more than a further leaf
# 2. events in the trace
# 3. parts of the tree: gates by how much they ask for, thresholds, runtime events, guards, patterns, kinds, labels, attributes
# 4. literals of the tree that are not 0, 1 or empty, by the length of what is written
# 5. nodes and event types that do not have the name that is due to their position
# 6. objects, lists and values in the events of the trace
# 7. values of the trace, by how soon a simpler one would have been tried, in sum
# 8. the same one by one, as many as the sixth number says: of two orders of the same values one is smaller

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


# A tree taken apart, with a trace: what reductions make smaller, and how small it is.
#
# A candidate is cheap: it becomes a tree, or is found to be none, only when it is tried.

Trace: TypeAlias = tuple[Json, ...]


@dataclass(frozen=True, eq=False)
class Pair:
    """The parts of a tree, and a trace. No part remembers its place in a file."""

    root: str
    nodes: Mapping[str, Node]
    events: Mapping[str, EventType]
    ignores: tuple[Ignore, ...]
    causality: Causality
    trace: Trace

    @classmethod
    def of(cls, tree: RVAFT, trace: Iterable[Json]) -> "Pair":
        """Take a whole tree apart."""
        return cls(
            tree.root,
            {name: replace(node, declared=True, places={}) for name, node in tree.nodes.items()},
            {name: replace(event, place=Place()) for name, event in tree.events.items()},
            tuple(replace(ignore, place=Place()) for ignore in tree.ignores),
            tree.causality,
            tuple(trace),
        )

    @cached_property
    def tree(self) -> RVAFT:
        """The tree; raises `TreeError` where the parts make none."""
        return RVAFT(
            self.root, self.nodes.values(), self.events.values(), ignores=self.ignores, causality=self.causality
        )

    @cached_property
    def measure(self) -> Measure:
        """How large the pair is; see `sizes`."""
        return measure(self.root, self.nodes, self.events, self.ignores, causality=self.causality, trace=self.trace)

    @cached_property
    def key(self) -> bytes:
        """Equal for pairs that are written the same way (so 1 and 1.0 differ)."""
        parts = (self.root, *self.nodes.values(), *self.events.values(), self.ignores, self.causality, self.trace)
        return blake2b(repr(parts).encode("utf-8", "backslashreplace"), digest_size=16).digest()

    @property
    def order(self) -> tuple[str, ...]:
        """The reachable nodes, parents first."""
        return self.tree.order

    def with_node(self, *nodes: Node) -> "Pair":
        """With these nodes in place of those of the same name, and without what is then unreachable."""
        return self.at(self.root, {**self.nodes, **{node.name: node for node in nodes}})

    def at(self, root: str, nodes: Mapping[str, Node]) -> "Pair":
        """With this root and, of these nodes, those that it reaches."""
        reached: set[str] = set()
        agenda = [root]
        while agenda:
            name = agenda.pop()
            if name not in reached:
                reached.add(name)
                agenda.extend(nodes[name].children)
        return replace(self, root=root, nodes={name: node for name, node in nodes.items() if name in reached})

    def with_trace(self, trace: Iterable[Json]) -> "Pair":
        """With another trace."""
        return replace(self, trace=tuple(trace))

    def with_event_at(self, index: int, event: Json) -> "Pair":
        """With another event at one place."""
        return self.with_trace([*self.trace[:index], event, *self.trace[index + 1 :]])

    def without_event_at(self, index: int) -> "Pair":
        """Without one event."""
        return self.with_trace([*self.trace[:index], *self.trace[index + 1 :]])

    def served_by(self, name: str) -> list[int]:
        """Where the trace has events that the runtime event of a node matches by itself."""
        pattern = self.tree.pattern(name)
        return [] if pattern is None else [i for i, e in enumerate(self.trace) if match(pattern, e, {}) is not None]


Reduction: TypeAlias = Callable[[Pair], Iterator[Pair]]
"""Candidates to go on with instead of a pair, in a fixed order. Those that are not smaller, or no trees, are not tried."""

# Plain names: a, b, c, … for nodes from the root down, in the tree and in the default events of the trace; e, f, … for event types.


def plain_event_names(pair: Pair) -> Iterator[Pair]:
    """All event types with the names that are due to them."""
    due = event_names(pair.events)
    yield replace(
        pair,
        nodes={name: replace(node, on=_called(node.on, due)) for name, node in pair.nodes.items()},
        ignores=tuple(replace(ignore, on=replace(ignore.on, event=due[ignore.on.event])) for ignore in pair.ignores),
        events={due[name]: replace(event, name=due[name]) for name, event in pair.events.items()},
    )


def _called(on: On | None, by: Mapping[str, str]) -> On | None:
    return None if on is None else replace(on, event=by[on.event])


def plain_names(pair: Pair) -> Iterator[Pair]:
    """All nodes with the names that are due to them, or one of them; with its events in the trace renamed too or not.

    Also with two neighbouring children of a gate exchanged first: `a or b c` on the event c is then on the event b.
    """
    due = names(pair.root, pair.nodes)
    single = [{old: new} for old, new in due.items() if old != new and new not in pair.nodes]
    for by in [due, *single]:
        yield from _renamed(pair, by)
    for name in pair.order:
        gate = pair.nodes[name]
        for index in range(1, len(gate.children)):
            one, other = gate.children[index - 1 : index + 1]
            turned = (*gate.children[: index - 1], other, one, *gate.children[index + 1 :])
            exchanged = pair.with_node(replace(gate, children=turned))
            yield from _renamed(exchanged, names(exchanged.root, exchanged.nodes))


def _renamed(pair: Pair, by: Mapping[str, str]) -> Iterator[Pair]:
    nodes = [
        replace(node, name=by.get(node.name, node.name), children=tuple(by.get(c, c) for c in node.children))
        for node in sorted(pair.nodes.values(), key=lambda node: _rank(node.name, by))
    ]
    if len({node.name for node in nodes}) == len(nodes):
        renamed = replace(pair, root=by.get(pair.root, pair.root), nodes={node.name: node for node in nodes})
        yield renamed.with_trace(_event(event, by) for event in pair.trace)
        yield renamed


def _rank(name: str, by: Mapping[str, str]) -> int:
    """The position of a node that gets another name; the others stay behind them in their order."""
    return list(by).index(name) if name in by else len(by)


def _event(event: Json, by: Mapping[str, str]) -> Json:
    name = event.get("event") if isinstance(event, dict) else None
    return {**event, "event": by[name]} if isinstance(name, str) and name in by else event


# Fewer annotations: no texts and kinds, no guards or only parts of them, default events, no `ignore`, no unused event type.


def plain_nodes(pair: Pair) -> Iterator[Pair]:
    """No labels, attributes and kinds at all, or without one of them."""
    yield pair.with_node(*(replace(node, kind=None, label=None, attributes=()) for node in pair.nodes.values()))
    for node in pair.nodes.values():
        yield pair.with_node(replace(node, label=None))
        yield pair.with_node(replace(node, kind=None))
        for index in range(len(node.attributes)):
            yield pair.with_node(replace(node, attributes=node.attributes[:index] + node.attributes[index + 1 :]))


def top_down(pair: Pair) -> Iterator[Pair]:
    """Causality as it is by default, with the trace as it is or turned round."""
    if pair.causality is not Causality.TOP_DOWN:
        turned = replace(pair, causality=Causality.TOP_DOWN)
        yield turned
        yield turned.with_trace(reversed(pair.trace))


def without_events(pair: Pair) -> Iterator[Pair]:
    """A node without its runtime event, or a leaf with its default event instead.

    In the trace, what matched it becomes a default event, or gets its field; all of it, or one event of it.
    """
    for name in pair.order:
        node = pair.nodes[name]
        if node.on is None:
            continue
        yield from _rewritten(pair, name, replace(node, on=None))
        if node.gate is None and node.when is not None:
            yield from _rewritten(pair, name, replace(node, on=None, when=None))


def _rewritten(pair: Pair, name: str, node: Node) -> Iterator[Pair]:
    served = pair.served_by(name)
    smaller = pair.with_node(node)
    yield smaller
    if not node.has_event:
        yield smaller.with_trace(event for index, event in enumerate(pair.trace) if index not in served)
        return
    default = {"event": name}
    yield smaller.with_trace(default if index in served else event for index, event in enumerate(pair.trace))
    yield from (smaller.with_event_at(index, default) for index in served)
    yield smaller.with_trace(
        {**event, **default} if index in served else event for index, event in enumerate(pair.trace)
    )
    yield from (smaller.with_event_at(index, {**pair.trace[index], **default}) for index in served)


def without_guards(pair: Pair) -> Iterator[Pair]:
    """A node or an `ignore` without its guard, or with a part of it; a leaf with nothing else waits for its default event then."""
    for name in pair.order:
        node = pair.nodes[name]
        if node.when is None:
            continue
        smaller = pair.with_node(replace(node, when=None))
        yield smaller
        if smaller.nodes[name].has_event and not node.has_event:
            yield from (smaller.with_event_at(i, {"event": name}) for i in range(len(pair.trace)))
        yield from (pair.with_node(replace(node, when=guard)) for guard in smaller_guards(node.when))
    for index, ignore in enumerate(pair.ignores):
        if ignore.when is not None:
            yield _with_ignore(pair, index, replace(ignore, when=None))
            for guard in smaller_guards(ignore.when):
                yield _with_ignore(pair, index, replace(ignore, when=guard))


def smaller_guards(guard: Guard) -> Iterator[Guard]:
    """`true` or `false`, an operand for an operation, a conjunction or disjunction without one operand; here or further in."""
    yield Literal(True)
    yield Literal(False)
    if not isinstance(guard, Operation):
        return
    yield from guard.operands
    if guard.operator in (Operator.AND, Operator.OR) and len(guard.operands) > 2:
        for index in range(len(guard.operands)):
            yield replace(guard, operands=guard.operands[:index] + guard.operands[index + 1 :])
    for index, operand in enumerate(guard.operands):
        for part in smaller_guards(operand):
            yield replace(guard, operands=(*guard.operands[:index], part, *guard.operands[index + 1 :]))


def plain_ignores(pair: Pair) -> Iterator[Pair]:
    """Without one `ignore` declaration; what it ignored may have to leave the trace, which other reductions try."""
    for index in range(len(pair.ignores)):
        yield replace(pair, ignores=pair.ignores[:index] + pair.ignores[index + 1 :])


def _with_ignore(pair: Pair, index: int, ignore: Ignore) -> Pair:
    return replace(pair, ignores=(*pair.ignores[:index], ignore, *pair.ignores[index + 1 :]))


def without_unused(pair: Pair) -> Iterator[Pair]:
    """Without the nodes that the root does not reach; without all event types that nothing uses, or one of them."""
    yield pair.at(pair.root, pair.nodes)
    calls = [node.on for node in pair.nodes.values()] + [ignore.on for ignore in pair.ignores]
    used = {on.event for on in calls if on is not None}
    yield replace(pair, events={name: event for name, event in pair.events.items() if name in used})
    for unused in [name for name in pair.events if name not in used]:
        yield replace(pair, events={name: event for name, event in pair.events.items() if name != unused})


# A smaller trace: fewer events, events with less in them, values that the tree knows.


def shorter_trace(pair: Pair) -> Iterator[Pair]:
    """Without a run of events: half of them, then shorter and shorter runs down to single events, the last first."""
    length = len(pair.trace)
    size = length
    while size:
        for end in range(length, 0, -size):
            yield pair.with_trace([*pair.trace[: max(end - size, 0)], *pair.trace[end:]])
        size //= 2


def smaller_events(pair: Pair) -> Iterator[Pair]:
    """An event with nothing in it, without one field, or without one item of a list in it."""
    for index, event in enumerate(pair.trace):
        yield pair.with_event_at(index, {})
        for path, _ in places(event):
            yield pair.with_event_at(index, without_value(event, path))


def simpler_values(pair: Pair) -> Iterator[Pair]:
    """A simpler value for a value in an event: 0, the empty string, a name or a literal of the tree."""
    simple = simple_values(pair.nodes, pair.events, pair.ignores)
    ranks = {written(value): rank for rank, value in enumerate(simple)}
    for index, event in enumerate(pair.trace):
        for path, value in places(event):
            for plain in simple[: value_size(value, ranks)]:
                yield pair.with_event_at(index, with_value(event, path, plain))


def with_value(event: Json, path: Path, value: Json) -> Json:
    """A copy of an event with another value at a place; what the path does not touch is shared."""
    around = _around(event, path)
    for step, whole in zip(reversed(path), reversed(around), strict=True):
        copy = whole.copy()
        copy[step] = value
        value = copy
    return value


def without_value(event: Json, path: Path) -> Json:
    """A copy of an event without the field or item at a place."""
    *above, last = path
    whole = _around(event, path)[-1].copy()
    del whole[last]
    return with_value(event, tuple(above), whole)


def _around(event: Json, path: Path) -> list[Json]:
    """The objects and lists that the path goes through, outermost first."""
    around: list[Json] = []
    for step in path:
        around.append(event)
        event = event[step]
    return around


# Fewer nodes and edges: another root, a child in its gate's place, fewer children, leaves for gates, nothing shared.
#
# What a removed node waited for may have to leave the trace too, so a smaller tree comes with several traces (`followed`).


def other_root(pair: Pair) -> Iterator[Pair]:
    """One of the root's children, or of their descendants, as the root."""
    for name in pair.order[1:]:
        yield from followed(pair, pair.at(name, pair.nodes))


def child_for_gate(pair: Pair) -> Iterator[Pair]:
    """One of a gate's children in the place of the gate, wherever that is used."""
    for name in pair.order[1:]:
        gate = pair.nodes[name]
        for child in gate.children:
            above = [_instead(pair.nodes[parent], name, child) for parent in pair.tree.parents(name)]
            yield from followed(pair, pair.with_node(*above))


def _instead(parent: Node, name: str, child: str) -> Node:
    """The parent with a child for one of its children, once."""
    children = tuple(dict.fromkeys(child if old == name else old for old in parent.children))
    threshold = None if parent.threshold is None else min(parent.threshold, len(children))
    return replace(parent, children=children, threshold=threshold)


def gates_to_leaves(pair: Pair) -> Iterator[Pair]:
    """A gate without what is below it; with neither event nor guard of its own it now waits for its default event."""
    for name in pair.order:
        gate = pair.nodes[name]
        if gate.gate is not None:
            leaf = replace(gate, gate=None, children=(), threshold=None)
            smaller = pair.with_node(leaf)
            yield from followed(pair, smaller)
            if gate.on is None and gate.when is None:
                yield from (smaller.with_event_at(i, {"event": name}) for i in range(len(pair.trace)))


def fewer_children(pair: Pair) -> Iterator[Pair]:
    """A gate without one of its children, the last first; where it asks for K, with K and with one less."""
    for name in pair.order:
        gate = pair.nodes[name]
        for index in reversed(range(len(gate.children) if len(gate.children) > 1 else 0)):
            children = gate.children[:index] + gate.children[index + 1 :]
            thresholds = {None} if gate.threshold is None else {max(gate.threshold - 1, 1), gate.threshold}
            for threshold in sorted(thresholds, key=lambda k: k or 0):
                if threshold is None or threshold <= len(children):
                    yield from followed(pair, pair.with_node(replace(gate, children=children, threshold=threshold)))


def unshared_leaves(pair: Pair) -> Iterator[Pair]:
    """A leaf of its own for one of the parents of a shared leaf; it may need an event of its own, next to the other's."""
    for name in sorted(pair.tree.shared, key=pair.order.index):
        leaf = pair.nodes[name]
        if leaf.gate is not None:
            continue
        fresh = next(f"{name}_{n}" for n in range(2, len(pair.nodes) + 3) if f"{name}_{n}" not in pair.nodes)
        for parent in reversed(pair.tree.parents(name)):
            smaller = pair.with_node(_instead(pair.nodes[parent], name, fresh), replace(leaf, name=fresh))
            yield smaller
            for index in pair.served_by(name):
                event = pair.trace[index] if leaf.on is not None else {"event": fresh}
                yield smaller.with_trace([*pair.trace[: index + 1], event, *pair.trace[index + 1 :]])
                yield smaller.with_trace([*pair.trace[:index], event, *pair.trace[index:]])


def lower_gates(pair: Pair) -> Iterator[Pair]:
    """A simpler gate for a gate (`sand_rl` is `sand` with its children turned round), or a smaller K."""
    for name in pair.order:
        node = pair.nodes[name]
        if node.gate is None:
            continue
        for gate in GATES[: GATES.index(node.gate)]:
            if gate is Gate.SAND and node.gate is Gate.SAND_RL:
                yield pair.with_node(replace(node, gate=gate, children=node.children[::-1]))
            yield pair.with_node(replace(node, gate=gate, threshold=None))
        for threshold in range(1, node.threshold or 1):
            yield pair.with_node(replace(node, threshold=threshold))


def followed(before: Pair, after: Pair) -> Iterator[Pair]:
    """The smaller pair with all of the trace, without the events that only lost occurrences match, without one that they match."""
    yield after
    lost: set[int] = set()
    kept: set[int] = set()
    for name in before.tree.occurrences:
        still = name in after.nodes and after.nodes[name].has_event
        (kept if still else lost).update(before.served_by(name))
    only = lost - kept
    if only:
        yield after.with_trace(event for index, event in enumerate(before.trace) if index not in only)
    if len(lost) > 1 or lost != only:
        yield from (after.without_event_at(index) for index in sorted(lost))


# Simpler terms: literals and `_` for variables, patterns with fewer parts, event types with fewer parameters, plain literals.

Leaf: TypeAlias = Literal | Variable | Anything


def constant_variables(pair: Pair) -> Iterator[Pair]:
    """A literal for a variable, everywhere in the nodes: what the trace gives it, or a plain one."""
    for name in pair.tree.variables:
        for value in _values_of(pair, name):
            yield _nodes_mapped(pair, _exchange(Variable(name), Literal(value)))


def _values_of(pair: Pair, variable: str) -> list[Scalar]:
    found: list[Scalar] = []
    for node in pair.order:
        pattern = pair.tree.pattern(node)
        matches = [] if pattern is None else [match(pattern, event, {}) for event in pair.trace]
        found += [one[variable] for one in matches if one is not None and variable in one]
    scalars = [value for value in found if not isinstance(value, (dict, list))]
    return list({written(value): value for value in (*scalars, *PLAIN)}.values())


def smaller_arguments(pair: Pair) -> Iterator[Pair]:
    """`_` for a variable in all runtime events, or for one argument of a node or an `ignore`; there also a literal."""
    for variable in pair.tree.variables:
        yield _calls_mapped(pair, _exchange(Variable(variable), Anything()))
    for node in pair.nodes.values():
        for on in [] if node.on is None else _smaller_calls(node.on, ()):
            yield replace(pair, nodes={**pair.nodes, node.name: replace(node, on=on)})
    for index, ignore in enumerate(pair.ignores):
        for on in _smaller_calls(ignore.on, PLAIN):
            yield replace(pair, ignores=(*pair.ignores[:index], replace(ignore, on=on), *pair.ignores[index + 1 :]))


def _smaller_calls(on: On, plain: tuple[Scalar, ...]) -> Iterator[On]:
    for index, argument in enumerate(on.arguments):
        smaller: list[Argument] = [Anything()] if not isinstance(argument, Anything) else []
        smaller += [Literal(value) for value in plain] if isinstance(argument, Variable) else []
        for one in smaller:
            yield replace(on, arguments=(*on.arguments[:index], one, *on.arguments[index + 1 :]))


def simpler_patterns(pair: Pair) -> Iterator[Pair]:
    """An event type without a parameter (`_`, or what all uses give it), without a field, with `_` for a part.

    A list pattern loses an item only together with the lists of the trace that it could match: a shorter one matches other lists.
    """
    for event in pair.events.values():
        calls = [node.on for node in pair.nodes.values()] + [ignore.on for ignore in pair.ignores]
        uses = [on for on in calls if on is not None and on.event == event.name]
        for index, parameter in enumerate(event.parameters):
            given = {repr(on.arguments[index]): on.arguments[index] for on in uses}
            alike = [argument for argument in given.values() if not isinstance(argument, Variable) and len(given) == 1]
            for argument in (Anything(), *alike):
                yield _redefined(pair, event, substitute(event.pattern, {parameter: argument}))
        for pattern in smaller_patterns(event.pattern):
            yield _redefined(pair, event, pattern)
        for path, length in list_items(event.pattern):
            trace = [_without_item(one, path, length) for one in pair.trace]
            yield _redefined(pair, event, _without_part(event.pattern, path)).with_trace(trace)


def smaller_patterns(pattern: Pattern) -> Iterator[Pattern]:
    """A pattern without one field, here or further in, or with `_` for a part; the outermost stays an object."""
    match pattern:
        case ObjectPattern(fields):
            for index, (name, inner) in enumerate(fields):
                before, after = fields[:index], fields[index + 1 :]
                yield ObjectPattern((*before, *after))
                yield ObjectPattern((*before, (name, Anything()), *after))
                yield from (ObjectPattern((*before, (name, part), *after)) for part in smaller_patterns(inner))
        case ListPattern(items):
            for index, inner in enumerate(items):
                for part in (Anything(), *smaller_patterns(inner)):
                    yield ListPattern((*items[:index], part, *items[index + 1 :]))
        case _:
            pass


def list_items(pattern: Pattern) -> Iterator[tuple[Path, int]]:
    """Where a pattern has an item of a list, and how long that list is."""
    inner: Iterable[tuple[Step, Pattern]] = ()
    match pattern:
        case ObjectPattern(fields):
            inner = fields
        case ListPattern(items):
            yield from (((index,), len(items)) for index in range(len(items)))
            inner = enumerate(items)
    for step, part in inner:
        yield from (((step, *path), length) for path, length in list_items(part))


def _without_part(pattern: Pattern, path: Path) -> Pattern:
    step, *below = path
    match pattern:
        case ObjectPattern(fields):
            changed = [(name, _without_part(inner, tuple(below)) if name == step else inner) for name, inner in fields]
            return ObjectPattern(tuple(changed))
        case ListPattern(items):
            kept = [_without_part(item, tuple(below)) if n == step and below else item for n, item in enumerate(items)]
            return ListPattern(tuple(item for n, item in enumerate(kept) if below or n != step))
        case _:
            return pattern


def _without_item(event: Json, path: Path, length: int) -> Json:
    """An event without the item at a place, where it has a list of that length there."""
    around = dict(places(event)).get(path[:-1])
    return without_value(event, path) if isinstance(around, list) and len(around) == length else event


def _redefined(pair: Pair, event: EventType, pattern: Pattern) -> Pair:
    """With another pattern for an event type; the parameters that it lost are lost in all uses."""
    left = pattern_variables(pattern)
    kept = [index for index, parameter in enumerate(event.parameters) if parameter in left]
    changed = EventType(event.name, tuple(event.parameters[index] for index in kept), pattern)

    def call(on: On) -> On:
        return replace(on, arguments=tuple(on.arguments[i] for i in kept)) if on.event == event.name else on

    nodes = {n: replace(node, on=None if node.on is None else call(node.on)) for n, node in pair.nodes.items()}
    ignores = tuple(replace(ignore, on=call(ignore.on)) for ignore in pair.ignores)
    return replace(pair, nodes=nodes, ignores=ignores, events={**pair.events, event.name: changed})


def simpler_literals(pair: Pair) -> Iterator[Pair]:
    """A plain literal for a literal, everywhere in the tree, and for the value in the trace, or in the tree alone."""
    found = {written(value): value for value in literals(pair.nodes, pair.events, pair.ignores)}
    for value in found.values():
        for plain in PLAIN:
            if literal_size(plain) < literal_size(value):
                changed = _literal_changed(pair, value, plain)
                yield changed.with_trace(_value_changed(event, value, plain) for event in pair.trace)
                yield changed


def _literal_changed(pair: Pair, value: Scalar, plain: Scalar) -> Pair:
    def exchange(leaf: Leaf) -> Leaf:
        same = isinstance(leaf, Literal) and written(leaf.value) == written(value)
        return Literal(plain) if same else leaf

    changed = _nodes_mapped(pair, exchange)
    ignores = tuple(
        replace(
            ignore, on=_call(ignore.on, exchange), when=None if ignore.when is None else _guard(ignore.when, exchange)
        )
        for ignore in pair.ignores
    )
    events = {name: replace(event, pattern=_pattern(event.pattern, exchange)) for name, event in pair.events.items()}
    return replace(changed, ignores=ignores, events=events)


def _value_changed(event: Json, value: Scalar, plain: Scalar) -> Json:
    for path, inner in list(places(event)):
        if not isinstance(inner, (dict, list)) and written(inner) == written(value):
            event = with_value(event, path, plain)
    return event


# -- terms with other leaves ------------------------------------------------------------------------------------

Exchange: TypeAlias = Callable[[Leaf], Leaf]


def _exchange(old: Leaf, new: Leaf) -> Exchange:
    return lambda leaf: new if leaf == old else leaf


def _nodes_mapped(pair: Pair, exchange: Exchange) -> Pair:
    nodes = {
        name: replace(
            node,
            on=None if node.on is None else _call(node.on, exchange),
            when=None if node.when is None else _guard(node.when, exchange),
        )
        for name, node in pair.nodes.items()
    }
    return replace(pair, nodes=nodes)


def _calls_mapped(pair: Pair, exchange: Exchange) -> Pair:
    nodes = {
        n: node if node.on is None else replace(node, on=_call(node.on, exchange)) for n, node in pair.nodes.items()
    }
    return replace(pair, nodes=nodes)


def _call(on: On, exchange: Exchange) -> On:
    return replace(on, arguments=tuple(map(exchange, on.arguments)))


def _guard(guard: Guard, exchange: Exchange) -> Guard:
    if isinstance(guard, Operation):
        return replace(guard, operands=tuple(_guard(operand, exchange) for operand in guard.operands))
    return cast("Guard", exchange(guard))


def _pattern(pattern: Pattern, exchange: Exchange) -> Pattern:
    match pattern:
        case ObjectPattern(fields):
            return ObjectPattern(tuple((name, _pattern(inner, exchange)) for name, inner in fields))
        case ListPattern(items):
            return ListPattern(tuple(_pattern(item, exchange) for item in items))
        case _:
            return exchange(pattern)


__all__ = ["REDUCTIONS", "Pair", "Reduction"]

REDUCTIONS: tuple[Reduction, ...] = (
    shorter_trace,
    other_root,
    child_for_gate,
    gates_to_leaves,
    fewer_children,
    unshared_leaves,
    shorter_trace,
    plain_nodes,
    without_guards,
    without_events,
    plain_ignores,
    without_unused,
    top_down,
    lower_gates,
    constant_variables,
    smaller_arguments,
    simpler_patterns,
    smaller_events,
    simpler_literals,
    plain_event_names,
    plain_names,
    simpler_values,
)
"""All of them, those first that take most away."""
