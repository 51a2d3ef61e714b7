"""A chart of numbers: a curve, or the steps of a front, as an SVG or a LaTeX document with TikZ."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final, NamedTuple

from rvaft.export import PICTURES, Format
from rvaft.export.latex import escaped
from rvaft.export.layout import wrapped
from rvaft.export.svg import rendered
from rvaft.support.terminal import cut, visible

FORMATS: Final = (*PICTURES, Format.TIKZ)
"""The formats of a chart."""
_WIDTH, _PLOT = 400.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 18.0, 44.0, 40.0
_LINE, _COLUMNS = 15.0, 58
_TICKS: Final = 5
_LIGHT: Final = {
    ".paper": "fill: #ffffff",
    "text": "fill: #111111",
    ".grid": "stroke: #dddddd",
    ".axis": "stroke: #444444",
    ".curve": "stroke: #1f5fbf",
    ".point": "fill: #1f5fbf",
}
_DARK: Final = {
    ".paper": "fill: #16191d",
    "text": "fill: #e8e8e8",
    ".grid": "stroke: #3a4048",
    ".axis": "stroke: #a0a8b2",
    ".curve": "stroke: #7fb2ff",
    ".point": "fill: #7fb2ff",
}
assert set(_LIGHT) == set(_DARK), "every colour is stated for both schemes"
_FORM: Final = {
    "text": 'font-family: Helvetica, Arial, "Liberation Sans", "DejaVu Sans", sans-serif; font-size: 12px',
    ".title": "font-weight: bold",
    ".middle": "text-anchor: middle",
    ".end": "text-anchor: end",
    ".curve": "fill: none; stroke-width: 2; stroke-linejoin: round",
}
_TIKZ: Final[dict[str, str]] = {
    "grid": "draw=black!15",
    "axis": "draw=black!75",
    "curve": "draw=blue!70!black, thick",
    "point": "fill=blue!70!black",
}
_ANCHORS: Final[dict[str, str]] = {"middle": "base", "end": "base east", "": "base west"}
_HEAD: Final = r"""\documentclass[tikz,border=2pt]{standalone}
\usepackage{iftex}
\ifPDFTeX\usepackage[T1]{fontenc}\IfFileExists{lmodern.sty}{\usepackage{lmodern}}{}\else\usepackage{fontspec}\fi
\usepackage{textcomp}
\begin{document}
\begin{tikzpicture}[
  x=0.75bp, y=-0.75bp,
  every node/.style={inner sep=0pt, font=\fontsize{9}{11}\selectfont\sffamily},
]"""
_TAIL: Final = r"""\end{tikzpicture}
\end{document}
"""


@dataclass(frozen=True, slots=True)
class Chart:
    """Points over an axis from 0, joined by lines, or by `steps`: a value holds until the next point.

    With `rows`, a text for each point, the points are numbered and their rows are below.
    """

    title: str
    across: str
    up: str
    points: Sequence[tuple[float, float]]
    steps: bool = False
    rows: Sequence[str] = ()


class _Line(NamedTuple):
    style: str
    points: list[tuple[float, float]]


class _Mark(NamedTuple):
    x: float
    y: float


class _Text(NamedTuple):
    x: float
    y: float
    text: str
    anchor: str = ""
    bold: bool = False


def ticks(most: float) -> list[float]:
    """Return round values from 0 to at least `most`, about five.

    >>> ticks(0.163)
    [0.0, 0.05, 0.1, 0.15, 0.2]
    """
    if most <= 0:
        return [0.0, 1.0]
    rough = most / _TICKS
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(one * unit for one in (1, 2, 5, 10) if one * unit >= rough * (1 - 1e-9))
    return [float(f"{step * place:.6g}") for place in range(math.ceil(most / step - 1e-9) + 1)]


def chart_text(chart: Chart, form: Format) -> bytes:
    """Return the chart in one of the `FORMATS`; raises `ToolMissing` for PDF and PNG.

    >>> text = chart_text(Chart("A < B", "t in h", "P", [(0, 0), (1, .5)]), Format.SVG).decode()
    >>> "A &lt; B" in text, text.count('class="curve"')
    (True, 1)
    """
    parts = list(_laid_out(chart))
    return _tikz(parts).encode() if form is Format.TIKZ else rendered(_svg(chart, parts), form)


def _laid_out(chart: Chart) -> Iterator[_Line | _Mark | _Text]:
    right = max((x for x, _ in chart.points), default=0.0)
    columns, rows = ticks(right), ticks(max((y for _, y in chart.points), default=0.0))
    end = columns[-1] if chart.steps else right or columns[-1]
    bottom = _TOP + _PLOT

    def x(value: float) -> float:
        return round(_LEFT + value / end * (_WIDTH - _LEFT - _RIGHT), 2)

    def y(value: float) -> float:
        return round(bottom - value / rows[-1] * _PLOT, 2)

    yield _Text(_LEFT, 15, cut(visible(chart.title), _COLUMNS - 8), bold=True)
    yield _Text(_LEFT, 34, cut(visible(chart.up), _COLUMNS))
    yield _Text(_WIDTH - _RIGHT, bottom + 34, cut(visible(chart.across), _COLUMNS), "end")
    for value in rows:
        yield _Line("grid" if value else "axis", [(x(0), y(value)), (x(end), y(value))])
        yield _Text(_LEFT - 6, y(value) + 4, f"{value:g}", "end")
    for value in (one for one in columns if one <= end * (1 + 1e-9)):
        yield _Line("axis", [(x(value), bottom), (x(value), bottom + 4)])
        yield _Text(x(value), bottom + 17, f"{value:g}", "middle")
    yield _Line("axis", [(x(0), _TOP), (x(0), bottom)])
    yield _Line("curve", list(_path([(x(a), y(b)) for a, b in chart.points], x(end), steps=chart.steps)))
    below = bottom + _BOTTOM + _LINE
    for number, (text, (a, b)) in enumerate(zip(chart.rows, chart.points, strict=False), 1):
        yield _Mark(x(a), y(b))
        yield _Text(x(a) + 5, y(b) - 6, str(number))
        for line in wrapped(f"{number}: {text}", _COLUMNS):
            yield _Text(_LEFT, below, line)
            below += _LINE


def _path(points: Sequence[tuple[float, float]], end: float, *, steps: bool) -> Iterator[tuple[float, float]]:
    before: float | None = None
    for x, y in points:
        if steps and before is not None:
            yield x, before
        yield x, y
        before = y
    if steps and before is not None:
        yield end, before


def _height(parts: Sequence[_Line | _Mark | _Text]) -> float:
    return max(part.y for part in parts if isinstance(part, _Text)) + 8


def _svg(chart: Chart, parts: Sequence[_Line | _Mark | _Text]) -> str:
    def sheet(rules: dict[str, str]) -> str:
        return "\n".join(f".rvaft-chart {name} {{ {rule} }}" for name, rule in rules.items())

    height = f"{_height(parts):g}"
    size = f'width="{_WIDTH:g}" height="{height}"'
    form = f'class="rvaft-chart" viewBox="0 0 {_WIDTH:g} {height}" {size} role="img"'
    dark = f"@media (prefers-color-scheme: dark) {{\n{sheet(_DARK)}\n}}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {form}>',
        f"<title>{escape(visible(chart.title))}</title>",
        f"<style>\n{sheet(_FORM)}\n{sheet(_LIGHT)}\n{dark}\n</style>",
        f'<rect class="paper" {size}/>',
    ]
    for part in parts:
        match part:
            case _Line(style, points):
                steps = " L".join(f"{x:g} {y:g}" for x, y in points)
                lines.append(f'<path class="{style}" d="M{steps}"/>' if points else "")
            case _Mark(x, y):
                lines.append(f'<circle class="point" cx="{x:g}" cy="{y:g}" r="3.5"/>')
            case _Text(x, y, text, anchor, bold):
                names = " ".join(filter(None, ["title" if bold else "", anchor]))
                lines.append(f'<text class="{names}" x="{x:g}" y="{y:g}">{escape(text)}</text>')
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + "\n".join(filter(None, [*lines, "</svg>"])) + "\n"


def _tikz(parts: Sequence[_Line | _Mark | _Text]) -> str:
    lines = [_HEAD]
    for part in parts:
        match part:
            case _Line(style, points):
                steps = " -- ".join(f"({x:g},{y:g})" for x, y in points)
                lines.append(rf"\path[{_TIKZ[style]}] {steps};" if points else "")
            case _Mark(x, y):
                lines.append(rf"\path[{_TIKZ['point']}] ({x:g},{y:g}) circle[radius=2.5bp];")
            case _Text(x, y, text, anchor, bold):
                shown = rf"\textbf{{{escaped(text)}}}" if bold else escaped(text)
                lines.append(rf"\node[anchor={_ANCHORS[anchor]}] at ({x:g},{y:g}) {{{shown}}};")
    return "\n".join(filter(None, [*lines, _TAIL]))
