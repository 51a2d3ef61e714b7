"""One figure with Matplotlib: panels with a logarithmic axis, and above each a strip for what has no value.

Languages differ by colour, marker and line, so that a grey print tells them apart. A cell without a value has its mark in the strip, in a row with the
name of its language.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rvaft.comparison.looks import MARKS, OTHER_VERDICTS, look
from rvaft.comparison.panels import Figure, Panel
from rvaft.comparison.width import Width
from rvaft.printable import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing
    from matplotlib.lines import Line2D


@dataclass(frozen=True, slots=True)
class Layout:
    """Lengths in centimetres, sizes of letters in points."""

    width: float
    panels: int
    height: float
    text: float
    rows: int
    slant: float = 0
    """Degrees by which words on the horizontal axis are turned."""


LAYOUTS: Final = {
    Width.PAGE: Layout(width=17.4, panels=3, height=4.8, text=8, rows=3),
    Width.COLUMN: Layout(width=8.5, panels=2, height=3.7, text=7, rows=3, slant=25),
}
_INCH: Final = 2.54
_ROW: Final = 0.34
"""Centimetres of a row of marks in the strip."""
_AROUND: Final = 0.06
"""How much room there is between the values and the frame, as a share of the axis: no marker is cut in half."""
_LONGEST: Final = 12
"""Letters of the name of a language."""


def drawn(figure: Figure, layout: Layout) -> "Drawing":
    """The figure, under whatever settings Matplotlib has."""
    from matplotlib.figure import Figure as Drawing  # noqa: PLC0415 -- an extra

    across = min(layout.panels, len(figure.panels))
    down = math.ceil(len(figure.panels) / across)
    without = figure.languages(lambda point: point.without)
    legend = _legend(figure)
    columns = 6 if layout.width > 10 else 3
    below = 0.45 * math.ceil(len(legend) / columns) + 0.2
    height = (layout.height + len(without) * _ROW) * down + below
    drawing = Drawing(figsize=(layout.width / _INCH, height / _INCH), layout="constrained")
    grid = drawing.subplots(down, across, sharey=True, squeeze=False)
    places = [axes for line in grid for axes in line]
    for number, (axes, panel) in enumerate(zip(places, figure.panels, strict=False)):
        _panel(axes, panel, layout)
        top = _strip(drawing, axes, panel, without, named=number % across == 0) if without else axes
        top.set_title(_fitting(panel.title, layout), parse_math=False)
    _scale(places[0], figure)
    for axes in places[len(figure.panels) :]:
        axes.set_visible(False)
    drawing.supylabel(figure.label, y=(1 + below / height) / 2, fontsize=layout.text)
    drawing.legend(handles=legend, loc="outside lower center", ncols=columns, frameon=False)
    return drawing


def _scale(axes: "Axes", figure: Figure) -> None:
    """Whole powers of ten around all values, and some room; within a single one there are numbers between them."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter  # noqa: PLC0415 -- an extra

    values = [point.value for panel in figure.panels for series in panel.series.values() for point in series]
    logarithms = [math.log10(value) for value in values if value]
    low = math.floor(min(logarithms, default=0))
    high = max(math.ceil(max(logarithms, default=0)), low + 1)
    room = _AROUND * (high - low)
    axes.set_yscale("log")
    axes.set_ylim(10 ** (low - room), 10 ** (high + room))
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high - low == 1 else (1,), numticks=9))
    axes.yaxis.set_major_formatter(LogFormatterSciNotation(labelOnlyBase=False, minor_thresholds=(math.inf, math.inf)))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _panel(axes: "Axes", panel: Panel, layout: Layout) -> None:
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415 -- an extra

    named = bool(panel.ticks)
    languages = sorted(panel.series)
    for number, language in enumerate(languages):
        points = panel.series[language]
        style = look(language)
        shift = (number - (len(languages) - 1) / 2) * 0.12 if named else 0.0
        if named:
            style["linestyle"] = "none"
        known = [(point.x + shift, point.value or math.nan) for point in points]  # a line ends where a value is missing
        axes.plot([x for x, _ in known], [y for _, y in known], **style)
        others = [place for place, point in zip(known, points, strict=True) if point.differing]
        axes.plot([x for x, _ in others], [y for _, y in others], **OTHER_VERDICTS)
    axes.set_xlabel(panel.label)
    if named:
        axes.set_xticks(range(len(panel.ticks)), panel.ticks, rotation=layout.slant)
        axes.set_xlim(-0.5, len(panel.ticks) - 0.5)
    else:
        places = [point.x for points in panel.series.values() for point in points]
        axes.set_xlim(min(places) - 0.6, max(places) + 0.6)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=7))
    axes.grid(visible=True, axis="y", linewidth=0.3, color="0.8")
    axes.tick_params(which="both", width=0.5)
    axes.tick_params(which="minor", length=1.5)


def _strip(drawing: "Drawing", axes: "Axes", panel: Panel, languages: Sequence[str], *, named: bool) -> "Axes":
    """What has no value: a frame of its own above the panel, in which each of these languages has the same row in all panels."""
    from matplotlib.transforms import ScaledTranslation, blended_transform_factory  # noqa: PLC0415 -- an extra

    top = ScaledTranslation(0, 1, axes.transAxes)  # type: ignore[arg-type]  # any transformation will do
    inches = drawing.dpi_scale_trans + top
    place = (0, 0, 1, len(languages) * _ROW / _INCH)
    part = axes.inset_axes(place, sharex=axes, transform=blended_transform_factory(axes.transAxes, inches))
    for row, language in enumerate(languages):
        for point in panel.series.get(language, ()):
            if point.without is not None:
                part.plot([point.x], [row], marker=MARKS[point.without], color=look(language)["color"], markersize=4)
    part.set_ylim(len(languages) - 0.5, -0.5)
    part.set_yticks(range(len(languages)), [_named(language) for language in languages] if named else [])
    part.tick_params(left=False, bottom=False, labelbottom=False, labelleft=named)
    part.set_facecolor("0.95")
    return part


def _legend(figure: Figure) -> "list[Line2D]":
    """The languages that have a value, then what marks mean. A language without any has its name beside the strip."""
    from matplotlib.lines import Line2D  # noqa: PLC0415 -- an extra

    drawn = figure.languages(lambda point: point.value is not None)
    handles = [Line2D([], [], label=_named(language), **look(language)) for language in drawn]
    if figure.languages(lambda point: point.differing and point.value is not None):
        handles.append(Line2D([], [], label="other verdicts", **OTHER_VERDICTS))
    met = {point.without for panel in figure.panels for points in panel.series.values() for point in points}
    for outcome, mark in MARKS.items():
        if outcome in met:
            style: dict[str, Any] = {"color": "0.3", "marker": mark, "linestyle": "none", "markersize": 4}
            handles.append(Line2D([], [], label=str(outcome), **style))
    return handles


def _named(language: str) -> str:
    text = _drawable(language)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _fitting(title: str, layout: Layout) -> str:
    """The end of a title that is too long for its panel: of a path that is what tells trees apart."""
    room = round(layout.width / layout.panels / layout.text * 34)
    text = _drawable(title)
    return text if len(text) <= room else f"…{text[1 - room :]}"


def _drawable(text: str) -> str:
    """The text with what the font does not have written as escapes."""
    from matplotlib.font_manager import FontProperties, findfont, get_font  # noqa: PLC0415 -- an extra

    known = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(c if ord(c) in known else c.encode("unicode_escape").decode() for c in visible(text))
