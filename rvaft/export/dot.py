r"""A tree as a graph for Graphviz in the style of fault trees: each node is a box above its gate.

Faults are orange and attacks red, as in the paper; both stay legible in grey prints. Conditions
(guards without event) have a dashed frame. In an SVG, a box has the node's name in `id`, its kind
in `class`, and a tooltip.
"""

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from html import escape
from typing import Final
from urllib.parse import quote

from rvaft.errors import ToolFailed, ToolMissing
from rvaft.export.layout import (
    PLAIN,
    Look,
    Role,
    Sign,
    gate_text,
    is_condition,
    node_line,
    rows,
    turn,
    wrapped,
)
from rvaft.export.placing import Placing, place, text_width
from rvaft.model.nodes import Gate, Kind, Node
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

_SPECIAL: Final = str.maketrans({"\\": "\\\\", "]": "&#93;"})
"""Graphviz interprets backslashes, and misplaces the text `]`."""
_TITLE: Final = str.maketrans({"&": "&amp;", "\\": "&#92;", '"': "&quot;"})
"""In SVG titles and tooltips Graphviz keeps entities, and prints escapes literally."""
_SPACE: Final = "&#160;"
_CREATED: Final = re.compile(rb"/CreationDate \(D:\d{14}")
"""The creation time of a PDF."""

SIZE: Final = 10
"""The size of text, in points: that of `placing`, as a whole number."""
_FILL: Final = {Kind.FAULT: "#fbb659", Kind.ATTACK: "#ee7872", None: "#ffffff"}
_CODE: Final = {Role.EVENT: "#17406d", Role.GUARD: "#6d2a17"}
_GATE, _PALE, _GREY, _BLACK = "#e8eef7", "#f6f6f6", "#b8b8b8", "#000000"
_FOLDED: Final = "shape=triangle, margin=0, fixedsize=true, {}height=0.44"
"""The transfer symbol of fault trees."""
_BOLD: Final = "penwidth=2.5"
_PILL: Final = 'style="filled,rounded", height=0.22, margin="0.06,0.01"'
"""A gate is a small box: Graphviz has none of the symbols of fault trees."""
_SAMPLES: Final[Mapping[Sign | Gate, str]] = {
    Sign.FAULT: f'fillcolor="{_FILL[Kind.FAULT]}"',
    Sign.ATTACK: f'fillcolor="{_FILL[Kind.ATTACK]}"',
    Sign.CONDITION: 'style="filled,dashed", fillcolor="#ffffff"',
    **dict.fromkeys([Sign.FOLDED, Sign.FOLDED_SHARED], f'{_FOLDED.format("")}, fillcolor="{_GATE}"'),
    Sign.ORDER: "shape=plaintext, style=solid",
    Sign.MARKED: f'fillcolor="#ffffff", {_BOLD}',
    **dict.fromkeys(Gate, f'{_PILL}, fillcolor="{_GATE}"'),
}


def html(text: str, width: int) -> str:
    """Return the text wrapped and escaped for an HTML-like label."""
    return html_lines(wrapped(text, width))


def html_lines(lines: Iterable[str]) -> str:
    """Return lines escaped for an HTML-like label."""
    return "<br/>".join(escape(line).translate(_SPECIAL) or _SPACE for line in lines) or _SPACE


def table(rows: Iterable[str], *, space: int = 0, cell: str = "") -> str:
    """Return rows of escaped text as a borderless table; `space` separates cells."""
    cells = "".join(f"<tr><td {cell}>{row}</td></tr>" if cell else f"<tr><td>{row}</td></tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="{space}" cellpadding="1">{cells}</table>'


def title(text: str) -> str:
    """Return a quoted text for a name or tooltip."""
    return f'"{visible(text).translate(_TITLE)}"'


def picture(dot: str, form: str, *, timeout: float = 300.0) -> bytes:
    """Return a graph as `svg`, `pdf` or `png`, reproducibly; `timeout` is in seconds.

    Raises `ToolMissing` and `ToolFailed`.
    """
    program = shutil.which("dot")
    if program is None:
        remedy = "install Graphviz (apt-get install graphviz), or write a .dot file, which needs none"
        raise ToolMissing("dot", remedy=remedy)
    command = [program, f"-T{form}", *(["-Gdpi=144"] if form == "png" else [])]
    try:
        done = subprocess.run(  # noqa: S603
            command, input=dot.encode(), capture_output=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        reason = f"no layout after {timeout:g} s; write a .dot file and try another layout"
        raise ToolFailed("dot", reason=reason) from None
    except OSError as error:
        raise ToolFailed("dot", reason=error.strerror or type(error).__name__) from error
    if done.returncode != 0 or not done.stdout:
        complaint = done.stderr.decode(errors="replace").strip().splitlines()
        raise ToolFailed("dot", reason=complaint[0] if complaint else f"exit status {done.returncode}")
    return _CREATED.sub(b"/CreationDate (D:19700101000000", done.stdout) if form == "pdf" else done.stdout


def dot_text(tree: RVAFT, look: Look = PLAIN) -> str:
    """Return the tree in the DOT language; node identifiers contain the top-down number of the
    node.

    With marks, marked parts are bold and the rest grey. Raises `OptionError`.
    """
    placed = place(tree, replace(look, symbols=False))
    part, number = placed.view, tree.rank
    lines = [
        'graph [margin=0, ordering=out, ranksep=0.25, nodesep=0.1, charset="UTF-8"];',
        (
            f'node [fontname="Helvetica", fontsize={SIZE}, shape=box, style=filled, margin="0.05,0.06", '
            "height=0.25, width=0.4];"
        ),
        f'edge [dir=none, color="#444444", fontname="Helvetica", fontsize={SIZE}];',
    ]
    for node in part.nodes:
        lines += _box(node, look, placed, number)
    if look.legend:
        lines += _legend(look, placed, number)
    if look.marks is not None and look.marks.below:
        below = table(
            (html(line, 3 * look.wrap) for line in look.marks.below), space=3, cell='align="left" balign="left"'
        )
        lines += [f"label=<{below}>;", f'labelloc=b; labeljust=l; fontname="Helvetica"; fontsize={SIZE};']
    return "\n".join([f"digraph {title(tree.root)} {{", *(f"  {line}" for line in lines), "}", ""])


def _pos(placed: Placing, x: float, y: float) -> str:
    """Return a position for `neato -n`, whose y axis points up."""
    return f'pos="{x:.1f},{placed.height - y:.1f}!"'


def _box(node: Node, look: Look, placed: Placing, number: Mapping[str, int]) -> Iterator[str]:
    own, marks, part, box = number[node.name], look.marks, placed.view, placed.boxes[node.name]
    faint = marks is not None and node.name not in marks.kept
    bold = "" if marks is None else f', color="{_GREY}", fontcolor="{_GREY}"' if faint else f", {_BOLD}"

    def line(*, marked: bool) -> str:
        if marks is None:
            return ""
        return f'{_BOLD}, color="{_BLACK}"' if marked else f'color="{_GREY}"'

    name = quote(node.name, safe="")
    label = table(_set(*row, node.kind, faint=faint) for row in rows(node, look))
    kinds = " ".join(filter(None, [node.kind and node.kind.value, "condition" * is_condition(node)]))
    kind = f'class="{kinds}", ' if kinds else ""
    known = f'id="node-{name}", {kind}tooltip={title(f"{node.name}  {node_line(node)}".rstrip())}'
    fill, style = _PALE if faint else _FILL[node.kind], "filled,dashed" if is_condition(node) else "filled"
    yield (
        f'n{own} [label=<{label}>, fillcolor="{fill}", style="{style}"{bold}, {known}, '
        f"{_pos(placed, box.x, box.y + box.height / 2)}];"
    )
    if node.gate is None or box.symbol is None:
        return
    at = _pos(placed, box.x, box.symbol.y + box.symbol.height / 2)
    fill, known = _PALE if faint else _GATE, f'id="gate-{name}", class="{node.gate.value}"'
    stem = ", ".join(filter(None, ["weight=8", line(marked=not faint)]))
    hidden = part.folded.get(node.name)
    if hidden is not None:
        outline = f'{_FOLDED.format("width=0.6, ")}, fillcolor="{fill}"'
        yield f"t{own} [label=<{f'+{hidden}' if hidden else '…'}>, {outline}{bold}, {known}, {at}];"
        yield f"n{own} -> t{own} [{stem}];"
        return
    outline = f'{_PILL}, fillcolor="{fill}"'
    yield f"g{own} [label=<{html(gate_text(node), look.wrap)}>, {outline}{bold}, {known}, {at}];"
    yield f"n{own} -> g{own} [{stem}];"
    for position, child in enumerate(node.children):
        looks = [
            line(marked=marks is not None and marks.edge(node.name, child)),
            "minlen=2" if look.stagger and placed.boxes[child].level > box.level + 1 else "",
            f"label=<{turn(node, position)}>" if node.name in part.numbered else "",
        ]
        shown = ", ".join(filter(None, looks))
        yield f"g{own} -> n{number[child]}{f' [{shown}]' if shown else ''};"


def _set(role: Role, lines: list[str], kind: Kind | None, *, faint: bool) -> str:
    text = html_lines(lines)
    if role in _CODE:
        color = _GREY if faint else _CODE[role] if kind is None else _BLACK
        return f'<font color="{color}"><i>{text}</i></font>'
    return f"<b>{text}</b>" if role is Role.BOLD else text


def _legend(look: Look, placed: Placing, number: Mapping[str, int]) -> Iterator[str]:
    deepest = max(placed.boxes.values(), key=lambda box: box.level + (box.node.name in placed.view.folded))
    above = f"{'t' if deepest.node.name in placed.view.folded else 'n'}{number[deepest.node.name]}"
    yield f"e0 [shape=point, style=invis, width=0, {_pos(placed, placed.width, placed.height)}];"
    yield f"{above} -> {'l0' if deepest.x < placed.width / 2 else 'e0'} [style=invis, weight=0];"
    for row, sample in enumerate(placed.samples):
        symbol, meaning = sample.symbol, sample.meaning
        at = _pos(placed, symbol.x, symbol.y + symbol.height / 2)
        yield f"l{row} [label=<{html(symbol.text, 2 * SIZE)}>, {_SAMPLES[sample.sign]}, width=1.05, {at}];"
        at = _pos(placed, meaning.x + text_width(meaning.text) * SIZE / 2, symbol.y + symbol.height / 2)
        yield f"m{row} [label=<{html(meaning.text, 3 * look.wrap)}>, shape=plain, style=solid, {at}];"
        yield f"{{ rank=same; l{row} -> m{row}{'' if row else ' -> e0'} [style=invis]; }}"
        if row:
            yield f"l{row - 1} -> l{row} [style=invis, weight=9];"
