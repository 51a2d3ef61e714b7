"""Rules about scenarios: existence, events, feasibility and bound variables."""

from collections.abc import Iterator
from typing import Final

from rvaft.core.feasibility import ScenarioSpace, borne_surely, inevitable
from rvaft.core.precedence import node_of
from rvaft.core.property import Condition, Kept, Part
from rvaft.model.guards import time_points, variables
from rvaft.model.nodes import Node
from rvaft.model.patterns import Anything, rigid_variables
from rvaft.model.tree import knots
from rvaft.rules.rule import RuleReport, branch_of
from rvaft.support.budget import Undecided
from rvaft.support.wording import did_you_mean, listing

_EVENT, _NEVER = 1, 2


def no_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Some scenario is feasible."""
    if not space.is_empty:
        return
    tree = space.tree
    dead: tuple[str, ...] = ()
    why = "in every scenario some event precedes itself; do not share a node between the children of an ordered gate"
    if not space.resolutions:
        dead = tuple(name for name in tree.order if name in space.dead)
        why = f"the guard of {listing(dead)} never holds; correct the guard or remove the node"
    yield RuleReport(tree.nodes[tree.root].place(), f"the tree has no feasible scenario: {why}", (tree.root, *dead))


def silent_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every feasible scenario has an occurrence."""
    tree = space.tree
    if all(node.name in space.leaf for node in tree.top_down() if node.leaf):
        return
    marks: dict[Part, int] = dict.fromkeys(space.leaf.values(), _EVENT)
    marks |= dict.fromkeys(space.never, _EVENT | _NEVER)
    if inevitable(space.order, marks, _EVENT | _NEVER)[space.prop.root]:
        return
    kept = space.feasible(space.budget(), without=tree.occurrences)
    assert kept is not None
    guards = tuple(node_of(part) for part in kept if isinstance(part, Condition)) or (tree.root,)
    message = f"{branch_of(kept)}, has no runtime event and would be detected before the first event"
    mend = f"; give {listing(guards[:3], 'or')} an event with `on`"
    yield RuleReport(tree.nodes[guards[0]].place(), message.replace(", has", " has") + mend, guards)


def infeasible_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No scenario is infeasible; infeasible scenarios are dropped."""
    if not space.resolutions:
        return
    tree = space.tree
    for name in tree.order:
        if name in space.dead:
            message = f"the guard of {name} never holds, so every scenario with {name} is dropped"
            yield RuleReport(tree.nodes[name].place("when"), message, (name,))
    if space.acyclic or space.is_empty:
        return
    budget = space.budget()
    for knot in knots(space.widest):
        if any((node := node_of(part)) and tree.nodes[node].made for _, part, _ in knot):
            continue
        found = space.cyclic(budget, knot)
        if found is not None:
            kept, nodes = found
            where = f"before itself in {branch_of(kept)}, so that scenario is dropped"
            mend = "do not put an event below two children of one ordered gate"
            message = f"{listing(nodes)} would have to come {where}; {mend}"
            yield RuleReport(tree.nodes[nodes[0]].place(), message, nodes)
    if (unending := space.endless(budget)) is not None:
        kept, gate = unending
        if tree.nodes[gate].made:
            return
        where = f"cannot end one after the other in {branch_of(kept)}, so that scenario is dropped"
        mend = "let no two of them end with the same event"
        yield RuleReport(tree.nodes[gate].place("gate"), f"the parts of {gate} {where}; {mend}", (gate,))


_ONE_OF_TWO_LETTERS: Final = 0.5
"""The similarity of `T1` and `T2`, one of which is suggested for the other."""


def unbound_variable(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every variable of a guard occurs in an `on` in every feasible scenario with the guard."""
    tree = space.tree
    binders: dict[str, list[str]] = {}
    for occurrence in tree.occurrences:
        for name in rigid_variables(tree.pattern(occurrence) or Anything()):
            binders.setdefault(name, []).append(occurrence)
    uses: list[tuple[Node, str]] = []  # guards with a variable that the node's own event does not bind
    for node in tree.top_down():
        bound_here = set(rigid_variables(tree.pattern(node.name) or Anything()))
        bound_here.update(point.name for point in time_points(node.when))
        bound_here.update(node.own_values)
        uses += ((node, name) for name in variables(node.when) if name not in bound_here)
    bearers = {name: [space.leaf[binder] for binder in some] for name, some in binders.items()}
    sure = borne_surely(space, [(node.name, name) for node, name in uses], bearers)
    budget = space.budget()
    for node, name in uses if space.resolutions else ():
        if (node.name, name) in sure:
            continue
        kept: Kept | None
        try:
            kept = space.feasible(budget, [node.name], without=binders.get(name, ()))
        except Undecided:
            if not space.acyclic:
                raise
            kept = {}  # The scenario exists, but the search for it reached the limit.
        if kept is not None:
            where = branch_of(kept) if kept else "some branch"
            mend = f"no `on` binds it{did_you_mean(name, tree.variables, cutoff=_ONE_OF_TWO_LETTERS)}"
            if name in binders:
                there = f"add it to the `on` of a node that is in every scenario with {node.name}"
                mend = f"only {listing(binders[name])} binds it: {there}"
            message = f"variable {name} in the guard of {node.name} is not bound in {where}; {mend}"
            yield RuleReport(node.place("when"), message, (node.name,))
