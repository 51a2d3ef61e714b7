"""How papers write the property of a branch: the notations in Unicode and in LaTeX, with the same signs.

The signs and their source stand in `rvaft.properties`.
"""

from typing import Final

from rvaft import latex
from rvaft.formulas import Join, Notation
from rvaft.guards import Guard, Operator
from rvaft.language.expressions import SIGNED_LEVEL, SUM_LEVEL, Style, guard_text, literal_text, on_text, quoted
from rvaft.model import Node, On
from rvaft.values import Scalar

_SUBSCRIPTS: Final = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_MINUS: Final = "−"


def subscript(digits: str) -> str:
    """Digits as an index."""
    return digits.translate(_SUBSCRIPTS)


def name_unicode(name: str) -> str:
    """A name, with the number at its end as an index: `T₁`; in quotes what is no identifier."""
    if not latex.identifier(name):
        return quoted(name)
    stem, index = latex.numbered(name)
    return stem + subscript(index)


def constant_unicode(value: Scalar) -> str:
    """A literal; a negative number with the sign of mathematics."""
    text = literal_text(value)
    return text if isinstance(value, str) or not text.startswith("-") else f"{_MINUS}{text[1:]}"


def event_unicode(on: On) -> str:
    """An event type applied to arguments."""
    return on_text(on, _STYLE)


def guard_unicode(guard: Guard) -> str:
    """A guard as it is written: nothing is simplified or reordered."""
    return guard_text(guard, _STYLE)


_STYLE: Final = Style(
    name_unicode,
    name_unicode,
    constant_unicode,
    "_",
    {
        Operator.EQ: "=",
        Operator.NE: "≠",
        Operator.LT: "<",
        Operator.LE: "≤",
        Operator.GT: ">",
        Operator.GE: "≥",
        Operator.ADD: "+",
        Operator.SUB: _MINUS,
        Operator.MUL: "×",
        Operator.DIV: "/",
        Operator.NEGATE: _MINUS,
        Operator.NOT: "¬",
        Operator.AND: "∧",
        Operator.OR: "∨",
    },
    minus_level=SUM_LEVEL,
    not_operand=SIGNED_LEVEL,
)


def _event(node: Node) -> str:
    return name_unicode(node.name) if node.on is None else event_unicode(node.on)


def _condition(node: Node) -> str:
    return "" if node.when is None else f"[{guard_unicode(node.when)}]"


def _event_latex(node: Node) -> str:
    return latex.name(node.name) if node.on is None else latex.event(node.on)


def _condition_latex(node: Node) -> str:
    if node.when is None:
        return ""
    guard = latex.guard(node.when)
    return rf"\left[{guard}\right]" if r"\frac" in guard else f"[{guard}]"


UNICODE: Final = Notation(
    _event,
    _condition,
    {Join.SEQUENCE: " · ", Join.ANY_ORDER: " ∧ ", Join.AT_LEAST: ", ", Join.CHOICE: " ∨ "},
    "VOT {}/{}".format,
    whole=frozenset(Join),
)
LATEX: Final = Notation(
    _event_latex,
    _condition_latex,
    {Join.SEQUENCE: r" \cdot ", Join.ANY_ORDER: r" \wedge ", Join.AT_LEAST: ", ", Join.CHOICE: r" \vee "},
    r"\mathrm{{VOT}}_{{{}/{}}}".format,
    whole=frozenset(Join),
)
