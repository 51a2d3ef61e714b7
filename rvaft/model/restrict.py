"""The part of a tree that a monitor for one branch or one kind looks at (semantics, sections 2 and 3).

The result is a tree again, with the alphabet of the whole, so nothing that takes a tree needs to know of branches or kinds.
A branch is a sub-DAG. The branches of a kind are a union of sub-DAGs, each given by the children that some `or` gates may
keep; where one does not suffice, the result is an `or` over renamed copies.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import networkx as nx

from rvaft.errors import TooLarge, TreeError
from rvaft.model.branches import branch as branch_of
from rvaft.model.nodes import Gate, Kind, Node
from rvaft.model.tree import RVAFT, Whole, reachable

DEFAULT_LIMIT = 1_000

Allowed = Mapping[str, frozenset[str]]


def restrict(
    tree: RVAFT, *, branch: int | None = None, kind: Kind | str | None = None, limit: int = DEFAULT_LIMIT
) -> RVAFT:
    """The tree with the scenarios of one branch, or of the branches of one kind; the tree itself when neither is given.

    Raises `TreeError` where there is no such branch or kind, `TooLarge` where a kind needs more than `limit` copies.
    """
    kind = None if kind is None else Kind(kind)
    if branch is not None:
        chosen = branch_of(tree, branch)
        if kind is not None and kind not in chosen.kinds:
            raise TreeError(f"branch {branch} does not have the kind {kind}", rule="no-branch")
        allowed = {gate: frozenset([child]) for gate, child in chosen.choices.items()}
        return _union(tree, [allowed], branch, kind)
    if kind is None:
        return tree
    ways = _ways_to_kind(tree, kind, limit)
    if not ways:
        raise TreeError(f"no branch has the kind {kind}", rule="no-branch", nodes=[tree.root])
    return _union(tree, ways, None, kind)


def _union(tree: RVAFT, ways: list[Allowed], branch: int | None, kind: Kind | None) -> RVAFT:
    """The tree whose scenarios are those that some of the ways allow."""
    if len(ways) == 1:
        whole = Whole(tree, branch, kind)
        nodes = _part(tree, ways[0])
        return _with(tree, tree.root, nodes, whole)
    copies: list[Node] = []
    origins: dict[str, str] = {}
    for number, allowed in enumerate(ways, 1):
        for node in _part(tree, allowed):
            copies.append(_renamed(node, number))
            origins[copies[-1].name] = node.name
    top = Node(f"{tree.root}#", Gate.OR, tuple(_copy(tree.root, number) for number in range(1, len(ways) + 1)))
    whole = Whole(tree, branch, kind, origins)
    nodes = [top, *copies]
    return _with(tree, top.name, nodes, whole)


def _with(tree: RVAFT, root: str, nodes: list[Node], whole: Whole) -> RVAFT:
    """The tree with another root and other nodes; what else it declares stays."""
    return RVAFT(
        root,
        nodes,
        tree.events.values(),
        ignores=tree.ignores,
        topics=tree.topics.values(),
        causality=tree.causality,
        part_of=whole,
    )


def _part(tree: RVAFT, allowed: Allowed) -> list[Node]:
    """The nodes reached through the allowed children, with these children only."""

    def kept(name: str) -> tuple[str, ...]:
        children = tree.nodes[name].children
        return tuple(child for child in children if child in allowed[name]) if name in allowed else children

    return [replace(tree.nodes[name], children=kept(name)) for name in reachable(tree.root, kept)]


def _copy(name: str, number: int) -> str:
    return f"{name}#{number}"


def _renamed(node: Node, number: int) -> Node:
    return replace(node, name=_copy(node.name, number), children=tuple(_copy(child, number) for child in node.children))


def _ways_to_kind(tree: RVAFT, kind: Kind, limit: int) -> list[Allowed]:
    """Sub-DAGs whose branches together are exactly the branches that have the kind."""
    dominator = nx.immediate_dominators(tree.graph, tree.root)
    ways: dict[str, list[Allowed]] = {}
    for node in tree.bottom_up():
        if node.kind is kind:
            ways[node.name] = [{}]
        elif node.gate is Gate.OR:
            ways[node.name] = _through_or(tree, node, ways, dominator)
        else:
            ways[node.name] = _distinct(way for child in node.children for way in ways[child])
        if len(ways[node.name]) > limit:
            raise TooLarge(f"ways to have the kind {kind} below {node.name}", limit=limit)
    return ways[tree.root]


def _through_or(
    tree: RVAFT, node: Node, ways: Mapping[str, list[Allowed]], dominator: Mapping[str, str | None]
) -> list[Allowed]:
    """One way per child and its ways; those that touch only what their child alone leads to are merged into one."""
    merged: dict[str, frozenset[str]] = {}
    together: set[str] = set()
    apart: list[Allowed] = []
    for child in node.children:
        owned = tree.parents(child) == (node.name,)
        if len(ways[child]) == 1 and all(owned and _dominates(child, gate, dominator) for gate in ways[child][0]):
            together.add(child)
            merged.update(ways[child][0])
        else:
            apart.extend({**way, node.name: frozenset([child])} for way in ways[child])
    if together:
        apart.append({**merged, node.name: frozenset(together)})
    return _distinct(_joined(apart, node))


def _joined(ways: Iterable[Allowed], node: Node) -> Iterator[Allowed]:
    """The ways with those made one that differ only in the children of the node; it need not be told that all are allowed."""
    kept: dict[frozenset[tuple[str, frozenset[str]]], frozenset[str]] = {}
    for way in ways:
        rest = frozenset(item for item in way.items() if item[0] != node.name)
        kept[rest] = kept.get(rest, frozenset()) | way[node.name]
    for rest, children in kept.items():
        yield dict(rest) if children == set(node.children) else {**dict(rest), node.name: children}


def _dominates(above: str, below: str, dominator: Mapping[str, str | None]) -> bool:
    name: str | None = below
    while name is not None and name != above:
        name = dominator.get(name) if dominator.get(name) != name else None
    return name == above


def _distinct(ways: Iterable[Allowed]) -> list[Allowed]:
    """The ways without repetition; one that allows everything makes the others superfluous."""
    found: list[Allowed] = []
    for way in ways:
        if not way:
            return [way]
        if way not in found:
            found.append(way)
    return found
