"""A tree as text for the terminal: one line per node, children in order.

A shared node is drawn once in full and referred to after that. Indentation is bounded: what lies deeper goes on in a section of
its own further down, so a chain of thousands of gates stays readable and linear in size.
"""

from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

from rvaft.export.layout import TERMINAL, Look, View, said, view
from rvaft.model.expressions import name_text
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

MAX_LEVELS = 20
"""Levels of indentation before a new section begins; three columns each leave room for text on a terminal."""
MARK: Final = "● "
"""What stands before the line of a marked node; the same width of space before the others."""
_COLOURS: Final = {Kind.FAULT: "1;33", Kind.ATTACK: "1;31", None: "1"}
_FAINT: Final = "2"


class TextLine(NamedTuple):
    """One line about a node; a line that refers to another one has the parent from which it does. `noted` is whether an event is named here."""

    name: str
    text: str
    noted: bool = True
    parent: str | None = None


def tree_text(tree: RVAFT, look: Look = TERMINAL, *, colour: bool = False) -> str:
    """The whole drawing; with marks, marked nodes stand out, and with `colour` they have ANSI escapes too.

    Raises `OptionError` for a look that the tree cannot have.

    >>> import rvaft
    >>> print(tree_text(rvaft.loads("top or a b; a fault;")), end="")
    top OR
    ├─ a  [fault]
    └─ b
    """
    marks = look.marks
    lines: list[str] = []
    for line in _lines(tree, look, view(tree, look)):
        if line is None or marks is None:
            lines.append(line.text if line else "")
            continue
        marked = line.name in marks.kept if line.parent is None else marks.edge(line.parent, line.name)
        note = visible(", ".join(marks.notes.get(line.name, ()))) if line.noted else ""
        text = f"{MARK if marked else ' ' * len(MARK)}{line.text}{f'  {note}' if note else ''}".rstrip()
        code = _COLOURS[tree.nodes[line.name].kind] if marked else _FAINT
        lines.append(f"\x1b[{code}m{text}\x1b[0m" if colour else text)
    if marks is not None and marks.below:
        lines += ["", *map(visible, marks.below)]
    return "\n".join(lines) + "\n"


def _lines(tree: RVAFT, look: Look, part: View) -> Iterator[TextLine | None]:
    """The lines of all sections, None between two sections."""
    sections = deque([tree.root])
    drawn: set[str] = set()
    while sections:
        agenda: list[tuple[str, str | None, str, str, int]] = [(sections.popleft(), None, "", "", 0)]
        while agenda:
            name, parent, indent, turn, level = agenda.pop()
            shown = f"{indent}{turn}{visible(name_text(name))}"
            if name in drawn and level > 0:
                where = "below" if name in sections else "above"
                yield TextLine(name, f"{shown} (see {where})", noted=False, parent=parent)
                continue
            drawn.add(name)
            node = tree.nodes[name]
            words = said(node, events=look.events)
            text = f"{shown}{'  ' if words and not node.gate else ' ' * bool(words)}{words}"
            children = part.children(node)
            if level == MAX_LEVELS and children:
                sections.append(name)
                yield TextLine(name, f"{text}  (continued below)", noted=False)
                continue
            yield TextLine(name, text + _left_out(part.folded.get(name)))
            below = indent + {"": "", "├─ ": "│  ", "└─ ": "   "}[turn]
            last = len(children) - 1
            agenda.extend(
                (child, name, below, "└─ " if index == last else "├─ ", level + 1)
                for index, child in reversed(tuple(enumerate(children)))
            )
        if sections:
            yield None


def _left_out(hidden: int | None) -> str:
    match hidden:
        case None:
            return ""
        case 0:
            return "  (…)"
        case _:
            return f"  (… {hidden} node{'s' * (hidden != 1)})"
