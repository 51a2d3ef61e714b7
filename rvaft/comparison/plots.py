"""Figures as PDF and PNG, for print: one panel per gate or tree, one line per language. Needs Matplotlib."""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Final

from rvaft.comparison.drawing import LAYOUTS, Layout, drawn
from rvaft.comparison.panels import Figure, figures
from rvaft.comparison.rows import Row
from rvaft.comparison.width import Width
from rvaft.errors import ToolMissing

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


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
