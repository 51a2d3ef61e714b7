r"""LaTeX by small pieces: what may stand in a text, in typewriter, in mathematics, and one table from its rows.

Every file that comes out can be taken by `\input`; `document` puts them together. No TeX is needed to write them.
"""

from collections.abc import Iterable, Sequence
from typing import Final

from rvaft.export.latex import escaped
from rvaft.model.verdict import Verdict

SIGNS: Final = {Verdict.TRUE: r"\top", Verdict.FALSE: r"\bot", Verdict.UNKNOWN: "?"}
PACKAGES: Final = ("amsmath", "array", "booktabs", "graphicx", "listings", "textcomp", "xcolor")
"""What the files need, besides the font encoding T1."""
_HEAD: Final = (
    r"\documentclass{article}",
    r"\usepackage[T1]{fontenc}",
    r"\usepackage{lmodern}",
    r"\usepackage[utf8]{inputenc}",
    r"\usepackage[a4paper,margin=2.5cm]{geometry}",
    *(rf"\usepackage{{{package}}}" for package in PACKAGES),
)


def typewriter(text: str) -> str:
    """A text in typewriter, in which spaces are places where a line may end."""
    return rf"\texttt{{{escaped(text)}}}"


def math(text: str) -> str:
    """A formula within a line."""
    return f"${text}$"


def phi(branch: int | None) -> str:
    """The sign of a monitor, for mathematics."""
    return r"\varphi" if branch is None else rf"\varphi_{{{branch}}}"


def row(cells: Iterable[str]) -> str:
    """A line of a table, with its end."""
    return rf"{' & '.join(cells)} \\"


def heading(text: str, width: int) -> str:
    """A line across that many columns, which starts a group of rows."""
    return rf"\midrule\multicolumn{{{width}}}{{l}}{{{text}}} \\"


def table(
    columns: str,
    head: Sequence[str],
    rows: Iterable[str],
    *,
    caption: str,
    label: str,
    notes: Sequence[str] = (),
    size: str = r"\small",
) -> str:
    """A floating table; `rows` are lines as `row` and `heading` give them, `notes` are paragraphs
    below it, `size` is that of its text.
    """
    below = [r"\par\smallskip\raggedright\footnotesize", *(rf"{note}\par" for note in notes)] if notes else []
    lines = [
        r"\begin{table}[htbp]",
        rf"\centering{size}",
        rf"\caption{{{caption}}}\label{{{label}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        row(head),
        *rows,
        r"\bottomrule",
        r"\end{tabular}",
        *below,
        r"\end{table}",
    ]
    return "\n".join([*lines, ""])


def captioned(listing: str, *, caption: str, label: str) -> str:
    """A listing with a caption above it, which it alone has."""
    own = rf"\lstset{{caption={{{caption}}}, label={{{label}}}, captionpos=t}}"
    return "\n".join([r"\begingroup", own, listing.rstrip("\n"), r"\endgroup", ""])


def document(parts: Iterable[str]) -> str:
    """A whole document of these lines."""
    return "\n".join([*_HEAD, r"\begin{document}", *parts, r"\end{document}", ""])
