"""What stands in the box of a node, row by row, before any format makes it its own."""

import json
from collections.abc import Iterator
from enum import Enum, auto
from typing import NamedTuple

from rvaft.drawing.captions import caption
from rvaft.drawing.look import Look
from rvaft.drawing.wrapping import wrapped, wrapped_code
from rvaft.model import Node


class Role(Enum):
    """What a row is there for."""

    PLAIN = auto()
    BOLD = auto()
    EVENT = auto()
    GUARD = auto()


class Row(NamedTuple):
    """The lines of a row. They are not escaped for any format."""

    role: Role
    lines: list[str]


def rows(node: Node, look: Look) -> Iterator[Row]:
    """Name, label, event, guard and notes, as far as the look has them; the first row tells which node it is."""
    words, width = caption(node), look.wrap
    if not words.label:
        yield Row(Role.PLAIN, wrapped(words.name, width))
    elif look.names:
        yield Row(Role.BOLD, wrapped(words.name, width))
    if words.label:
        yield Row(Role.PLAIN, wrapped(words.label, width))
    if look.events and (event := words.on or _default(node)) is not None:
        yield Row(Role.EVENT, wrapped_code(event, look.code_width))
    if look.events and words.when is not None:
        yield Row(Role.GUARD, wrapped_code(f"when {words.when}", look.code_width))
    for place, part in enumerate(() if look.marks is None else look.marks.notes.get(node.name, ())):
        yield Row(Role.PLAIN if place else Role.BOLD, wrapped(part, width))


def _default(node: Node) -> str | None:
    """The event of a leaf that states nothing: the field that it asks for, with the leaf's name."""
    return f"event: {json.dumps(node.name, ensure_ascii=False)}" if node.leaf and node.when is None else None
