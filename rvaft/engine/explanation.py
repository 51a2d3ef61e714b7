"""After detection: a match under given choices of `or` gates, with its scenario."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import islice
from typing import NamedTuple, Protocol

from rvaft.analysis.branches import branches, number_of
from rvaft.engine.compiled_tree import plan_of
from rvaft.engine.configuration import Configuration
from rvaft.engine.contiguous import Following
from rvaft.engine.progress import SURE, TOUCHED
from rvaft.engine.scattered_linear import Earliest, Run
from rvaft.engine.steps import Matching
from rvaft.model.nodes import Gate, Kind
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json
from rvaft.monitors import Explanation

# The number of a branch, without enumerating those before it where no node is shared (semantics, section 2).
#
# Branches are ordered by the digits of their `or` gates, the gate that is last in breadth-first order counting most; a gate that a branch
# does not reach has digit 0. So the number is one more than, summed over the gates from the last to the first, the
# count of branches that agree on the gates after it and have a smaller digit there. Such a count is a product over gates, a sum over
# the choices of an `or`.

MOST = 10**9
"""Counts stop here; a number beyond is not told."""

EFFORT = 20_000_000
"""How many steps to spend on counting."""


def or_gates(tree: RVAFT) -> list[str]:
    """The reachable `or` gates in breadth-first order."""
    order, seen = [tree.root], {tree.root}
    for name in order:
        new = [child for child in tree.nodes[name].children if child not in seen]
        seen.update(new)
        order.extend(new)
    return [name for name in order if tree.nodes[name].gate is Gate.OR]


def lowest_number(tree: RVAFT, choices: Mapping[str, str], kind: Kind | None = None) -> int | None:
    """The lowest number of a branch that makes these choices (and has the kind); None where counting takes too long."""
    if tree.shared or kind is not None:
        return number_of(tree, choices, kind=kind)
    counts = _Counts(tree)
    number = 1
    for name in reversed(or_gates(tree)):
        digit = tree.nodes[name].children.index(choices[name]) if name in choices else 0
        if digit:
            number += counts.below(name, digit)
        counts.fix(name, digit)
        if number > MOST or counts.effort > EFFORT:
            return None
    return number


class _Counts:
    """For each node the ways to resolve what is below it, and whether it may stay unreached, given the digits fixed so far."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.effort = 0
        self._digits: dict[str, range] = {}
        self._ways: dict[str, int] = {}
        self._idle: dict[str, bool] = {}
        for node in tree.bottom_up():
            self._ways[node.name], self._idle[node.name] = self._evaluate(node.name)

    def _evaluate(self, name: str) -> tuple[int, bool]:
        node = self.tree.nodes[name]
        self.effort += 1 + len(node.children)
        busy = [child for child in node.children if not self._idle[child]]
        if node.gate is not Gate.OR:
            ways = 1
            for child in node.children:
                ways = min(ways * self._ways[child], MOST)
            return ways, not busy
        digits = self._digits.get(name, range(len(node.children)))
        possible = (node.children[digit] for digit in digits)
        ways = sum(self._ways[child] for child in possible if all(other == child for other in busy))
        return min(ways, MOST), not busy and 0 in digits

    def fix(self, name: str, digit: int) -> None:
        """Fix the digit of a gate."""
        self._digits[name] = range(digit, digit + 1)
        self._refresh(name, {})

    def below(self, name: str, digit: int) -> int:
        """The number of branches where a gate has a smaller digit."""
        self._digits[name] = range(digit)
        before: dict[str, tuple[int, bool]] = {}
        possible = self._refresh(name, before)
        count = self._ways[self.tree.root] if possible else 0
        for node, (ways, idle) in before.items():
            self._ways[node], self._idle[node] = ways, idle
        return count

    def _refresh(self, name: str, before: dict[str, tuple[int, bool]]) -> bool:
        """Bring a node and those above it up to date; False, and stop, at one that must be reached and cannot be resolved."""
        while True:
            old = self._ways[name], self._idle[name]
            new = self._evaluate(name)
            if new == old:
                return True
            before[name] = old
            self._ways[name], self._idle[name] = new
            if new == (0, False):
                return False
            parents = self.tree.parents(name)
            if not parents:
                return True
            name = parents[0]


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


# The explanation of a detection: one match of the lowest-numbered branch that has one (semantics, section 4).

BRANCHES = 20_000
"""How many branches of a kind are looked at."""

EXPLAIN_EFFORT = 20_000_000
"""How many nodes are looked at in search of a lower branch."""


def explain(tree: RVAFT, strategy: Following | Earliest) -> Explanation:
    """The explanation after detection; its branch is None where there are too many to find the lowest."""
    finder: Finder
    finder = EarliestMatches(tree, strategy) if isinstance(strategy, Earliest) else FollowedMatches(tree, strategy)
    part = tree.part_of
    number: int | None
    if part is None:
        found, certain = _lowest(tree, finder)
        number = lowest_number(tree, _choices(tree, found)) if certain else None
    elif part.branch is None and part.kind is not None:
        found, number = _lowest_of_kind(part.tree, finder, part.kind)
    else:
        found, number = _any(finder), part.branch
    return _explanation(whole(tree), found, number)


def _any(finder: Finder) -> Found:
    found = finder.find({})
    assert found is not None
    return found


def _choices(tree: RVAFT, found: Found) -> dict[str, str]:
    """What the scenario of a match chooses."""
    return {
        name: kept[0] for name, kept in found.kept.items() if name in tree.nodes and tree.nodes[name].gate is Gate.OR
    }


def _lowest(tree: RVAFT, finder: Finder) -> tuple[Found, bool]:
    """The match whose branch has the lowest number, and whether that is certain.

    The digit that counts most is made as small as it can be, then the next. A gate that the best match so far does not reach has
    digit 0 in its branch already.
    """
    found = _any(finder)
    fixed: dict[str, str] = {}
    effort = 0
    for name in reversed(or_gates(tree)):
        children = tree.nodes[name].children
        digit = children.index(found.kept[name][0]) if name in found.kept else 0
        for lower in range(digit):
            if finder.possible(name, children[lower]):
                effort += len(tree.nodes)
                if effort > EXPLAIN_EFFORT:
                    return found, False
                better = finder.find({**fixed, name: children[lower]})
                if better is not None:
                    found, digit = better, lower
                    break
        fixed[name] = children[digit]
    return found, True


def _lowest_of_kind(tree: RVAFT, finder: Finder, kind: Kind) -> tuple[Found, int | None]:
    """The same among the branches of a kind, which a match may be in with what its scenario does not contain."""
    for branch in islice(branches(tree), BRANCHES):
        if kind in branch.kinds:
            found = finder.find(branch.choices)
            if found is not None:
                return found, branch.number
    return _any(finder), None


def _explanation(tree: RVAFT, found: Found, number: int | None) -> Explanation:
    nodes = ((tree.nodes[name], set(kept)) for name, kept in found.kept.items() if name in tree.nodes)
    scenario = {node.name: tuple(child for child in node.children if child in kept) for node, kept in nodes}
    kinds = (tree.nodes[name].kind for name in scenario)
    variables: dict[str, Json] = {}
    for step in found.steps:
        variables = {**step.values, **variables}
    return Explanation(
        branch=number,
        kinds=frozenset(kind for kind in kinds if kind is not None),
        matched={step.node: step.position for step in found.steps},
        variables=variables,
        scenario=scenario,
    )
