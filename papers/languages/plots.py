"""Figures as PDF and PNG: one panel per gate or tree, one line per language. Needs Matplotlib."""

import io
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import PurePath
from textwrap import fill
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from cross_check.results import DETECTIONS_ONLY
from papers.languages.measurement import Measurement, Outcome
from papers.languages.tables import Width, unable
from rvaft.errors import installed
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import cut, visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LOOK: Final = ("color", "marker", "linestyle", "fillstyle", "markersize")
_STYLES: Final = {
    "automaton": ("#000000", "o", "-", "full", 3.0),
    "ltlf": ("#d55e00", "s", "--", "none", 5.0),
    "rml": ("#0072b2", "^", "-.", "full", 3.0),
    "rml-paper": ("#009e73", "D", ":", "none", 5.0),
    "rml-prolog": ("#cc79a7", "v", "-", "full", 3.0),
    "sql": ("#e69f00", "P", "--", "none", 5.5),
    "sigma": ("#56b4e9", "X", "-.", "full", 4.0),
    "stix": ("#882255", "p", ":", "none", 5.5),
    "eql": ("#117733", "<", "-", "full", 3.5),
    "kql": ("#4477aa", "4", "-.", "none", 6.0),
    "mfotl": ("#332288", "*", "--", "none", 6.5),
    "mtl": ("#999933", ">", "-.", "full", 3.5),
    "mtl-r2u2": ("#661100", "d", ":", "none", 5.5),
    "match-recognize": ("#aa4499", "h", "-", "full", 4.0),
    "sql-duckdb": ("#ddcc77", "8", "--", "none", 5.0),
    "sql-postgres": ("#44aa99", "H", "-.", "full", 4.0),
    "": ("#777777", "|", "-", "full", 6.0),
}
"""Styles of languages, also distinguishable in grey and for colour-blind readers.

Every second marker is open and larger, so that markers below it remain visible.
"""
_LETTERS: Final = dict(zip(list(Outcome)[1:], "NLT+*", strict=True))
"""The letters above a panel for each outcome without a value."""
_RING: Final[dict[str, Any]] = dict(zip(_LOOK, ("black", "o", "none", "none", 8.0), strict=True))
"""A ring around the value of a text with other verdicts than the tree's."""
_SETTINGS: Final = {
    "font.family": "DejaVu Sans",  # part of matplotlib: the same everywhere
    "axes.titlesize": "medium",
    "axes.linewidth": 0.6,
    "lines.linewidth": 0.9,
    "lines.markeredgewidth": 0.8,
    "pdf.fonttype": 42,  # TrueType outlines; some publishers reject type 3
}
_SILENT: Final = {"pdf": dict.fromkeys(("CreationDate", "Producer", "Creator")), "png": {"Software": None}}
_ROWS: Final = 3  # rows of panels in one figure
_LETTER: Final = 8.5  # points between lines of letters

Value = Callable[[Measurement], float | None]
MEASURES: Final[Mapping[str, tuple[str, Value]]] = {
    "symbols": ("symbols", lambda row: row.symbols),
    "parts": (
        "subformulas, atoms, states or equations",
        lambda row: row.states if row.subformulas is None else row.subformulas,
    ),
    "seconds": ("seconds to translate", lambda row: row.seconds),
    "speed": ("events per second", lambda row: row.events_per_second),
    "speed-again": ("known events per second", lambda row: row.again_per_second),
}


class Panel(NamedTuple):
    """The measurements of one panel by horizontal position; `ticks` names positions that are not
    numbers.
    """

    title: str
    label: str
    points: Sequence[tuple[int, Measurement]]
    ticks: Sequence[str] = ()


class Plot(NamedTuple):
    """The panels of one figure with a shared vertical axis, and the plotted value."""

    name: str
    label: str
    panels: Sequence[Panel]
    value: Value

    @property
    def rows(self) -> list[Measurement]:
        """The measurements of all panels."""
        return [row for panel in self.panels for _, row in panel.points]

    def of(self, languages: Collection[str]) -> "Plot":
        """Return the plot for these languages only."""
        panels = [
            panel._replace(points=[(x, row) for x, row in panel.points if row.language in languages])
            for panel in self.panels
        ]
        return self._replace(panels=panels)

    def lost(self, row: Measurement) -> str:
        """Return the letter for a missing value, or an empty string."""
        return "" if self.value(row) is not None or row.ended is None else _LETTERS.get(row.ended, "")


def figures(rows: Sequence[Measurement]) -> Iterator[Plot]:
    """Yield per measure a figure of the gates per semantics, and one of the other trees, if not
    empty.
    """
    gates = {
        semantics: list(_gates([row for row in rows if row.gate is not None and row.semantics is semantics]))
        for semantics in dict.fromkeys(row.semantics for row in rows)
    }
    trees = list(_trees([row for row in rows if row.gate is None]))
    for name, (label, value) in MEASURES.items():
        found = [Plot(f"gates-{name}-{one}", f"{label}, {one}", panels, value) for one, panels in gates.items()]
        found.append(Plot(f"trees-{name}", label, trees, value))
        yield from (plot for plot in found if any(value(row) is not None for row in plot.rows))


def _gates(rows: Sequence[Measurement]) -> Iterator[Panel]:
    """Yield a panel per gate over the number of children; for VOT one at half, and one over all
    thresholds.
    """
    for gate in dict.fromkeys(row.gate for row in rows):
        title = str(gate).upper().replace("_RL", ", right to left")
        chosen = [(row.children or 0, row) for row in rows if row.gate is gate]
        voting = any(row.threshold for _, row in chosen)
        half = [(n, row) for n, row in chosen if row.threshold in (None, (n + 1) // 2)]
        yield Panel(title + " ⌈n/2⌉ of n" * voting, "children n", half)
        if voting:
            most = max(n for n, _ in chosen)
            yield Panel(
                f"{title} k of {most}", "threshold k", [(row.threshold or 0, row) for n, row in chosen if n == most]
            )


def _trees(rows: Sequence[Measurement]) -> Iterator[Panel]:
    """Yield a panel per tree over the semantics, titled by file name."""
    order = [choice for choice in Semantics if any(row.semantics is choice for row in rows)]
    for tree, digest in dict.fromkeys((row.tree, row.digest) for row in rows):
        points = [(order.index(row.semantics), row) for row in rows if (row.tree, row.digest) == (tree, digest)]
        yield Panel(PurePath(tree).stem.replace("_", " "), "", points, order)


def library(otherwise: str = "") -> Any:
    """Return Matplotlib; raises `ToolMissing` with `otherwise` as an alternative."""
    parts = (".figure", ".font_manager", ".lines", ".ticker", "")
    *_, found = [
        installed(f"matplotlib{part}", "Matplotlib", f"pip install '.[papers]' in a checkout{otherwise}")
        for part in parts
    ]
    return found


@contextmanager
def style(**settings: Any) -> Iterator[ModuleType]:
    """Apply fixed Matplotlib settings, independent of the user's; raises `ToolMissing`."""
    matplotlib = library()
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**_SETTINGS, **settings})
        yield matplotlib


def saved(drawing: "Figure") -> Iterator[tuple[str, bytes]]:
    """Yield the figure as PDF and PNG, with reproducible bytes."""
    for form, silent in _SILENT.items():
        stream = io.BytesIO()
        drawing.savefig(stream, format=form, dpi=300, metadata=silent)
        yield form, stream.getvalue()


def plots(rows: Sequence[Measurement], width: Width = Width.PAGE) -> Iterator[tuple[str, bytes]]:
    """Yield each figure as PDF and PNG with its file name; raises `ToolMissing`."""
    size, across = (8, 3) if width is Width.PAGE else (7, 2)
    for figure in figures(rows):
        parts = range(0, len(figure.panels), across * _ROWS)
        for number, start in enumerate(parts, 1):
            name = figure.name if len(parts) == 1 else f"{figure.name}-{number}"
            with style(**{"font.size": size}):
                drawing = _drawn(figure._replace(panels=figure.panels[start : start + across * _ROWS]), width, across)
                yield from ((f"{name}.{form}", data) for form, data in saved(drawing))


def _drawn(plot: Plot, width: Width, across: int) -> "Figure":
    matplotlib = library()
    across = min(across, len(plot.panels))
    down = math.ceil(len(plot.panels) / across)
    mute = unable(plot.rows)
    valued = {row.language for row in plot.rows if plot.value(row) is not None}
    lacking = {row.language for row in plot.rows if plot.lost(row)} - {*mute}
    seen = valued | (lacking - {row.language for row in plot.rows if row.only_emitted})
    plot = plot.of(seen)
    languages = sorted(seen)
    lost = [name for name in languages if any(plot.lost(row) for row in plot.rows if row.language == name)]
    centimetres, each = (17.4, 4.8) if width is Width.PAGE else (8.5, 3.7)
    height = (each + 0.3 * len(lost) + 0.2 * max(len(languages) - 6, 0)) * down + 1.1
    drawing: Figure = matplotlib.figure.Figure(figsize=(centimetres / 2.54, height / 2.54), layout="constrained")
    places = drawing.subplots(down, across, sharey=True, squeeze=False).flat
    for axes, panel in zip(places, plot.panels, strict=False):
        _draw_panel(axes, panel, plot, languages, lost)
    for axes in places[len(plot.panels) :]:
        axes.set_visible(False)
    places[0].set_yscale("log")
    places[0].margins(y=0.12)
    drawing.supylabel(plot.label, fontsize="medium")
    mark = matplotlib.lines.Line2D
    starred = {row.language for row in plot.rows if row.detections_only}
    names = {language: f"{_drawable(language)}{'*' * (language in starred)}" for language in languages}
    handles = [mark([], [], label=name, **_look(language)) for language, name in names.items()]
    if starred:
        handles.append(mark([], [], label=f"* {DETECTIONS_ONLY}", linestyle="none"))
    if any(row.differing for row in plot.rows):
        handles.append(mark([], [], label="other verdicts", **_RING))
    met = {plot.lost(row) for row in plot.rows}
    for outcome, letter in _LETTERS.items():
        if letter in met:
            sign = {"marker": rf"$\mathrm{{{letter}}}$", "linestyle": "none", "color": "0.3"}
            handles.append(mark([], [], label=str(outcome), **sign))
    title = fill(f"not expressible: {', '.join(map(_drawable, mute))}", _TITLE[width]) if mute else None
    drawing.legend(handles=handles, loc="outside lower center", ncols=across * 2, frameon=False, title=title)
    return drawing


_TITLE: Final = {Width.PAGE: 96, Width.COLUMN: 44}
"""Characters in a line of the legend's title."""


def _draw_panel(axes: "Axes", panel: Panel, plot: Plot, languages: Sequence[str], lost: Sequence[str]) -> None:
    """Draw lines over numbers, or marks side by side over names; languages in `lost` have letters
    above.
    """
    for number, language in enumerate(languages):
        shift = (number - (len(languages) - 1) / 2) * 0.12 if panel.ticks else 0.0
        look = _look(language) | ({"linestyle": "none"} if panel.ticks else {})
        points = sorted((x, row) for x, row in panel.points if row.language == language)
        known = [
            (x + shift, plot.value(row) or math.nan, row) for x, row in points
        ]  # missing values interrupt the line
        axes.plot([x for x, _, _ in known], [y for _, y, _ in known], **look)
        axes.plot([x for x, _, row in known if row.differing], [y for _, y, row in known if row.differing], **_RING)
        for x, row in points:
            if letter := plot.lost(row):
                place = (0, 1.5 + _LETTER * lost.index(language))
                above: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
                axes.annotate(letter, (x, 1), place, color=look["color"], ha="center", **above)
    axes.set_title(_drawable(panel.title), pad=4 + _LETTER * len(lost), parse_math=False)
    axes.set_xlabel(panel.label)
    at = range(len(panel.ticks)) if panel.ticks else [x for x, _ in panel.points]
    axes.set_xlim(min(at) - 0.6, max(at) + 0.6)
    if panel.ticks:
        axes.set_xticks(at, panel.ticks)
    else:
        axes.xaxis.set_major_locator(library().ticker.MaxNLocator(integer=True, nbins=7))
    axes.grid(visible=True, axis="y", linewidth=0.3, color="0.8")


def _look(language: str) -> dict[str, Any]:
    """Return colour, marker and line of a language, the same in every figure; unknown languages
    share one.
    """
    return dict(zip(_LOOK, _STYLES.get(language, _STYLES[""]), strict=True))


def _drawable(text: str) -> str:
    """Return the start of the text, with characters missing in the font escaped."""
    fonts = library().font_manager
    known = fonts.get_font(fonts.findfont("DejaVu Sans")).get_charmap()
    return cut("".join(c if ord(c) in known else c.encode("unicode_escape").decode() for c in visible(text)), 28)
