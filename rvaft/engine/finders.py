"""After detection: a match under given choices of `or` gates, with its scenario."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple, Protocol

from rvaft.engine.configuration import Configuration
from rvaft.engine.earliest import Earliest, Run
from rvaft.engine.following import Following
from rvaft.engine.matching import Matching
from rvaft.engine.plan import plan_of
from rvaft.engine.progress import SURE, TOUCHED
from rvaft.model import Gate
from rvaft.tree import RVAFT, reachable
from rvaft.values import Json


class Step(NamedTuple):
    """An occurrence, by its name in the whole tree, with the position of its event and the values that it saw."""

    node: str
    position: int
    values: Mapping[str, Json]


class Found(NamedTuple):
    """A match: its steps in the order of the events, and the nodes of its scenario with the children they keep."""

    steps: tuple[Step, ...]
    kept: Mapping[str, tuple[str, ...]]


class Finder(Protocol):
    """Finds the matches at the detecting prefix."""

    def find(self, choices: Mapping[str, str]) -> Found | None:
        """A match of a scenario in which each of these `or` gates, where it is reached, keeps the child chosen."""

    def possible(self, gate: str, child: str) -> bool:
        """False only where certainly no match keeps this child of an `or` gate (or, if it is the first, does without the gate)."""


def whole(tree: RVAFT) -> RVAFT:
    """The tree that a restricted tree is part of, or the tree itself."""
    return tree if tree.part_of is None else tree.part_of.tree


class FollowedMatches:
    """Matches that were followed: one is a match under some choices if its steps can be taken in the narrowed tree."""

    def __init__(self, tree: RVAFT, strategy: Following) -> None:
        restricted_to_branch = tree.part_of is not None and tree.part_of.branch is not None
        self.tree = tree if restricted_to_branch else whole(tree)
        self.strategy = strategy
        names, origins = strategy.plan.names, tree.origins
        self.matches = [
            tuple(
                Step(origins.get(names[taken.node], names[taken.node]), taken.position, taken.values)
                for taken in reversed(list(configuration.history()))
            )
            for configuration in strategy.matches
        ]
        self._number = {name: node for node, name in enumerate(names)}

    def find(self, choices: Mapping[str, str]) -> Found | None:
        """A match under choices."""
        kept = _kept_nodes(self.tree, choices)
        fitting = [steps for steps in self.matches if all(step.node in kept for step in steps)]
        if not fitting:
            return None
        matching = Matching(plan_of(narrowed(self.tree, choices)), limit=self.strategy.limit)
        for steps in fitting:
            configuration = _replay(matching, steps)
            if configuration is not None:
                return Found(steps, _scenario(matching, configuration))
        return None

    def possible(self, gate: str, child: str) -> bool:
        """With one match and no sharing it is known what was taken below the gate."""
        strategy, number = self.strategy, self._number
        if len(self.matches) > 1 or strategy.plan.core or gate not in number or child not in number:
            return True
        match, progress = strategy.matches[0], strategy.matching.progress
        touched = [node for node in strategy.plan.children[number[gate]] if progress.flags(match, node) & TOUCHED]
        return not touched or number[child] in touched


def narrowed(tree: RVAFT, choices: Mapping[str, str]) -> RVAFT:
    """The tree whose scenarios are those that keep the children chosen; its alphabet is its own."""
    kept = _kept_nodes(tree, choices)
    nodes = [replace(tree.nodes[name], children=children) for name, children in kept.items()]
    return RVAFT(tree.root, nodes, tree.events.values(), causality=tree.causality)


def _kept_nodes(tree: RVAFT, choices: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """The nodes that are reachable under choices, each with its children."""

    def children(name: str) -> tuple[str, ...]:
        return (choices[name],) if name in choices else tree.nodes[name].children

    return {name: children(name) for name in reachable(tree.root, children)}


def _replay(matching: Matching, steps: Iterable[Step]) -> Configuration | None:
    """The configuration after taking the steps in order, if it is a match."""
    number = {name: node for node, name in enumerate(matching.plan.names)}
    configuration = matching.replayed((number[step.node], step.values, step.position) for step in steps)
    return configuration if configuration is not None and matching.standing(configuration)[0] else None


def _scenario(matching: Matching, configuration: Configuration) -> dict[str, tuple[str, ...]]:
    """One scenario that a match is a match of."""
    plan, core = matching.plan, matching.core
    kept = dict(next(core.complete(configuration))) if plan.core else {}
    agenda = [child for children in kept.values() for child in children if child not in core.members]
    agenda = agenda if plan.core else [plan.root]
    while agenda:
        node = agenda.pop()
        kept[node] = _kept(matching, configuration, node)
        agenda.extend(kept[node])
    return {plan.names[node]: tuple(plan.names[child] for child in children) for node, children in kept.items()}


def _kept(matching: Matching, configuration: Configuration, node: int) -> tuple[int, ...]:
    """The children of a node of a part that are in the scenario."""
    plan = matching.plan
    children = plan.children[node]
    flags = {child: matching.progress.flags(configuration, child) for child in children}
    touched = tuple(child for child in children if flags[child] & TOUCHED)
    silent = tuple(child for child in children if flags[child] & SURE and not flags[child] & TOUCHED)
    match plan.gates[node]:
        case Gate.OR:
            return touched or silent[:1]
        case Gate.VOT:
            return touched + silent[: max(plan.thresholds[node] - len(touched), 0)]
        case _:
            return children


class EarliestMatches:
    """The linear way: a run in which the `or` gates keep what is chosen."""

    def __init__(self, tree: RVAFT, strategy: Earliest) -> None:
        self.strategy = strategy
        origins = tree.origins
        self._names = [origins.get(name, name) for name in strategy.plan.names]
        self._number = {name: node for node, name in enumerate(strategy.plan.names)}

    def find(self, choices: Mapping[str, str]) -> Found | None:
        """A match under choices."""
        run = self.strategy.match(dict(self._choices(choices)))
        return None if run is None else self._found(run)

    def awaited(self, choices: Mapping[str, str]) -> list[str]:
        """The nodes of the whole tree that wait for their event under choices; none where the branch is infeasible."""
        run = self.strategy.run_under(dict(self._choices(choices)))
        return [self._names[node] for node in run.awaited()]

    def possible(self, gate: str, child: str) -> bool:
        """What events never came decides; the first child also stands for not reaching the gate."""
        node, kept = self._number.get(gate), self._number.get(child)
        if node is None or kept is None:
            return True
        able, unavoidable = self._limits
        is_first = self.strategy.plan.children[node][0] == kept
        return kept in able or (is_first and node not in unavoidable)

    @cached_property
    def _limits(self) -> tuple[set[int], set[int]]:
        """The nodes that some choices may make complete, given what came; and those without which the root is not."""
        plan = self.strategy.plan
        able: set[int] = set()
        for node in range(len(plan.names) - 1, -1, -1):
            count = sum(child in able for child in plan.children[node])
            if count >= plan.least(node) and self.strategy.came(node) and not plan.dead >> node & 1:
                able.add(node)
        unavoidable = {plan.root}
        for node, children in enumerate(plan.children):
            candidates = [child for child in children if child in able]
            if node in unavoidable and len(candidates) == plan.least(node):
                unavoidable.update(candidates)
        return able, unavoidable

    def _choices(self, choices: Mapping[str, str]) -> Iterator[tuple[int, int]]:
        """The choices in the numbers of the plan; -1 where a copy of a gate does not have the child."""
        plan = self.strategy.plan
        for node, name in enumerate(self._names):
            if name in choices and plan.gates[node] is Gate.OR:
                children = (child for child in plan.children[node] if self._names[child] == choices[name])
                yield node, next(children, -1)

    def _found(self, run: Run) -> Found:
        names = self._names
        kept = dict(run.scenario())
        steps = [Step(names[node], *run.fired[node]) for node in kept if node in run.fired]
        steps.sort(key=lambda step: step.position)
        scenario = {names[node]: tuple(names[child] for child in children) for node, children in kept.items()}
        return Found(tuple(steps), scenario)
