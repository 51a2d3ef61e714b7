"""A tree as a LaTeX document with the package `forest`; a shared node is repeated as a small grey
box.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from rvaft.export import latex
from rvaft.export.layout import PLAIN, Look, Role, Sign, View, gate_text, is_condition, legend, rows, view
from rvaft.model.nodes import Gate, Kind
from rvaft.model.tree import RVAFT

_OURS = str.maketrans({"[": "{[}", "]": "{]}", "*": "{*}"})
"""Characters with a meaning in `forest`."""
_BREAK: Final = r"\\"
_FORMS: Final = {
    Role.PLAIN: "{}",
    Role.BOLD: r"\textbf{{{}}}",
    Role.EVENT: r"\textit{{{}}}",
    Role.GUARD: r"\textit{{{}}}",
}
_FILL: Final = {Kind.FAULT: ", fault", Kind.ATTACK: ", attack", None: ""}
_OUTLINES: Final[Mapping[Gate, str]] = {
    Gate.OR: "signal, signal to=north, signal pointer angle=130",
    Gate.AND: "rounded corners=4pt",
    Gate.SAND: "signal, signal to=east",
    Gate.SAND_RL: "signal, signal to=west",
    Gate.PAND: "signal, signal to=east, rounded corners=2pt",
    Gate.VOT: "signal, signal to=east and west",
}
assert set(_OUTLINES) == set(Gate), "every gate has an outline"
_STYLES: Final[Mapping[Sign | Gate, str]] = {
    Sign.FAULT: "box, fault",
    Sign.ATTACK: "box, attack",
    Sign.CONDITION: "box, condition",
    Sign.FOLDED: "folded",
    Sign.FOLDED_SHARED: "folded",
    Sign.AGAIN: "again",
    Sign.MARKED: "box, marked",
    **{gate: f"{gate.replace('_', ' ')} gate" for gate in Gate},
}
_HEAD: Final = (
    r"""\documentclass[tikz,border=4pt]{standalone}
% Other scripts than Latin need LuaLaTeX or XeLaTeX and a font that has them: \setsansfont{...}[Ligatures=TeXOff].
\usepackage{iftex}
\ifPDFTeX\usepackage[T1]{fontenc}\IfFileExists{lmodern.sty}{\usepackage{lmodern}}{}\else\usepackage{fontspec}\fi
\usepackage{textcomp}
\usepackage{forest}
\usetikzlibrary{shapes.geometric,shapes.symbols}
% Styles of TikZ and not of forest: the legend below the tree has them, too.
\tikzset{
  box/.style={draw, align=center, font=\footnotesize\sffamily, inner sep=3pt},
  gate/.style={draw, font=\scriptsize\sffamily, inner sep=2pt, fill=blue!8},
"""
    + "\n".join(f"  {_STYLES[gate]}/.style={{gate, {outline}}}," for gate, outline in _OUTLINES.items())
    + r"""
  folded/.style={gate, isosceles triangle, shape border rotate=90, isosceles triangle apex angle=90, inner sep=1pt},
  fault/.style={fill=orange!60},
  attack/.style={fill=red!50},
  condition/.style={dashed},
  again/.style={draw=black!45, align=center, rounded corners=4pt, font=\scriptsize\sffamily, inner sep=3pt},
  marked/.style={very thick},
  unmarked/.style={draw=black!30, text=black!30, fill=black!3},
}
\begin{document}
\begin{forest}
  for tree={anchor=north, parent anchor=south, child anchor=north, l sep=11pt, s sep=6pt},
"""
)
_TAIL: Final = r"""\end{forest}
\end{document}
"""
_UNDER: Final = r"at ([yshift=-6pt]current bounding box.south west)"


def tikz_text(tree: RVAFT, look: Look = PLAIN) -> str:
    """Return the document; raises `OptionError`."""
    part = view(tree, look)
    return "\n".join([_HEAD + "\n".join(_brackets(tree, look, part)), *_below(look, part), _TAIL])


def _brackets(tree: RVAFT, look: Look, part: View) -> Iterator[str]:
    marks = look.marks

    def edge(*, marked: bool) -> str:
        return "" if marks is None else ", edge={very thick}" if marked else ", edge={draw=black!30}"

    drawn: set[str] = set()
    agenda: list[tuple[str | None, str] | None] = [(None, tree.root)]
    while agenda:
        item = agenda.pop()
        if item is None:
            yield "]]"
            continue
        parent, name = item
        node = tree.nodes[name]
        led = marks is not None and marks.edge(parent, name)
        if name in drawn:
            faint = ", unmarked" if marks is not None and not led else ""
            yield f"[{{{_set(*next(rows(node, look)))}}}, again{faint}{edge(marked=led)}]"
            continue
        drawn.add(name)
        kept = marks is not None and name in marks.kept
        mark = "" if marks is None else ", marked" if kept else ", unmarked"
        styles = f"box{_FILL[node.kind]}{', condition' if is_condition(node) else ''}{mark}{edge(marked=led)}"
        box = f"[{{{_BREAK.join(_set(*row) for row in rows(node, look))}}}, {styles}"
        if node.gate is None:
            yield f"{box}]"
            continue
        yield box
        hidden = part.folded.get(name)
        if hidden is not None:
            count = f"+{hidden}" if hidden else r"\ldots"
            yield f"[{{{count}}}, folded{mark}{edge(marked=kept)}]]"
            continue
        yield f"[{{{_flat(gate_text(node))}}}, {_STYLES[node.gate]}{mark}{edge(marked=kept)}"
        agenda.append(None)
        agenda.extend((name, child) for child in reversed(node.children))


def _below(look: Look, part: View) -> Iterator[str]:
    for text in look.marks.below if look.marks is not None else ():
        yield rf"\node[anchor=north west, font=\footnotesize\sffamily] {_UNDER} {{{_flat(text)}}};"
    if look.legend and (signs := list(legend(part, look.marks, graph=False))):
        yield rf"\matrix[anchor=north west, row sep=2pt, column sep=2pt, ampersand replacement=\&] {_UNDER} {{"
        for sign, sample, meaning in signs:
            label = rf"\node[anchor=base west, font=\footnotesize\sffamily] {{{_flat(meaning)}}};"
            yield rf"\node[{_STYLES[sign]}, anchor=base] {{{_flat(sample)}}}; \& {label} \\"
        yield "};"


def escaped(text: str) -> str:
    """Return the text escaped for a node."""
    return latex.escaped(text).translate(_OURS)


def _set(role: Role, lines: list[str]) -> str:
    return _BREAK.join(_FORMS[role].format(escaped(line) or "~") for line in lines) or "~"


def _flat(text: str) -> str:
    return " ".join(escaped(line) for line in text.splitlines())
