"""The rules about scenarios against enumeration, on thousands of small random trees."""

import re
from functools import cache
from itertools import product
from random import Random

import pytest

from rvaft.analysis.scenarios import cycle, path, precedence
from rvaft.analysis.unification import overlaps
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Anything, match, rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.rules import check_tree
from rvaft.rules.rule import Finding
from rvaft.semantics.scenarios import feasible_scenarios
from tests.analysis.random_trees import random_tree

from . import brute_force

SEEDS = range(10)
TREES = 200


def _trees(seed: int) -> list[RVAFT]:
    random = Random(seed)
    return [random_tree(random) for _ in range(TREES)]


@cache
def _checked(seed: int) -> list[tuple[RVAFT, list[Finding], list[brute_force.Scenario]]]:
    """Each tree with the findings on it and its feasible scenarios."""
    return [(tree, check_tree(tree), brute_force.feasible(tree)) for tree in _trees(seed)]


def _of(findings: list[Finding], code: str) -> list[Finding]:
    return [finding for finding in findings if finding.code == code]


@pytest.mark.parametrize("seed", SEEDS)
def test_the_precedence_graph_says_what_the_definition_says(seed: int) -> None:
    for tree in _trees(seed):
        for kept in list(brute_force.scenarios(tree))[:15]:
            expected = brute_force.before(tree, kept)
            graph = precedence(tree, kept)
            assert bool(cycle(graph)) == any(a == b for a, b in expected)
            events = [name for name in kept if tree.nodes[name].has_event]
            for one, other in product(events, repeat=2):
                if one != other:
                    assert bool(path(graph, one, other)) == ((one, other) in expected), (tree, one, other)


@pytest.mark.parametrize("seed", SEEDS)
def test_feasibility_rules_agree_with_enumeration(seed: int) -> None:
    for tree, findings, feasible in _checked(seed):
        everything = list(brute_force.scenarios(tree))
        assert bool(_of(findings, "no-scenario")) == (not feasible)
        silent = any(not any(tree.nodes[name].has_event for name in kept) for kept in feasible)
        assert bool(_of(findings, "silent-scenario")) == silent
        assert not [f for f in _of(findings, "undecided") if "guard" not in f.message]
        infeasible = _of(findings, "infeasible-scenario")
        if feasible:
            reported = {f.nodes[0] for f in infeasible if "never holds" in f.message}
            assert reported == set().union(*(brute_force.dead(tree, kept) for kept in everything))
            cyclic = any(brute_force.cyclic(tree, kept) for kept in everything if not brute_force.dead(tree, kept))
            assert any("before itself" in f.message for f in infeasible) == cyclic
        else:
            assert not any("before itself" in f.message for f in infeasible)  # that nothing is left is the error


@pytest.mark.parametrize("seed", SEEDS)
def test_unbound_variables_agree_with_enumeration(seed: int) -> None:
    for tree, findings, feasible in _checked(seed):
        expected = set()
        for kept in feasible:
            bound = {v for name in kept for v in rigid_variables(tree.pattern(name) or Anything())}
            for name in kept:
                when = tree.nodes[name].when
                expected |= {(name, v) for v in guard_variables(when) if v not in bound} if when is not None else set()
        reported = set()
        for finding in _of(findings, "unbound-variable"):
            found = re.match(r"variable (\w+) in the guard of (\w+) ", finding.message)
            assert found is not None
            reported.add((found[2], found[1]))
        assert reported == expected


@pytest.mark.parametrize("seed", SEEDS)
def test_ambiguous_events_agree_with_enumeration(seed: int) -> None:
    for tree, findings, feasible in _checked(seed):
        expected = set()
        for kept in feasible:
            order = brute_force.before(tree, kept)
            events = [name for name in tree.order if name in kept and tree.nodes[name].has_event]
            for one, other in product(events, repeat=2):
                left, right = tree.pattern(one), tree.pattern(other)
                assert left is not None
                assert right is not None
                unordered = (one, other) not in order and (other, one) not in order
                if unordered and tree.order.index(one) < tree.order.index(other) and overlaps(left, right):
                    expected.add((one, other))
        assert {finding.nodes for finding in _of(findings, "ambiguous-event")} == expected


_GRID = (1, 2, "a", "one", 1.25, 1.75, 3, 4, 0, -1, 1.5, "aa", "b", "p", "q", "", "A", True, False, None)


def _satisfiable(tree: RVAFT, names: list[str]) -> bool:
    guards = [tree.nodes[name].when for name in names]
    some = [guard for guard in guards if guard is not None]
    return any(
        all(holds(guard, dict(zip("XYZ", values, strict=True))) for guard in some)
        for values in product(_GRID, repeat=len("XYZ"))
    )


@pytest.mark.parametrize("seed", range(5))
def test_contradictory_guards_agree_with_enumeration(seed: int) -> None:
    random = Random(seed)
    for _ in range(30):
        tree = random_tree(random, guards=0.6, constants=0.05)
        feasible = brute_force.feasible(tree)
        findings = check_tree(tree)
        assert not _of(findings, "undecided")
        reported = _of(findings, "contradictory-guards")
        guards = {tuple(n for n in sorted(kept) if tree.nodes[n].when is not None) for kept in feasible}
        assert bool(reported) == any(not _satisfiable(tree, list(names)) for names in guards)
        for finding in reported:
            assert not _satisfiable(tree, list(finding.nodes))
            assert any(set(finding.nodes) <= kept.keys() for kept in feasible)


@pytest.mark.parametrize("seed", SEEDS)
def test_shared_under_order_agrees_with_enumeration(seed: int) -> None:
    for tree, findings, _ in _checked(seed):
        found = {finding.nodes[0]: finding.nodes for finding in _of(findings, "shared-under-order")}
        alive = [kept for kept in brute_force.scenarios(tree) if not brute_force.dead(tree, kept)]
        sequences: dict[tuple[str, str], set[tuple[str, str]]] = {}
        for kept in alive:
            slots = [(gate, child) for gate, children in kept.items() if _ordered(tree, gate) for child in children]
            parts = {slot: brute_force.part(kept, slot[1]) for slot in slots}
            for parent, children in kept.items():
                for child in children:
                    own = {slot for slot in slots if parent in parts[slot] or slot == (parent, child)}
                    sequences.setdefault((parent, child), set()).update(own)
        expected = set()
        for kept in alive:
            for name in kept:
                sides = [sequences[parent, name] for parent, children in kept.items() if name in children]
                if any(side != sides[0] for side in sides):
                    expected.add(name)
        assert found.keys() == expected
        for name, one, other in found.values():
            assert any(name in kept.get(one, ()) and name in kept.get(other, ()) for kept in alive)


def _ordered(tree: RVAFT, name: str) -> bool:
    gate = tree.nodes[name].gate
    return gate is not None and gate.ordered


_ATOMS = (1, 2, "a", "one", "four", True)


def test_overlap_finds_what_a_common_event_shows() -> None:
    """Where some event out of many matches both patterns, the patterns overlap."""
    values = [*_ATOMS, {"b": 1}, {"a": 1, "b": 1}, {"b": "one"}, {"a": 1, "b": "one"}, {"a": 1, "b": "four"}, {"a": 1}]
    events = [
        {"kind": kind, "value": value, "inner": inner, "other": other, "event": name}
        for kind in (1, "one", "four", "a")
        for value in (1, "a", [1])
        for inner in values
        for other in ([1], ["a"])
        for name in ("n1", "n2")
    ]
    random, checked = Random(7), 0
    for _ in range(60):
        tree = random_tree(random)
        patterns = [pattern for name in tree.occurrences if (pattern := tree.pattern(name)) is not None]
        for left, right in product(patterns[:4], patterns[:4]):
            common = False
            for event in events:
                binding = match(left, event, {})
                rigid = {k: v for k, v in (binding or {}).items() if not k.startswith("_")}
                common = common or (binding is not None and match(right, event, rigid) is not None)
            assert overlaps(left, right) >= common
            checked += common
    assert checked > 100


@pytest.mark.parametrize("seed", range(3))
def test_the_enumeration_here_is_that_of_the_reference(seed: int) -> None:
    for tree, _, feasible in _checked(seed):
        here = [frozenset(kept.items()) for kept in feasible]
        there = [frozenset(scenario.kept.items()) for scenario in feasible_scenarios(tree)]
        assert sorted(map(sorted, here)) == sorted(map(sorted, there))
