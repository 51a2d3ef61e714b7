"""Rules about whether anything can be detected at all (semantics, section 2)."""

from collections.abc import Iterator

import networkx as nx

from rvaft.findings import Severity
from rvaft.rules.context import Context
from rvaft.rules.inevitable import inevitable
from rvaft.rules.rule import Report, Rule
from rvaft.rules.words import branch_of, listing

_EVENT, _NEVER = 1, 2


def no_scenario(context: Context) -> Iterator[Report]:
    """Some scenario must be feasible."""
    if context.feasible_exists:
        return
    tree = context.tree
    place = tree.nodes[tree.root].place()
    if not context.space:
        dead = tuple(name for name in tree.order if name in context.dead)
        why = f"the guard of {listing(dead)} never holds; mend the guard or take the node out"
        yield Report(place, f"the tree has no feasible scenario: {why}", (tree.root, *dead))
        return
    why = "some event always has to come before itself; do not share a node between the children of an ordered gate"
    yield Report(place, f"the tree has no feasible scenario: {why}", (tree.root,))


def silent_scenario(context: Context) -> Iterator[Report]:
    """Every feasible scenario must have an occurrence; one without is feasible when its guards are: it orders nothing."""
    tree = context.tree
    marks = dict.fromkeys(tree.occurrences, _EVENT) | dict.fromkeys(context.dead, _EVENT | _NEVER)
    if inevitable(tree, marks, _EVENT | _NEVER)[tree.root]:
        return
    kept = context.feasible(context.budget(), without=frozenset(tree.occurrences))
    assert kept is not None
    guards = tuple(name for name in kept if tree.nodes[name].when is not None)
    message = f"{branch_of(tree, kept)}, has no runtime event and would be detected before anything happened"
    mend = f"; give {listing(guards[:3] or (tree.root,), 'or')} an event with `on`"
    place = tree.nodes[guards[0] if guards else tree.root].place()
    yield Report(place, message.replace(", has", " has") + mend, guards or (tree.root,))


def infeasible_scenario(context: Context) -> Iterator[Report]:
    """Scenarios that no trace can match are dropped, which is worth knowing."""
    if not context.space:
        return
    tree = context.tree
    for name in tree.order:
        if name in context.dead:
            message = f"the guard of {name} never holds, so every scenario with {name} is dropped"
            yield Report(tree.nodes[name].place("when"), message, (name,))
    if context.acyclic or not context.feasible_exists:
        return
    budget = context.budget()
    for component in nx.strongly_connected_components(context.order):
        if len(component) == 1:
            continue
        found = context.cyclic(budget, frozenset(component))
        if found is not None:
            kept, cycle = found
            nodes = tuple(dict.fromkeys(cycle))
            message = (
                f"{listing(nodes)} would have to come before itself in {branch_of(tree, kept)}, so that scenario is "
                "dropped; let no event be part of two children of one ordered gate"
            )
            yield Report(tree.nodes[nodes[0]].place(), message, nodes)


RULES = (
    Rule(
        "no-scenario",
        Severity.ERROR,
        "no feasible scenario",
        no_scenario,
        "A scenario is infeasible when one of its guards has no variables and does not hold, or when its precedence is "
        "cyclic. Infeasible scenarios are dropped; a tree of which nothing is left can never detect anything.",
        "top and a b;\na;\nb when 2 > 3;\n",
        "top and a b;\na;\nb when 3 > 2;\n",
    ),
    Rule(
        "silent-scenario",
        Severity.ERROR,
        "scenario without occurrences",
        silent_scenario,
        "A scenario all of whose nodes are without runtime event would be detected before anything happened. A leaf with "
        "only a guard observes nothing: put it under an `and` beside a node with an event.",
        "event reading(v) = { value: v };\ntop or a b;\na on reading(_);\nb when 1 < 2;\n",
        "event reading(v) = { value: v };\ntop and a b;\na on reading(_);\nb when 1 < 2;\n",
    ),
    Rule(
        "infeasible-scenario",
        Severity.WARNING,
        "infeasible scenario",
        infeasible_scenario,
        "A scenario with a guard that has no variables and does not hold, or with an event that has to come before itself "
        "because it is part of two children of one ordered gate, matches no trace. It is dropped.",
        "top or a b;\na;\nb and c d;\nc;\nd when 2 > 3;\n",
        "top or a b;\na;\nb and c d;\nc;\nd when 3 > 2;\n",
    ),
)
