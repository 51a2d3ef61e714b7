"""A tree as an SVG: an element for pages that style it by classes, or a document with its own style.

A node is a group of class `node` with its kind and `data-node` (its top-down number); it contains a
`box`, text, a symbol of class `gate` or `leaf`, and for pages an empty text of class `badge`. Edges
have the numbers of their ends in `data-line`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from importlib import import_module
from typing import Any, Final
from urllib.parse import quote

from rvaft.errors import ToolMissing
from rvaft.export import Format
from rvaft.export.layout import PLAIN, Look, Marks, Role, Sign, is_condition, node_line
from rvaft.export.placing import SIZE, Box, Edge, LegendEntry, PlacedSymbol, Placing, Step, Text, place
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

SCREEN: Final = Look(events=True, wrap=20)
CROWDED: Final = Look(events=True, wrap=14, stagger=True)
MANY: Final = 12
_PIXELS: Final = 2
"""Pixels of a PNG for one of the 96 pixels of an inch."""
_CREATED: Final = re.compile(rb"/CreationDate \(D:\d{14}")
"""The creation time of a PDF."""
_PAGE, _SPARE = 12.0, 8.0
"""The size of text on a page, and the additional gap between boxes, in pixels."""
_CLASSES: Final[Mapping[Role, str]] = {Role.PLAIN: "", Role.BOLD: "name", Role.EVENT: "event", Role.GUARD: "guard"}

_LIGHT: Final = {
    "": "fill: #ffffff; stroke: none",
    "text": "fill: #111111",
    ".box": "fill: #ffffff; stroke: #444444",
    ".gate, .leaf": "fill: #e8eef7; stroke: #444444",
    ".fault > .box, .fault > .leaf": "fill: #fbb659",
    ".attack > .box, .attack > .leaf": "fill: #ee7872",
    ".line": "stroke: #444444",
    ".event": "fill: #17406d",
    ".guard": "fill: #6d2a17",
    ".fault > text, .attack > text": "fill: #000000",
    ".kept > path, .kept > rect, .kept.line": "stroke: #000000",
    ".faint > .box, .faint > .gate, .faint > .leaf": "fill: #f6f6f6; stroke: #b8b8b8",
    ".faint > text": "fill: #999999",
    ".faint > .line, .faint.line": "stroke: #c4c4c4",
}
_DARK: Final = {
    "": "fill: #16191d",
    "text": "fill: #e8e8e8",
    ".box": "fill: #22272e; stroke: #a0a8b2",
    ".gate, .leaf": "fill: #2f3a4a; stroke: #a0a8b2",
    ".fault > .box, .fault > .leaf": "fill: #8a5712",
    ".attack > .box, .attack > .leaf": "fill: #8f2f2b",
    ".line": "stroke: #a0a8b2",
    ".event": "fill: #9cc4f5",
    ".guard": "fill: #f2b49f",
    ".fault > text, .attack > text": "fill: #ffffff",
    ".kept > path, .kept > rect, .kept.line": "stroke: #ffffff",
    ".faint > .box, .faint > .gate, .faint > .leaf": "fill: #1b1f24; stroke: #4a5058",
    ".faint > text": "fill: #7d848c",
    ".faint > .line, .faint.line": "stroke: #4a5058",
}
assert set(_LIGHT) == set(_DARK), "every colour is stated for both schemes"
_FORM: Final = {
    "text": f'font-family: Helvetica, Arial, "Liberation Sans", "DejaVu Sans", sans-serif; font-size: {SIZE:g}px; '
    "text-anchor: middle",
    ".start": "text-anchor: start",
    ".end": "text-anchor: end",
    ".name": "font-weight: bold",
    ".event, .guard": "font-style: italic",
    ".line, .inside": "fill: none",
    ".inside": "stroke: #444444",
    ".condition > .leaf, .boxes .condition > .box": "stroke-dasharray: 3 2",
    ".kept > path, .kept > rect, .kept.line": "stroke-width: 2.2",
}


def svg_text(tree: RVAFT, *, badges: bool = False) -> str:
    """Return the tree as an `svg` element, with room for `badges` in the boxes of events.

    >>> import rvaft
    >>> text = svg_text(rvaft.loads('top and a b; a label "<b>";'))
    >>> text.count('class="node'), "&lt;b&gt;" in text
    (3, True)
    """
    look = CROWDED if sum(tree.nodes[name].leaf for name in tree.order) > MANY else SCREEN
    placed = place(tree, look, size=_PAGE, spare=_SPARE, badges=badges)
    size = f'viewBox="0 0 {placed.width:g} {placed.height:g}" width="{placed.width:g}" height="{placed.height:g}"'
    title = escape(visible(f"The tree {tree.root}"))
    drawn = "".join(_drawn(tree, placed, look, badges=badges, ids=False))
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{title}">{drawn}</svg>\n'


def svg_document(tree: RVAFT, look: Look = PLAIN) -> str:
    """Return the tree as a document with a style for light and dark screens; raises `OptionError`.

    With marks, marked parts are bold and the rest grey.

    >>> import rvaft
    >>> 'id="node-a"' in svg_document(rvaft.loads("top and a b;"))
    True
    """
    placed = place(tree, look)
    width, height = f"{placed.width:g}", f"{placed.height:g}"
    name = "rvaft-tree" if look.symbols else "rvaft-tree boxes"
    size = f'viewBox="0 0 {width} {height}" width="{width}pt" height="{height}pt"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="{name}" {size} role="img">',
        f"<title>{escape(visible(tree.root))}</title>",
        f"<style>\n{_style()}</style>",
        f'<rect class="paper" width="{width}" height="{height}"/>',
        *_drawn(tree, placed, look, badges=False, ids=True),
        *_below(placed, boxes=not look.symbols),
        "</svg>",
    ]
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + "\n".join(filter(None, parts)) + "\n"


def notebook_svg(tree: RVAFT) -> str:
    """Return a picture of a tree for a notebook."""
    return svg_document(tree).partition("?>\n")[2]


def rendered(svg: str, form: Format) -> bytes:
    """Return an SVG as `svg`, `pdf` or `png`, reproducibly; raises `ToolMissing`."""
    data = svg.encode("utf-8", errors="replace")
    match form:
        case Format.SVG:
            return data
        case Format.PDF:
            return _CREATED.sub(b"/CreationDate (D:19700101000000", _cairo().svg2pdf(bytestring=data))
        case Format.PNG:
            return bytes(_cairo().svg2png(bytestring=data, scale=_PIXELS))
        case _:
            raise ValueError(f"not a picture: {form}")


def require_pictures(form: Format) -> None:
    """Raise `ToolMissing` unless a picture in this format can be made."""
    if form is not Format.SVG:
        _cairo()


def _cairo() -> Any:
    try:
        return import_module("cairosvg")
    except (ImportError, OSError) as error:  # OSError: the library cairo itself is missing
        remedy = "pip install '.[pictures]' in a checkout of rvaft, or write an .svg file, which needs nothing"
        raise ToolMissing("cairosvg", remedy=remedy) from error


def _style() -> str:
    """Return the style sheet, which applies to this drawing alone."""

    def sheet(rules: Mapping[str, str]) -> Iterator[str]:
        for selectors, rule in rules.items():
            names = ", ".join(f".rvaft-tree {one}" for one in (selectors or ".paper").split(", "))
            yield f"{names.replace('.rvaft-tree .boxes', '.rvaft-tree.boxes')} {{ {rule} }}"

    light, paper = ".rvaft-tree { background: #ffffff }", ".rvaft-tree { background: #16191d }"
    dark = "\n".join(sheet(_DARK))
    inside = ".rvaft-tree .inside { stroke: #e8e8e8 }"
    return "\n".join(
        [
            light,
            *sheet(_FORM),
            *sheet(_LIGHT),
            f"@media (prefers-color-scheme: dark) {{\n{paper}\n{dark}\n{inside}\n}}",
            "",
        ]
    )


def _drawn(tree: RVAFT, placed: Placing, look: Look, *, badges: bool, ids: bool) -> Iterator[str]:
    number = tree.rank
    for edge in placed.edges:
        yield from _edge(edge, number, look.marks)
    for name, box in placed.boxes.items():
        mark = "" if look.marks is None else "kept" if name in look.marks.kept else "faint"
        yield "".join(_node(box, number[name], mark, badge=badges, ids=ids))


def _edge(edge: Edge, number: Mapping[str, int], marks: Marks | None) -> Iterator[str]:
    mark = "" if marks is None else " kept" if marks.edge(edge.parent, edge.child) else " faint"
    ends = f"{number[edge.parent]} {number[edge.child]}"
    yield f'<path class="line{mark}" data-line="{ends}" d="{path_text(edge.path)}"/>'
    if edge.turn is not None:
        yield _text(edge.turn, f"turn {edge.turn.anchor}")


def path_text(path: Iterable[Step]) -> str:
    """Return a path in the notation of SVG."""
    return "".join(f"{letter}{' '.join(f'{one:.1f}' for one in ends)}" for letter, ends in path)


def _node(box: Box, number: int, mark: str, *, badge: bool, ids: bool) -> Iterator[str]:
    node = box.node
    words = ["node", node.kind.value if node.kind else "", "condition" if is_condition(node) else "", mark]
    name = quote(node.name, safe="")
    known = f' id="node-{name}"' if ids else ""
    yield f'<g class="{" ".join(filter(None, words))}"{known} data-node="{number}">'
    yield f"<title>{escape(visible(f'{node.name}  {node_line(node)}'.rstrip()))}</title>"
    if box.symbol is not None:
        foot = box.y + box.height
        yield f'<path class="line stem" d="M{box.x:.1f} {foot:.1f}V{box.symbol.y:.1f}"/>'
        known = f' id="gate-{name}"' if ids and node.gate is not None else ""
        yield from _symbol(box.symbol, "leaf" if node.leaf else f"gate {node.gate or ''}".strip(), known)
    left, size = box.x - box.width / 2, f'width="{box.width:.1f}" height="{box.height:.1f}"'
    yield f'<rect class="box" x="{left:.1f}" y="{box.y:.1f}" {size} rx="3"/>'
    for line in box.lines:
        yield _text(line, _CLASSES[line.role])
    if badge:
        yield f'<text class="badge" x="{box.x:.1f}" y="{box.y + box.height - 7:.1f}"></text>'
    yield "</g>"


def _symbol(symbol: PlacedSymbol, words: str, known: str = "") -> Iterator[str]:
    yield f'<path class="{words}"{known} d="{path_text(symbol.outline())}"/>'
    if inside := symbol.inside():
        yield f'<path class="line inside" d="{path_text(inside)}"/>'
    if symbol.text:
        yield _text(Text(symbol.x, symbol.middle, symbol.text), "gate-text")


_SAMPLES: Final[Mapping[Sign, tuple[str, str]]] = {
    Sign.FAULT: ("fault", "box"),
    Sign.ATTACK: ("attack", "box"),
    Sign.EVENT: ("", "leaf"),
    Sign.CONDITION: ("condition", "leaf"),
    Sign.FOLDED: ("", "gate"),
    Sign.FOLDED_SHARED: ("", "gate"),
    Sign.ORDER: ("", ""),
    Sign.MARKED: ("kept", "box"),
}
assert set(_SAMPLES) == set(Sign), "every sign of the legend has a sample"


def _text(text: Text, words: str) -> str:
    named = f' class="{words}"' if words else ""
    return f'<text{named} x="{text.x:.1f}" y="{text.y:.1f}">{escape(text.text)}</text>'


def _below(placed: Placing, *, boxes: bool) -> Iterator[str]:
    for line in placed.below:
        yield _text(line, line.anchor)
    for sample in placed.samples:
        yield "".join(_sample(sample, boxes=boxes))


def _sample(sample: LegendEntry, *, boxes: bool) -> Iterator[str]:
    sign, symbol = sample.sign, sample.symbol
    kind, shape = ("", "gate") if isinstance(sign, Gate) else _SAMPLES[sign]
    yield f'<g class="{f"sample {kind}".rstrip()}">'
    if sample.drawn:
        yield from _symbol(symbol, "box" if boxes and shape == "leaf" else shape)
    else:
        yield _text(Text(symbol.x, symbol.middle, symbol.text), "gate-text")
    yield f"{_text(sample.meaning, sample.meaning.anchor)}</g>"
