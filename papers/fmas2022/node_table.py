"""Table 1: the nodes of the tree, their runtime events and topics."""

from collections.abc import Iterator
from typing import Final

from papers.fmas2022 import tex
from rvaft.export import latex
from rvaft.export.latex import escaped
from rvaft.model.expressions import event_text, guard_text
from rvaft.model.nodes import Node, topic_of
from rvaft.model.patterns import Literal
from rvaft.model.tree import RVAFT

_NOTES: Final = (
    (
        r"The print has \textit{movebase\_result} for $\mathit{result}$, and \textit{MoveBaseGoal} for "
        r"$\mathit{goal}$; it writes strings without quotation marks."
    ),
    (
        r"The print has \textit{move(Waypoint)} for ev1. Here an event type has the same arguments everywhere; "
        r"$\_$ is any time."
    ),
)


def node_table(tree: RVAFT) -> str:
    """Return Table 1 as LaTeX; nodes without runtime event and guard have no row."""
    rows = [tex.row(_cells(tree, node)) for node in tree.top_down() if node.has_event or node.when is not None]
    return tex.table(
        "lll",
        ["Node", "Runtime event", "ROS topic"],
        [r"\midrule", *rows],
        caption="Nodes, runtime events and topics (Table 1 of the paper, from the tree).",
        label="tab:nodes",
        notes=_NOTES,
    )


def _cells(tree: RVAFT, node: Node) -> Iterator[str]:
    yield escaped(node.name)
    parts = [event_text(node, latex.STYLE)] if node.has_event else []
    parts += [] if node.when is None else [guard_text(node.when, latex.STYLE)]
    yield ", ".join(map(tex.math, parts))
    pattern = tree.pattern(node.name)
    topic = None if pattern is None else topic_of(pattern)
    yield tex.typewriter(str(topic.value)) if isinstance(topic, Literal) else "--"
