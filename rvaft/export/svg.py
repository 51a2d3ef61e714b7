"""A tree as an SVG for pages, laid out without Graphviz; classes instead of colours.

Nodes are below all their parents, and centred above their own children; a shared node is drawn
once. A node is a group of class `node` with its kind and `data-node` (its top-down number); it
contains a `box`, text, a gate, and an empty text of class `badge`. Lines have the numbers of their
ends in `data-line`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from rvaft.export.layout import Look, Role, View, gate_text, is_condition, node_line, rows, text_columns, turn, view
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

SCREEN: Final = Look(events=True, wrap=20)
CROWDED: Final = Look(events=True, wrap=14, stagger=True)
MANY: Final = 12
_CHARACTER, _LINE, _PAD, _MARGIN = 7.2, 15, 8, 9
"""Width of a character, height of a line, padding, margin."""
_BADGE: Final = 12
"""Characters of a badge, such as `20×, event 7316`, which are narrower."""
_ACROSS, _DOWN, _GATE = 14, 26, 22
"""Gap between boxes, gap below a gate, and its height with the stem."""
_CLASSES: Final[Mapping[Role, str]] = {Role.PLAIN: "", Role.BOLD: "name", Role.EVENT: "event", Role.GUARD: "guard"}


@dataclass(slots=True)
class SvgBox:
    """A drawn node: lines with classes, size, level, and its top centre."""

    node: Node
    lines: Sequence[tuple[str, str]]
    width: float
    height: float
    level: int = 0
    x: float = 0.0
    y: float = 0.0

    @property
    def bottom(self) -> float:
        """The lower end."""
        return self.y + self.height + (_GATE if self.node.gate is not None else 0)


def svg_text(tree: RVAFT, *, badges: bool = False) -> str:
    """Return the tree as an `svg` element, with room for `badges` in the boxes of events.

    >>> import rvaft
    >>> text = svg_text(rvaft.loads('top and a b; a label "<b>";'))
    >>> text.count('class="node'), "&lt;b&gt;" in text
    (3, True)
    """
    look = CROWDED if sum(tree.nodes[name].leaf for name in tree.order) > MANY else SCREEN
    part = view(tree, look)
    boxes = {node.name: _box(node, look, badge=badges and node.has_event) for node in part.nodes}
    width, bottoms = _place(part, look, boxes)
    height = bottoms[-1] + _MARGIN
    number = tree.rank
    lines = "".join(line for node in part.nodes for line in _lines(node, part, boxes, bottoms, number))
    drawn = "".join("".join(_drawn(box, number[name], badge=badges)) for name, box in boxes.items())
    size = f'viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}"'
    title = escape(visible(f"The tree {tree.root}"))
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{title}">{lines}{drawn}</svg>\n'


def _box(node: Node, look: Look, *, badge: bool) -> SvgBox:
    lines = [(_CLASSES[role], line) for role, some in rows(node, look) for line in some]
    widest = max((text_columns(line) for _, line in lines), default=1)
    gate = text_columns(gate_text(node)) + 2
    width = max(widest, gate, _BADGE if badge else 4) * _CHARACTER + 2 * _PAD
    return SvgBox(node, lines, round(width, 1), (len(lines) + badge) * _LINE + 2 * _PAD)


def _place(part: View, look: Look, boxes: Mapping[str, SvgBox]) -> tuple[float, list[float]]:
    """Position all boxes; return width and bottom of each level."""
    above: dict[str, str] = {}
    for node in part.nodes:  # parents first: a shared node goes below its deepest parent
        for place, child in enumerate(part.children(node)):
            lower = look.stagger and place % 2 == 1 and boxes[child].node.leaf
            level = boxes[node.name].level + 1 + lower
            if child not in above or boxes[child].level < level:
                boxes[child].level, above[child] = level, node.name
    own: dict[str, list[str]] = {node.name: [] for node in part.nodes}
    for node in part.nodes:
        own[node.name] = [child for child in dict.fromkeys(part.children(node)) if above[child] == node.name]
    # bottom up: move each subtree close to its left neighbour
    shift: dict[str, float] = {}
    outlines: dict[str, dict[int, tuple[float, float]]] = {}
    for node in reversed(part.nodes):
        box, children = boxes[node.name], own[node.name]
        outline: dict[int, tuple[float, float]] = {}
        for place, child in enumerate(children):
            theirs = outlines.pop(child)
            before = children[place - 1] if place else child
            least = shift.get(before, 0.0) + (boxes[before].width + boxes[child].width) / 4 if place else 0.0
            gaps = [outline[level][1] + _ACROSS - left for level, (left, _) in theirs.items() if level in outline]
            shift[child] = max([least, *gaps])
            for level, (left, right) in theirs.items():
                first = outline[level][0] if level in outline else left + shift[child]
                outline[level] = first, right + shift[child]
        middle = (shift[children[0]] + shift[children[-1]]) / 2 if children else 0.0
        for child in children:
            shift[child] -= middle
        moved = {level: (left - middle, right - middle) for level, (left, right) in outline.items()}
        outlines[node.name] = {**moved, box.level: (-box.width / 2, box.width / 2)}
    leftmost = min(left for left, _ in outlines[part.nodes[0].name].values())
    rightmost = max(right for _, right in outlines[part.nodes[0].name].values())
    heights = [0.0] * (max(box.level for box in boxes.values()) + 1)
    for box in boxes.values():
        heights[box.level] = max(heights[box.level], box.height + _GATE * (box.node.gate is not None))
    tops, bottoms = [float(_MARGIN + 8)], list[float]()
    for height in heights:
        bottoms.append(tops[-1] + height)
        tops.append(bottoms[-1] + _DOWN)
    boxes[part.nodes[0].name].x = _MARGIN - leftmost
    for node in part.nodes:
        box = boxes[node.name]
        box.y = tops[box.level]
        for child in own[node.name]:
            boxes[child].x = box.x + shift[child]
    return round(rightmost - leftmost + 2 * _MARGIN, 1), bottoms


def _lines(
    node: Node, part: View, boxes: Mapping[str, SvgBox], bottoms: Sequence[float], number: Mapping[str, int]
) -> Iterator[str]:
    """Yield the lines to the children, with numbers if their order may be invisible."""
    box, children = boxes[node.name], part.children(node)
    for place, child in enumerate(children):
        below = boxes[child]
        # vertical, a curve between two levels, then vertical
        end, begin = bottoms[box.level], bottoms[box.level] + _DOWN
        bends = f"C{box.x:.1f} {(end + begin) / 2:.1f} {below.x:.1f} {(end + begin) / 2:.1f} {below.x:.1f} {begin:.1f}"
        way = f"M{box.x:.1f} {box.bottom:.1f}V{end:.1f}{bends}V{below.y:.1f}"
        yield f'<path class="line" data-line="{number[node.name]} {number[child]}" d="{way}"/>'
        if node.name in part.numbered:
            # on the side from which the line does not come
            left = box.x > below.x
            x, anchor = below.x + (-4 if left else 4), "end" if left else "start"
            yield f'<text class="turn {anchor}" x="{x:.1f}" y="{below.y - 5:.1f}">{turn(node, place)}</text>'


def _drawn(box: SvgBox, number: int, *, badge: bool) -> Iterator[str]:
    node, left = box.node, box.x - box.width / 2
    words = ["node", node.kind.value if node.kind else "", "condition" if is_condition(node) else ""]
    yield f'<g class="{" ".join(filter(None, words))}" data-node="{number}">'
    yield f"<title>{escape(visible(f'{node.name}  {node_line(node)}'.rstrip()))}</title>"
    if node.gate is not None:
        text, top = gate_text(node), box.y + box.height
        wide = (text_columns(text) + 2) * _CHARACTER
        yield f'<path class="line stem" d="M{box.x:.1f} {top:.1f}v{_GATE}"/>'
        yield (
            f'<rect class="gate" x="{box.x - wide / 2:.1f}" y="{top + 4:.1f}" width="{wide:.1f}" '
            f'height="{_GATE - 4}" rx="9"/>'
        )
        yield f'<text class="gate-text" x="{box.x:.1f}" y="{top + 17:.1f}">{escape(text)}</text>'
    yield f'<rect class="box" x="{left:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" rx="5"/>'
    for place, (word, line) in enumerate(box.lines):
        styled = f' class="{word}"' if word else ""
        y = box.y + _PAD + _LINE * place + 11.5
        yield f'<text{styled} x="{box.x:.1f}" y="{y:.1f}">{escape(visible(line))}</text>'
    yield f'<text class="badge" x="{box.x:.1f}" y="{box.y + box.height - 7:.1f}"></text>' if badge else ""
    yield "</g>"
