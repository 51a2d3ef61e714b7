"""Relaxations: trees with one condition less, each of which some logs match that the tree does not."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final

from rvaft.model.guards import Guard, renamed, time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Gate, Node
from rvaft.model.patterns import Variable
from rvaft.model.tree import RVAFT, reachable

_CONJUNCTIVE: Final = frozenset({Gate.AND, Gate.SAND, Gate.SAND_RL, Gate.PAND, Gate.VOT})
"""The gates that need several children; a child that is not asked for is one less."""


class Lack(StrEnum):
    """What a relaxation does not ask for."""

    COUNT = "count"
    EVENT = "event"
    WINDOW = "window"
    GUARD = "guard"
    ORDER = "order"
    VALUE = "value"
    ABSENCE = "absence"


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A tree without a condition of a node; `missing` are the nodes whose events it does not ask for.

    `value` is the variable that may have another value at the node, called `other` in the tree.
    """

    lack: Lack
    node: str
    tree: RVAFT
    missing: tuple[str, ...] = ()
    value: str = ""
    other: str = ""


def relaxations(tree: RVAFT) -> Iterator[Relaxation]:
    """Iterate over the trees with one condition less, by node; counts are left to `with_count`.

    >>> import rvaft
    >>> tree = rvaft.loads("time t as s; top sand a b within 5 s; b times 3;")
    >>> [(one.lack.value, one.node) for one in relaxations(tree)]
    [('window', 'top'), ('order', 'top'), ('event', 'a'), ('event', 'b')]
    """
    for node in tree.top_down():
        if node.within is not None:
            yield Relaxation(Lack.WINDOW, node.name, _with(tree, node.name, within=None))
        if node.when is not None and (node.has_event or node.children):
            yield Relaxation(Lack.GUARD, node.name, _with(tree, node.name, when=None))
        if node.without:
            yield Relaxation(Lack.ABSENCE, node.name, _with(tree, node.name, without=()))
        if node.gate is not None and node.gate.ordered:
            yield Relaxation(Lack.ORDER, node.name, _with(tree, node.name, gate=Gate.AND))
        if (rest := without_events(tree, [node.name])) is not None:
            lack = Lack.EVENT if node.has_event or node.children else Lack.GUARD
            yield Relaxation(lack, node.name, rest, missing=(node.name,))
        yield from _other_values(tree, node)


def with_count(tree: RVAFT, leaf: str, count: int) -> RVAFT:
    """Return the tree with another number of events of a leaf."""
    return _with(tree, leaf, times=count)


def without_events(tree: RVAFT, names: Collection[str]) -> RVAFT | None:
    """Return the tree that does not ask for these nodes; None if a node is an alternative, or nothing remains.

    Guards and absences that name something of them are left out with them.
    """
    nodes = _without(tree, names)
    return None if nodes is None else _rebuilt(tree, nodes)


def can_leave_out(tree: RVAFT, names: Collection[str]) -> bool:
    """Whether there is a tree `without_events` of these nodes."""
    return _without(tree, names) is not None


def _without(tree: RVAFT, names: Collection[str]) -> dict[str, Node] | None:
    """Return the nodes without these, and without leaves of a guard that names something of them."""
    nodes, gone, todo = dict(tree.nodes), set[str](), list(names)
    while todo:
        for name in sorted(todo, key=lambda name: -tree.rank[name]):
            if name not in gone and not _leave_out(tree, nodes, gone, name):
                return None
        if tree.root in gone:
            return None
        reached, lost = _reached(tree, nodes)
        conditions = (node for node in reached.values() if not node.children and node.on is None and node.when)
        todo = [node.name for node in conditions if not _is_known(node.when, reached, lost)]
    return nodes


def _leave_out(tree: RVAFT, nodes: dict[str, Node], gone: set[str], name: str) -> bool:
    """Remove a node from its parents, and parents of which nothing remains from theirs."""
    gone.add(name)
    for above in tree.parents(name):
        parent = nodes[above]
        if above in gone or name not in parent.children:
            continue
        if parent.gate not in _CONJUNCTIVE or parent.threshold == 1:
            return False
        children = tuple(child for child in parent.children if child != name)
        threshold = None if parent.threshold is None else parent.threshold - 1
        nodes[above] = replace(parent, children=children, threshold=threshold)
        if not children:
            if parent.on is None:
                if not _leave_out(tree, nodes, gone, above):
                    return False
            else:
                nodes[above] = replace(nodes[above], gate=None, threshold=None, within=None)
    return True


def _with(tree: RVAFT, name: str, **parts: Any) -> RVAFT:
    return _rebuilt(tree, {**tree.nodes, name: replace(tree.nodes[name], **parts)})


def _other_values(tree: RVAFT, node: Node) -> Iterator[Relaxation]:
    """Iterate over the trees in which a variable of a node may have another value than at the other nodes."""
    others = {name for one in tree.top_down() if one.name != node.name and one.on for name in one.on.variables}
    for name in () if node.on is None else node.on.variables:
        if name in others and name not in node.own_values and node.on is not None:
            other = f"{name} of {node.name}"
            arguments = tuple(Variable(other) if one == Variable(name) else one for one in node.on.arguments)
            guard = node.when and renamed(node.when, {name: other})
            changed = _with(tree, node.name, on=replace(node.on, arguments=arguments), when=guard)
            yield Relaxation(Lack.VALUE, node.name, changed, value=name, other=other)


def _rebuilt(tree: RVAFT, nodes: Mapping[str, Node]) -> RVAFT:
    """Return a tree with these nodes as far as the root reaches them, without what names other parts."""
    reached, lost = _reached(tree, nodes)
    kept = [_closed(node, reached, lost) for name, node in nodes.items() if name in reached]
    return tree.changed(nodes=kept, shows=(), repeat_by=None, part_of=None)


def _reached(tree: RVAFT, nodes: Mapping[str, Node]) -> tuple[dict[str, Node], frozenset[str]]:
    """Return the nodes that the root reaches, and the variables of the tree that they do not bind."""
    reached = {name: nodes[name] for name in reachable(tree.root, lambda name: nodes[name].children)}
    bound = {one for node in reached.values() if node.on for one in node.on.variables}
    return reached, frozenset(tree.variables) - bound


def _is_known(guard: Guard | None, nodes: Collection[str], lost: frozenset[str]) -> bool:
    """Whether a guard names only nodes and variables that the tree still has."""
    return lost.isdisjoint(guard_variables(guard)) and all(point.node in nodes for point in time_points(guard))


def _closed(node: Node, nodes: Collection[str], lost: frozenset[str]) -> Node:
    """Return a node without the guard and the absences that name a node or a variable that the tree has lost."""
    whole = _is_known(node.when, nodes, lost)
    without = tuple(clause for clause in node.without if lost.isdisjoint(clause.variables))
    return replace(node, when=node.when if whole else None, without=without)
