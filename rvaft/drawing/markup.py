r"""Text for Graphviz that cannot leave its place: HTML-like labels, in which Graphviz still replaces `\N` and the like, and names."""

from collections.abc import Iterable
from html import escape
from typing import Final

from rvaft.drawing.wrapping import wrapped
from rvaft.printable import visible

_SPECIAL: Final = str.maketrans({"\\": "\\\\", "]": "&#93;"})
"""Beside what is special in HTML: Graphviz replaces escapes, and holds back a text of nothing but `]` until it is misplaced."""
_TITLE: Final = str.maketrans({"&": "&amp;", "\\": "&#92;", '"': "&quot;"})
"""In the title of an SVG, Graphviz takes entities as such, and shows an escape as it is written."""
_SPACE = "&#160;"


def html(text: str, width: int) -> str:
    """The text wrapped and escaped for an HTML-like label."""
    return html_lines(wrapped(text, width))


def html_lines(lines: Iterable[str]) -> str:
    """Lines escaped for an HTML-like label."""
    return "<br/>".join(escape(line).translate(_SPECIAL) or _SPACE for line in lines) or _SPACE


def table(rows: Iterable[str], *, space: int = 0, cell: str = "") -> str:
    """Rows of escaped text, one below the other, as a table without lines, with `space` around each and attributes of all cells."""
    cells = "".join(f"<tr><td {cell}>{row}</td></tr>" if cell else f"<tr><td>{row}</td></tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="{space}" cellpadding="1">{cells}</table>'


def title(text: str) -> str:
    """The text as the name of a graph, which becomes the title of a picture."""
    return f'"{visible(text).translate(_TITLE)}"'
