"""Rules about what is written but does nothing, or does what was perhaps not meant."""

from collections.abc import Iterator

from rvaft.analysis.scenarios import ScenarioSpace
from rvaft.model.expressions import name_text
from rvaft.rules.rule import Report, Rule, Severity, did_you_mean


def undeclared(space: ScenarioSpace) -> Iterator[Report]:
    """A child that no statement defines is perhaps misspelt."""
    tree = space.tree
    declared = [name for name, node in tree.nodes.items() if node.declared]
    for node in tree.nodes.values():
        if not node.declared:
            guess = did_you_mean(node.name, declared)
            mend = f"write `{name_text(node.name)};`"
            message = f"child {node.name} is not declared; it observes its default event ({mend}){guess}"
            yield Report(node.place(), message, (node.name,))


def unreachable(space: ScenarioSpace) -> Iterator[Report]:
    """A node that does not lie below the root takes part in nothing."""
    tree = space.tree
    reachable = set(tree.order)
    for node in tree.nodes.values():
        if node.name not in reachable and node.declared:
            message = f"{node.name} cannot be reached from the root {tree.root}; make it a child, or prune it"
            yield Report(node.place(), message, (node.name,))


def unused_event(space: ScenarioSpace) -> Iterator[Report]:
    """An event type that neither a node nor an `ignore` uses."""
    tree = space.tree
    used = {node.on.event for node in tree.nodes.values() if node.on is not None}
    used.update(ignore.on.event for ignore in tree.ignores)
    for event in tree.events.values():
        if event.name not in used:
            yield Report(event.place, f"event type {event.name} is not used; use it with `on`, or remove it")


def root_event(space: ScenarioSpace) -> Iterator[Report]:
    """The undesired event is what the tree concludes, not what it observes."""
    root = space.tree.nodes[space.tree.root]
    if root.has_event:
        message = f"the root {root.name} carries a runtime event, which every match must contain; move it to a child"
        yield Report(root.place("on"), message, (root.name,))


RULES = (
    Rule(
        "undeclared",
        Severity.WARNING,
        "undeclared child",
        undeclared,
        'A child that no statement defines is a leaf that observes the default event `{"event": "<its name>"}`. '
        "A misspelt name looks the same, so every child wants a statement of its own.",
        "top and pump valve;\npump;\n",
        "top and pump valve;\npump;\nvalve;\n",
    ),
    Rule(
        "unreachable",
        Severity.WARNING,
        "unreachable node",
        unreachable,
        "A node that is not below the root is in no scenario. `prune` drops a part on purpose.",
        "toplevel top;\ntop and a b;\na;\nb;\nc;\n",
        "toplevel top;\ntop and a b c;\na;\nb;\nc;\n",
    ),
    Rule(
        "unused-event",
        Severity.WARNING,
        "unused event type",
        unused_event,
        "An event type that no `on` and no `ignore` applies has no effect.",
        "event reading(v) = { value: v };\ntop and a b;\na;\nb;\n",
        "event reading(v) = { value: v };\ntop sand a b;\na on reading(3);\nb;\n",
    ),
    Rule(
        "root-event",
        Severity.WARNING,
        "event on the root",
        root_event,
        "The root is the undesired event itself: that it happened is what a monitor concludes. A runtime event on the root counts "
        "like any other, and under `causality top_down` comes before all others, which is rarely meant.",
        "event reading(v) = { value: v };\ntop and a b on reading(3);\na;\nb;\n",
        "event reading(v) = { value: v };\ntop sand c a b;\na;\nb;\nc on reading(3);\n",
    ),
)
