"""A tree as a LaTeX document with the package `forest`, without Graphviz.

`forest` draws trees: a shared node is drawn once in full, and as a dashed reference after that.
"""

from rvaft.drawing.captions import caption, wrapped
from rvaft.model import Kind, Node
from rvaft.printable import visible
from rvaft.tree import RVAFT

WIDTH = 26
"""Columns of text in a box."""

_SPECIAL = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "$": r"\$",
        "&": r"\&",
        "#": r"\#",
        "%": r"\%",
        "_": r"\_",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        '"': r"\textquotedbl{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "-": r"{-}",
        "'": r"\textquotesingle{}",
        "`": r"\textasciigrave{}",
        "→": r"$\rightarrow$",
        "←": r"$\leftarrow$",
    }
)
_FILL = {Kind.FAULT: "fault", Kind.ATTACK: "attack", None: ""}
_HEAD = r"""\documentclass[tikz,border=4pt]{standalone}
% Other scripts than Latin need LuaLaTeX or XeLaTeX and a font that has them.
\usepackage{iftex}
\ifPDFTeX\usepackage[T1]{fontenc}\else\usepackage{fontspec}\fi
\usepackage{textcomp}
\usepackage{forest}
\begin{document}
\begin{forest}
  box/.style={draw, align=center, font=\footnotesize\sffamily, inner sep=3pt},
  gate/.style={draw, rounded corners=4pt, font=\scriptsize\sffamily, inner sep=2pt, fill=blue!8},
  fault/.style={fill=orange!60},
  attack/.style={fill=red!50},
  condition/.style={dashed},
  again/.style={draw, dashed, rounded corners=2pt, font=\scriptsize\sffamily},
  for tree={parent anchor=south, child anchor=north, l sep=8pt, s sep=6pt},
"""
_TAIL = r"""\end{forest}
\end{document}
"""


def tikz_text(tree: RVAFT) -> str:
    """The document."""
    lines: list[str] = []
    drawn: set[str] = set()
    agenda: list[tuple[str, str | None]] = [("", tree.root)]
    while agenda:
        text, name = agenda.pop()
        if name is None:
            lines.append(text)
            continue
        node = tree.nodes[name]
        if name in drawn:
            lines.append(f"[{{{_line(name)}}}, again]")
            continue
        drawn.add(name)
        gate = caption(node).gate
        if gate is None:
            lines.append(f"[{{{_text(node)}}}, {_style(node)}]")
            continue
        lines.append(f"[{{{_text(node)}}}, {_style(node)}")
        lines.append(f"[{{{_line(gate)}}}, gate")
        agenda.append(("]]", None))
        agenda.extend(("", child) for child in reversed(node.children))
    return _HEAD + "\n".join(lines) + "\n" + _TAIL


def escaped(text: str) -> str:
    """The text for LaTeX: no character keeps a special meaning."""
    return visible(text).translate(_SPECIAL)


def _text(node: Node) -> str:
    words = caption(node)
    lines = [rf"\textbf{{{_line(words.name)}}}" if words.label else _line(words.name)]
    if words.label:
        lines += [escaped(line) for line in wrapped(words.label, WIDTH)]
    if words.on is not None:
        lines += [rf"\texttt{{{escaped(line)}}}" for line in wrapped(words.on, WIDTH)]
    if words.when is not None:
        lines += [rf"\textit{{{escaped(line)}}}" for line in wrapped(f"when {words.when}", WIDTH)]
    return r"\\".join(line or "~" for line in lines)


def _line(text: str) -> str:
    return " ".join(escaped(line) for line in text.splitlines())


def _style(node: Node) -> str:
    condition = "condition" if node.leaf and node.on is None and node.when is not None else ""
    return ", ".join(style for style in ("box", _FILL[node.kind], condition) if style)
