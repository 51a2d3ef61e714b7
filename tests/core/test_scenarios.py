"""The scenarios of a property, and questions about them, against the reference's enumeration:
random trees with shared nodes.
"""

from itertools import combinations, islice, product
from random import Random
from typing import TypeAlias

import pytest

from rvaft import RVAFT, TooLarge
from rvaft.core.build import build
from rvaft.core.feasibility import Resolutions, ScenarioSpace, inevitable
from rvaft.core.precedence import Edge, path, precedence, standstill
from rvaft.core.property import EndInOrder, Property, Source
from rvaft.core.restriction import restrict_property
from rvaft.core.scenarios import fewest_events, most_scenarios, resolutions
from rvaft.core.scenarios import scenarios as of_property
from rvaft.model.guards import holds, variables
from rvaft.model.tree import find_cycle
from rvaft.semantics import ReferenceScenario, branches, feasible_scenarios, scenarios
from rvaft.semantics.scenarios import of_branch
from rvaft.support.budget import Budget, Undecided
from tests.core.kept import names, parts_of
from tests.core.trees import random_tree, small_trees

Sample: TypeAlias = list[tuple[Random, RVAFT, list[ReferenceScenario]]]
Meaning: TypeAlias = tuple[frozenset[str], frozenset[tuple[str, str]], frozenset[str]]
"""The nodes with events, the pairs of them that are ordered, and the nodes with a guard over variables."""


@pytest.fixture(scope="module", params=range(3))
def sample(request: pytest.FixtureRequest) -> Sample:
    random = Random(request.param)
    return [(random, tree, scenarios(tree)) for tree in (random_tree(random) for _ in range(100))]


def is_dead(scenario: ReferenceScenario) -> bool:
    guards = [node.when for node in scenario.nodes if node.when is not None and not variables(node.when)]
    return not all(holds(guard, {}) for guard in guards)


def edges_of(space: ScenarioSpace) -> list[tuple[str, str, Edge]]:
    """The edges of a tree by names and by parts."""
    tree = space.tree
    pairs = ((name, child) for name in tree.order for child in tree.nodes[name].children)
    return [(name, child, (space.gate[name], space.whole[child])) for name, child in pairs]


def of_reference(scenarios: list[ReferenceScenario]) -> set[Meaning]:
    return {
        (
            scenario.occurrences,
            frozenset((a, b) for b, earlier in scenario.before.items() for a in earlier),
            frozenset(node.name for node in scenario.nodes if node.when is not None and variables(node.when)),
        )
        for scenario in scenarios
    }


def meanings(prop: Property) -> list[Meaning]:
    found = []
    for scenario in of_property(prop):
        nodes = [event.source.node for event in scenario.events]
        pairs = {
            (nodes[one], node)
            for node, before in zip(nodes, scenario.before, strict=True)
            for one in range(len(nodes))
            if before >> one & 1
        }
        found.append((frozenset(nodes), frozenset(pairs), frozenset(one.source.node for one in scenario.conditions)))
    return found


def test_scenarios_of_all_small_trees_and_random_ones() -> None:
    random, compared = Random(3), 0
    trees = [tree for size in range(1, 4) for tree in islice(small_trees(size), 0, None, 4)]
    for tree in [*trees, *(random_tree(random) for _ in range(300))]:
        prop = build(tree)
        if not any(isinstance(part, EndInOrder) for part in prop.parts):
            assert set(meanings(prop)) == of_reference(feasible_scenarios(tree)), tree.nodes
            for number, branch in islice(enumerate(branches(tree), 1), 5):
                chosen = [scenario for scenario in feasible_scenarios(tree) if of_branch(scenario, branch)]
                assert set(meanings(restrict_property(prop, branch=number))) == of_reference(chosen), tree.nodes
                compared += len(chosen)
    assert compared > 100


def test_precedence(sample: Sample) -> None:
    for _, tree, every in sample:
        space = ScenarioSpace(tree)
        for scenario in every[:15]:
            kept = parts_of(space.prop, scenario)
            graph = precedence(kept)
            before, ends = scenario.before, any(isinstance(part, EndInOrder) for part in kept)
            cyclic = any(name in earlier for name, earlier in before.items())
            assert bool(find_cycle(graph)) == cyclic or ends
            assert (standstill(kept, graph) is None) == bool(scenario.orders)
            for one, other in product(scenario.occurrences, repeat=2):
                found = path(graph, space.leaf[one], space.leaf[other])
                assert one == other or bool(found) == (one in before[other]) or ends


def test_one_by_one(sample: Sample) -> None:
    for _, tree, every in sample:
        prop = build(tree)
        found = [frozenset(names(tree, kept).items()) for kept in resolutions(prop, limit=10_000)]
        assert len(set(found)) == len(found) <= most_scenarios(prop)
        assert set(found) == {frozenset(scenario.kept.items()) for scenario in every if not is_dead(scenario)}
        if not tree.shared:
            assert most_scenarios(prop) == len(every)
        minimal = resolutions(prop, minimal=True, limit=10_000)
        assert {frozenset(names(tree, kept).items()) for kept in minimal} <= set(found)
        if found:
            with pytest.raises(TooLarge):
                list(resolutions(prop, limit=len(found) - 1))


def test_what_may_be_together(sample: Sample) -> None:
    for random, tree, every in sample:
        space = ScenarioSpace(tree)
        banned = random.sample(tree.order, random.randint(0, 1))
        edges = edges_of(space)
        without = random.sample(edges, random.randint(0, 1))
        left = [
            scenario.kept
            for scenario in every
            if scenario.kept.keys().isdisjoint(banned)
            and not any(child in scenario.kept.get(name, ()) for name, child, _ in without)
        ]
        ways = Resolutions(space.everything, {space.whole[name] for name in banned}, {edge for _, _, edge in without})
        assert bool(ways) == bool(left)
        assert {pair for name, some in names(tree, ways.union).items() for pair in product([name], some)} == {
            (parent, child) for kept in left for parent, children in kept.items() for child in children
        }
        for nodes in islice(combinations(tree.order, 2), 10):
            asked = random.sample(edges, min(len(edges), random.randint(0, 2)))
            fitting = [
                kept for kept in left if {*nodes} <= kept.keys() and all(c in kept.get(p, ()) for p, c, _ in asked)
            ]
            parts, needed = [space.whole[name] for name in nodes], [edge for _, _, edge in asked]
            kept = ways.scenario(parts, needed, Budget())
            assert ways.possible(parts, Budget(), edges=needed) == (kept is not None) == bool(fitting)
            assert kept is None or names(tree, kept) in fitting


def test_feasible_scenarios(sample: Sample) -> None:
    for random, tree, _ in sample:
        space, every = ScenarioSpace(tree), feasible_scenarios(tree)
        assert space.is_empty == (not every)
        for one, other in islice(combinations(tree.occurrences, 2), 8):
            both = [s for s in every if {one, other} <= s.occurrences]
            ways = [(one, other), (other, one)]
            apart = [s.kept for s in both if all(any(a not in order[b] for order in s.orders) for a, b in ways)]
            kept = space.feasible(space.budget(), apart=(one, other))
            assert (names(tree, kept) in apart) if kept else not apart
            without = random.sample(tree.order, 1)
            lacking = [s.kept for s in every if one in s.kept and s.kept.keys().isdisjoint(without)]
            kept = space.feasible(space.budget(), (one,), without=without)
            assert (names(tree, kept) in lacking) if kept else not lacking
            part = random.choice([name for name in tree.order if name not in space.leaf] or [one])
            quiet = [s.kept for s in every if one in s.kept and part in s.kept and not s.events(part)]
            kept = None if part == one else space.feasible(space.budget(), (one,), silent=part)
            assert (names(tree, kept) in quiet) if kept else not quiet


def test_what_every_scenario_has(sample: Sample) -> None:
    for random, tree, every in sample:
        space = ScenarioSpace(tree)
        marks = {name: 1 << number for number, name in enumerate(random.sample(tree.order, min(3, len(tree.order))))}
        found = inevitable(space.order, {space.whole[name]: bit for name, bit in marks.items()}, 7)
        for name in tree.order:
            having = [s.kept for s in every if name in s.kept]
            for mark, bit in marks.items():
                assert bool(found[space.whole[name]] & bit) == all(mark in kept for kept in having)


def test_fewest_events(sample: Sample) -> None:
    for random, tree, every in sample:
        prop = build(tree)
        fewest = min(len(scenario.occurrences) for scenario in every)
        least = fewest_events(prop.parts)[prop.root].events
        assert least >= fewest
        without = random.sample(tree.order, random.randint(0, 2))
        found = fewest_events(prop.parts, without={prop.wholes[Source(name)] for name in without}).get(prop.root)
        left = [len(s.occurrences) for s in every if s.kept.keys().isdisjoint(without)]
        if not tree.shared:
            assert least == fewest
            assert (None if found is None else found.events) == (min(left) if left else None)


def test_a_spent_budget_is_reported(sample: Sample) -> None:
    for _, tree, _ in sample:
        space = ScenarioSpace(tree, limit=0)
        if tree.shared and not space.acyclic:
            with pytest.raises(Undecided):
                space.feasible(space.budget())
            return
    raise AssertionError
