r"""LaTeX output of names, guards and listings, with all special characters escaped.

Symbols and Greek letters become commands of `textcomp` and mathematics. Other scripts need LuaLaTeX
or XeLaTeX. Mathematics needs `amsmath` for `\text`.
"""

import re
import unicodedata
from functools import cache
from typing import Final

from rvaft.backend import Highlighting
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import SIGNED_LEVEL, SIGNS, SUM_LEVEL, Style, literal_text
from rvaft.model.guards import FUNCTIONS, Operator
from rvaft.model.values import Scalar
from rvaft.support.terminal import visible

_SPECIAL: Final = str.maketrans(
    {
        **{character: rf"\{character}" for character in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        # characters that some fonts lack, or that begin ligatures
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': r"\texttt{\char34}",
        "'": r"\textquotesingle{}",
        "`": r"\textasciigrave{}",
        "→": r"\ensuremath{\rightarrow}",
        "←": r"\ensuremath{\leftarrow}",
    }
)
_LIGATURE: Final = re.compile(r"([-,])(?=\1)")
"""Ligatures; braces do not break them in LuaTeX."""
_BEYOND: Final = re.compile(r"[^\x00-\x7f]")
_IDENTIFIER: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_NUMBERED: Final = re.compile(r"([A-Za-z0-9_]*[A-Za-z])([0-9]+)")
_EXPONENT: Final = re.compile(r"(.*)e([+-]?)0*([0-9]+)")


def escaped(text: str) -> str:
    """Return the text on one line, escaped."""
    parted = _LIGATURE.sub(r"\1{\\kern0pt}", visible(text).translate(_SPECIAL))
    return re.sub(" (?= )", lambda _: r"\ ", _BEYOND.sub(lambda found: _symbol(found[0]), parted))


@cache
def _symbol(character: str) -> str:
    """Return the command for a symbol or Greek letter."""
    from pylatexenc.latexencode import UnicodeToLatexEncoder  # noqa: PLC0415

    encoder = UnicodeToLatexEncoder(unknown_char_policy="keep", unknown_char_warning=False)
    command = str(encoder.unicode_to_latex(character))
    letter = unicodedata.category(character)[0] in "LM"
    return character if letter and not command.startswith((r"\ensuremath", r"\text")) else command


def stem_and_index(text: str) -> tuple[str, str] | None:
    """Split `ev1` into stem and index; None for other texts."""
    if not _IDENTIFIER.fullmatch(text):
        return None
    found = _NUMBERED.fullmatch(text)
    return (found[1], found[2]) if found else (text, "")


def name(text: str) -> str:
    r"""Return a name in mathematics (`ev1` as `\mathit{ev}_{1}`), or a quoted text."""
    parts = stem_and_index(text)
    if parts is None:
        return rf"\textit{{``{escaped(text)}''}}"
    return rf"\mathit{{{escaped(parts[0])}}}" + (f"_{{{parts[1]}}}" if parts[1] else "")


def _constant(value: Scalar) -> str:
    if isinstance(value, str):
        return rf"\text{{``{escaped(value)}''}}"
    text = literal_text(value)
    if value is None or isinstance(value, bool):
        return rf"\mathrm{{{text}}}"
    scientific = _EXPONENT.fullmatch(text)
    return text if scientific is None else rf"{scientific[1]} \times 10^{{{scientific[2].strip('+')}{scientific[3]}}}"


def _duration(nanoseconds: int) -> str:
    r"""Return a duration in mathematics: `5\,\mathrm{min}`."""
    number, unit = duration_text(nanoseconds).split()
    return rf"{number}\,\mathrm{{{unit}}}" if unit != "us" else rf"{number}\,\mu\mathrm{{s}}"


STYLE: Final = Style(
    *(name, name, name),
    _constant,
    r"\ \text{{{}}}\ ".format,
    r"\_",
    SIGNS
    | {
        Operator.EQ: "=",
        Operator.NE: r"\neq",
        Operator.LE: r"\leq",
        Operator.GE: r"\geq",
        Operator.MUL: r"\times",
        Operator.NOT: r"\neg ",
        Operator.AND: r"\wedge",
        Operator.OR: r"\vee",
        Operator.IN: r"\in",
        **{function: rf"\mathrm{{{function}}}" for function in FUNCTIONS},
        Operator.MIN: r"\min",
        Operator.MAX: r"\max",
    },
    brackets=(r"\left(", r"\right)"),
    point=r"\mathrm{{{}}}({})",
    duration=_duration,
    listed=(r"\{", r"\}"),
    # a nested fraction uses a slash
    fraction=lambda above, below: None if r"\frac" in above + below else rf"\frac{{{above}}}{{{below}}}",
    minus_level=SUM_LEVEL,
    not_operand=SIGNED_LEVEL,
)
"""Mathematics, without simplification or reordering."""

_OPEN: Final = "(*@"
_CLOSE: Final = "@*)"
_HARD: Final = re.compile(r"[^\n\t -~]|\\(?=end\{lstlisting\})|" + re.escape(_OPEN[0]) + f"(?={re.escape(_OPEN[1:])})")
_OPTIONS: Final = (
    r"basicstyle=\scriptsize\ttfamily, columns=fullflexible, keepspaces=true, showstringspaces=false, "
    r"upquote=true, breaklines=true, "
    rf"breakatwhitespace=true, escapeinside={{{_OPEN}}}{{{_CLOSE}}}"
)


def listing(text: str, highlighting: Highlighting | None) -> str:
    r"""Return the text in an `lstlisting` after the definition of its language.

    The printed text can be copied and run. Characters beyond ASCII, and an end of the listing, are
    escaped to LaTeX. Needs the packages `listings` and `textcomp`.
    """
    lines = [r"% Needs \usepackage{listings} and \usepackage{textcomp}."]
    lines += [] if highlighting is None else highlighting.definition.strip().splitlines()
    language = "" if highlighting is None else f", language={highlighting.name}"
    body = _HARD.sub(lambda found: f"{_OPEN}{escaped(found[0])}{_CLOSE}", text.rstrip("\n"))
    return "\n".join([*lines, f"\\begin{{lstlisting}}[{_OPTIONS}{language}]", body, r"\end{lstlisting}", ""])
