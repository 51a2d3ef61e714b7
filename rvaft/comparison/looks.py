"""How the plots draw each language, and what stands for a value that is not there."""

from collections.abc import Mapping
from typing import Any, Final

from rvaft.backend import all_backends
from rvaft.comparison.rows import Outcome

_STYLES: Final[tuple[Mapping[str, Any], ...]] = tuple(
    {
        "color": colour,
        "marker": marker,
        "linestyle": line,
        "fillstyle": fill,
        "markersize": size,
        "linewidth": 0.9,
        "markeredgewidth": 0.8,
    }
    for colour, marker, line, fill, size in (
        ("#000000", "o", "-", "full", 3.0),
        ("#d55e00", "s", "--", "none", 5.0),
        ("#0072b2", "^", "-.", "full", 3.0),
        ("#009e73", "D", ":", "none", 5.0),
        ("#cc79a7", "v", "-", "full", 3.0),
        ("#e69f00", "P", "--", "none", 5.5),
        ("#56b4e9", "X", "-.", "full", 3.5),
    )
)
"""Colour, marker and line; the colours are told apart by nearly everybody.

Every other marker is open and larger, so that the one below it is seen where two lines coincide.
"""
_OWN: Final = ("automaton", "ltlf", "rml", "rml-paper", "rml-prolog")
"""Languages whose look is theirs whatever else is installed."""

MARKS: Final[Mapping[Outcome, str]] = {
    Outcome.NOT_EXPRESSIBLE: r"$\mathrm{N}$",
    Outcome.TOO_LARGE: r"$\mathrm{L}$",
    Outcome.TIMEOUT: r"$\mathrm{T}$",
    Outcome.TOOL_MISSING: "+",
    Outcome.FAILED: "*",
}
"""The marker for each way to end without a value."""
OTHER_VERDICTS: Final[Mapping[str, Any]] = {
    "color": "#000000",
    "marker": "o",
    "linestyle": "none",
    "fillstyle": "none",
    "markersize": 8.0,
    "markeredgewidth": 0.6,
}
"""A ring around a value of a text that gives other verdicts than the tree."""


def look(language: str) -> dict[str, Any]:
    """Colour, marker and line of a language: the same in every figure, whoever else is compared."""
    others = sorted({*all_backends(), language} - {*_OWN})
    return dict(_STYLES[[*_OWN, *others].index(language) % len(_STYLES)])
