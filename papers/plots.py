"""How plots look in a paper: one column wide, readable in print, in grey and by the colour-blind, and the same bytes every time.

    with plots.style():
        figure = plots.figure(height=6.0)
        axes = figure.subplots()
        axes.plot(x, y, **plots.LINES[0])
        plots.write(figure, folder, "name")

Everything that draws text stands inside of `style()`: matplotlib looks its settings up when a text is made. Matplotlib comes with the
extra `papers` and is imported on use.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rvaft.errors import ToolMissing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMN: Final = 8.5
"""Centimetres of one column of a page."""
PAGE: Final = 17.5
"""Centimetres of both columns."""
SMALLEST: Final = 7.0
"""Points of the smallest text."""
RESOLUTION: Final = 300
"""Dots per inch of a PNG."""
_INCH: Final = 2.54

LINES: Final[tuple[Mapping[str, Any], ...]] = tuple(
    {"color": colour, "linestyle": line, "marker": marker, "fillstyle": fill, "markersize": size}
    for colour, line, marker, fill, size in (
        ("#000000", "-", "o", "full", 3.5),
        ("#0072B2", "--", "s", "none", 5.5),
        ("#D55E00", "-.", "^", "full", 3.5),
        ("#56B4E9", ":", "D", "none", 5.5),
        ("#009E73", (0, (5, 1, 1, 1, 1, 1)), "v", "full", 3.5),
        ("#CC79A7", (0, (1, 1)), "P", "none", 6.0),
        ("#E69F00", (0, (8, 2)), "X", "full", 4.0),
    )
)
"""What tells the lines of a plot apart: colours of Okabe and Ito (Color Universal Design, 2008), and beside the colour a line and a marker.

Every other marker is open and larger, so that the one below it is seen where two lines coincide.
"""

_STYLE: Final[Mapping[Any, Any]] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same everywhere
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": SMALLEST,
    "ytick.labelsize": SMALLEST,
    "legend.fontsize": SMALLEST,
    "legend.frameon": False,
    "legend.handlelength": 3.0,  # a dashed line shows its dashes
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.1,
    "errorbar.capsize": 2.0,
    "savefig.dpi": RESOLUTION,
    "pdf.fonttype": 42,  # outlines that publishers accept; type 3 some do not
    "svg.hashsalt": "rvaft",
}
# What a format says of when and by what it was made would differ from run to run, or from machine to machine.
_SILENT: Final[Mapping[str, Mapping[str, None]]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}


@contextmanager
def style() -> Iterator[None]:
    """The settings of matplotlib for what is drawn in here, whatever the user's own are; raises `ToolMissing`."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 (an extra, imported on use)
    except ImportError as error:
        raise ToolMissing("matplotlib", remedy="pip install '.[papers]' in a checkout") from error
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def figure(*, height: float, width: float = COLUMN) -> "Figure":
    """An empty figure of so many centimetres, whose parts make room for each other; inside of `style()`."""
    from matplotlib.figure import Figure  # noqa: PLC0415 (an extra, imported on use)

    return Figure(figsize=(width / _INCH, height / _INCH), layout="constrained")


def write(figure: "Figure", folder: Path, name: str, forms: Sequence[str] = ("pdf", "png")) -> tuple[Path, ...]:
    """Write a figure as it is, uncropped, in each of the forms, and return the files; raises `OSError` with the path."""
    files = tuple(folder / f"{name}.{form}" for form in forms)
    for form, file in zip(forms, files, strict=True):
        figure.savefig(file, format=form, metadata=dict(_SILENT[form]))
    return files
