"""Figures with logarithmic axes as PDF and PNG, for print: one panel per gate or tree, one line per language.

Needs Matplotlib. Languages differ by colour, marker and line, so that a grey print tells them apart. A cell without a value has its mark in a strip
above the values, in the row of its language.
"""

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

from rvaft.comparison.panels import Figure, Panel, Point, figures
from rvaft.comparison.rows import Outcome, Row
from rvaft.errors import ToolMissing
from rvaft.printable import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing
    from matplotlib.lines import Line2D


class Width(StrEnum):
    """How wide a figure is: a page of A4 with usual margins, or one of its two columns."""

    PAGE = "page"
    COLUMN = "column"


@dataclass(frozen=True, slots=True)
class _Layout:
    """Lengths in centimetres, sizes of letters in points."""

    width: float
    panels: int
    height: float
    text: float
    rows: int
    slant: float = 0
    """Degrees by which words on the horizontal axis are turned."""


_LAYOUTS: Final = {
    Width.PAGE: _Layout(width=17.4, panels=3, height=4.8, text=8, rows=4),
    Width.COLUMN: _Layout(width=8.5, panels=2, height=3.7, text=7, rows=5, slant=25),
}
_INCH: Final = 2.54
_DPI: Final = 300
_STYLES: Final[tuple[dict[str, Any], ...]] = tuple(
    {
        "color": colour,
        "marker": marker,
        "linestyle": line,
        "fillstyle": fill,
        "markersize": size,
        "linewidth": 0.9,
        "markeredgewidth": 0.8,
    }
    for colour, marker, line, fill, size in (
        ("#000000", "o", "-", "full", 3.0),
        ("#d55e00", "s", "--", "none", 5.0),
        ("#0072b2", "^", "-.", "full", 3.0),
        ("#009e73", "D", ":", "none", 5.0),
        ("#cc79a7", "v", "-", "full", 3.0),
        ("#e69f00", "P", "--", "none", 5.5),
        ("#56b4e9", "X", "-.", "full", 3.5),
    )
)
"""Colour, marker and line of each language in turn; the colours are told apart by nearly everybody.

Every other marker is open and larger, so that the one below it is seen where two lines coincide.
"""
_MARKS: Final = {
    Outcome.NOT_EXPRESSIBLE: "_",
    Outcome.TOO_LARGE: "x",
    Outcome.TIMEOUT: "$T$",
    Outcome.TOOL_MISSING: "+",
    Outcome.FAILED: "*",
}
_STRIP: Final = 0.075
"""How much of the height of a panel each row of marks takes."""


def library() -> ModuleType:
    """Matplotlib; raises `ToolMissing`."""
    try:
        import matplotlib  # noqa: PLC0415 -- an extra
    except ImportError:
        raise ToolMissing("Matplotlib", remedy="pip install 'rvaft[papers]', or leave --plots out") from None
    return matplotlib


def plots(rows: Sequence[Row], width: Width = Width.PAGE) -> Iterator[tuple[str, bytes]]:
    """Each figure as a PDF and as a PNG, with its file name; raises `ToolMissing`."""
    matplotlib = library()
    languages = list(dict.fromkeys(row.language for row in rows))
    layout = _LAYOUTS[width]
    settings = {
        "font.size": layout.text,
        "axes.titlesize": layout.text,
        "axes.labelsize": layout.text,
        "xtick.labelsize": layout.text,
        "ytick.labelsize": layout.text,
        "legend.fontsize": layout.text,
        "axes.linewidth": 0.6,
        "axes.unicode_minus": False,
        "font.family": "DejaVu Sans",
        "pdf.fonttype": 42,
    }
    for page in _pages(rows, layout):
        with matplotlib.rc_context(settings):
            drawing = _drawn(page, languages, layout)
            drawing.draw_without_rendering()  # finds the places of everything, once for both files
            drawing.set_layout_engine("none")
            yield f"{page.name}.pdf", _file(drawing, "pdf", {"CreationDate": None, "Producer": None, "Creator": None})
            yield f"{page.name}.png", _file(drawing, "png", {"Software": None})


def write_plots(rows: Sequence[Row], folder: Path, width: Width = Width.PAGE) -> list[Path]:
    """Write the figures to a folder, which is made where it is not there; raises `ToolMissing`, `OSError`."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, data in plots(rows, width):
        (folder / name).write_bytes(data)
        written.append(folder / name)
    return written


def _pages(rows: Sequence[Row], layout: _Layout) -> Iterator[Figure]:
    """The figures; one with more panels than a page has room for in several parts."""
    room = layout.panels * layout.rows
    for figure in figures(rows):
        parts = [figure.panels[start : start + room] for start in range(0, len(figure.panels), room)]
        for number, panels in enumerate(parts, 1):
            yield Figure(figure.name if len(parts) == 1 else f"{figure.name}-{number}", figure.label, panels)


def _file(drawing: "Drawing", form: str, metadata: dict[str, None]) -> bytes:
    stream = io.BytesIO()
    drawing.savefig(stream, format=form, dpi=_DPI, metadata=metadata)
    return stream.getvalue()


def _drawn(figure: Figure, languages: Sequence[str], layout: _Layout) -> "Drawing":
    from matplotlib.figure import Figure as Drawing  # noqa: PLC0415 -- an extra

    across = min(layout.panels, len(figure.panels))
    down = math.ceil(len(figure.panels) / across)
    legend = _legend(figure, languages)
    legend_rows = math.ceil(len(legend) / _legend_columns(layout))
    below = 0.45 * legend_rows + 0.2
    height = layout.height * down + below
    drawing = Drawing(figsize=(layout.width / _INCH, height / _INCH), layout="constrained")
    grid = drawing.subplots(down, across, sharey=True, squeeze=False)
    places = [axes for line in grid for axes in line]
    bottom, top = _range(figure)
    for axes, panel in zip(places, figure.panels, strict=False):
        _panel(axes, panel, languages, layout)
    rows = max(len(_without(panel)) for panel in figure.panels)
    places[0].set_yscale("log")
    places[0].set_ylim(bottom, top * (top / bottom) ** (rows * _STRIP / (1 - rows * _STRIP)))
    for axes in places[len(figure.panels) :]:
        axes.set_visible(False)
    drawing.supylabel(figure.label, y=(1 + below / height) / 2, fontsize=layout.text)
    drawing.legend(handles=legend, loc="outside lower center", ncols=_legend_columns(layout), frameon=False)
    return drawing


def _legend_columns(layout: _Layout) -> int:
    return 7 if layout.width > 10 else 3


def _range(figure: Figure) -> tuple[float, float]:
    """Powers of ten around all values."""
    values = [point.value for panel in figure.panels for series in panel.series.values() for point in series]
    positive = [value for value in values if value]
    low, high = math.floor(math.log10(min(positive))), math.ceil(math.log10(max(positive)))
    return 10.0**low, 10.0 ** max(high, low + 1)


def _without(panel: Panel) -> list[str]:
    """The languages of a panel that lack a value for a reason."""
    return [name for name, points in panel.series.items() if any(_marked(point) for point in points)]


def _marked(point: Point) -> bool:
    return point.value is None and point.outcome in _MARKS


def _panel(axes: "Axes", panel: Panel, languages: Sequence[str], layout: _Layout) -> None:
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415 -- an extra

    named = bool(panel.ticks)
    for language, points in panel.series.items():
        look = _look(languages, language)
        shift = (languages.index(language) - (len(languages) - 1) / 2) * 0.12 if named else 0.0
        known = [(point.x + shift, point.value or math.nan) for point in points]  # a line ends where a value is missing
        if named:
            look["linestyle"] = "none"
        axes.plot([x for x, _ in known], [y for _, y in known], **look)
    for number, language in enumerate(_without(panel)):
        colour = _look(languages, language)["color"]
        for point in panel.series[language]:
            if _marked(point) and point.outcome is not None:
                place: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "linestyle": "none", "clip_on": False}
                height = 1 - (number + 0.5) * _STRIP
                axes.plot([point.x], [height], marker=_MARKS[point.outcome], color=colour, markersize=4, **place)
    axes.set_title(_fitting(panel.title, layout), parse_math=False)
    axes.set_xlabel(panel.label)
    if named:
        axes.set_xticks(range(len(panel.ticks)), panel.ticks, rotation=layout.slant)
        axes.set_xlim(-0.5, len(panel.ticks) - 0.5)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=7))
    axes.grid(visible=True, axis="y", linewidth=0.3, color="0.8")
    axes.tick_params(which="both", width=0.5)
    axes.tick_params(which="minor", length=1.5)


def _legend(figure: Figure, languages: Sequence[str]) -> "list[Line2D]":
    from matplotlib.lines import Line2D  # noqa: PLC0415 -- an extra

    series = [series for panel in figure.panels for series in panel.series.items()]
    drawn = {name for name, points in series if any(point.value is not None or _marked(point) for point in points)}
    handles = [
        Line2D([], [], label=_drawable(language), **_look(languages, language))
        for language in languages
        if language in drawn
    ]
    met = {point.outcome for _, points in series for point in points if _marked(point)}
    for outcome, mark in _MARKS.items():
        if outcome in met:
            look: dict[str, Any] = {"color": "0.3", "marker": mark, "linestyle": "none", "markersize": 4}
            handles.append(Line2D([], [], label=str(outcome), **look))
    return handles


def _look(languages: Sequence[str], language: str) -> dict[str, Any]:
    return dict(_STYLES[languages.index(language) % len(_STYLES)])


def _fitting(title: str, layout: _Layout) -> str:
    """The end of a title that is too long for its panel: of a path that is what tells trees apart."""
    room = round(layout.width / layout.panels / layout.text * 40)
    text = _drawable(title)
    return text if len(text) <= room else f"…{text[1 - room :]}"


def _drawable(text: str) -> str:
    """The text with what the font does not have written as escapes."""
    from matplotlib.font_manager import FontProperties, findfont, get_font  # noqa: PLC0415 -- an extra

    known = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(c if ord(c) in known else c.encode("unicode_escape").decode() for c in visible(text))
