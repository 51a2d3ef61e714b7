"""A tree as a LaTeX document with TikZ, at the positions of `placing`."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from rvaft.export.latex import escaped
from rvaft.export.layout import PLAIN, Look, Role, Sign, is_condition
from rvaft.export.placing import Box, PlacedSymbol, Placing, Step, Text, place
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT

_FORMS: Final = {
    Role.PLAIN: "{}",
    Role.BOLD: r"\textbf{{{}}}",
    Role.EVENT: r"\textit{{{}}}",
    Role.GUARD: r"\textit{{{}}}",
}
_ANCHORS: Final[Mapping[str, str]] = {"middle": "base", "start": "base west", "end": "base east"}
_SAMPLES: Final[Mapping[Sign, str]] = {
    Sign.FAULT: "box, fault",
    Sign.ATTACK: "box, attack",
    Sign.EVENT: "leaf",
    Sign.CONDITION: "leaf, condition",
    Sign.FOLDED: "gate",
    Sign.FOLDED_SHARED: "gate",
    Sign.ORDER: "",
    Sign.MARKED: "box, marked",
}
assert set(_SAMPLES) == set(Sign), "every sign of the legend has a style"
_HEAD: Final = r"""\documentclass[tikz,border=2pt]{standalone}
% Other scripts than Latin need LuaLaTeX or XeLaTeX and a font that has them: \setsansfont{...}[Ligatures=TeXOff].
\usepackage{iftex}
\ifPDFTeX\usepackage[T1]{fontenc}\IfFileExists{lmodern.sty}{\usepackage{lmodern}}{}\else\usepackage{fontspec}\fi
\usepackage{textcomp}
\begin{document}
\begin{tikzpicture}[
  x=1bp, y=-1bp,
  line/.style={draw=black!75},
  box/.style={draw=black!75, fill=white},
  gate/.style={draw=black!75, fill=blue!8},
  leaf/.style={gate},
  fault/.style={fill=orange!60},
  attack/.style={fill=red!50},
  condition/.style={dashed},
  marked/.style={draw=black, very thick},
  unmarked/.style={draw=black!30, fill=black!3},
  faint/.style={draw=black!30},
  text of/.style={anchor=#1, inner sep=0pt, font=\fontsize{10}{12}\selectfont\sffamily},
]"""
_TAIL: Final = r"""\end{tikzpicture}
\end{document}
"""


def tikz_text(tree: RVAFT, look: Look = PLAIN) -> str:
    """Return the document; raises `OptionError`."""
    placed = place(tree, look)
    return "\n".join([_HEAD, *_drawn(placed, look), *_below(placed, look), _TAIL])


def _drawn(placed: Placing, look: Look) -> Iterator[str]:
    marks = look.marks
    for edge in placed.edges:
        mark = "" if marks is None else ", marked" if marks.edge(edge.parent, edge.child) else ", faint"
        yield _path(f"line{mark}", edge.path)
        if edge.turn is not None:
            yield _text(edge.turn)
    for name, box in placed.boxes.items():
        yield from _node(box, None if marks is None else name in marks.kept)


def _node(box: Box, marked: bool | None) -> Iterator[str]:
    node, symbol = box.node, box.symbol
    kind = f", {node.kind.value}" if node.kind else ""
    mark = "" if marked is None else ", marked" if marked else ", unmarked"
    dashed = ", condition" if is_condition(node) else ""
    if symbol is not None:
        stem: tuple[Step, ...] = (("M", (box.x, box.y + box.height)), ("L", (box.x, symbol.y)))
        yield _path(f"line{mark.replace('unmarked', 'faint')}", stem)
        yield from _symbol(symbol, f"leaf{kind}{dashed}{mark}" if node.leaf else f"gate{mark}", mark=mark)
    yield _path(f"box{kind}{'' if symbol is not None else dashed}{mark}", box.outline())
    for line in box.lines:
        yield _text(line, faint=marked is False)


def _symbol(symbol: PlacedSymbol, style: str, *, mark: str = "") -> Iterator[str]:
    yield _path(style, symbol.outline())
    if inside := symbol.inside():
        yield _path(f"line{mark.replace('unmarked', 'faint')}", inside)
    if symbol.text:
        yield _text(Text(symbol.x, symbol.middle, symbol.text), faint=mark == ", unmarked")


def _path(style: str, path: Iterable[Step]) -> str:
    steps = []
    for letter, ends in path:
        points = [f"({x:.1f},{y:.1f})" for x, y in zip(ends[::2], ends[1::2], strict=True)]
        match letter:
            case "M":
                steps.append(points[0])
            case "L":
                steps.append(f"-- {points[0]}")
            case "C":
                steps.append(f".. controls {points[0]} and {points[1]} .. {points[2]}")
            case _:
                steps.append("-- cycle")
    return rf"\path[{style}] {' '.join(steps)};"


def _text(text: Text, *, faint: bool = False) -> str:
    shown = _FORMS[text.role].format(escaped(text.text))
    grey = ", text=black!40" if faint else ""
    return rf"\node[text of={_ANCHORS[text.anchor]}{grey}] at ({text.x:.1f},{text.y:.1f}) {{{shown}}};"


def _below(placed: Placing, look: Look) -> Iterator[str]:
    for line in placed.below:
        yield _text(line)
    for sample in placed.samples:
        sign, symbol = sample.sign, sample.symbol
        style = "gate" if isinstance(sign, Gate) else _SAMPLES[sign]
        if sample.drawn:
            yield from _symbol(symbol, style.replace("leaf", "leaf" if look.symbols else "box"))
        else:
            yield _text(Text(symbol.x, symbol.middle, symbol.text))
        yield _text(sample.meaning)
