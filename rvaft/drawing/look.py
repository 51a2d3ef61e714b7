"""What a drawing shows of a tree: the choices that are the same for every format."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from rvaft.drawing.marks import Marks, branch_marks
from rvaft.errors import OptionError
from rvaft.tree import RVAFT

WIDTH: Final = 14
"""Columns of text in a box: so narrow that a tree of the size that papers print is still readable in one column."""

NARROWEST: Final = 4
"""Columns of text that a box has at least."""


@dataclass(frozen=True, slots=True)
class Look:
    """How a tree is drawn. `collapse` names nodes, of which what is below is left out; `depth` counts levels below the root.

    `events` are runtime events and guards, `names` those of nodes that have a label as well; `wrap` is in columns of text.
    With `stagger` every other child of a gate, where it is a leaf, stands one level lower: Graphviz then draws a narrower tree.
    """

    events: bool = False
    names: bool = True
    wrap: int = WIDTH
    depth: int | None = None
    collapse: tuple[str, ...] = ()
    marks: Marks | None = None
    legend: bool = False
    stagger: bool = False

    @property
    def code_width(self) -> int:
        """Columns of an event or a guard: a quarter more than of a label, as these do not break as well as words."""
        return self.wrap + self.wrap // 4


PLAIN: Final = Look()
TERMINAL: Final = Look(events=True)
"""What a terminal shows where nothing else is asked for: there is room."""


def looking(
    tree: RVAFT,
    *,
    events: bool = False,
    names: bool = True,
    wrap: int | None = None,
    depth: int | None = None,
    collapse: Iterable[str] = (),
    branch: int | None = None,
    legend: bool = False,
    stagger: bool = False,
) -> Look:
    """The look at a tree with a branch marked; raises `OptionError`, and `TreeError` where there is no such branch."""
    if wrap is not None and wrap < NARROWEST:
        raise OptionError(f"a box has at least {NARROWEST} columns of text, not {wrap}")
    if isinstance(collapse, str):
        collapse = (collapse,)
    marks = None if branch is None else branch_marks(tree, branch)
    return Look(events, names, WIDTH if wrap is None else wrap, depth, tuple(collapse), marks, legend, stagger)
