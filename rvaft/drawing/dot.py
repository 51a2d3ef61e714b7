r"""A tree as a graph for Graphviz, in the manner of fault trees: a box per node, below it the gate, then the children.

Faults are orange and attacks red, as in the paper's figures; a condition (a guard without event) has a dashed frame. Text is
escaped so that no name or label can leave its place: labels are HTML-like, where Graphviz still replaces `\N` and the like.
"""

from collections.abc import Iterator
from html import escape

from rvaft.drawing.captions import caption, wrapped
from rvaft.drawing.marks import Marks
from rvaft.model import Kind, Node
from rvaft.printable import visible
from rvaft.tree import RVAFT

WIDTH = 26
"""Columns of text in a box."""

_FILL = {Kind.FAULT: "#fbb659", Kind.ATTACK: "#ee7872", None: "#ffffff"}
_PALE, _GREY, _BLACK = "#f6f6f6", "#b8b8b8", "#000000"
_BOLD = "penwidth=2.5"
"""The frame or line of what a match is made of."""


def dot_text(tree: RVAFT, marks: Marks | None = None) -> str:
    """The tree in the DOT language; node identifiers are `n` and `g` with the number of the node in top-down order.

    With marks, what is marked is bold and the rest grey.
    """
    number = {name: index for index, name in enumerate(tree.order)}
    lines = [
        f"digraph {_identifier(tree.root)} {{",
        '  graph [ordering=out, ranksep=0.28, nodesep=0.25, charset="UTF-8"];',
        '  node [fontname="Helvetica", fontsize=11, shape=box, style=filled, margin="0.08,0.04"];',
        '  edge [dir=none, color="#444444"];',
    ]
    for node in tree.top_down():
        lines.extend(f"  {line}" for line in _node(node, number, marks))
    if marks is not None and marks.below:
        lines.append(f"  label=<{_table([_html(line, 2 * WIDTH) for line in marks.below])}>;")
        lines.append('  labelloc=b; fontname="Helvetica"; fontsize=11;')
    return "\n".join([*lines, "}", ""])


def _node(node: Node, number: dict[str, int], marks: Marks | None) -> Iterator[str]:
    own = number[node.name]
    style = "filled,dashed" if node.on is None and node.when is not None and node.leaf else "filled"
    faint = marks is not None and node.name not in marks.kept
    bold = "" if marks is None else _frame(bold=not faint)
    fill = _PALE if faint else _FILL[node.kind]
    note = () if marks is None else marks.notes.get(node.name, ())
    yield f'n{own} [label=<{_label(node, note, faint=faint)}>, fillcolor="{fill}", style="{style}"{bold}];'
    gate = caption(node).gate
    if gate is None:
        return
    yield (
        f'g{own} [label=<{escape(gate)}>, shape=oval, fillcolor="{_PALE if faint else "#e8eef7"}", fontsize=9, '
        f'margin="0.03,0.01", height=0.26, width=0.5{bold}];'
    )
    yield f"n{own} -> g{own} [weight=8{'' if marks is None else _line(bold=not faint)}];"
    for child in node.children:
        look = "" if marks is None else f" [{_line(bold=marks.edge(node.name, child))[2:]}]"
        yield f"g{own} -> n{number[child]}{look};"


def _frame(*, bold: bool) -> str:
    return f", {_BOLD}" if bold else f', color="{_GREY}", fontcolor="{_GREY}"'


def _line(*, bold: bool) -> str:
    return f', {_BOLD}, color="{_BLACK}"' if bold else f', color="{_GREY}"'


def _label(node: Node, note: tuple[str, ...], *, faint: bool) -> str:
    """The words of a box as a table without lines, one row per part; a bold name where a label stands below it."""
    words = caption(node)
    rows = [f"<b>{_html(words.name)}</b>" if words.label else _html(words.name)]
    if words.label:
        rows.append(_html(words.label))
    if words.on is not None:
        rows.append(_code(words.on, _GREY if faint else "#17406d" if node.kind is None else _BLACK))
    if words.when is not None:
        rows.append(_code(f"when {words.when}", _GREY if faint else "#6d2a17" if node.kind is None else _BLACK))
    rows += [f"<b>{_html(part)}</b>" for part in note[:1]]
    rows += [_small(part) for part in note[1:]]
    return _table(rows)


def _table(rows: list[str]) -> str:
    cells = "".join(f"<tr><td>{row}</td></tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="0" cellpadding="1">{cells}</table>'


def _code(text: str, color: str) -> str:
    return f'<font face="Courier" point-size="9.5" color="{color}">{_html(text, WIDTH + 4)}</font>'


def _small(text: str) -> str:
    return f'<font point-size="9.5">{_html(text, WIDTH + 8)}</font>'


def _html(text: str, width: int = WIDTH) -> str:
    """The text wrapped and escaped for an HTML-like label."""
    return "<br/>".join(escape(line).replace("\\", "\\\\") or "&#160;" for line in wrapped(text, width)) or "&#160;"


def _identifier(text: str) -> str:
    """The text as a quoted identifier: a quote is escaped, and a backslash, which could escape the closing one, doubled."""
    return '"' + visible(text).replace("\\", "\\\\").replace('"', '\\"') + '"'
