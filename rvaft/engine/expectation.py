"""What the branches that are still alive wait for (semantics, sections 2 and 4).

A node is pending in a branch if some partial match of the branch has all that precedes the node's event, but not that event. As for
the verdict, whether the variables and guards can ever agree is not looked at. Under `scattered` only those partial matches
count that the engine follows: one that another can replace waits for nothing that matters.

All of this is found when it is asked for, from how the partial matches came about; monitoring does nothing for it.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

from rvaft.analysis.branches import branches
from rvaft.engine.compiled_tree import fingerprint, plan_of
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.contiguous import Following
from rvaft.engine.explanation import EarliestMatches, narrowed, whole
from rvaft.engine.scattered_linear import Earliest
from rvaft.engine.steps import Matching
from rvaft.errors import TooLarge
from rvaft.model.expressions import name_text, on_text
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import Awaited, Pending


@dataclass(frozen=True, slots=True)
class Selected:
    """A branch by its number and choices; without a number all branches together."""

    number: int | None
    choices: Mapping[str, str]


def pending(
    tree: RVAFT, strategy: Following | Earliest, *, limit: int, before: int | None = None
) -> tuple[Pending, ...]:
    """What each live branch waits for; with `before`, waited for when the event of that number ended the last hope.

    Beyond `limit` branches all are taken together. Raises `TooLarge` as the monitor does.
    """
    selected = _selected(tree, limit)
    if isinstance(strategy, Earliest):
        return tuple(_of_runs(tree, strategy, selected))
    histories = [
        tuple(step for step in reversed(list(configuration.history())) if before is None or step.position < before)
        for configuration in (strategy.partial if before is None else strategy.lost)
    ]
    return tuple(
        record
        for branch in selected
        for record in _of_matches(_place(tree, strategy, branch), branch.number, histories)
    )


def _selected(tree: RVAFT, limit: int) -> list[Selected]:
    """The branches that the monitor of a tree looks at, or, beyond the limit, one that stands for all."""
    part = tree.part_of
    if part is not None and part.branch is not None:
        return [Selected(part.branch, {})]
    kind = None if part is None else part.kind
    together = [Selected(None, {})]
    try:
        first = list(islice(branches(whole(tree)), limit + 1))
    except TooLarge:
        return together
    if len(first) > limit:
        return together
    return [Selected(branch.number, branch.choices) for branch in first if kind is None or kind in branch.kinds]


def _awaited(tree: RVAFT, names: Iterable[str]) -> tuple[Awaited, ...]:
    """The nodes of the whole tree with these names, each once, in the order of that tree."""
    wanted = set(names)
    return tuple(Awaited(name, _event(tree.nodes[name])) for name in tree.order if name in wanted)


def _event(node: Node) -> str:
    return name_text(node.name) if node.on is None else on_text(node.on)


def _of_runs(tree: RVAFT, strategy: Earliest, selected: Iterable[Selected]) -> Iterator[Pending]:
    """The linear way: what the run of each branch listens for."""
    finder = EarliestMatches(tree, strategy)
    for branch in selected:
        names = finder.awaited(branch.choices)
        if names:
            yield Pending(branch.number, _awaited(whole(tree), names), {})


class _Place(NamedTuple):
    """Where a branch is looked at: the whole tree, a matching, the names that its nodes have in that tree, and its nodes by the plan's."""

    tree: RVAFT
    matching: Matching
    names: Sequence[str]
    node: Mapping[int, int]


def _place(tree: RVAFT, strategy: Following, branch: Selected) -> _Place:
    names = [tree.origins.get(name, name) for name in strategy.plan.names]
    if branch.number is None:
        return _Place(whole(tree), strategy.matching, names, {node: node for node in range(len(names))})
    chosen_already = tree.part_of is not None and tree.part_of.branch is not None
    part = narrowed(tree if chosen_already else whole(tree), branch.choices)
    matching = Matching(plan_of(part), limit=strategy.limit)
    number = {name: node for node, name in enumerate(matching.plan.names)}
    nodes = {node: number[name] for node, name in enumerate(names) if name in number}
    return _Place(whole(tree), matching, matching.plan.names, nodes)


def _of_matches(place: _Place, branch: int | None, histories: Iterable[tuple[Witness, ...]]) -> Iterator[Pending]:
    """The general way: what the partial matches that can be made in the branch too have yet to take."""
    records: dict[Hashable, tuple[Mapping[str, Json], set[str]]] = {}
    known: dict[Hashable, set[str]] = {}
    for history in histories:
        if any(step.node not in place.node for step in history):
            continue
        steps = ((place.node[step.node], step.values, step.position) for step in history)
        match = place.matching.replayed(steps)
        if match is None:
            continue
        shape = match.taken, match.dead, match.closed, match.inversions
        if shape not in known:
            known[shape] = {place.names[node] for node in _open(place.matching, match)}
        records.setdefault(fingerprint(match.binding), (dict(match.binding), set()))[1].update(known[shape])
    for variables, names in records.values():
        if names:
            yield Pending(branch, _awaited(place.tree, names), variables)


def _open(matching: Matching, configuration: Configuration) -> Iterator[int]:
    """The nodes whose event may come next."""
    return (node for node, own in enumerate(matching.plan.own) if own and matching.admits(configuration, node))
