"""A tree with the path marked on which it was detected (semantics, section 4: one match and its scenario).

Marked are the nodes of the matched scenario, those without an event of their own too. A KofN gate keeps the children that the match
took: K of them, or more where all their events had to be used.
"""

from collections.abc import Mapping

from rvaft.drawing.dot import dot_text
from rvaft.drawing.look import Look
from rvaft.drawing.marks import marks
from rvaft.drawing.tree import tree_text
from rvaft.monitors import Explanation
from rvaft.tree import RVAFT
from rvaft.values import Json

_WIDTH = 26
"""Columns of text in a box: values of events are longer than labels, and such a picture is for a screen."""


def fired_text(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json], *, colour: bool = False) -> str:
    """For the terminal: marked nodes after a dot, matched ones with their event behind them; branch and variables below.

    `events` holds matched events by number, from 1; of one that is not there only the number is shown. With `colour` the text has
    ANSI escapes: marked lines are bold, those of faults yellow and of attacks red, the others faint.
    """
    whole = _whole(tree)
    return tree_text(whole, Look(events=True, marks=marks(whole, explanation, events)), colour=colour)


def fired_dot(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> str:
    """In the DOT language: marked nodes and edges bold, the others grey; branch and variables below the tree."""
    whole = _whole(tree)
    return dot_text(whole, Look(events=True, wrap=_WIDTH, marks=marks(whole, explanation, events)))


def _whole(tree: RVAFT) -> RVAFT:
    """The tree whose nodes an explanation names."""
    return tree if tree.part_of is None else tree.part_of.tree
