"""Plain names: a, b, c, … for nodes from the root down, in the tree and in the default events of the trace; e, f, … for event types."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from cross_check.reductions.pair import Pair
from cross_check.reductions.sizes import event_names, names
from rvaft.model import On
from rvaft.values import Json


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
