"""A tree as text for the terminal: one line per node, children in order.

A shared node is drawn once and then referred to. Deep parts continue in a section of their own, so
that long chains of gates stay readable and linear in size.
"""

from collections import deque
from collections.abc import Iterator
from typing import Final

from rvaft.export.layout import TERMINAL, Look, View, node_line, view
from rvaft.model.expressions import name_text
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible

MAX_LEVELS = 20
MARK: Final = "● "
_COLOURS: Final = {Kind.FAULT: "1;33", Kind.ATTACK: "1;31", None: "1"}
_FAINT: Final = "2"


def tree_text(tree: RVAFT, look: Look = TERMINAL, *, colour: bool = False) -> str:
    """Return the tree as text; `colour` adds ANSI escapes for marks. Raises `OptionError`.

    >>> import rvaft
    >>> print(tree_text(rvaft.loads("top or a b; a fault;")), end="")
    top OR
    ├─ a  [fault]
    └─ b
    """
    marks = look.marks
    lines: list[str] = []
    for name, line, parent, noted in _lines(tree, look, view(tree, look)):
        if marks is None or not line:
            lines.append(line)
            continue
        marked = name in marks.kept if parent is None else marks.edge(parent, name)
        notes = visible(", ".join(marks.notes.get(name, ()))) if noted else ""
        text = f"{MARK if marked else ' ' * len(MARK)}{line}{f'  {notes}' if notes else ''}".rstrip()
        code = _COLOURS[tree.nodes[name].kind] if marked else _FAINT
        lines.append(f"\x1b[{code}m{text}\x1b[0m" if colour else text)
    if marks is not None and marks.below:
        lines += ["", *map(visible, marks.below)]
    return "\n".join(lines) + "\n"


def _lines(tree: RVAFT, look: Look, part: View) -> Iterator[tuple[str, str, str | None, bool]]:
    """Yield lines with node, parent of a reference, and whether events are shown."""
    sections = deque([tree.root])
    drawn: set[str] = set()
    while sections:
        if drawn:
            yield "", "", None, False
        agenda: list[tuple[str, str | None, str, str, int]] = [(sections.popleft(), None, "", "", 0)]
        while agenda:
            name, parent, indent, turn, level = agenda.pop()
            shown = f"{indent}{turn}{visible(name_text(name))}"
            if name in drawn and level > 0:
                yield name, f"{shown} (see {'below' if name in sections else 'above'})", parent, False
                continue
            drawn.add(name)
            node = tree.nodes[name]
            children = part.children(node)
            if words := node_line(node, events=look.events, value=(look.values or {}).get(name, "")):
                shown += f"{' ' if node.gate else '  '}{words}"
            if level == MAX_LEVELS and children:
                sections.append(name)
                yield name, f"{shown}  (continued below)", None, False
                continue
            if hidden := part.folded.get(name):
                shown += f"  (… {hidden} node{'s' * (hidden != 1)})"
            elif hidden == 0:
                shown += "  (…)"
            yield name, shown, None, True
            below = indent + {"": "", "├─ ": "│  ", "└─ ": "   "}[turn]
            turns = ["├─ "] * (len(children) - 1) + ["└─ "]
            entries = zip(children, turns, strict=False)
            agenda += [(child, name, below, turn, level + 1) for child, turn in entries][::-1]
