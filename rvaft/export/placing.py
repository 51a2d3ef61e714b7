"""The layout of a drawn tree: positions of boxes, symbols, edges and legend, for SVG, TikZ and DOT.

Nodes are below all their parents, and centred above their own children; a shared node is placed
once. Below its box, a node has a symbol of IEC 61025 and NUREG-0492, or a pill with the text of its
gate. An edge ends at the middle of a box; it passes between the boxes of the levels that it
crosses. The y axis points down.
"""

import math
from bisect import bisect
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias, assert_never

from rvaft.export.layout import (
    Look,
    Role,
    Sign,
    View,
    gate_text,
    is_condition,
    legend,
    rows,
    text_columns,
    turn,
    view,
)
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

SIZE: Final = 10.0
"""The size of text, in points; all other lengths are relative to it."""
_LINE, _SIDE, _PAD, _MARGIN, _ACROSS, _DOWN = 1.25, 0.28, 0.35, 0.25, 0.6, 2.0
"""Height of a line, padding of a box beside and above text, margin, gap between boxes and levels."""
_STEM: Final = 0.6
"""Length of the line between a box and its symbol."""
_CROSSING, _MOST = 0.5, 2.0
"""Additional gap above a level for each edge from another node than that above, and the most."""
_BADGE: Final = 12
"""Columns of a badge, such as `20×, event 7316`, which is set smaller."""
_WORK, _FEW = 8_000, 4
"""A staggered layout tries several arrangements of this many nodes together; of single leaves, so many."""
_SAMPLE: Final = 5.2
"""Width of the column of samples in a legend."""
_EMS: Final[Mapping[str, float]] = {
    letter: width
    for width, letters in {
        0.28: "'ijl",
        0.32: " ,.IJ",
        0.36: "/:;\\f|",
        0.40: "()-[]t",
        0.44: "!r",
        0.48: '"',
        0.52: "*_`",
        0.56: "?Lcsz",
        0.60: "Fkvxy",
        0.64: "$0123456789EPSTYabdeghnopqu{}",
        0.68: "K",
        0.72: "ABCRVXZ",
        0.76: "HNU",
        0.80: "&DGOQ",
        0.84: "#+<=>^w~×≥≤≠→←",
        0.88: "M",
        0.96: "%",
        1.00: "@Wm…",
    }.items()
    for letter in letters
}
"""Widths of letters in the widest of the common sans-serif fonts, DejaVu Sans."""
_LETTER, _BOLD = 0.64, 1.13

Step: TypeAlias = tuple[str, tuple[float, ...]]
"""A step of a path as in SVG: `M`, `L`, `C` with absolute coordinates, or `Z`."""


class Text(NamedTuple):
    """A line of text: its middle, or its left or right end, at x; its baseline at y."""

    x: float
    y: float
    text: str
    role: Role = Role.PLAIN
    anchor: str = "middle"


@dataclass(frozen=True, slots=True)
class PlacedSymbol:
    """A symbol: what it means, its text, top centre and size. A `pill` shows the text of a gate."""

    sign: Gate | Sign
    text: str
    x: float
    y: float
    width: float
    height: float
    pill: bool = False

    @property
    def foot(self) -> float:
        """Where the edges to the children start."""
        curved = self.sign in (Gate.OR, Gate.VOT) and not self.pill
        return self.y + self.height * (1 - 0.1875 * curved)

    @property
    def middle(self) -> float:
        """The baseline of the text in the symbol, for text of the size of the drawing."""
        low = {Gate.VOT: 0.64, Gate.OR: 0.64, Sign.FOLDED: 0.88, Sign.FOLDED_SHARED: 0.88}
        return self.y + self.height * (0.7 if self.pill else low.get(self.sign, 0.7))

    def outline(self) -> tuple[Step, ...]:
        """Return the closed outline."""
        x, top, bottom, height = self.x, self.y, self.y + self.height, self.height
        left, right, half = x - self.width / 2, x + self.width / 2, self.y + self.height / 2
        if self.pill:
            return rounded((left, top), (self.width, height), (height / 2, height / 2))
        match self.sign:
            case Gate.AND | Gate.SAND | Gate.SAND_RL | Gate.PAND:
                peak = half - height * 2 / 3
                arch: Step = ("C", (left, peak, right, peak, right, half))
                return ("M", (left, bottom)), ("L", (left, half)), arch, ("L", (right, bottom)), ("Z", ())
            case Gate.OR | Gate.VOT:
                side, low, high = self.width * 0.22, bottom - height * 0.55, top + height * 0.14
                return (
                    ("M", (left, bottom)),
                    ("C", (left, low, x - side, high, x, top)),
                    ("C", (x + side, high, right, low, right, bottom)),
                    ("C", (x + side, bottom - height / 4, x - side, bottom - height / 4, left, bottom)),
                    ("Z", ()),
                )
            case Sign.FOLDED | Sign.FOLDED_SHARED:
                return ("M", (x, top)), ("L", (right, bottom)), ("L", (left, bottom)), ("Z", ())
            case Sign.EVENT | Sign.CONDITION:
                return rounded((left, top), (self.width, height), (self.width / 2, height / 2))
            case Sign.FAULT | Sign.ATTACK | Sign.ORDER | Sign.MARKED:
                return rounded((left, top), (self.width, height), (height / 8, height / 8))
            case _:
                assert_never(self.sign)

    def inside(self) -> tuple[Step, ...]:
        """Return the open lines in the outline: the arrow of SAND, the triangle of PAND."""
        x, bottom, width, height = self.x, self.y + self.height, self.width, self.height
        if self.pill:
            return ()
        if self.sign is Gate.PAND:
            side = width * 0.36
            return ("M", (x - side, bottom)), ("L", (x, self.y + height * 0.16)), ("L", (x + side, bottom))
        if self.sign not in (Gate.SAND, Gate.SAND_RL):
            return ()
        way = 1 if self.sign is Gate.SAND else -1
        long, head, y = way * width * 0.27, way * width * 0.12, self.y + height * 0.6
        shaft: tuple[Step, ...] = (("M", (x - long, y)), ("L", (x + long, y)))
        tip: Step = ("L", (x + long, y))
        return *shaft, ("M", (x + long - head, y - abs(head))), tip, ("L", (x + long - head, y + abs(head)))


@dataclass(frozen=True, slots=True)
class Box:
    """A placed node: its level, top centre and size, lines of text, and symbol."""

    node: Node
    level: int
    x: float
    y: float
    width: float
    height: float
    lines: tuple[Text, ...]
    symbol: PlacedSymbol | None

    @property
    def foot(self) -> float:
        """Where the edges to the children start."""
        return self.symbol.foot if self.symbol is not None else self.y + self.height

    def outline(self) -> tuple[Step, ...]:
        """Return the outline of the box."""
        return rounded((self.x - self.width / 2, self.y), (self.width, self.height), (3, 3))


class Edge(NamedTuple):
    """An edge: its ends, its path, and the position of the child in the order of the gate."""

    parent: str
    child: str
    path: tuple[Step, ...]
    turn: Text | None


class LegendEntry(NamedTuple):
    """An entry of the legend; an entry without outline is a text alone."""

    sign: Sign | Gate
    symbol: PlacedSymbol
    drawn: bool
    meaning: Text


@dataclass(frozen=True, slots=True)
class Placing:
    """A placed tree: parents before children; lines of text below it, a legend, and the size."""

    view: View
    boxes: Mapping[str, Box]
    edges: tuple[Edge, ...]
    below: tuple[Text, ...]
    samples: tuple[LegendEntry, ...]
    width: float
    height: float


@dataclass(slots=True)
class _PlacedNode:
    """A node while it is placed."""

    node: Node
    lines: list[tuple[Role, str]]
    width: float
    height: float
    symbol: PlacedSymbol | None
    spare: float = 0.0
    level: int = 0
    x: float = 0.0
    y: float = 0.0

    @property
    def across(self) -> float:
        """The width of the box with its symbol and its spare room."""
        return max(self.width, self.symbol.width if self.symbol is not None else 0.0) + self.spare


@dataclass(slots=True)
class _Outline:
    """The left and right end of a subtree on each level, relative to `offset`."""

    ends: dict[int, tuple[float, float]]
    offset: float = 0.0


def rounded(corner: tuple[float, float], size: tuple[float, float], radii: tuple[float, float]) -> tuple[Step, ...]:
    """Return a rectangle with round corners, or an ellipse where the radii are half its size."""
    (left, top), (width, height), (across, down) = corner, size, radii
    right, bottom, near, low = left + width, top + height, across * 0.4477, down * 0.4477
    return (
        ("M", (left + across, top)),
        ("L", (right - across, top)),
        ("C", (right - near, top, right, top + low, right, top + down)),
        ("L", (right, bottom - down)),
        ("C", (right, bottom - low, right - near, bottom, right - across, bottom)),
        ("L", (left + across, bottom)),
        ("C", (left + near, bottom, left, bottom - low, left, bottom - down)),
        ("L", (left, top + down)),
        ("C", (left, top + low, left + near, top, left + across, top)),
        ("Z", ()),
    )


def text_width(text: str, *, bold: bool = False) -> float:
    """Return the width of a text, relative to its size.

    >>> text_width("ill") < text_width("own") < text_width("own", bold=True)
    True
    """
    width = sum(_EMS.get(one, _LETTER) if one < "\u2e80" else 1.05 * text_columns(one) / 2 for one in text)
    return width * (_BOLD if bold else 1)


def place(tree: RVAFT, look: Look, *, size: float = SIZE, spare: float = 0.0, badges: bool = False) -> Placing:
    """Return the layout of a tree with room for `badges` in the boxes of events.

    `size` is that of text, and `spare` an additional gap between boxes.

    Raises `OptionError`.
    """
    part = view(tree, look)
    drafts = {node.name: _draft(node, part, look, size, badge=badges and node.has_event) for node in part.nodes}
    for draft in drafts.values():
        draft.spare = spare
    width, tops, bottoms = _spread(part, look, drafts, size)
    boxes = {name: _boxed(draft, size) for name, draft in drafts.items()}
    marks = look.marks  # marked edges are drawn last, over the others of their gates
    edges = sorted(
        _edges(part, boxes, tops, bottoms, size), key=lambda one: bool(marks and marks.edge(one.parent, one.child))
    )
    below, samples, bottom = _foot(part, look, max(bottoms), size)
    ends = [text.x + text_width(text.text) * size for text in (*below, *(one.meaning for one in samples))]
    return Placing(
        part,
        boxes,
        tuple(edges),
        below,
        samples,
        round(max([width, *(end + _MARGIN * size for end in ends)]), 1),
        round(bottom + _MARGIN * size, 1),
    )


def _draft(node: Node, part: View, look: Look, size: float, *, badge: bool) -> _PlacedNode:
    lines = [(role, visible(line)) for role, some in rows(node, look) for line in some]
    widest = max((text_width(line, bold=role is Role.BOLD) for role, line in lines), default=1.0)
    width = max(widest, _BADGE * _LETTER if badge else 2.0) + 2 * _SIDE
    symbol = _symbol(node, part, look, size)
    return _PlacedNode(node, lines, round(width * size, 1), ((len(lines) + badge) * _LINE + 2 * _PAD) * size, symbol)


def _symbol(node: Node, part: View, look: Look, size: float) -> PlacedSymbol | None:
    hidden = part.folded.get(node.name)
    if node.gate is not None and hidden is not None:
        text = f"+{hidden}" if hidden else "…"
        return sign_symbol(Sign.FOLDED if hidden else Sign.FOLDED_SHARED, text, size)
    if node.gate is not None:
        return gate_symbol(node.gate, gate_text(node), size, pill=not look.symbols)
    if not look.symbols:
        return None
    return sign_symbol(Sign.CONDITION if is_condition(node) else Sign.EVENT, "", size)


def gate_symbol(gate: Gate, text: str, size: float, *, pill: bool) -> PlacedSymbol:
    """Return the symbol of a gate at the origin."""
    if pill:
        return PlacedSymbol(gate, text, 0, 0, (text_width(text) + 1.4) * size, 1.6 * size, pill=True)
    shown = text.partition(" ")[2] if gate is Gate.VOT else ""
    return PlacedSymbol(gate, shown, 0, 0, max(3.0, (text_width(shown) + 1.3)) * size, 2.5 * size)


def sign_symbol(sign: Sign, text: str, size: float) -> PlacedSymbol:
    """Return a symbol other than a gate at the origin."""
    match sign:
        case Sign.EVENT:
            width, height = 1.9, 1.9
        case Sign.CONDITION:
            width, height = 3.2, 1.7
        case Sign.FOLDED | Sign.FOLDED_SHARED:
            width, height = max(3.6, 1.8 * text_width(text) + 1), 2.5
        case Sign.FAULT | Sign.ATTACK | Sign.ORDER | Sign.MARKED:
            width, height = text_width(text) + 1, 1.6
        case _:
            assert_never(sign)
    return PlacedSymbol(sign, text, 0, 0, width * size, height * size)


def _moved(symbol: PlacedSymbol, x: float, y: float) -> PlacedSymbol:
    return PlacedSymbol(symbol.sign, symbol.text, x, y, symbol.width, symbol.height, symbol.pill)


def _levels(part: View, lowered: Collection[str], drafts: Mapping[str, _PlacedNode]) -> dict[str, list[str]]:
    """Set the levels; return the children of each node that are placed below it."""
    above: dict[str, str] = {}
    for draft in drafts.values():
        draft.level = 0
    for node in part.nodes:  # parents first: a shared node goes below its deepest parent
        for child in part.children(node):
            level = drafts[node.name].level + 1 + (child in lowered)
            if child not in above or drafts[child].level < level:
                drafts[child].level, above[child] = level, node.name
    return {
        node.name: [child for child in dict.fromkeys(part.children(node)) if above[child] == node.name]
        for node in part.nodes
    }


def _lowered(part: View, drafts: Mapping[str, _PlacedNode], size: float) -> Collection[str]:
    """Return the leaves to lower by a level: per gate every other one, one, or none, for the least width."""
    choices: dict[str, list[frozenset[str]]] = {}
    for node in part.nodes:
        children = part.children(node)
        leaves = [frozenset(one for one in children[start::2] if drafts[one].node.leaf) for start in (1, 0)]
        single = [frozenset([one]) for one in children if drafts[one].node.leaf][:_FEW]
        choices[node.name] = [*leaves, frozenset(), *single] if any(leaves) else []
    chosen = {name: some[0] for name, some in choices.items() if some}

    def width() -> float:
        return _across(part, _levels(part, frozenset().union(*chosen.values()), drafts), drafts, size)[0]

    tried = list(chosen)[: _WORK // len(part.nodes)]
    for name in tried:
        widths = []
        for choice in choices[name]:
            chosen[name] = choice
            widths.append(width())
        chosen[name] = choices[name][widths.index(min(widths))]
    least = width()
    for name in tried:  # siblings stay at one height where that costs nothing
        kept, chosen[name] = chosen[name], frozenset()
        if width() > least:
            chosen[name] = kept
    return frozenset().union(*chosen.values())


def _across(
    part: View, own: Mapping[str, Sequence[str]], drafts: Mapping[str, _PlacedNode], size: float
) -> tuple[float, float, dict[str, float]]:
    """Return the width, the place of the root, and the distance of each node from that above it."""
    shift: dict[str, float] = {}
    outlines: dict[str, _Outline] = {}
    for node in reversed(part.nodes):  # bottom up: move each subtree close to its left neighbour
        draft, children = drafts[node.name], own[node.name]
        outline = _Outline({})
        for position, child in enumerate(children):
            shift[child] = _distance(outline, outlines[child], size)
            if position:
                before = children[position - 1]
                shift[child] = max(shift[child], shift[before] + (drafts[before].across + drafts[child].across) / 4)
            outline = _joined(outline, outlines.pop(child), shift[child])
        middle = (shift[children[0]] + shift[children[-1]]) / 2 if children else 0.0
        for child in children:
            shift[child] -= middle
        outline.offset -= middle
        left, right = -draft.across / 2 - outline.offset, draft.across / 2 - outline.offset
        outline.ends[draft.level] = left, right
        outlines[node.name] = outline
    whole = outlines[part.nodes[0].name]
    leftmost = min(left for left, _ in whole.ends.values()) + whole.offset
    rightmost = max(right for _, right in whole.ends.values()) + whole.offset
    return rightmost - leftmost + 2 * _MARGIN * size, _MARGIN * size - leftmost, shift


def _spread(
    part: View, look: Look, drafts: Mapping[str, _PlacedNode], size: float
) -> tuple[float, list[float], list[float]]:
    """Position all boxes; return the width, and the top and bottom of each level."""
    own = _levels(part, _lowered(part, drafts, size) if look.stagger else (), drafts)
    width, root, shift = _across(part, own, drafts, size)
    crossing = Counter(
        drafts[child].level for node in part.nodes for child in set(part.children(node)).difference(own[node.name])
    )
    tops, bottoms = _heights(drafts, crossing, size)
    drafts[part.nodes[0].name].x = root
    for node in part.nodes:
        draft = drafts[node.name]
        draft.y = tops[draft.level]
        for child in own[node.name]:
            drafts[child].x = draft.x + shift[child]
    return width, tops, bottoms


def _distance(left: _Outline, right: _Outline, size: float) -> float:
    """Return how far to move a subtree to the right of others."""
    few, many = sorted((left.ends, right.ends), key=len)
    gaps = [
        left.ends[level][1] + left.offset + _ACROSS * size - right.ends[level][0] - right.offset
        for level in few
        if level in many
    ]
    return max(gaps, default=0.0)


def _joined(left: _Outline, right: _Outline, shift: float) -> _Outline:
    """Return the outline of subtrees side by side; the longer one is changed, the other is spent."""
    right.offset += shift
    if len(left.ends) < len(right.ends):
        for level, (first, last) in left.ends.items():
            ends = first + left.offset - right.offset, last + left.offset - right.offset
            right.ends[level] = ends[0], right.ends[level][1] if level in right.ends else ends[1]
        return right
    for level, (first, last) in right.ends.items():
        ends = first + right.offset - left.offset, last + right.offset - left.offset
        left.ends[level] = left.ends[level][0] if level in left.ends else ends[0], ends[1]
    return left


def _heights(
    drafts: Mapping[str, _PlacedNode], crossing: Mapping[int, int], size: float
) -> tuple[list[float], list[float]]:
    """Return the top and the bottom of each level."""
    heights = [0.0] * (max(draft.level for draft in drafts.values()) + 1)
    for draft in drafts.values():
        symbol = _STEM * size + draft.symbol.height if draft.symbol is not None else 0.0
        heights[draft.level] = max(heights[draft.level], draft.height + symbol)
    tops, bottoms = [_MARGIN * size], list[float]()
    for level, height in enumerate(heights, 1):
        bottoms.append(tops[-1] + height)
        tops.append(bottoms[-1] + (_DOWN + min(_CROSSING * crossing.get(level, 0), _MOST)) * size)
    return tops, bottoms


def _boxed(draft: _PlacedNode, size: float) -> Box:
    x, y = round(draft.x, 1), round(draft.y, 1)
    lines = tuple(
        Text(x, round(y + (_PAD + _LINE * number + 0.95) * size, 1), line, role)
        for number, (role, line) in enumerate(draft.lines)
    )
    symbol = draft.symbol
    if symbol is not None:
        symbol = _moved(symbol, x, round(y + draft.height + _STEM * size, 1))
    return Box(draft.node, draft.level, x, y, draft.width, round(draft.height, 1), lines, symbol)


def _edges(
    part: View, boxes: Mapping[str, Box], tops: Sequence[float], bottoms: Sequence[float], size: float
) -> Iterator[Edge]:
    """Yield the edges: curves between levels, vertical beside the boxes of a level."""
    taken: list[list[tuple[float, float]]] = [[] for _ in bottoms]
    for box in boxes.values():
        across = max(box.width, box.symbol.width if box.symbol is not None else 0.0) / 2
        taken[box.level].append((box.x - across, box.x + across))
    gaps = [_gaps(level, size) for level in taken]
    numbers: list[Text] = []
    for node in part.nodes:
        above = boxes[node.name]
        for position, child in enumerate(part.children(node)):
            below, x = boxes[child], above.x
            path: list[Step] = [("M", (x, above.foot)), ("L", (x, bottoms[above.level]))]
            came = x
            for level in range(above.level + 1, below.level + 1):
                wanted = x + (below.x - x) / (below.level - level + 1)
                beside = below.x if level == below.level else _free(gaps[level], wanted, below.x)
                bend = (bottoms[level - 1] + tops[level]) / 2
                path.append(("C", (x, bend, beside, bend, beside, tops[level])))
                came, x = x, beside
                if level < below.level:
                    path.append(("L", (x, bottoms[level])))
            numbered = None
            if node.name in part.numbered:
                ends = (came, bottoms[below.level - 1], below.x, below.y)
                numbered = _numbered(str(turn(node, position)), ends, numbers, size)
                numbers.append(numbered)
            yield Edge(node.name, child, tuple(path), numbered)


def _numbered(text: str, ends: tuple[float, float, float, float], others: Sequence[Text], size: float) -> Text:
    """Return a number above the middle of the last curve of an edge, or beside the middle."""
    start, top, end, bottom = ends
    left = start > end
    places = []
    for part in (0.5, 0.35, 0.65, 0.25, 0.75):
        share = 3 * part**2 * (1 - part) + part**3
        x = start + (end - start) * share + (-0.3 if left else 0.3) * size
        y = top + (bottom - top) * (1.5 * part * (1 - part) + part**3) - 0.15 * size
        places.append(Text(x, y, text, anchor="end" if left else "start"))
    free = (one for one in places if all(abs(one.x - two.x) > size or abs(one.y - two.y) > size for two in others))
    return next(free, places[0])


def _gaps(taken: Iterable[tuple[float, float]], size: float) -> list[tuple[float, float]]:
    """Return where an edge may pass the boxes of a level, from left to right."""
    room, end, gaps = _ACROSS * size / 2 - 0.1, -math.inf, []
    for first, last in sorted(taken):
        if end <= first - room:
            gaps.append((end, first - room))
        end = max(end, last + room)
    return [*gaps, (end, math.inf)]


def _free(gaps: Sequence[tuple[float, float]], wanted: float, target: float) -> float:
    """Return the target if it is in a gap, else the place in a gap that is nearest to the wanted one."""
    after = bisect(gaps, (target, math.inf))
    if after and target <= gaps[after - 1][1]:
        return target
    after = bisect(gaps, (wanted, math.inf))
    near = [min(max(wanted, first), last) for first, last in gaps[max(0, after - 1) : after + 1]]
    return min(near, key=lambda one: abs(one - wanted))


def _foot(
    part: View, look: Look, bottom: float, size: float
) -> tuple[tuple[Text, ...], tuple[LegendEntry, ...], float]:
    """Return the lines below the tree, the legend, and the bottom of both."""
    below, samples, left = [], [], _MARGIN * size
    for line in look.marks.below if look.marks is not None else ():
        bottom += _LINE * size
        below.append(Text(left, bottom + 0.6 * size, visible(line), anchor="start"))
    if below:
        bottom += 0.6 * size
    for sign, sample, meaning in legend(part, look.marks, symbols=look.symbols) if look.legend else ():
        pill = not look.symbols
        if isinstance(sign, Gate):
            symbol = gate_symbol(sign, sample, size, pill=pill)
        elif sign is Sign.CONDITION and not look.symbols:
            symbol = PlacedSymbol(sign, sample, 0, 0, (text_width(sample) + 1) * size, 1.6 * size)
        else:
            symbol = sign_symbol(sign, "" if sign is Sign.CONDITION else sample, size)
        symbol = _moved(symbol, left + _SAMPLE / 2 * size + pill * size, bottom + 0.7 * size)
        bottom += symbol.height + 0.7 * size
        word = f"{sample.split()[0]}: {meaning}" if isinstance(sign, Gate) and look.symbols else meaning
        middle = symbol.y + symbol.height / 2 + 0.35 * size
        said = Text(left + (_SAMPLE + 0.8 + 2 * pill) * size, middle, word, anchor="start")
        samples.append(LegendEntry(sign, symbol, sign is not Sign.ORDER, said))
    return tuple(below), tuple(samples), bottom
