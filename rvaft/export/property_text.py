"""Properties of trees and branches in mathematical notation, as LaTeX or Unicode, for display.

The symbols follow Cardoso, Ferrando and Fisher, Extending Attack-Fault Trees with Runtime
Verification (FMAS 2022), except for sequences; `docs/reference/command-line.md` lists them.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Final

from rvaft.core.branches import Branch
from rvaft.core.restriction import of_branch, property_of
from rvaft.export import latex
from rvaft.export.formula import DEFAULT_LIMIT, TEXT, Formula, Join, Notation, breakable, formula, write
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import SIGNED_LEVEL, SIGNS, SUM_LEVEL, Style, literal_text, quoted
from rvaft.model.guards import Operator
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Scalar
from rvaft.support.terminal import visible

_SUBSCRIPTS: Final = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SUPERSCRIPTS: Final = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_MINUS: Final = "−"


def _name(name: str) -> str:
    """Return a name with a subscript, `T₁`, or quoted."""
    parts = latex.stem_and_index(name)
    return quoted(name) if parts is None else parts[0] + parts[1].translate(_SUBSCRIPTS)


def _constant(value: Scalar) -> str:
    text = literal_text(value)
    return text if isinstance(value, str) else re.sub("^-", _MINUS, text)


STYLE: Final = Style(
    *(_name, _name, _name),
    _constant,
    signs=SIGNS
    | {
        Operator.EQ: "=",
        Operator.NE: "≠",
        Operator.LE: "≤",
        Operator.GE: "≥",
        Operator.SUB: _MINUS,
        Operator.MUL: "×",
        Operator.NEGATE: _MINUS,
        Operator.NOT: "¬",
        Operator.AND: "∧",
        Operator.OR: "∨",
        Operator.IN: "∈",
    },
    duration=lambda nanoseconds: duration_text(nanoseconds).replace("us", "µs"),
    listed=("{", "}"),
    minus_level=SUM_LEVEL,
    not_operand=SIGNED_LEVEL,
)


_UNICODE: Final = Notation(
    STYLE,
    {Join.SEQUENCE: " · ", Join.ANY_ORDER: " ∧ ", Join.AT_LEAST: ", ", Join.CHOICE: " ∨ ", Join.ENDS: " ◁ "},
    "VOT {}/{}",
    lambda number: str(number).translate(_SUPERSCRIPTS),
    ("⟨", "⟩[≤ {}]"),
    whole=frozenset(Join),
)
_LATEX: Final = Notation(
    latex.STYLE,
    {
        Join.SEQUENCE: r" \cdot ",
        Join.ANY_ORDER: r" \wedge ",
        Join.AT_LEAST: ", ",
        Join.CHOICE: r" \vee ",
        Join.ENDS: r" \triangleleft ",
    },
    r"\mathrm{{VOT}}_{{{}/{}}}",
    "^{{{}}}".format,
    (r"\langle ", r" \rangle_{{\leq {}}}"),
    r"\colon ",
    lambda guard: rf"\left[{guard}\right]" if r"\frac" in guard else f"[{guard}]",
    whole=frozenset(Join),
)

WIDTH: Final = 72
"""Characters per line: about one column in 10 pt."""
_INDENT: Final = 3


def _formula(part: RVAFT | Branch) -> Formula:
    return formula(of_branch(property_of(part.tree), part) if isinstance(part, Branch) else property_of(part))


def property_text(part: RVAFT | Branch) -> str:
    """Return the property in plain text; raises `TooLarge`."""
    return write(_formula(part), TEXT)


def property_unicode(part: RVAFT | Branch) -> str:
    """Return the property as one line: `move(Waypoint, _) · [T₂ ≥ T₁ + 10]`; raises `TooLarge`."""
    return visible(write(_formula(part), _UNICODE))


def property_latex(part: RVAFT | Branch, *, width: int | None = None, limit: int = DEFAULT_LIMIT) -> str:
    r"""Return the property in LaTeX mathematics without an environment; needs `amsmath`.

    With a `width` in characters, long formulas are broken with `\\` and `&\quad`, for an
    environment like `align*`. Raises `TooLarge` beyond `limit` pieces.
    """
    term = _formula(part)
    if width is None:
        return write(term, _LATEX, limit=limit)
    lines, used = [""], 0
    for text, shown in zip(breakable(term, _LATEX, limit=limit), breakable(term, _UNICODE, limit=limit), strict=True):
        if lines[-1] and used + len(shown) > width:
            ended = lines[-1].rstrip()
            lines[-1] = f"{ended}  " if ended.endswith("\\") else f"{ended} "  # `\ ` is a space that is shown
            lines.append(" ")
            used = _INDENT
        lines[-1] += text.lstrip() if lines[-1] == " " else text
        used += len(shown)
    return "\\\\\n  &\\quad".join(lines)


def equation_latex(part: RVAFT | Branch, *, width: int | None = WIDTH) -> str:
    r"""Return a row of `align*` with the name: `\varphi_{1} &= …`; raises `TooLarge`."""
    index = _index(part)
    shown = index if index.isdigit() else rf"\mathrm{{{index}}}"
    sign = rf"\varphi_{{{shown}}}" if index else r"\varphi"
    return f"{sign} &= {property_latex(part, width=width)}"


def align_latex(parts: Iterable[RVAFT | Branch], *, width: int | None = WIDTH) -> Iterator[str]:
    """Yield an `align*` with the properties, after comments with their kinds."""
    yield r"% Needs \usepackage{amsmath} and \usepackage{textcomp}."
    yield r"\begingroup\allowdisplaybreaks"
    yield r"\begin{align*}"
    row = ""
    for part in parts:
        yield from [f"{row} \\\\"] if row else []
        yield f"% {property_sign(part)}: {', '.join(sorted(kind.value for kind in kinds_of(part))) or 'no kind'}"
        row = equation_latex(part, width=width)
    yield from [row] if row else []
    yield r"\end{align*}"
    yield r"\endgroup"


def property_sign(part: RVAFT | Branch) -> str:
    """Return φ for a tree, φ₁ for branch 1, φ(fault) for a kind."""
    index = _index(part)
    return f"φ{index.translate(_SUBSCRIPTS) if index.isdigit() else f'({index})' if index else ''}"


def kinds_of(part: RVAFT | Branch) -> frozenset[Kind]:
    """Return the kinds of the nodes of a property."""
    return part.kinds if isinstance(part, Branch) else frozenset(n.kind for n in part.top_down() if n.kind is not None)


def _index(part: RVAFT | Branch) -> str:
    if isinstance(part, Branch):
        return str(part.number)
    return str((part.part_of and (part.part_of.kind or part.part_of.branch)) or "")
