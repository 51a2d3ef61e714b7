"""Restriction of trees and properties to one branch or one kind (semantics, sections 2 and 3).

Of a tree, a branch is a sub-DAG, and a kind a union of sub-DAGs. The union may have more branches
than the kind; only the property has exactly those of the kind.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final, TypeAlias

from rvaft.core.branches import Branch, or_gates
from rvaft.core.branches import branch as branch_of
from rvaft.core.build import build
from rvaft.core.property import Condition, One, Part, Property, Source, Within, parts_below, with_parts
from rvaft.errors import TooLarge, TreeError
from rvaft.model.guards import TimePoint, substitute, time_points
from rvaft.model.nodes import Kind, Node
from rvaft.model.tree import RVAFT, Whole, reachable

COPIES: Final = 1_000
"""The maximum number of sub-DAGs for a kind."""
Allowed: TypeAlias = Mapping[str, frozenset[str]]
"""For some `or` gates, the children that they may keep."""


def restrict(tree: RVAFT, *, branch: int | None = None, kind: Kind | str | None = None, limit: int = COPIES) -> RVAFT:
    """Return the tree restricted to one branch, or to the branches of one kind.

    Raises `TreeError` if there is none, and `TooLarge` if a kind needs more than `limit` sub-DAGs.
    """
    if branch is None and kind is None:
        return tree
    kind = None if kind is None else Kind(kind)
    return _part(tree, _ways(tree, branch, kind, limit), Whole(tree, branch, kind))


def _ways(tree: RVAFT, number: int | None, kind: Kind | None, limit: int) -> list[Allowed]:
    """Return the ways to have a branch or a kind; raises `TreeError` if there is none."""
    if number is not None:
        selected = branch_of(tree, number)
        if kind is not None and kind not in selected.kinds:
            raise TreeError(f"branch {number} does not have the kind {kind}", rule="no-branch")
        return [singly(selected.choices)]
    assert kind is not None, "without a branch and a kind there is no restriction"
    ways = ways_to_kind(tree, kind, limit)
    if not ways:
        raise TreeError(f"no branch has the kind {kind}", rule="no-branch", nodes=[tree.root])
    return ways


def alternatives(tree: RVAFT) -> tuple[RVAFT, ...]:
    """Return the sub-DAGs of a tree restricted to a kind; for any other tree, the tree itself.

    >>> import rvaft
    >>> tree = rvaft.loads("top and p q; p or f a; q or x b; f fault; x fault;")
    >>> [one.nodes["p"].children for one in alternatives(restrict(tree, kind="fault"))]
    [('f',), ('f', 'a')]
    """
    if tree.part_of is None or tree.part_of.kind is None or tree.part_of.branch is not None:
        return (tree,)
    whole = tree.part_of.tree
    return tuple(_part(whole, [allowed], tree.part_of) for allowed in ways_to_kind(whole, tree.part_of.kind))


def _part(tree: RVAFT, ways: Iterable[Allowed], part_of: Whole) -> RVAFT:
    kept: dict[str, set[str]] = {}
    for allowed in ways:

        def below(name: str, allowed: Allowed = allowed) -> tuple[str, ...]:
            children = tree.nodes[name].children
            return tuple(child for child in children if child in allowed[name]) if name in allowed else children

        for name in reachable(tree.root, below):
            kept.setdefault(name, set()).update(below(name))
    nodes = (tree.nodes[name] for name in kept)
    parts = [
        replace(node, children=tuple(child for child in node.children if child in kept[node.name])) for node in nodes
    ]
    return tree.changed(nodes=parts, part_of=part_of)


def ways_to_kind(tree: RVAFT, kind: Kind, limit: int = COPIES) -> list[Allowed]:
    """Return sub-DAGs that together have exactly the branches of the kind."""
    choosing = frozenset(or_gates(tree))
    rank = {name: index for index, name in enumerate(tree.order)}
    above = {tree.root: tree.root}  # immediate dominators
    for name in tree.order[1:]:
        meeting = set(tree.parents(name))
        while len(meeting) > 1:
            lowest = max(meeting, key=rank.__getitem__)
            meeting = meeting - {lowest} | {above[lowest]}
        (above[name],) = meeting
    ways: dict[str, list[Allowed]] = {}
    for node in tree.bottom_up():
        if node.kind is kind:
            ways[node.name] = [{}]
        elif node.name in choosing:
            ways[node.name] = _through_or(tree, node, ways, above)
        else:
            ways[node.name] = _distinct(way for child in node.children for way in ways[child])
        if len(ways[node.name]) > limit:
            raise TooLarge(f"ways to have the kind {kind} below {node.name}", limit=limit)
    return ways[tree.root]


def _through_or(tree: RVAFT, node: Node, ways: Mapping[str, list[Allowed]], above: Mapping[str, str]) -> list[Allowed]:
    """Return the ways of all children, merged if they constrain only gates dominated by their
    child.
    """

    def dominates(child: str, gate: str) -> bool:
        while gate not in (child, tree.root):
            gate = above[gate]
        return gate == child

    merged: dict[str, frozenset[str]] = {}
    together: set[str] = set()
    apart: list[Allowed] = []
    for child in node.children:
        owned = tree.parents(child) == (node.name,)
        if len(ways[child]) == 1 and all(owned and dominates(child, gate) for gate in ways[child][0]):
            together.add(child)
            merged.update(ways[child][0])
        else:
            apart.extend({**way, node.name: frozenset([child])} for way in ways[child])
    if together:
        apart.append({**merged, node.name: frozenset(together)})
    # Merge ways that differ only in the children of the node; drop a constraint that allows all.
    joined: dict[frozenset[tuple[str, frozenset[str]]], frozenset[str]] = {}
    for way in apart:
        rest = frozenset(item for item in way.items() if item[0] != node.name)
        joined[rest] = joined.get(rest, frozenset()) | way[node.name]
    everything = set(node.children)
    return _distinct(
        {**dict(rest), **({} if kept == everything else {node.name: kept})} for rest, kept in joined.items()
    )


def whole(tree: RVAFT) -> RVAFT:
    """Return the tree before restriction."""
    return tree if tree.part_of is None else tree.part_of.tree


def _distinct(ways: Iterable[Allowed]) -> list[Allowed]:
    """Return the ways without duplicates; an unconstrained way replaces all others."""
    found: list[Allowed] = []
    for way in ways:
        if not way:
            return [way]
        if way not in found:
            found.append(way)
    return found


def restrict_property(prop: Property, *, branch: int | None = None, kind: Kind | str | None = None) -> Property:
    """Return the property restricted to one branch or kind, with the alphabet of the tree.

    Raises `TreeError` if there is none, and `TooLarge` if a kind needs too many alternatives.
    """
    if branch is None and kind is None:
        return prop
    kind = None if kind is None else Kind(kind)
    ways = _ways(prop.tree, branch, kind, COPIES)
    prop = replace(prop, branch=branch, kind=kind)
    if len(ways) == 1:
        return allowing(prop, ways[0])
    copies = [allowing(prop, way, number) for number, way in enumerate(ways, 1)]
    wholes = {source: whole for copy in copies for source, whole in copy.wholes.items()}
    return replace(prop, root=One(None, tuple(dict.fromkeys(copy.root for copy in copies))), wholes=wholes)


def of_branch(prop: Property, selected: Branch) -> Property:
    """Return the property restricted to one branch of its tree."""
    return allowing(replace(prop, branch=selected.number), singly(selected.choices))


def singly(choices: Mapping[str, str]) -> Allowed:
    """Return the restriction to these choices."""
    return {gate: frozenset([child]) for gate, child in choices.items()}


def allowing(prop: Property, allowed: Allowed, copy: int = 0) -> Property:
    """Return the property with restricted choices and its time points numbered `copy`."""

    def kept(part: Part) -> tuple[Part, ...]:
        if not (isinstance(part, One) and part.source is not None and part.source.node in allowed):
            return part.parts
        chosen = allowed[part.source.node]
        return tuple(one for one in part.parts if one.source is not None and one.source.node in chosen)

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        match part:
            case One(source=Source(node, _)) if node in allowed:
                return One(part.source, parts)
            case Condition(guard=guard) if copy:
                points = [point for point in time_points(guard) if point.point != "at"]
                copied = {point.name: TimePoint.of(point.point, point.node, copy) for point in points}
                return replace(part, guard=substitute(guard, copied), written=part.written or guard)
            case Within() if copy:
                return Within(Source(part.source.node, copy), parts, part.duration)
            case _:
                return with_parts(part, parts)

    made: dict[Part, Part] = {}
    wholes: dict[Source, Part] = {}
    for part in parts_below(prop.root, kept):
        made[part] = change(part, tuple(made[one] for one in kept(part)))
        if part.source is not None and prop.wholes.get(whole := Source(part.source.node)) is part:
            wholes[whole._replace(number=copy)] = made[part]
    return replace(prop, root=made[prop.root], wholes=wholes)


def property_of(tree: RVAFT) -> Property:
    """Return the property of a tree, or of the branch or kind of a restricted tree."""
    if tree.part_of is None:
        return replace(build(tree), requested=tree)
    prop = restrict_property(build(tree.part_of.tree), branch=tree.part_of.branch, kind=tree.part_of.kind)
    return replace(prop, requested=tree)
