"""After detection: one match of the lowest-numbered branch that has one, with its scenario (semantics, section 4)."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from itertools import islice
from typing import Final, NamedTuple

from rvaft.analysis.branches import branches, number_of, or_gates
from rvaft.analysis.normal_form import Op
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import Configuration
from rvaft.engine.contiguous import Following
from rvaft.engine.progress import SURE, TOUCHED
from rvaft.engine.scattered_linear import Earliest, possible_nodes
from rvaft.engine.steps import Matching
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json
from rvaft.monitors import Explanation

SEARCHING: Final = 20_000_000
"""How many nodes are looked at in search of a lower branch."""
BRANCHES: Final = 20_000
"""How many branches of a kind are looked at."""


# Matches under given choices.


class MatchedEvent(NamedTuple):
    """An occurrence, by its name in the whole tree, with the position of its event and the values that it saw."""

    node: str
    position: int
    values: Mapping[str, Json]


class FoundMatch(NamedTuple):
    """A match: its steps in the order of the events, and the nodes of its scenario with the children they keep."""

    steps: tuple[MatchedEvent, ...]
    kept: Mapping[str, tuple[str, ...]]


def whole(tree: RVAFT) -> RVAFT:
    """The tree that a restricted tree is part of, or the tree itself."""
    return tree if tree.part_of is None else tree.part_of.tree


def kept_nodes(tree: RVAFT, choices: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """The nodes that are reachable under choices, each with its children."""

    def children(name: str) -> tuple[str, ...]:
        return (choices[name],) if name in choices else tree.nodes[name].children

    return {name: children(name) for name in reachable(tree.root, children)}


def chosen_part(tree: RVAFT, choices: Mapping[str, str]) -> RVAFT:
    """The tree whose scenarios are those that keep the children chosen; its alphabet is its own."""
    nodes = [replace(tree.nodes[name], children=children) for name, children in kept_nodes(tree, choices).items()]
    events = dict.fromkeys(node.on.event for node in nodes if node.on is not None)
    return RVAFT(tree.root, nodes, (tree.events[event] for event in events), causality=tree.causality)


class FollowedMatches:
    """Matches that were followed: one is a match under some choices if its steps can be taken in that part of the tree."""

    def __init__(self, tree: RVAFT, strategy: Following) -> None:
        of_branch = tree.part_of is not None and tree.part_of.branch is not None
        self.tree = tree if of_branch else whole(tree)
        self.strategy = strategy
        names = [tree.origins.get(name, name) for name in strategy.compiled.names]
        histories = [reversed(list(match.history())) for match in strategy.matches]
        self.matches = [
            tuple(MatchedEvent(names[taken.node], taken.position, taken.values) for taken in history)
            for history in histories
        ]
        self._number = {name: node for node, name in enumerate(strategy.compiled.names)}

    def find(self, choices: Mapping[str, str]) -> FoundMatch | None:
        """A match of a scenario in which each of these choices of one child, where it is reached, keeps the child chosen."""
        kept = kept_nodes(self.tree, choices)
        fitting = [steps for steps in self.matches if all(step.node in kept for step in steps)]
        if not fitting:
            return None
        matching = Matching(CompiledTree(chosen_part(self.tree, choices)), limit=self.strategy.limit)
        number = {name: node for node, name in enumerate(matching.compiled.names)}
        for steps in fitting:
            match = matching.replayed((number[step.node], step.values, step.position) for step in steps)
            if match is not None and matching.standing(match)[0]:
                return FoundMatch(steps, _scenario(matching, match))
        return None

    def is_possible(self, gate: str, child: str) -> bool:
        """False only where certainly no match keeps this child of a choice (or, if it is the first, does without the choice).

        With one match and no sharing it is known what was taken below the gate.
        """
        compiled, number = self.strategy.compiled, self._number
        if len(self.matches) > 1 or compiled.core or gate not in number or child not in number:
            return True
        flags, match = self.strategy.matching.progress.flags, self.strategy.matches[0]
        touched = [node for node in compiled.children[number[gate]] if flags(match, node) & TOUCHED]
        return not touched or number[child] in touched


def _scenario(matching: Matching, match: Configuration) -> dict[str, tuple[str, ...]]:
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
    names = compiled.names
    return {names[node]: tuple(names[child] for child in children) for node, children in kept.items()}


class EarliestMatches:
    """The linear way: a run in which choices of one child keep what is chosen."""

    def __init__(self, tree: RVAFT, strategy: Earliest) -> None:
        self.strategy = strategy
        origins, names = tree.origins, strategy.compiled.names
        self._names = [origins.get(name, name) for name in names]
        self._number = {name: node for node, name in enumerate(names)}

    def find(self, choices: Mapping[str, str]) -> FoundMatch | None:
        """As that of `FollowedMatches`."""
        run, names = self.strategy.run_under(self._choices(choices)), self._names
        if not run.detected:
            return None
        kept = dict(run.scenario())
        steps = [MatchedEvent(names[node], *run.fired[node]) for node in kept if node in run.fired]
        steps.sort(key=lambda step: step.position)
        scenario = {names[node]: tuple(names[child] for child in children) for node, children in kept.items()}
        return FoundMatch(tuple(steps), scenario)

    def awaited(self, choices: Mapping[str, str]) -> list[str]:
        """The nodes of the whole tree that wait for their event under choices; none where the branch is infeasible."""
        return [self._names[node] for node in self.strategy.run_under(self._choices(choices)).awaited()]

    def is_possible(self, gate: str, child: str) -> bool:
        """As that of `FollowedMatches`: what events never came decides."""
        node, kept = self._number.get(gate), self._number.get(child)
        if node is None or kept is None:
            return True
        able, unavoidable = self._limits
        is_first = self.strategy.compiled.children[node][0] == kept
        return kept in able or (is_first and node not in unavoidable)

    @cached_property
    def _limits(self) -> tuple[set[int], set[int]]:
        """The nodes that some choices may make complete, given what came; and those without which the root is not."""
        compiled = self.strategy.compiled
        came = [node for node in range(len(compiled.names)) if self.strategy.came(node)]
        able = possible_nodes(compiled, compiled.children.__getitem__, among=set(came))
        unavoidable = {compiled.root}
        for node, children in enumerate(compiled.children):
            candidates = [child for child in children if child in able]
            if node in unavoidable and len(candidates) == compiled.need[node]:
                unavoidable.update(candidates)
        return able, unavoidable

    def _choices(self, choices: Mapping[str, str]) -> dict[int, int]:
        """The choices in the numbers of the tree; -1 where a copy of a gate does not have the child."""
        compiled, names = self.strategy.compiled, self._names
        return {
            node: next((child for child in compiled.children[node] if names[child] == choices[name]), -1)
            for node, name in enumerate(names)
            if name in choices and compiled.ops[node] is Op.ONE
        }


# The explanation.


def explain(tree: RVAFT, strategy: Following | Earliest) -> Explanation:
    """The explanation after detection; its branch is None where there are too many to find the lowest."""
    finder: FollowedMatches | EarliestMatches
    finder = EarliestMatches(tree, strategy) if isinstance(strategy, Earliest) else FollowedMatches(tree, strategy)
    part = tree.part_of
    found = finder.find({})
    assert found is not None, "what detected is a match"
    number = None if part is None else part.branch
    if part is None:
        found, number = _lowest(tree, finder, found)
    elif part.branch is None and part.kind is not None:
        found, number = _lowest_of_kind(part.tree, finder, part.kind, found)
    tree = whole(tree)
    kept = {name: set(children) for name, children in found.kept.items() if name in tree.nodes}
    kinds = (tree.nodes[name].kind for name in kept)
    variables: dict[str, Json] = {}
    for step in found.steps:
        variables = {**step.values, **variables}
    return Explanation(
        branch=number,
        kinds=frozenset(kind for kind in kinds if kind is not None),
        matched={step.node: step.position for step in found.steps},
        variables=variables,
        scenario={name: tuple(c for c in tree.nodes[name].children if c in chosen) for name, chosen in kept.items()},
    )


def _lowest(tree: RVAFT, finder: FollowedMatches | EarliestMatches, found: FoundMatch) -> tuple[FoundMatch, int | None]:
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


def _lowest_of_kind(
    tree: RVAFT, finder: FollowedMatches | EarliestMatches, kind: Kind, found: FoundMatch
) -> tuple[FoundMatch, int | None]:
    """The same among the branches of a kind, which a match may be in with what its scenario does not contain."""
    for branch in islice(branches(tree), BRANCHES):
        if kind in branch.kinds:
            of_branch = finder.find(branch.choices)
            if of_branch is not None:
                return of_branch, branch.number
    return found, None
