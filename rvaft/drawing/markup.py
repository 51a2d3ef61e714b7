r"""Text for Graphviz that cannot leave its place: HTML-like labels, in which Graphviz still replaces `\N` and the like, and names."""

from collections.abc import Iterable
from html import escape

from rvaft.drawing.captions import wrapped, wrapped_code
from rvaft.printable import visible

_SPACE = "&#160;"


def html(text: str, width: int) -> str:
    """The text wrapped and escaped for an HTML-like label."""
    return _lines(wrapped(text, width))


def html_code(text: str, width: int) -> str:
    """The same for an event or a guard."""
    return _lines(wrapped_code(text, width))


def _lines(lines: list[str]) -> str:
    return "<br/>".join(escape(line).replace("\\", "\\\\") or _SPACE for line in lines) or _SPACE


def table(rows: Iterable[str]) -> str:
    """Rows of escaped text, one below the other, as a table without lines."""
    cells = "".join(f"<tr><td>{row}</td></tr>" for row in rows)
    return f'<table border="0" cellborder="0" cellspacing="0" cellpadding="1">{cells}</table>'


def quoted(text: str) -> str:
    """The text as a quoted identifier: a quote is escaped, and a backslash, which could escape the closing one, doubled."""
    return '"' + visible(text).replace("\\", "\\\\").replace('"', '\\"') + '"'
