r"""LaTeX fragments: text, typewriter, mathematics and tables.

Each generated file is an `\input`; `document` combines them. Writing needs no TeX.
"""

from collections.abc import Iterable, Sequence
from typing import Final

from rvaft.export.latex import escaped
from rvaft.model.verdict import Verdict

SIGNS: Final = {Verdict.TRUE: r"\top", Verdict.FALSE: r"\bot", Verdict.UNKNOWN: "?"}
PACKAGES: Final = ("amsmath", "array", "booktabs", "graphicx", "listings", "textcomp", "xcolor")
"""Required packages, besides the font encoding T1."""
_HEAD: Final = (
    r"\documentclass{article}",
    r"\usepackage[T1]{fontenc}",
    r"\usepackage{lmodern}",
    r"\usepackage[utf8]{inputenc}",
    r"\usepackage[a4paper,margin=2.5cm]{geometry}",
    *(rf"\usepackage{{{package}}}" for package in PACKAGES),
)


def typewriter(text: str) -> str:
    """Return a text in typewriter; lines may break at spaces."""
    return rf"\texttt{{{escaped(text)}}}"


def math(text: str) -> str:
    """Return an inline formula."""
    return f"${text}$"


def phi(branch: int | None) -> str:
    """Return the sign of a monitor, for mathematics."""
    return r"\varphi" if branch is None else rf"\varphi_{{{branch}}}"


def row(cells: Iterable[str]) -> str:
    """Return a row of a table."""
    return rf"{' & '.join(cells)} \\"


def heading(text: str, width: int) -> str:
    """Return a heading across this many columns."""
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
    """Return a floating table; `notes` are paragraphs below it, `size` is its font size."""
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
    """Return a listing with a caption above it."""
    own = rf"\lstset{{caption={{{caption}}}, label={{{label}}}, captionpos=t}}"
    return "\n".join([r"\begingroup", own, listing.rstrip("\n"), r"\endgroup", ""])


def document(parts: Iterable[str]) -> str:
    """Return a document of these lines."""
    return "\n".join([*_HEAD, r"\begin{document}", *parts, r"\end{document}", ""])
