r"""A tree as a graph for Graphviz, in the manner of fault trees: a box per node, below it the gate, then the children.

Faults are orange and attacks red, as in the paper's figures; a condition (a guard without event) has a dashed frame. Text is
escaped so that no name or label can leave its place: labels are HTML-like, where Graphviz still replaces `\N` and the like.
"""

from collections.abc import Iterator
from html import escape

from rvaft.drawing.captions import caption, wrapped
from rvaft.model import Kind, Node
from rvaft.printable import visible
from rvaft.tree import RVAFT

WIDTH = 26
"""Columns of text in a box."""

_FILL = {Kind.FAULT: "#fbb659", Kind.ATTACK: "#ee7872", None: "#ffffff"}


def dot_text(tree: RVAFT) -> str:
    """The tree in the DOT language; node identifiers are `n` and `g` with the number of the node in top-down order."""
    number = {name: index for index, name in enumerate(tree.order)}
    lines = [
        f"digraph {_identifier(tree.root)} {{",
        '  graph [ordering=out, ranksep=0.28, nodesep=0.25, charset="UTF-8"];',
        '  node [fontname="Helvetica", fontsize=11, shape=box, style=filled, margin="0.08,0.04"];',
        '  edge [dir=none, color="#444444"];',
    ]
    for node in tree.top_down():
        lines.extend(f"  {line}" for line in _node(node, number))
    return "\n".join([*lines, "}", ""])


def _node(node: Node, number: dict[str, int]) -> Iterator[str]:
    own = number[node.name]
    style = "filled,dashed" if node.on is None and node.when is not None and node.leaf else "filled"
    yield f'n{own} [label=<{_label(node)}>, fillcolor="{_FILL[node.kind]}", style="{style}"];'
    gate = caption(node).gate
    if gate is None:
        return
    yield (
        f'g{own} [label=<{escape(gate)}>, shape=oval, fillcolor="#e8eef7", fontsize=9, margin="0.03,0.01", '
        f"height=0.26, width=0.5];"
    )
    yield f"n{own} -> g{own} [weight=8];"
    for child in node.children:
        yield f"g{own} -> n{number[child]};"


def _label(node: Node) -> str:
    """The words of a box as a table without lines, one row per part; a bold name where a label stands below it."""
    words = caption(node)
    rows = [f"<b>{_html(words.name)}</b>" if words.label else _html(words.name)]
    if words.label:
        rows.append(_html(words.label))
    if words.on is not None:
        rows.append(_code(words.on, "#17406d" if node.kind is None else "#000000"))
    if words.when is not None:
        rows.append(_code(f"when {words.when}", "#6d2a17" if node.kind is None else "#000000"))
    cells = "".join(f"<tr><td>{row}</td></tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="0" cellpadding="1">{cells}</table>'


def _code(text: str, color: str) -> str:
    return f'<font face="Courier" point-size="9.5" color="{color}">{_html(text, WIDTH + 4)}</font>'


def _html(text: str, width: int = WIDTH) -> str:
    """The text wrapped and escaped for an HTML-like label."""
    return "<br/>".join(escape(line).replace("\\", "\\\\") or "&#160;" for line in wrapped(text, width)) or "&#160;"


def _identifier(text: str) -> str:
    """The text as a quoted identifier: a quote is escaped, and a backslash, which could escape the closing one, doubled."""
    return '"' + visible(text).replace("\\", "\\\\").replace('"', '\\"') + '"'
