"""Fewer annotations: no texts and kinds, no guards or only parts of them, default events, no `ignore`, no unused event type."""

from collections.abc import Iterator
from dataclasses import replace

from cross_check.reductions.pair import Pair
from rvaft.guards import Guard, Operation, Operator
from rvaft.model import Causality, Ignore, Node
from rvaft.patterns import Literal


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
