"""Drawings of trees and detections, and trees in other formats."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from rvaft.core.restriction import whole
from rvaft.export import PICTURES, WRITTEN, Format, galileo_text, open_psa
from rvaft.export.dot import dot_text
from rvaft.export.layout import PLAIN, TERMINAL, Look, marks
from rvaft.export.svg import rendered, svg_document
from rvaft.export.text import tree_text
from rvaft.export.tikz import tikz_text
from rvaft.export.tree_json import json_text
from rvaft.language.printer import dumps
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import Explanation

_DRAWN: Final[Mapping[Format, Callable[[RVAFT, Look], str]]] = {
    Format.TREE: tree_text,
    Format.DOT: dot_text,
    Format.TIKZ: tikz_text,
}
_WRITTEN: Final[Mapping[Format, Callable[[RVAFT], str]]] = {
    Format.JSON: json_text,
    Format.GALILEO: galileo_text.galileo_text,
    Format.OPEN_PSA: open_psa.open_psa_text,
    Format.RVAFT: dumps,
}
LOSSES: Final[Mapping[Format, Callable[[RVAFT], Iterator[str]]]] = {
    Format.GALILEO: galileo_text.losses,
    Format.OPEN_PSA: open_psa.losses,
}
"""What the formats of other tools lack of a tree, one clause each."""
assert set(_DRAWN) | set(PICTURES) == set(Format) - WRITTEN, "every drawing is made in one way"
assert set(_WRITTEN) == WRITTEN, "every other format is written in one way"


def draw(tree: RVAFT, form: Format, look: Look | None = None) -> bytes:
    """Return the tree in that format; formats that are not drawings ignore the look.

    By default the terminal shows runtime events and guards, pictures do not. Raises `ToolMissing`
    for PDF and PNG, and `OptionError`.
    """
    chosen = look if look is not None else TERMINAL if form is Format.TREE else PLAIN
    if form in PICTURES:
        return rendered(svg_document(tree, chosen), form)
    text = _DRAWN[form](tree, chosen) if form in _DRAWN else _WRITTEN[form](tree)
    return text.encode("utf-8", errors="replace")


def fired_text(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json], *, colour: bool = False) -> str:
    """Return a detection as a tree for the terminal, with matched nodes and their events marked.

    `events` has the known matched events by number, from 1. `colour` adds ANSI escapes: marked
    lines are bold, yellow for faults and red for attacks; others are faint.

    >>> import rvaft
    >>> tree = rvaft.loads("top and a b;")
    >>> monitor, log = rvaft.monitor(tree), [{"event": "b"}, {"event": "a"}]
    >>> verdicts = list(monitor.run(log))
    >>> print(fired_text(tree, monitor.explanation, dict(enumerate(log, 1))), end="")
    ● top AND
    ● ├─ a  event 2
    ● └─ b  event 1
    <BLANKLINE>
    branch 1
    """
    tree = whole(tree)
    return tree_text(tree, Look(events=True, marks=marks(tree, explanation, events)), colour=colour)


def fired_dot(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> str:
    """Return a detection in the DOT language: matches bold, the rest grey."""
    return dot_text(whole(tree), _fired(tree, explanation, events))


def fired_picture(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json], form: Format) -> bytes:
    """Return a detection as `svg`, `pdf` or `png`; raises `ToolMissing`."""
    return rendered(svg_document(whole(tree), _fired(tree, explanation, events)), form)


def _fired(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> Look:
    wide = 26  # for long values, on a screen
    return Look(events=True, wrap=wide, marks=marks(whole(tree), explanation, events))
