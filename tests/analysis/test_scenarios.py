"""The scenario space against the reference's enumeration, on random trees with shared nodes, guards and every gate."""

from itertools import combinations, islice, product
from random import Random
from typing import TypeAlias

import pytest

from rvaft.analysis.scenarios import (
    Resolutions,
    ScenarioSpace,
    fewest_events,
    inevitable,
    most_scenarios,
    path,
    precedence,
    resolutions,
    standstill,
)
from rvaft.errors import TooLarge
from rvaft.model.guards import holds, variables
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT, find_cycle
from rvaft.semantics import Scenario, feasible_scenarios, scenarios
from rvaft.support.budget import Budget, Undecided
from tests.core.trees import random_tree

Sample: TypeAlias = list[tuple[Random, RVAFT, list[Scenario]]]


@pytest.fixture(scope="module", params=range(3))
def sample(request: pytest.FixtureRequest) -> Sample:
    random = Random(request.param)
    return [(random, tree, scenarios(tree)) for tree in (random_tree(random) for _ in range(100))]


def is_dead(scenario: Scenario) -> bool:
    guards = [node.when for node in scenario.nodes if node.when is not None and not variables(node.when)]
    return not all(holds(guard, {}) for guard in guards)


def test_precedence(sample: Sample) -> None:
    for _, tree, every in sample:
        for scenario in every[:15]:
            graph = precedence(tree, scenario.kept)
            before, ends = scenario.before, any(node.gate is Gate.PAND for node in scenario.nodes)
            cyclic = any(name in earlier for name, earlier in before.items())
            assert bool(find_cycle(graph)) == cyclic or ends
            assert (standstill(tree, scenario.kept, graph) is None) == bool(scenario.orders)
            for one, other in product(scenario.occurrences, repeat=2):
                assert one == other or bool(path(graph, one, other)) == (one in before[other]) or ends


def test_one_by_one(sample: Sample) -> None:
    for _, tree, every in sample:
        found = [frozenset(kept.items()) for kept in resolutions(tree, limit=10_000)]
        assert len(set(found)) == len(found) <= most_scenarios(tree)
        assert set(found) == {frozenset(scenario.kept.items()) for scenario in every if not is_dead(scenario)}
        if not tree.shared:
            assert most_scenarios(tree) == len(every)
        least = [frozenset(kept.items()) for kept in resolutions(tree, minimal=True, limit=10_000)]
        assert set(least) <= set(found)
        if found:
            with pytest.raises(TooLarge):
                list(resolutions(tree, limit=len(found) - 1))


def test_what_may_be_together(sample: Sample) -> None:
    for random, tree, every in sample:
        banned = frozenset(random.sample(tree.order, random.randint(0, 1)))
        edges = [(parent, child) for parent in tree.order for child in tree.nodes[parent].children]
        without = frozenset(random.sample(edges, random.randint(0, 1)))
        left = [
            s.kept for s in every if not banned & s.kept.keys() and not any(c in s.kept.get(p, ()) for p, c in without)
        ]
        space = Resolutions(tree, banned, without)
        assert bool(space) == bool(left)
        assert {(p, c) for p, children in space.union.items() for c in children} == {
            (p, c) for kept in left for p, children in kept.items() for c in children
        }
        for nodes in islice(combinations(tree.order, 2), 10):
            asked = random.sample(edges, min(len(edges), random.randint(0, 2)))
            fitting = [k for k in left if set(nodes) <= k.keys() and all(c in k.get(p, ()) for p, c in asked)]
            kept = space.scenario(nodes, asked, Budget())
            assert space.possible(nodes, Budget(), edges=asked) == (kept is not None) == bool(fitting)
            assert kept is None or kept in fitting


def test_feasible_scenarios(sample: Sample) -> None:
    for random, tree, _ in sample:
        space, every = ScenarioSpace(tree), feasible_scenarios(tree)
        assert space.is_empty == (not every)
        for one, other in islice(combinations(tree.occurrences, 2), 8):
            both = [s for s in every if {one, other} <= s.occurrences]
            ways = [(one, other), (other, one)]
            apart = [s.kept for s in both if all(any(a not in order[b] for order in s.orders) for a, b in ways)]
            kept = space.feasible(space.budget(), apart=(one, other))
            assert kept is None if not apart else kept in apart
            without = frozenset(random.sample(tree.order, 1))
            lacking = [s.kept for s in every if one in s.kept and not without & s.kept.keys()]
            kept = space.feasible(space.budget(), (one,), without=without)
            assert kept is None if not lacking else kept in lacking
            part = random.choice([name for name in tree.order if not tree.nodes[name].has_event] or [one])
            quiet = [s.kept for s in every if one in s.kept and part in s.kept and not s.events(part)]
            kept = None if part == one else space.feasible(space.budget(), (one,), silent=part)
            assert kept is None if not quiet else kept in quiet


def test_what_every_scenario_has(sample: Sample) -> None:
    for random, tree, every in sample:
        marks = {name: 1 << number for number, name in enumerate(random.sample(tree.order, min(3, len(tree.order))))}
        for name, found in inevitable(tree, marks, 7).items():
            having = [s.kept for s in every if name in s.kept]
            for mark, bit in marks.items():
                assert bool(found & bit) == all(mark in kept for kept in having)


def test_fewest_events(sample: Sample) -> None:
    for random, tree, every in sample:
        fewest = min(len(scenario.occurrences) for scenario in every)
        least = fewest_events(tree.bottom_up())[tree.root].events
        assert least >= fewest
        without = frozenset(random.sample(tree.order, random.randint(0, 2)))
        taken = frozenset(random.sample(tree.order, random.randint(0, 2)))
        found = fewest_events(tree.bottom_up(), without=without, taken=taken).get(tree.root)
        left = [len(s.occurrences - taken) for s in every if not without & s.kept.keys()]
        if not tree.shared:
            assert least == fewest
            assert (None if found is None else found.events) == (min(left) if left else None)


def test_a_spent_budget_is_told(sample: Sample) -> None:
    for _, tree, _ in sample:
        space = ScenarioSpace(tree, limit=0)
        if tree.shared and not space.acyclic:
            with pytest.raises(Undecided):
                space.feasible(space.budget())
            return
    raise AssertionError
