"""What the events so far mean for the branches of a tree (semantics, sections 2 and 4).

After detection: one match of the lowest-numbered branch that has one, with its scenario. Before: what the branches that are still
alive wait for. A node is pending in a branch if some partial match of the branch has all that precedes the node's event, but not that
event. As for the verdict, whether the variables and guards can ever agree is not looked at. Under `scattered` only those partial
matches count that the engine follows: one that another can replace waits for nothing that matters.

All of this is found when it is asked for, from how the partial matches came about; monitoring does nothing for it.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import islice
from typing import Final, NamedTuple, TypeAlias

from rvaft.analysis.branches import branches, number_of, or_gates
from rvaft.analysis.normal_form import Op
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import SURE, TOUCHED, Configuration, Witness, history
from rvaft.engine.partial_matches import Following, Matching
from rvaft.engine.scattered_linear import Earliest, EarliestRun, possible_nodes
from rvaft.errors import TooLarge
from rvaft.model.expressions import event_text
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json, fingerprint
from rvaft.monitors import Awaited, Explanation, Pending
from rvaft.support.bits import mask_of

SEARCHING: Final = 20_000_000
"""How many nodes are looked at in search of a lower branch."""
BRANCHES: Final = 20_000
"""How many branches of a kind are looked at."""

Choices: TypeAlias = Mapping[str, str]
"""The child that each choice of one child keeps, where it is reached."""


class MatchedEvent(NamedTuple):
    """An occurrence, by its name in the whole tree, with the position of its event and the values that it saw."""

    node: str
    position: int
    values: Mapping[str, Json]


class FoundMatch(NamedTuple):
    """A match: its steps in the order of the events, and the nodes of its scenario with the children they keep."""

    steps: list[MatchedEvent]
    kept: Mapping[str, tuple[str, ...]]


def whole(tree: RVAFT) -> RVAFT:
    """The tree that a restricted tree is part of, or the tree itself."""
    return tree if tree.part_of is None else tree.part_of.tree


def is_all(tree: RVAFT) -> bool:
    """Whether a tree has all branches of the tree that it is part of, said in other words perhaps."""
    return tree.part_of is None or (tree.part_of.branch is None and tree.part_of.kind is None)


def kept_nodes(tree: RVAFT, choices: Choices) -> dict[str, tuple[str, ...]]:
    """The nodes that are reachable under choices, each with its children."""

    def children(name: str) -> tuple[str, ...]:
        return (choices[name],) if name in choices else tree.nodes[name].children

    return {name: children(name) for name in reachable(tree.root, children)}


def chosen_part(tree: RVAFT, choices: Choices) -> RVAFT:
    """The tree whose scenarios are those that keep the children chosen; its alphabet is its own."""
    nodes = [replace(tree.nodes[name], children=children) for name, children in kept_nodes(tree, choices).items()]
    events = dict.fromkeys(node.on.event for node in nodes if node.on is not None)
    return RVAFT(tree.root, nodes, (tree.events[event] for event in events), causality=tree.causality, time=tree.time)


class MatchFinder:
    """What the monitor of a tree knows of matches under choices."""

    def __init__(self, tree: RVAFT, strategy: Following | Earliest) -> None:
        self.tree = tree
        self.strategy = strategy
        self._names = [tree.origins.get(name, name) for name in strategy.compiled.names]
        self._number = {name: node for node, name in enumerate(self._names)}

    def find(self, choices: Choices) -> FoundMatch | None:
        """A match of a scenario in which each of these choices keeps the child chosen."""
        strategy = self.strategy
        if isinstance(strategy, Earliest):
            run, names = self._run(strategy, choices), self._names
            if not run.detected:
                return None
            kept = dict(run.scenario())
            steps = [MatchedEvent(names[node], *run.fired[node]) for node in kept if node in run.fired]
            return _found(names, sorted(steps, key=lambda step: step.position), kept)
        for matching, match in self._replayed([history(match.witness) for match in strategy.matches], choices):
            if matching.standing(match)[0]:
                own = matching.compiled.names
                steps = [MatchedEvent(own[one.node], one.position, one.values) for one in history(match.witness)]
                return _found(own, steps, _scenario(matching, match))
        return None

    def waiting(
        self, choices: Choices | None, histories: Iterable[list[Witness]]
    ) -> Iterator[tuple[set[str], Mapping[str, Json]]]:
        """What the matches with these steps that can be made under choices too have yet to take, by the values they remember."""
        if isinstance(self.strategy, Earliest):
            yield {self._names[node] for node in self._run(self.strategy, choices or {}).awaited()}, {}
            return
        found: dict[Hashable, tuple[set[str], Mapping[str, Json]]] = {}
        known: dict[Hashable, set[str]] = {}
        histories = list(histories)
        replayed = list(self._replayed(histories, choices))
        if not replayed and choices and not self.strategy.uses_up:  # those of this branch have been replaced by others
            kept = kept_nodes(self._base, choices)
            rest = [[step for step in steps if self._names[step.node] in kept] for steps in histories]
            replayed = list(self._replayed(rest, choices)) or list(self._replayed([[]], choices))
        for matching, match in replayed:
            place = match.taken, match.dead, match.closed, match.inversions
            if place not in known:
                known[place] = {self.tree.origins.get(name, name) for name in matching.admitted(match)}
            found.setdefault(fingerprint(match.binding), (set(), dict(match.binding)))[0].update(known[place])
        yield from found.values()

    def _run(self, strategy: Earliest, choices: Choices) -> EarliestRun:
        """The run under choices in the numbers of the tree; -1 where a copy of a gate does not have the child."""
        compiled, names = strategy.compiled, self._names
        return strategy.run_under(
            {
                node: next((child for child in compiled.children[node] if names[child] == choices[name]), -1)
                for node, name in enumerate(names)
                if name in choices and compiled.ops[node] is Op.ONE
            }
        )

    @property
    def _base(self) -> RVAFT:
        """The tree whose choices are made."""
        of_branch = self.tree.part_of is not None and self.tree.part_of.branch is not None
        return self.tree if of_branch or is_all(self.tree) else whole(self.tree)

    def _replayed(
        self, histories: Iterable[list[Witness]], choices: Choices | None
    ) -> Iterator[tuple[Matching, Configuration]]:
        """The matches with these steps that can be made under choices too; with None as they are."""
        assert isinstance(self.strategy, Following), "the linear way follows no matches"
        matching, node_of = self.strategy.matching, {node: node for node in range(len(self._names))}
        base = self._base
        if choices or (choices is not None and base is not self.tree):
            kept = kept_nodes(base, choices)
            histories = [steps for steps in histories if all(self._names[step.node] in kept for step in steps)]
            if not histories:
                return
            matching = Matching(CompiledTree(chosen_part(base, choices)), limit=self.strategy.limit)
            number = {name: node for node, name in enumerate(matching.compiled.names)}
            node_of = {node: number[name] for node, name in enumerate(self._names) if name in number}
        for steps in histories:
            match = matching.replayed((node_of[step.node], step.values, step.position) for step in steps)
            if match is not None:
                yield matching, match

    def is_possible(self, gate: str, child: str) -> bool:
        """False only where certainly no match keeps this child of a choice (or, if it is the first, does without the choice)."""
        node, kept = self._number[gate], self._number[child]
        able, unavoidable = self._limits
        is_first = self.strategy.compiled.children[node][0] == kept
        return kept in able or (is_first and node not in unavoidable)

    @cached_property
    def _limits(self) -> tuple[set[int], set[int]]:
        """The nodes that some choices may make complete, given what came; and those without which the root is not."""
        strategy, compiled = self.strategy, self.strategy.compiled
        if isinstance(strategy, Earliest):
            came = {node for node in range(len(compiled.names)) if strategy.came(node)}
        else:
            taken = mask_of(step.node for match in strategy.matches for step in history(match.witness))
            came = {node for node, own in enumerate(compiled.own) if not own or taken >> node & 1}
        able = possible_nodes(compiled, compiled.children.__getitem__, among=came)
        unavoidable = {compiled.root}
        for node, children in enumerate(compiled.children):
            candidates = [child for child in children if child in able]
            if node in unavoidable and len(candidates) == compiled.need[node]:
                unavoidable.update(candidates)
        return able, unavoidable


def _found(names: Sequence[str], steps: list[MatchedEvent], kept: Mapping[int, Iterable[int]]) -> FoundMatch:
    return FoundMatch(steps, {names[node]: tuple(names[child] for child in kept[node]) for node in kept})


def _scenario(matching: Matching, match: Configuration) -> dict[int, tuple[int, ...]]:
    """One scenario that a match is a match of."""
    compiled = matching.compiled
    kept: dict[int, tuple[int, ...]] = {}
    agenda = [compiled.root]
    if compiled.core:
        kept.update(next(matching.shared.resolutions(match, complete=True)))
        agenda = [child for children in kept.values() for child in children if child not in compiled.members]
    while agenda:
        node = agenda.pop()
        children = compiled.children[node]
        if compiled.chooses >> node & 1:
            flags = {child: matching.progress.flags(match, child) for child in children}
            touched = tuple(child for child in children if flags[child] & TOUCHED)
            silent = tuple(child for child in children if flags[child] & SURE and not flags[child] & TOUCHED)
            children = touched + silent[: max(compiled.need[node] - len(touched), 0)]
        kept[node] = children
        agenda.extend(children)
    return kept


def explain(tree: RVAFT, strategy: Following | Earliest) -> Explanation:
    """The explanation after detection; its branch is None where there are too many to find the lowest."""
    finder, part = MatchFinder(tree, strategy), tree.part_of
    found = finder.find({})
    assert found is not None, "what detected is a match"
    number = None if part is None else part.branch
    if is_all(tree):
        found, number = _lowest(whole(tree), finder, found)
    elif part is not None and part.branch is None:  # a match may be in it with what its scenario does not contain
        of_kind = (branch for branch in islice(branches(part.tree), BRANCHES) if part.kind in branch.kinds)
        matches = ((match, branch.number) for branch in of_kind if (match := finder.find(branch.choices)) is not None)
        found, number = next(matches, (found, None))
    tree = whole(tree)
    kept = {name: set(children) for name, children in found.kept.items() if name in tree.nodes}
    kinds = (tree.nodes[name].kind for name in kept)
    variables: dict[str, Json] = {}
    for step in found.steps:
        variables = {**step.values, **variables}
    return Explanation(
        branch=number or None,
        kinds=frozenset(kind for kind in kinds if kind is not None),
        matched={_occurrence(tree, step.node): step.position for step in found.steps},
        variables={name: value for name, value in variables.items() if name in tree.variables},
        scenario={name: tuple(c for c in tree.nodes[name].children if c in chosen) for name, chosen in kept.items()},
    )


def _occurrence(tree: RVAFT, name: str) -> str:
    """The occurrence that an event serves: the event of a gate may have become a leaf beside what is below it."""
    return name if name in tree.nodes else name.removesuffix("[event]")


def _lowest(tree: RVAFT, finder: MatchFinder, found: FoundMatch) -> tuple[FoundMatch, int | None]:
    """The match whose branch has the lowest number, and that number where it is certain.

    The digit that counts most is made as small as it can be, then the next. A choice that the best match so far does not reach has
    digit 0 in its branch already.
    """
    fixed: dict[str, str] = {}
    effort = 0
    order = or_gates(tree)
    for name in reversed(order):
        children = tree.nodes[name].children
        digit = children.index(found.kept[name][0]) if name in found.kept else 0
        for lower in range(digit):
            if finder.is_possible(name, children[lower]):
                effort += len(tree.nodes)
                if effort > SEARCHING:
                    return found, None
                better = finder.find({**fixed, name: children[lower]})
                if better is not None:
                    found, digit = better, lower
                    break
        fixed[name] = children[digit]
    return found, number_of(tree, {name: found.kept[name][0] for name in order if name in found.kept})


def pending(
    tree: RVAFT, strategy: Following | Earliest, *, limit: int, before: int | None = None
) -> tuple[Pending, ...]:
    """What each live branch waits for; with `before`, waited for when the event of that number ended the last hope.

    Beyond `limit` branches all are taken together, without a number. Raises `TooLarge` as the monitor does.
    """
    all_of, part, finder = whole(tree), tree.part_of, MatchFinder(tree, strategy)
    selected: list[tuple[int | None, Choices | None]] = [(None, None)]
    if part is not None and part.branch is not None:
        selected = [(part.branch, {})]
    else:
        with suppress(TooLarge):
            first = list(islice(branches(all_of), limit + 1))
            if len(first) <= limit:
                wanted = (one for one in first if part is None or part.kind is None or part.kind in one.kinds)
                selected = [(branch.number, branch.choices) for branch in wanted]
    histories: list[list[Witness]] = []
    if isinstance(strategy, Following):
        matches = strategy.combined if before is None else strategy.lost
        steps = (history(match.witness) for match in matches)
        histories = [[one for one in some if before is None or one.position < before] for some in steps]
    return tuple(
        Pending(
            number or None,
            awaited(all_of, names),
            {n: value for n, value in variables.items() if n in all_of.variables},
        )
        for number, choices in selected
        for names, variables in finder.waiting(choices, histories)
        if names
    )


def together(waiting: Iterable[Pending], *, numbered: bool = True) -> tuple[Pending, ...]:
    """The same, what one branch waits for with equal values as one; all branches are one if they are not `numbered`."""
    found: dict[Hashable, tuple[Pending, dict[Awaited, None]]] = {}
    for one in waiting:
        place = one.branch if numbered else None, fingerprint(one.variables)
        found.setdefault(place, (one, {}))[1].update(dict.fromkeys(one.awaited))
    return tuple(Pending(one.branch if numbered else None, tuple(all_), one.variables) for one, all_ in found.values())


def awaited(tree: RVAFT, names: Iterable[str]) -> tuple[Awaited, ...]:
    """The nodes of a tree with these names, each once, in the order of the tree, with their events as text."""
    wanted = {name if name in tree.nodes else name.rpartition("[")[0] for name in names}
    nodes = (tree.nodes[name] for name in tree.order if name in wanted)
    return tuple(Awaited(n.name, event_text(n)) for n in nodes)
