"""Names of atomic propositions, words that every tool reads and different for different nodes, and of automata."""

import re
from typing import Final

from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

ALIVE: Final = "alive"
RELEVANT: Final = "relevant"

_PLAIN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_TAKEN: Final = re.compile(r"alive|relevant|guard_\d+|true|false|and|or|xor|not|last|first|[FGXUWRMV]", re.IGNORECASE)


def guard_name(number: int) -> str:
    """The name of the proposition of a guard."""
    return f"guard_{number}"


def atom_name(node: str) -> str:
    """The name of the proposition for a node's event: the node's own where that is a word with no other meaning.

    Otherwise the characters in the way are written as `_x` and their number in hexadecimal, and a `_`; so is a `_` that an `x`
    follows, which keeps different names different.
    """
    if _PLAIN.fullmatch(node) and not _TAKEN.fullmatch(node) and "_x" not in node:
        return node
    if _TAKEN.fullmatch(node):
        return _code(node[0]) + node[1:]
    written = [_written(node, index) for index in range(len(node))]
    return "".join(written) or "_x_"


def _written(node: str, index: int) -> str:
    character = node[index]
    letter = character.isascii() and (character.isalpha() or character == "_" or (character.isdigit() and index > 0))
    return character if letter and node[index : index + 2] != "_x" else _code(character)


def _code(character: str) -> str:
    return f"_x{ord(character):x}_"


def title_of(tree: RVAFT, semantics: Semantics) -> str:
    """The name of an automaton: the root, the part of the tree that is watched, the semantics."""
    if (part := tree.part_of) is None:
        return f"{tree.root}, {semantics}"
    chosen = [f"branch {part.branch}"] if part.branch is not None else []
    chosen += [part.kind.value] if part.kind is not None else []
    return ", ".join([part.tree.root, *chosen, semantics])
