"""A tree as canonical text, which the parser reads back as an equal tree."""

from collections.abc import Iterable, Iterator
from itertools import repeat
from typing import Final

from rvaft.errors import expect
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import (
    assumptions_text,
    count_text,
    guard_text,
    name_text,
    on_text,
    pattern_text,
    quoted,
    time_text,
    value_text,
    without_text,
    word_text,
)
from rvaft.model.guards import Guard
from rvaft.model.nodes import Causality, EventType, Node, Topic, ValueType
from rvaft.model.tree import RVAFT

_WIDEST: Final = 40
"""The width of the widest aligned cells."""


def dumps(tree: RVAFT) -> str:
    """Return the canonical text of a tree; `loads(dumps(tree)) == tree`.

    The order is causality, semantics, time, assumptions, repetition, shown variables, event types,
    topics, ignores, toplevel, nodes (parents before children, then unreachable ones). A child without a statement stays
    undeclared; a restriction is lost. Raises `LanguageError` for an unpaired surrogate, and beyond
    100 levels of nesting.

    >>> import rvaft
    >>> print(dumps(rvaft.loads("top   and a b;")), end="")
    toplevel top;
    top and a b;
    """
    expect("a tree to print", tree, RVAFT, "an RVAFT")
    blocks = [
        [*_settings(tree)],
        aligned(
            [f"event {word_text(event.name)}({_parameters(event)})", f"= {pattern_text(event.pattern)}"]
            for event in tree.events.values()
        ),
        aligned(_topic_cells(topic) for topic in tree.topics.values()),
        [f"ignore {on_text(ignore.on)}{_when(ignore.when)};" for ignore in tree.ignores],
        [f"toplevel {name_text(tree.root)};", *aligned(_node_cells(node) for node in _stated(tree))],
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def _settings(tree: RVAFT) -> Iterator[str]:
    if tree.causality is not Causality.TOP_DOWN:
        yield f"causality {tree.causality};"
    if tree.semantics is not None:
        yield f"semantics {tree.semantics};"
    if tree.time is not None:
        yield f"{time_text(tree.time)};"
    if tree.assumes:
        yield f"assume {assumptions_text(tree.assumes, tree.time)};"
    if tree.repeat_by is not None:
        yield f"repeat by {tree.repeat_by};"
    if tree.shows:
        yield f"show {', '.join(tree.shows)};"


def _parameters(event: EventType) -> str:
    typed = zip(event.parameters, event.types or repeat(ValueType.ANY), strict=False)
    return ", ".join(name if type_ is ValueType.ANY else f"{name}: {type_}" for name, type_ in typed)


def _stated(tree: RVAFT) -> Iterator[Node]:
    children = {child for node in tree.nodes.values() for child in node.children}
    for name in dict.fromkeys([*tree.order, *sorted(tree.nodes)]):
        node = tree.nodes[name]
        implied = not node.declared and node == Node(name) and name in children and name != tree.root
        if not implied:
            yield node


def _topic_cells(topic: Topic) -> list[str]:
    publishers = ", ".join(name_text(name) for name in topic.publishers)
    return [f"topic {quoted(topic.name)}", f"type {quoted(topic.type)}", f"from {publishers}" if publishers else ""]


def _when(guard: Guard | None) -> str:
    return "" if guard is None else f" when {guard_text(guard)}"


def _node_cells(node: Node) -> list[str]:
    gate = ""
    if node.gate is not None:
        word = f"{node.threshold}of{len(node.children)}" if node.threshold is not None else node.gate.value
        within = [] if node.within is None else [f"within {duration_text(node.within)}"]
        gate = " ".join([word, *(name_text(child) for child in node.children), *within])
    tail = f"on {on_text(node.on)}" if node.on is not None else ""
    tail = f"{tail} {count_text(node)}".strip()
    tail += _when(node.when) + "".join(f" {without_text(clause)}" for clause in node.without)
    attributes = " ".join(f"{word_text(key)}={value_text(value)}" for key, value in node.attributes)
    label = f"label {quoted(node.label)}" if node.label is not None else ""
    return [name_text(node.name), gate, node.kind or "", tail.lstrip(), attributes, label]


def aligned(rows: Iterable[list[str]]) -> list[str]:
    """Return a line for each row of cells, with its semicolon; cells of a column start below each other.

    >>> aligned([["a", "or b", ""], ["long", "", "fault"]])
    ['a    or b;', 'long      fault;']
    """
    table = list(rows)
    widths = [max((len(c) for c in column if len(c) <= _WIDEST), default=0) for column in zip(*table, strict=True)]
    lines = []
    for row in table:
        line, edge = "", 0
        for cell, width in zip(row, widths, strict=True):
            if cell:
                line = f"{line.ljust(edge - 1)} {cell}" if line else cell
            edge += width + 1 if width else 0
        lines.append(line + ";")
    return lines
