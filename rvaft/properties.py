"""The property of a tree or of a branch as papers print it: in LaTeX's mathematics, or in Unicode.

The signs are those of Cardoso, Ferrando and Fisher, Extending Attack-Fault Trees with Runtime Verification (FMAS 2022), with one
difference. There the formulas φ, φ₁, φ₂, … (section 4.2) join everything by ∧, which for want of another sign also stands for one after the
other (its footnote says so), while the gates (section 3.2) tell the two apart. Here

| sign | what it joins | gate |
| --- | --- | --- |
| · | one after the other | SAND; a node before (or, bottom up, after) what is below it |
| ∧ | all, in any order (the paper's gate: a bar) | AND |
| ∨ | one of them | OR |
| VOT k/n | at least k of these n, in any order | VOT |

and a condition stands in square brackets where its node stands. For display only; nothing is run from it, and a node that
several parents share stands wherever it is used.
"""

from collections.abc import Iterable, Iterator
from typing import Final

from rvaft.branches import Branch
from rvaft.formulas import DEFAULT_LIMIT, TEXT, Formula, breakable, formula, write
from rvaft.model import Kind
from rvaft.notations import LATEX, UNICODE, subscript
from rvaft.printable import visible
from rvaft.tree import RVAFT

WIDTH: Final = 72
"""Characters on a line of a formula in LaTeX, roughly what fits a page of one column in 10 pt."""
_INDENT: Final = 3


def property_text(part: RVAFT | Branch, *, limit: int = DEFAULT_LIMIT) -> str:
    """The property in plain text: `;` in sequence, `&` in any order, `|` one of them; raises `TooLarge` beyond `limit` pieces."""
    return write(_formula(part), TEXT, limit=limit)


def property_unicode(part: RVAFT | Branch, *, limit: int = DEFAULT_LIMIT) -> str:
    """The property in Unicode, on one line: `move(Waypoint, _) · inspect(Waypoint) · [T₂ ≥ T₁ + 10]`.

    The signs are those of the table above; raises `TooLarge` beyond `limit` pieces.
    """
    return visible(write(_formula(part), UNICODE, limit=limit))


def property_latex(part: RVAFT | Branch, *, width: int | None = None, limit: int = DEFAULT_LIMIT) -> str:
    r"""The property in LaTeX's mathematics, without dollar signs or an environment; needs the package `amsmath`.

    The signs are those of the table above. With a `width`, in characters, a longer formula is broken for an environment in which
    `&` stands before it, such as `align*`: a line ends with `\\`, and the next starts with `&\quad` and a sign. The branches
    of a tree are those of the paper's section 4.2. Raises `TooLarge` beyond `limit` pieces.
    """
    term = _formula(part)
    if width is None:
        return write(term, LATEX, limit=limit)
    return "\\\\\n  &\\quad".join(_broken(term, width, limit))


def equation_latex(part: RVAFT | Branch, *, width: int | None = WIDTH, limit: int = DEFAULT_LIMIT) -> str:
    r"""The property with its name before it, as a row of `align*`: `\varphi_{1} &= …`. Raises `TooLarge`."""
    index = _index(part)
    shown = index if index.isdigit() else rf"\mathrm{{{index}}}"
    sign = rf"\varphi_{{{shown}}}" if index else r"\varphi"
    return f"{sign} &= {property_latex(part, width=width, limit=limit)}"


def align_latex(parts: Iterable[RVAFT | Branch], *, width: int | None = WIDTH) -> Iterator[str]:
    """The properties as one `align*` over any number of pages, line by line, each behind a comment that names its kinds."""
    yield r"% Needs \usepackage{amsmath} and \usepackage{textcomp}."
    yield r"\begingroup\allowdisplaybreaks"
    yield r"\begin{align*}"
    before: str | None = None
    for part in parts:
        if before is not None:
            yield f"{before} \\\\"
        kinds = ", ".join(sorted(kind.value for kind in kinds_of(part))) or "no kind"
        yield f"% {property_sign(part)}: {kinds}"
        before = equation_latex(part, width=width)
    if before is not None:
        yield before
    yield r"\end{align*}"
    yield r"\endgroup"


def property_sign(part: RVAFT | Branch) -> str:
    """What the property is called, in Unicode: φ for a tree, φ₁ for its branch 1, φ(fault) for the part of a kind."""
    index = _index(part)
    return f"φ{subscript(index) if index.isdigit() else f'({index})' if index else ''}"


def kinds_of(part: RVAFT | Branch) -> frozenset[Kind]:
    """The kinds of the nodes that a property is about."""
    return part.kinds if isinstance(part, Branch) else frozenset(n.kind for n in part.top_down() if n.kind is not None)


def _formula(part: RVAFT | Branch) -> Formula:
    if isinstance(part, Branch):
        return formula(part.tree, part.nodes, part.children)
    return formula(part, part.order, lambda name: part.nodes[name].children)


def _index(part: RVAFT | Branch) -> str:
    """What tells the property from others of the same tree: a number, a kind, or nothing."""
    if isinstance(part, Branch):
        return str(part.number)
    whole = part.part_of
    if whole is None or (whole.branch is None and whole.kind is None):
        return ""
    return str(whole.branch) if whole.kind is None else whole.kind.value


def _broken(term: Formula, width: int, limit: int) -> Iterator[str]:
    """The formula in LaTeX line by line; how wide a part is, its Unicode tells."""
    line, used = "", 0
    for part, shown in zip(breakable(term, LATEX, limit=limit), breakable(term, UNICODE, limit=limit), strict=True):
        if line and used + len(shown) > width:
            yield f"{line.rstrip()} "
            line, used = " ", _INDENT
        line += part.lstrip() if line == " " else part
        used += len(shown)
    yield line
