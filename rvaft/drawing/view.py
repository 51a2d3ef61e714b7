"""Which part of a tree is drawn, where subtrees are left out."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property

import networkx as nx

from rvaft.drawing.look import Look
from rvaft.errors import OptionError
from rvaft.model import Node
from rvaft.printable import visible
from rvaft.tree import RVAFT


@dataclass(frozen=True)
class View:
    """The nodes that are drawn, parents first; of a folded one the children are left out.

    `folded` counts the nodes below that are drawn nowhere else.
    """

    nodes: tuple[Node, ...]
    folded: Mapping[str, int]

    def children(self, node: Node) -> tuple[str, ...]:
        """The children that are drawn as such."""
        return () if node.name in self.folded else node.children

    @cached_property
    def shared(self) -> frozenset[str]:
        """The nodes that are drawn as children of several others."""
        parents = Counter(child for node in self.nodes for child in self.children(node))
        return frozenset(name for name, count in parents.items() if count > 1)

    @cached_property
    def numbered(self) -> frozenset[str]:
        """The SAND gates below which something is shared: no layout can promise that their children stand in order.

        What is below them and shared may have to stand elsewhere, as other parents want it.
        """
        loose: set[str] = set()  # shared, or above something that is
        found: set[str] = set()
        for node in reversed(self.nodes):
            if any(child in loose for child in self.children(node)):
                loose.add(node.name)
                if node.gate is not None and node.gate.ordered:
                    found.add(node.name)
            if node.name in self.shared:
                loose.add(node.name)
        return frozenset(found)


def view(tree: RVAFT, look: Look) -> View:
    """The part that a look shows; raises `OptionError` for a node to collapse that the tree does not have, or a negative depth.

    A node is as deep as its shortest path from the root. At the last level a node is folded if a child of it is left out.
    """
    for name in look.collapse:
        _check_known(tree, name)
    if look.depth is not None and look.depth < 0:
        raise OptionError(f"the depth of a drawing is 0 or more, not {look.depth}")
    drawn = _drawn(tree, frozenset(look.collapse), look.depth)
    nodes = tuple(node for node in tree.top_down() if node.name in drawn)
    return View(nodes, {node.name: _hidden(tree, node, drawn) for node in nodes if _folded(node, look, drawn)})


def _folded(node: Node, look: Look, drawn: Collection[str]) -> bool:
    return bool(node.children) and (node.name in look.collapse or not all(child in drawn for child in node.children))


def _drawn(tree: RVAFT, collapse: frozenset[str], depth: int | None) -> frozenset[str]:
    drawn = {tree.root}
    level, reached = [tree.root], 0
    while level and (depth is None or reached < depth):
        below = [child for name in level if name not in collapse for child in tree.nodes[name].children]
        level = [child for child in dict.fromkeys(below) if child not in drawn]
        drawn.update(level)
        reached += 1
    return frozenset(drawn)


def _hidden(tree: RVAFT, node: Node, drawn: Collection[str]) -> int:
    return sum(name not in drawn for name in nx.descendants(tree.graph, node.name))


def _check_known(tree: RVAFT, name: str) -> None:
    if name in tree.order:
        return
    if name in tree.nodes:
        raise OptionError(f"cannot collapse {visible(name)}: the root does not lead to it")
    close = get_close_matches(name, tree.order, n=1, cutoff=0.4)
    hint = f"; did you mean {visible(close[0])}?" if close else ""
    raise OptionError(f"cannot collapse {visible(name)}: the tree has no such node{hint}")
