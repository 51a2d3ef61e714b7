"""What the branches that are still alive wait for (semantics, sections 2 and 4).

A node is pending in a branch if some partial match of the branch has all that precedes the node's event, but not that event. As for
the verdict, whether the variables and guards can ever agree is not looked at. Under `scattered` only those partial matches
count that the engine follows: one that another can replace waits for nothing that matters.

All of this is found when it is asked for, from how the partial matches came about; monitoring does nothing for it.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from itertools import islice

from rvaft.analysis.branches import branches
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.contiguous import Following
from rvaft.engine.explanation import EarliestMatches, chosen_part, whole
from rvaft.engine.scattered_linear import Earliest
from rvaft.engine.steps import Matching
from rvaft.errors import TooLarge
from rvaft.model.expressions import name_text, on_text
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, fingerprint
from rvaft.monitors import Awaited, Pending


def pending(
    tree: RVAFT, strategy: Following | Earliest, *, limit: int, before: int | None = None
) -> tuple[Pending, ...]:
    """What each live branch waits for; with `before`, waited for when the event of that number ended the last hope.

    Beyond `limit` branches all are taken together. Raises `TooLarge` as the monitor does.
    """
    selected, all_of = _selected(tree, limit), whole(tree)
    if isinstance(strategy, Earliest):
        finder = EarliestMatches(tree, strategy)
        waiting = ((number, finder.awaited(choices)) for number, choices in selected)
        return tuple(Pending(number, awaited(all_of, names), {}) for number, names in waiting if names)
    histories = [
        [step for step in reversed(list(configuration.history())) if before is None or step.position < before]
        for configuration in (strategy.partial if before is None else strategy.lost)
    ]
    return tuple(
        Pending(number, awaited(all_of, names), variables)
        for number, choices in selected
        for names, variables in _waiting(tree, strategy, number, choices, histories)
        if names
    )


def awaited(tree: RVAFT, names: Iterable[str]) -> tuple[Awaited, ...]:
    """The nodes of a tree with these names, each once, in the order of the tree, with their events as text."""
    wanted = set(names)
    nodes = (tree.nodes[name] for name in tree.order if name in wanted)
    return tuple(Awaited(n.name, name_text(n.name) if n.on is None else on_text(n.on)) for n in nodes)


def admitted(matching: Matching, configuration: Configuration) -> Iterator[str]:
    """The nodes whose event may come next."""
    compiled = matching.compiled
    return (compiled.names[n] for n, own in enumerate(compiled.own) if own and matching.admits(configuration, n))


def _selected(tree: RVAFT, limit: int) -> list[tuple[int | None, Mapping[str, str]]]:
    """The branches that the monitor of a tree looks at, with their choices; beyond the limit one without a number stands for all."""
    part = tree.part_of
    if part is not None and part.branch is not None:
        return [(part.branch, {})]
    kind = None if part is None else part.kind
    try:
        first = list(islice(branches(whole(tree)), limit + 1))
    except TooLarge:
        return [(None, {})]
    if len(first) > limit:
        return [(None, {})]
    return [(branch.number, branch.choices) for branch in first if kind is None or kind in branch.kinds]


def _waiting(
    tree: RVAFT,
    strategy: Following,
    branch: int | None,
    choices: Mapping[str, str],
    histories: Iterable[list[Witness]],
) -> Iterator[tuple[set[str], Mapping[str, Json]]]:
    """What the partial matches that can be made in the branch too have yet to take, by the values they remember."""
    names = [tree.origins.get(name, name) for name in strategy.compiled.names]
    if branch is None:
        matching, node_of = strategy.matching, {node: node for node in range(len(names))}
    else:
        of_branch = tree.part_of is not None and tree.part_of.branch is not None
        compiled = CompiledTree(chosen_part(tree if of_branch else whole(tree), choices))
        matching = Matching(compiled, limit=strategy.limit)
        number = {name: node for node, name in enumerate(compiled.names)}
        node_of = {node: number[name] for node, name in enumerate(names) if name in number}
    found: dict[Hashable, tuple[set[str], Mapping[str, Json]]] = {}
    known: dict[Hashable, set[str]] = {}
    for history in histories:
        if all(step.node in node_of for step in history):
            match = matching.replayed((node_of[step.node], step.values, step.position) for step in history)
            if match is not None:
                place = match.taken, match.dead, match.closed, match.inversions
                if place not in known:
                    known[place] = {tree.origins.get(name, name) for name in admitted(matching, match)}
                found.setdefault(fingerprint(match.binding), (set(), dict(match.binding)))[0].update(known[place])
    yield from found.values()
