"""Figures as PDF and PNG, for print: one panel per gate or tree, one line per language. Needs Matplotlib."""

import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

from cross_check.benchmark.measurement import Outcome, Row
from cross_check.benchmark.tables import Width
from rvaft.backend import all_backends
from rvaft.errors import ToolMissing
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing
    from matplotlib.lines import Line2D


# How the plots draw each language, and what stands for a value that is not there.

_STYLES: Final[tuple[Mapping[str, Any], ...]] = tuple(
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
"""Colour, marker and line; the colours are told apart by nearly everybody.

Every other marker is open and larger, so that the one below it is seen where two lines coincide.
"""
_OWN: Final = ("automaton", "ltlf", "rml", "rml-paper", "rml-prolog")
"""Languages whose look is theirs whatever else is installed."""

MARKS: Final[Mapping[Outcome, str]] = {
    Outcome.NOT_EXPRESSIBLE: r"$\mathrm{N}$",
    Outcome.TOO_LARGE: r"$\mathrm{L}$",
    Outcome.TIMEOUT: r"$\mathrm{T}$",
    Outcome.TOOL_MISSING: "+",
    Outcome.FAILED: "*",
}
"""The marker for each way to end without a value."""
OTHER_VERDICTS: Final[Mapping[str, Any]] = {
    "color": "#000000",
    "marker": "o",
    "linestyle": "none",
    "fillstyle": "none",
    "markersize": 8.0,
    "markeredgewidth": 0.6,
}
"""A ring around a value of a text that gives other verdicts than the tree."""


def look(language: str) -> dict[str, Any]:
    """Colour, marker and line of a language: the same in every figure, whoever else is compared."""
    others = sorted({*all_backends(), language} - {*_OWN})
    return dict(_STYLES[[*_OWN, *others].index(language) % len(_STYLES)])


# What the plots show: for each measure the panels of a figure, and in each panel a series of points per language.


@dataclass(frozen=True, slots=True)
class Measure:
    """Something that is measured: its file name, the label of its axis, its value in a row, and how that ended."""

    name: str
    label: str
    value: Callable[[Row], float | None]
    outcome: Callable[[Row], Outcome | None]


def _size(row: Row) -> float | None:
    return row.subformulas if row.subformulas is not None else row.states


def _of_translation(row: Row) -> Outcome | None:
    return row.result


def _of_run(row: Row) -> Outcome | None:
    return row.run if row.result is Outcome.OK else row.result


MEASURES: Final = (
    Measure("symbols", "symbols", lambda row: row.symbols, _of_translation),
    Measure("parts", "subformulas, states or equations", _size, _of_translation),
    Measure("seconds", "seconds to translate", lambda row: row.seconds, _of_translation),
    Measure("speed", "events per second", lambda row: row.events_per_second, _of_run),
    Measure("speed-again", "known events per second", lambda row: row.again_per_second, _of_run),
)


@dataclass(frozen=True, slots=True)
class Point:
    """One cell: its place on the horizontal axis, and a value or how it ended without one.

    `differing` is true where the value is that of a text which gives other verdicts than the tree.
    """

    x: int
    value: float | None
    outcome: Outcome | None
    differing: bool = False

    @property
    def without(self) -> Outcome | None:
        """Why there is no value; None also for what the language does not have at all."""
        return self.outcome if self.value is None and self.outcome is not Outcome.OK else None


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel: `series` has the points of each language; `ticks` names the places where these are no numbers."""

    title: str
    label: str
    series: dict[str, tuple[Point, ...]]
    ticks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Figure:
    """The panels of one figure, which share the vertical axis."""

    name: str
    label: str
    panels: tuple[Panel, ...]

    def points(self, language: str) -> Iterator[Point]:
        """All points of a language."""
        return (point for panel in self.panels for point in panel.series.get(language, ()))

    def languages(self, known: Callable[[Point], object]) -> list[str]:
        """The languages with a point of which this is true, each in the same place in every figure."""
        spoken = sorted({language for panel in self.panels for language in panel.series})
        return [language for language in spoken if any(known(point) for point in self.points(language))]


_TITLES: Final = {
    Gate.OR: "OR",
    Gate.AND: "AND",
    Gate.SAND: "SAND",
    Gate.SAND_RL: "SAND, right to left",
    Gate.VOT: "VOT ⌈n/2⌉ of n",
}


def figures(rows: Sequence[Row]) -> Iterator[Figure]:
    """For each measure a figure of the gates under each semantics, and one of all other trees; those without any value are left out."""
    for measure in MEASURES:
        of_gates = [row for row in rows if row.gate is not None]
        for semantics in dict.fromkeys(row.semantics for row in of_gates):
            chosen = [row for row in of_gates if row.semantics is semantics]
            label = f"{measure.label}, {semantics}"
            yield from _figure(f"gates-{measure.name}-{semantics}", label, list(_gates(chosen, measure)))
        trees = [row for row in rows if row.gate is None]
        yield from _figure(f"trees-{measure.name}", measure.label, list(_trees(trees, measure)))


def _figure(name: str, label: str, panels: list[Panel]) -> Iterator[Figure]:
    points = (point for panel in panels for series in panel.series.values() for point in series)
    if any(point.value is not None for point in points):
        yield Figure(name, label, tuple(panels))


def _gates(rows: Sequence[Row], measure: Measure) -> Iterator[Panel]:
    """A panel per gate over the number of children; VOT has one for thresholds of half of them, and one for all thresholds of the most."""
    for gate in dict.fromkeys(row.gate for row in rows):
        assert gate is not None
        chosen = [row for row in rows if row.gate is gate]
        half = [row for row in chosen if row.threshold in (None, ((row.children or 0) + 1) // 2)]
        yield Panel(_TITLES[gate], "children n", _series(half, measure, lambda row: row.children or 0))
        if gate is Gate.VOT:
            most = max(row.children or 0 for row in chosen)
            whole = [row for row in chosen if row.children == most]
            yield Panel(f"VOT k of {most}", "threshold k", _series(whole, measure, lambda row: row.threshold or 0))


def _trees(rows: Sequence[Row], measure: Measure) -> Iterator[Panel]:
    """A panel per tree over the semantics."""
    order = [choice for choice in Semantics if any(row.semantics is choice for row in rows)]
    for tree, digest in dict.fromkeys((row.tree, row.digest) for row in rows):
        chosen = [row for row in rows if (row.tree, row.digest) == (tree, digest)]
        series = _series(chosen, measure, lambda row: order.index(row.semantics))
        yield Panel(tree, "", series, tuple(order))


def _series(rows: Iterable[Row], measure: Measure, place: Callable[[Row], int]) -> dict[str, tuple[Point, ...]]:
    found: dict[str, list[Point]] = {}
    for row in rows:
        outcome, value = measure.outcome(row), measure.value(row)
        found.setdefault(row.language, []).append(Point(place(row), value, outcome, bool(row.differing)))
    return {language: tuple(sorted(points, key=lambda point: point.x)) for language, points in found.items()}


# One figure with Matplotlib: panels with a logarithmic axis, and above each a strip for what has no value.
#
# Languages differ by colour, marker and line, so that a grey print tells them apart. A cell without a value has its mark in the strip, in a row with the
# name of its language.


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


__all__ = ["Width", "library", "pages", "plots", "write_plots"]

_DPI: Final = 300


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
    layout = LAYOUTS[width]
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
    for page in pages(rows, layout):
        with matplotlib.rc_context():
            matplotlib.rcdefaults()  # not the user's own: the same picture everywhere
            matplotlib.rcParams.update(settings)
            drawing = drawn(page, layout)
            drawing.draw_without_rendering()  # finds the places of everything, once for both files
            drawing.set_layout_engine("none")
            yield f"{page.name}.pdf", _file(drawing, "pdf", {"CreationDate": None, "Producer": None, "Creator": None})
            yield f"{page.name}.png", _file(drawing, "png", {"Software": None})


def write_plots(rows: Sequence[Row], folder: Path, width: Width = Width.PAGE) -> list[Path]:
    """Write the figures to a folder, which is made where it is not there; none where nothing has a value. Raises `ToolMissing`, `OSError`."""
    written = []
    for name, data in plots(rows, width):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
        written.append(folder / name)
    return written


def pages(rows: Sequence[Row], layout: Layout) -> Iterator[Figure]:
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
