r"""A tree as a graph for Graphviz in the style of fault trees: each node is a box above its gate.

Faults are orange and attacks red, as in the paper; both stay legible in grey prints. Conditions
(guards without event) have a dashed frame. In an SVG, a box has the node's name in `id`, its kind
in `class`, and a tooltip.
"""

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from typing import Final
from urllib.parse import quote

from rvaft.errors import ToolFailed, ToolMissing
from rvaft.export.layout import (
    PLAIN,
    Look,
    Role,
    Sign,
    View,
    gate_text,
    is_condition,
    legend,
    node_line,
    rows,
    turn,
    view,
    wrapped,
)
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
"""The size of text, in points."""
_FILL: Final = {Kind.FAULT: "#fbb659", Kind.ATTACK: "#ee7872", None: "#ffffff"}
_CODE: Final = {Role.EVENT: "#17406d", Role.GUARD: "#6d2a17"}
_GATE, _PALE, _GREY, _BLACK = "#e8eef7", "#f6f6f6", "#b8b8b8", "#000000"
_FOLDED: Final = "shape=triangle, margin=0, fixedsize=true, {}height=0.44"
"""The transfer symbol of fault trees."""
_BOLD: Final = "penwidth=2.5"
_OUTLINES: Final[Mapping[Gate, str]] = {
    Gate.OR: "shape=house, height=0.34",
    Gate.AND: 'shape=box, style="filled,rounded", height=0.28',
    Gate.SAND: "shape=house, orientation=270, height=0.22",
    Gate.SAND_RL: "shape=house, orientation=90, height=0.22",
    Gate.PAND: 'shape=house, orientation=270, height=0.22, style="filled,rounded"',
    Gate.VOT: "shape=hexagon, height=0.28",
}
"""Pointed roof for OR, round for AND, signpost for SAND, round signpost for PAND, hexagon for a
vote.
"""
_SAMPLES: Final[Mapping[Sign | Gate, str]] = {
    Sign.FAULT: f'fillcolor="{_FILL[Kind.FAULT]}"',
    Sign.ATTACK: f'fillcolor="{_FILL[Kind.ATTACK]}"',
    Sign.CONDITION: 'style="filled,dashed", fillcolor="#ffffff"',
    **dict.fromkeys([Sign.FOLDED, Sign.FOLDED_SHARED], f'{_FOLDED.format("")}, fillcolor="{_GATE}"'),
    Sign.ORDER: "shape=plaintext, style=solid",
    Sign.MARKED: f'fillcolor="#ffffff", {_BOLD}',
    **{gate: f'{outline}, fillcolor="{_GATE}", margin="0.06,0.01"' for gate, outline in _OUTLINES.items()},
}
assert set(_OUTLINES) == set(Gate), "every gate has an outline"


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


def notebook_svg(tree: RVAFT) -> str | None:
    """Return a picture of a tree for a notebook; None without Graphviz."""
    try:
        return picture(dot_text(tree), "svg", timeout=20).decode()
    except (ToolMissing, ToolFailed):
        return None


def dot_text(tree: RVAFT, look: Look = PLAIN) -> str:
    """Return the tree in the DOT language; node identifiers contain the top-down number of the
    node.

    With marks, marked parts are bold and the rest grey. Raises `OptionError`.
    """
    part = view(tree, look)
    number = {name: index for index, name in enumerate(tree.order)}
    lines = [
        'graph [margin=0, ordering=out, ranksep=0.25, nodesep=0.1, charset="UTF-8"];',
        (
            f'node [fontname="Helvetica", fontsize={SIZE}, shape=box, style=filled, margin="0.05,0.06", '
            "height=0.25, width=0.4];"
        ),
        f'edge [dir=none, color="#444444", fontname="Helvetica", fontsize={SIZE}];',
    ]
    for node in part.nodes:
        lines += _box(node, tree, look, part, number)
    if look.legend:
        lines += _legend(look, part, number)
    if look.marks is not None and look.marks.below:
        below = table(
            (html(line, 3 * look.wrap) for line in look.marks.below), space=3, cell='align="left" balign="left"'
        )
        lines += [f"label=<{below}>;", f'labelloc=b; labeljust=l; fontname="Helvetica"; fontsize={SIZE};']
    return "\n".join([f"digraph {title(tree.root)} {{", *(f"  {line}" for line in lines), "}", ""])


def _box(node: Node, tree: RVAFT, look: Look, part: View, number: Mapping[str, int]) -> Iterator[str]:
    own, marks = number[node.name], look.marks
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
    yield f'n{own} [label=<{label}>, fillcolor="{fill}", style="{style}"{bold}, {known}];'
    if node.gate is None:
        return
    fill, known = _PALE if faint else _GATE, f'id="gate-{name}", class="{node.gate.value}"'
    stem = ", ".join(filter(None, ["weight=8", line(marked=not faint)]))
    hidden = part.folded.get(node.name)
    if hidden is not None:
        outline = f'{_FOLDED.format("width=0.6, ")}, fillcolor="{fill}"'
        yield f"t{own} [label=<{f'+{hidden}' if hidden else '…'}>, {outline}{bold}, {known}];"
        yield f"n{own} -> t{own} [{stem}];"
        return
    outline = f'{_OUTLINES[node.gate]}, fillcolor="{fill}", margin="0.06,0.01"'
    yield f"g{own} [label=<{html(gate_text(node), look.wrap)}>, {outline}{bold}, {known}];"
    yield f"n{own} -> g{own} [{stem}];"
    for place, child in enumerate(node.children):
        looks = [
            line(marked=marks is not None and marks.edge(node.name, child)),
            "minlen=2" if look.stagger and place % 2 and tree.nodes[child].leaf else "",
            f"label=<{turn(node, place)}>" if node.name in part.numbered else "",
        ]
        shown = ", ".join(filter(None, looks))
        yield f"g{own} -> n{number[child]}{f' [{shown}]' if shown else ''};"


def _set(role: Role, lines: list[str], kind: Kind | None, *, faint: bool) -> str:
    text = html_lines(lines)
    if role in _CODE:
        color = _GREY if faint else _CODE[role] if kind is None else _BLACK
        return f'<font color="{color}"><i>{text}</i></font>'
    return f"<b>{text}</b>" if role is Role.BOLD else text


def _legend(look: Look, part: View, number: Mapping[str, int]) -> Iterator[str]:
    places = {part.nodes[0].name: (0, 0.0, 1.0)}  # level, left edge and share of the width
    for node in part.nodes:
        level, left, width = places[node.name]
        children = part.children(node)
        for index, child in enumerate(children):
            below = level + 1 + (look.stagger and index % 2)
            if child not in places or places[child][0] < below:
                places[child] = (below, left + width * index / len(children), width / len(children))
    deepest = max(part.nodes, key=lambda node: places[node.name][0] + (node.name in part.folded))
    _, left, width = places[deepest.name]
    above = f"{'t' if deepest.name in part.folded else 'n'}{number[deepest.name]}"
    yield "e0 [shape=point, style=invis, width=0];"
    yield f"{above} -> {'l0' if left + width / 2 < 0.5 else 'e0'} [style=invis, weight=0];"
    for place, (sign, sample, meaning) in enumerate(legend(part, look.marks, graph=True)):
        yield f"l{place} [label=<{html(sample, 2 * SIZE)}>, {_SAMPLES[sign]}, width=1.05];"
        yield f"m{place} [label=<{html(meaning, 3 * look.wrap)}>, shape=plain, style=solid];"
        yield f"{{ rank=same; l{place} -> m{place}{'' if place else ' -> e0'} [style=invis]; }}"
        if place:
            yield f"l{place - 1} -> l{place} [style=invis, weight=9];"
