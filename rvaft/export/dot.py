r"""A tree as a graph for Graphviz, in the manner of fault trees: a box per node, below it the gate, then the children.

Faults are orange and attacks red, as in the paper's figures, in tints that differ and carry black text when they are printed in grey;
a condition (a guard without event) has a dashed frame. A gate has its own outline and its short form in it. Text is escaped so that no
name or label can leave its place.
"""

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from typing import Final

from rvaft.errors import ToolFailed, ToolMissing
from rvaft.export.layout import PLAIN, Entry, Look, Role, Row, Sign, View, caption, entries, is_condition, rows, view
from rvaft.export.line_breaks import wrapped
from rvaft.model.nodes import Gate, Kind, Node
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

# Text for Graphviz that cannot leave its place: HTML-like labels, in which Graphviz still replaces `\N` and the like, and names.

_SPECIAL: Final = str.maketrans({"\\": "\\\\", "]": "&#93;"})
"""Beside what is special in HTML: Graphviz replaces escapes, and holds back a text of nothing but `]` until it is misplaced."""
_TITLE: Final = str.maketrans({"&": "&amp;", "\\": "&#92;", '"': "&quot;"})
"""In the title of an SVG, Graphviz takes entities as such, and shows an escape as it is written."""
_SPACE = "&#160;"


def html(text: str, width: int) -> str:
    """The text wrapped and escaped for an HTML-like label."""
    return html_lines(wrapped(text, width))


def html_lines(lines: Iterable[str]) -> str:
    """Lines escaped for an HTML-like label."""
    return "<br/>".join(escape(line).translate(_SPECIAL) or _SPACE for line in lines) or _SPACE


def table(rows: Iterable[str], *, space: int = 0, cell: str = "") -> str:
    """Rows of escaped text, one below the other, as a table without lines, with `space` around each and attributes of all cells."""
    cells = "".join(f"<tr><td {cell}>{row}</td></tr>" if cell else f"<tr><td>{row}</td></tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="{space}" cellpadding="1">{cells}</table>'


def title(text: str) -> str:
    """The text as the name of a graph, which becomes the title of a picture."""
    return f'"{visible(text).translate(_TITLE)}"'


# Pictures through Graphviz's program `dot`.

TIMEOUT = 300.0
"""Seconds after which a layout is given up."""

_CREATED: Final = re.compile(rb"/CreationDate \(D:\d{14}")
"""When a PDF was made: `dot` has no option that leaves it out."""


def picture(dot: str, form: str, *, timeout: float = TIMEOUT) -> bytes:
    """A graph in the DOT language as `svg`, `pdf` or `png`, the same bytes every time; raises `ToolMissing`, `ToolFailed`."""
    program = shutil.which("dot")
    if program is None:
        raise ToolMissing(
            "dot", remedy="install Graphviz (apt-get install graphviz), or write a .dot file, which needs none"
        )
    command = [program, f"-T{form}", *(["-Gdpi=144"] if form == "png" else [])]
    try:
        done = subprocess.run(command, input=dot.encode(), capture_output=True, timeout=timeout, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        raise ToolFailed(
            "dot", reason=f"no layout after {timeout:g} s; write a .dot file and try another layout"
        ) from None
    except OSError as error:
        raise ToolFailed("dot", reason=error.strerror or type(error).__name__) from error
    if done.returncode != 0 or not done.stdout:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise ToolFailed("dot", reason=said[0] if said else f"exit status {done.returncode}")
    return _CREATED.sub(b"/CreationDate (D:19700101000000", done.stdout) if form == "pdf" else done.stdout


SIZE = 10
"""Points of all text: one size, so that a picture stays readable as long as any of it does."""

_FILL = {Kind.FAULT: "#fbb659", Kind.ATTACK: "#ee7872", None: "#ffffff"}
_CODE = {Role.EVENT: "#17406d", Role.GUARD: "#6d2a17"}
_GATE, _PALE, _GREY, _BLACK = "#e8eef7", "#f6f6f6", "#b8b8b8", "#000000"
_OUTLINE = {
    Gate.OR: "shape=house, height=0.34",
    Gate.AND: 'shape=box, style="filled,rounded", height=0.28',
    Gate.SAND: "shape=house, orientation=270, height=0.22",
    Gate.SAND_RL: "shape=house, orientation=90, height=0.22",
    Gate.VOT: "shape=hexagon, height=0.28",
}
"""A pointed roof for a choice, a round one for all, a signpost in the direction of a SAND, the hexagon of a vote."""
_FOLDED = "shape=triangle, margin=0, fixedsize=true, width=0.6, height=0.44"
"""The transfer symbol of fault trees."""
_BOLD = "penwidth=2.5"
"""The frame or line of what is marked."""


def dot_text(tree: RVAFT, look: Look = PLAIN) -> str:
    """The tree in the DOT language; node identifiers are `n` and `g` with the number of the node in top-down order.

    With marks, what is marked is bold and the rest grey. Raises `OptionError` for a look that the tree cannot have.
    """
    return "\n".join(_Drawing(tree, look, view(tree, look)).lines())


@dataclass(frozen=True, slots=True)
class _Drawing:
    """One tree under one look."""

    tree: RVAFT
    look: Look
    view: View

    def lines(self) -> Iterator[str]:
        number = {name: index for index, name in enumerate(self.tree.order)}
        yield f"digraph {title(self.tree.root)} {{"
        yield '  graph [margin=0, ordering=out, ranksep=0.25, nodesep=0.1, charset="UTF-8"];'
        yield f'  node [fontname="Helvetica", fontsize={SIZE}, shape=box, style=filled, margin="0.05,0.03", height=0.25, width=0.4];'
        yield f'  edge [dir=none, color="#444444", fontname="Helvetica", fontsize={SIZE}];'
        for node in self.view.nodes:
            for line in self._node(node, number):
                yield f"  {line}"
        if below := [*self._below()]:
            yield f"  label=<{_frame_of(below)}>;"
            yield f'  labelloc=b; labeljust=l; fontname="Helvetica"; fontsize={SIZE};'
        yield from ("}", "")

    def _node(self, node: Node, number: dict[str, int]) -> Iterator[str]:
        own = number[node.name]
        style = "filled,dashed" if is_condition(node) else "filled"
        fill = _PALE if self._faint(node) else _FILL[node.kind]
        bold = self._outline(node)
        yield f'n{own} [label=<{self._label(node)}>, fillcolor="{fill}", style="{style}"{bold}];'
        if node.gate is None:
            return
        fill = _PALE if self._faint(node) else _GATE
        folded = self.view.folded.get(node.name)
        if folded is not None:
            count = f"+{folded}" if folded else "…"
            yield f't{own} [label=<{count}>, {_FOLDED}, fillcolor="{fill}"{bold}];'
            yield f"n{own} -> t{own} [weight=8{self._line(marked=not self._faint(node), separator=', ')}];"
            return
        gate = html(caption(node).gate or "", self.look.wrap)
        yield f'g{own} [label=<{gate}>, {_OUTLINE[node.gate]}, fillcolor="{fill}", margin="0.06,0.01"{bold}];'
        yield f"n{own} -> g{own} [weight=8{self._line(marked=not self._faint(node), separator=', ')}];"
        marks = self.look.marks
        for place, child in enumerate(self.view.children(node)):
            looks = [self._line(marked=marks is not None and marks.edge(node.name, child))]
            if self.look.stagger and place % 2 and self.tree.nodes[child].leaf:
                looks.append("minlen=2")
            if node.name in self.view.numbered:
                looks.append(f"label=<{_turn(node, place)}>")
            line = ", ".join(filter(None, looks))
            yield f"g{own} -> n{number[child]}{f' [{line}]' if line else ''};"

    def _faint(self, node: Node) -> bool:
        return self.look.marks is not None and node.name not in self.look.marks.kept

    def _outline(self, node: Node) -> str:
        if self.look.marks is None:
            return ""
        return f', color="{_GREY}", fontcolor="{_GREY}"' if self._faint(node) else f", {_BOLD}"

    def _line(self, *, marked: bool, separator: str = "") -> str:
        if self.look.marks is None:
            return ""
        return separator + (f'{_BOLD}, color="{_BLACK}"' if marked else f'color="{_GREY}"')

    def _label(self, node: Node) -> str:
        """The words of a box as a table without lines, one row per part; a bold name where a label stands below it."""
        return table(self._row(row, node) for row in rows(node, self.look))

    def _row(self, row: Row, node: Node) -> str:
        text = html_lines(row.lines)
        if row.role is Role.PLAIN:
            return text
        if row.role is Role.BOLD:
            return f"<b>{text}</b>"
        color = _GREY if self._faint(node) else _CODE[row.role] if node.kind is None else _BLACK
        return f'<font color="{color}"><i>{text}</i></font>'

    def _below(self) -> Iterator[str]:
        """Rows of two columns below the tree: what the marks say, and the legend."""
        marks = self.look.marks
        for line in () if marks is None else marks.below:
            yield f'<td colspan="2" align="left" balign="left">{html(line, 3 * self.look.wrap)}</td>'
        for entry in entries(self.view, marks, graph=True) if self.look.legend else ():
            meaning = f"{entry.meaning} ({_SHAPES[entry.gate]})" if entry.gate else entry.meaning
            yield f'<td {_SAMPLES[entry.sign]}>{_sample(entry)}</td><td align="left">{html(meaning, 3 * self.look.wrap)}</td>'


def _turn(node: Node, place: int) -> int:
    """When the child at a place comes, counted from 1."""
    return place + 1 if node.gate is Gate.SAND else len(node.children) - place


_SAMPLES = {
    Sign.FAULT: f'border="1" cellpadding="3" bgcolor="{_FILL[Kind.FAULT]}"',
    Sign.ATTACK: f'border="1" cellpadding="3" bgcolor="{_FILL[Kind.ATTACK]}"',
    Sign.CONDITION: 'border="1" cellpadding="4" style="dashed"',
    Sign.GATE: f'cellpadding="3" bgcolor="{_GATE}"',
    Sign.FOLDED: f'cellpadding="3" bgcolor="{_GATE}"',
    Sign.ORDER: "",
    Sign.MARKED: 'border="3" cellpadding="3"',
}
"""A cell has no other outlines than these, so those of gates and of the triangle are said."""
_SHAPES = {
    Gate.OR: "pointed roof",
    Gate.AND: "round corners",
    Gate.SAND: "arrow",
    Gate.SAND_RL: "arrow",
    Gate.VOT: "hexagon",
}


def _sample(entry: Entry) -> str:
    return f"△ {html(entry.sample, SIZE)}" if entry.sign is Sign.FOLDED else html(entry.sample, 2 * SIZE)


def _frame_of(rows: list[str]) -> str:
    cells = "".join(f"<tr>{row}</tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="3" cellpadding="1">{cells}</table>'
