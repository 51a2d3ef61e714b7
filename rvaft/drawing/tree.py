"""A tree as text for the terminal: one line per node, children in order.

A shared node is drawn once in full and referred to after that. Indentation is bounded: what lies deeper goes on in a section of
its own further down, so a chain of thousands of gates stays readable and linear in size.
"""

import json
from collections import deque
from collections.abc import Iterator

from rvaft.drawing.captions import caption
from rvaft.language import name_text
from rvaft.model import Node
from rvaft.printable import visible
from rvaft.tree import RVAFT

MAX_LEVELS = 20
"""Levels of indentation before a new section begins; three columns each leave room for text on a terminal."""


def tree_text(tree: RVAFT) -> str:
    """The whole drawing."""
    sections = deque([tree.root])
    drawn: set[str] = set()
    lines: list[str] = []
    while sections:
        name = sections.popleft()
        if lines:
            lines.append("")
        lines.extend(_section(tree, name, drawn, sections))
    return "\n".join(lines) + "\n"


def _section(tree: RVAFT, top: str, drawn: set[str], sections: "deque[str]") -> Iterator[str]:
    """The lines of one section; adds to `drawn` what it draws and to `sections` what it leaves for later."""
    agenda: list[tuple[str, str, str, int]] = [(top, "", "", 0)]
    while agenda:
        name, indent, branch, level = agenda.pop()
        node = tree.nodes[name]
        if name in drawn and level > 0:
            yield f"{indent}{branch}{visible(name_text(name))} (see {'below' if name in sections else 'above'})"
            continue
        drawn.add(name)
        later = level == MAX_LEVELS and bool(node.children)
        yield f"{indent}{branch}{line(node)}{'  (continued below)' if later else ''}"
        if later:
            sections.append(name)
            continue
        below = indent + {"": "", "├─ ": "│  ", "└─ ": "   "}[branch]
        last = len(node.children) - 1
        agenda.extend(
            (child, below, "└─ " if index == last else "├─ ", level + 1)
            for index, child in reversed(tuple(enumerate(node.children)))
        )


def line(node: Node) -> str:
    """A node in one line: name, gate, kind, event, guard, label."""
    words = caption(node)
    head = name_text(node.name) if words.gate is None else f"{name_text(node.name)} {words.gate}"
    parts = [
        head,
        words.kind and f"[{words.kind}]",
        words.on and f"on {words.on}",
        words.when and f"when {words.when}",
        json.dumps(words.label, ensure_ascii=False) if words.label else None,
    ]
    return visible("  ".join(part for part in parts if part))
