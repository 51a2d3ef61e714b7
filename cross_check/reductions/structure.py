"""Fewer nodes and edges: another root, a child in its gate's place, fewer children, leaves for gates, nothing shared.

What a removed node waited for may have to leave the trace too, so a smaller tree comes with several traces (`followed`).
"""

from collections.abc import Iterator
from dataclasses import replace

from cross_check.reductions.pair import Pair
from cross_check.reductions.sizes import GATES
from rvaft.model import Gate, Node


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
