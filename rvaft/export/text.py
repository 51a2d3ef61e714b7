"""A tree as text for the terminal: one line per node, children in order.

A shared node is drawn once in full and referred to after that. Indentation is bounded: what lies deeper goes on in a section of
its own further down, so a chain of thousands of gates stays readable and linear in size.
"""

import json
from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

from rvaft.export.layout import TERMINAL, Look, Marks, View, caption, view
from rvaft.model.expressions import name_text
from rvaft.model.nodes import Kind, Node
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

MAX_LEVELS = 20
"""Levels of indentation before a new section begins; three columns each leave room for text on a terminal."""

MARK: Final = "● "
"""What stands before the line of a marked node; the same width of space before the others."""

_COLOURS: Final = {Kind.FAULT: "1;33", Kind.ATTACK: "1;31", None: "1"}
_FAINT: Final = "2"


class Line(NamedTuple):
    """One line: what stands left of a node, the node, what is said of it; `noted` is whether an event is named here.

    A line that refers to another one has the parent from which it does.
    """

    left: str
    node: Node
    text: str
    noted: bool = True
    parent: str | None = None

    def marked(self, marks: Marks) -> bool:
        """Whether the node is in the scenario; of a reference, whether the scenario has the node from this parent."""
        name = self.node.name
        return name in marks.kept if self.parent is None else marks.edge(self.parent, name)


def tree_text(tree: RVAFT, look: Look = TERMINAL, *, colour: bool = False) -> str:
    """The whole drawing; with marks, marked nodes stand out, and with `colour` they have ANSI escapes too.

    Raises `OptionError` for a look that the tree cannot have.
    """
    marks = look.marks
    lines: list[str] = []
    for line in _lines(_Scene(tree, look, view(tree, look))):
        if line is None:
            lines.append("")
        elif marks is None:
            lines.append(f"{line.left}{line.text}")
        else:
            text = _marked(line, marks)
            lines.append(_coloured(text, _colour(line, marks)) if colour else text)
    if marks is not None and marks.below:
        lines += ["", *map(visible, marks.below)]
    return "\n".join(lines) + "\n"


def _marked(line: Line, marks: Marks) -> str:
    sign = MARK if line.marked(marks) else " " * len(MARK)
    note = ", ".join(marks.notes.get(line.node.name, ())) if line.noted else ""
    return f"{sign}{line.left}{line.text}{f'  {visible(note)}' if note else ''}".rstrip()


def _colour(line: Line, marks: Marks) -> str:
    return _COLOURS[line.node.kind] if line.marked(marks) else _FAINT


def _coloured(text: str, colour: str) -> str:
    return f"\x1b[{colour}m{text}\x1b[0m"


class _Scene(NamedTuple):
    """What is drawn."""

    tree: RVAFT
    look: Look
    part: View


def _lines(scene: _Scene) -> Iterator[Line | None]:
    """The lines of all sections, None between two sections."""
    sections = deque([scene.tree.root])
    drawn: set[str] = set()
    while sections:
        yield from _section(scene, sections.popleft(), drawn, sections)
        if sections:
            yield None


def _section(scene: _Scene, top: str, drawn: set[str], sections: "deque[str]") -> Iterator[Line]:
    """The lines of one section; adds to `drawn` what it draws and to `sections` what it leaves for later."""
    agenda: list[tuple[str, str | None, str, str, int]] = [(top, None, "", "", 0)]
    while agenda:
        name, parent, indent, branch, level = agenda.pop()
        node = scene.tree.nodes[name]
        if name in drawn and level > 0:
            where = "below" if name in sections else "above"
            yield Line(indent + branch, node, f"{visible(name_text(name))} (see {where})", noted=False, parent=parent)
            continue
        drawn.add(name)
        children = scene.part.children(node)
        later = level == MAX_LEVELS and bool(children)
        rest = "  (continued below)" if later else _left_out(scene.part.folded.get(name))
        yield Line(indent + branch, node, f"{said(node, events=scene.look.events)}{rest}", noted=not later)
        if later:
            sections.append(name)
            continue
        below = indent + {"": "", "├─ ": "│  ", "└─ ": "   "}[branch]
        last = len(children) - 1
        agenda.extend(
            (child, name, below, "└─ " if index == last else "├─ ", level + 1)
            for index, child in reversed(tuple(enumerate(children)))
        )


def _left_out(hidden: int | None) -> str:
    match hidden:
        case None:
            return ""
        case 0:
            return "  (…)"
        case 1:
            return "  (… 1 node)"
        case _:
            return f"  (… {hidden} nodes)"


def said(node: Node, *, events: bool = True) -> str:
    """A node in one line: name, gate, kind, event, guard, label."""
    words = caption(node)
    head = name_text(node.name) if words.gate is None else f"{name_text(node.name)} {words.gate}"
    parts = [
        head,
        words.kind and f"[{words.kind}]",
        words.on and f"on {words.on}" if events else None,
        words.when and f"when {words.when}" if events else None,
        json.dumps(words.label, ensure_ascii=False) if words.label else None,
    ]
    return visible("  ".join(part for part in parts if part))
