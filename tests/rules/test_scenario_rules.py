"""The rules about scenarios: against enumeration, on hundreds of small random trees, and on large and deep ones."""

import re
from collections import Counter
from collections.abc import Iterable
from itertools import product
from random import Random
from typing import TypeAlias

import pytest

from rvaft import RVAFT, EventType, Finding, Gate, Node, On
from rvaft.core.overlaps import overlaps
from rvaft.model.expressions import guard_text
from rvaft.model.guards import Operation, Operator, holds, time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Variable
from rvaft.rules.registry import check_tree
from rvaft.semantics import ReferenceScenario, feasible_scenarios, scenarios
from tests.core.trees import random_tree, with_times

Sample: TypeAlias = list[tuple[RVAFT, list[Finding], list[ReferenceScenario]]]
"""Trees, each with the findings on it and its feasible scenarios."""


@pytest.fixture(scope="module", params=range(2))
def checked(request: pytest.FixtureRequest) -> Sample:
    random = Random(request.param)
    return [(tree, check_tree(tree), feasible_scenarios(tree)) for tree in (random_tree(random) for _ in range(200))]


def _dead(scenario: ReferenceScenario) -> set[str]:
    constant = ((node.name, node.when) for node in scenario.nodes if node.when and not guard_variables(node.when))
    return {name for name, guard in constant if not holds(guard, {})}


def _of(findings: list[Finding], code: str) -> list[Finding]:
    return [finding for finding in findings if finding.code == code]


def test_feasibility_rules_agree_with_enumeration(checked: Sample) -> None:
    for tree, findings, feasible in checked:
        everything = scenarios(tree)
        assert bool(_of(findings, "no-scenario")) == (not feasible)
        assert bool(_of(findings, "silent-scenario")) == any(not kept.occurrences for kept in feasible)
        assert not [f for f in _of(findings, "undecided") if "guard" not in f.message]
        infeasible = _of(findings, "infeasible-scenario")
        if feasible:
            reported = {f.nodes[0] for f in infeasible if "never holds" in f.message}
            assert reported == set().union(*(_dead(kept) for kept in everything))
            disordered = any(not kept.orders for kept in everything if not _dead(kept))
            assert any("scenario is dropped" in f.message for f in infeasible) == disordered
        else:
            assert not any("scenario is dropped" in f.message for f in infeasible)  # that nothing is left is the error


def test_unbound_variables_agree_with_enumeration(checked: Sample) -> None:
    for _, findings, feasible in checked:
        expected = set()
        for kept in feasible:
            guards = [(node.name, node.when) for node in kept.nodes if node.when is not None]
            expected |= {(v, name) for name, when in guards for v in guard_variables(when) if v not in kept.bound}
        said = "\n".join(finding.message for finding in _of(findings, "unbound-variable"))
        assert set(re.findall(r"^variable (\w+) in the guard of (\w+) ", said, re.MULTILINE)) == expected


def test_ambiguous_events_agree_with_enumeration(checked: Sample) -> None:
    for tree, findings, feasible in checked:
        expected = set()
        for kept in feasible:
            for one, other in product(kept.occurrences, repeat=2):
                unordered = all(any(a not in o[b] for o in kept.orders) for a, b in ((one, other), (other, one)))
                if unordered and tree.order.index(one) < tree.order.index(other):
                    left, right = tree.pattern(one), tree.pattern(other)
                    assert left is not None
                    assert right is not None
                    expected |= {(one, other)} if overlaps(left, right) else set()
        assert {finding.nodes for finding in _of(findings, "ambiguous-event")} == expected


@pytest.mark.parametrize("seed", range(2))
def test_conditions_on_time_agree_with_enumeration(seed: int) -> None:
    random, told = Random(seed), Counter[str]()
    for tree in [with_times(random, random_tree(random, guards=0.1)) for _ in range(150)]:
        findings, feasible = check_tree(tree), feasible_scenarios(tree)
        lacking = set()
        for kept in feasible:
            for node in kept.nodes:
                asked = {one.name for one in time_points(node.when)} if node.when is not None else set()
                asked |= set() if node.within is None else {f"end({node.name})"}
                lacking |= {node.name for one in asked if not kept.points[one]}
        assert {finding.nodes[0] for finding in _of(findings, "unbound-time")} == lacking
        contradictions = [f.nodes for f in _of(findings, "contradictory-guards") if "times are" in f.message]
        told.update({"lacking": bool(lacking), "contradictions": bool(contradictions)})
        if not lacking:
            small = [kept for kept in feasible if len(kept.occurrences) <= 3]
            hopeless = [set(kept.kept) for kept in small if not _timely(kept)]
            for nodes in contradictions:
                having = [kept for kept in feasible if set(nodes) <= set(kept.kept)]
                assert any(kept not in small or not _timely(kept) for kept in having)
            guards = [node.when for node in tree.top_down() if node.when is not None]
            unequal = any("!=" in guard_text(guard) for guard in guards)
            if not unequal and all(one.point == "at" for guard in guards for one in time_points(guard)):
                assert all(any(set(nodes) <= kept for nodes in contradictions) for kept in hopeless)
    assert min(told.values()) > 3, told


def _timely(kept: ReferenceScenario) -> bool:
    """Whether some times of its events keep all conditions on time that a scenario has."""
    names = sorted(kept.occurrences)
    guards = [node.when for node in kept.nodes if node.when is not None and time_points(node.when)]
    windows = [(kept.events(node.name), node.within) for node in kept.nodes if node.within is not None]
    for row in product(range(4 * len(names)), repeat=len(names)):
        time = dict(zip(names, row, strict=True))
        ends = {one: [time[event] for event in events] for one, events in kept.points.items()}
        points = {one: min(found) if one.startswith("start") else max(found) for one, found in ends.items() if found}
        short = all(max(at) - min(at) <= d for events, d in windows if (at := [time[event] for event in events]))
        if short and all(holds(guard, points) for guard in guards):
            return True
    return False


_GRID = (1, 2, "a", "one", 1.25, 1.75, 3, 4, 0, -1, 1.5, "aa", "b", "p", "q", "", "A", True, False, None)


def _satisfiable(tree: RVAFT, names: Iterable[str]) -> bool:
    some = [guard for name in names if (guard := tree.nodes[name].when) is not None]
    used = sorted(set().union(*map(guard_variables, some)))
    values = product(_GRID, repeat=len(used))
    return any(all(holds(guard, dict(zip(used, row, strict=True))) for guard in some) for row in values)


@pytest.mark.parametrize("seed", range(2))
def test_contradictory_guards_agree_with_enumeration(seed: int) -> None:
    random = Random(seed)
    for _ in range(30):
        tree = random_tree(random, guards=0.6, constants=0.05)
        feasible = feasible_scenarios(tree)
        findings = check_tree(tree)
        assert not _of(findings, "undecided")
        reported = _of(findings, "contradictory-guards")
        guards = {tuple(n for n in sorted(kept.kept) if tree.nodes[n].when is not None) for kept in feasible}
        assert bool(reported) == any(not _satisfiable(tree, names) for names in guards)
        for finding in reported:
            assert not _satisfiable(tree, finding.nodes)
            assert any(set(finding.nodes) <= kept.kept.keys() for kept in feasible)


def test_shared_under_order_agrees_with_enumeration(checked: Sample) -> None:
    for tree, findings, _ in checked:
        found = {finding.nodes[0]: finding.nodes for finding in _of(findings, "shared-under-order")}
        alive = [kept for kept in scenarios(tree) if not _dead(kept)]
        sequences: dict[tuple[str, str], set[tuple[str, str]]] = {}
        for kept in alive:
            gates = [(name, gate) for name in kept.kept if (gate := tree.nodes[name].gate) is not None]
            slots = [(name, child) for name, gate in gates if gate.ordered for child in kept.kept[name]]
            parts = {slot: kept.part(slot[1]) for slot in slots}
            for parent, children in kept.kept.items():
                for child in children:
                    own = {slot for slot in slots if parent in parts[slot] or slot == (parent, child)}
                    sequences.setdefault((parent, child), set()).update(own)
        expected = set()
        for kept in alive:
            for name in kept.kept:
                sides = [sequences[parent, name] for parent, children in kept.kept.items() if name in children]
                if any(side != sides[0] for side in sides):
                    expected.add(name)
        assert found.keys() == expected
        for name, one, other in found.values():
            assert any(name in kept.kept.get(one, ()) and name in kept.kept.get(other, ()) for kept in alive)


# Every rule answers, without recursion and without enumerating anything.

EVENT = EventType("at", ("k", "v"), ObjectPattern((("kind", Variable("k")), ("value", Variable("v")))))


@pytest.mark.parametrize("gate", [Gate.AND, Gate.OR, Gate.SAND, Gate.SAND_RL])
def test_a_chain_deeper_than_python_recurses(gate: Gate) -> None:
    nodes = [Node("g3000")]
    for index in range(3000):
        nodes += [Node(f"g{index}", gate, (f"g{index + 1}", f"l{index}")), Node(f"l{index}")]
    assert check_tree(RVAFT("g0", nodes)) == []


def _wide(gate: Gate, count: int, *, same: bool, guarded: bool = False) -> RVAFT:
    nodes = [Node("top", gate, tuple(f"n{i}" for i in range(count)))]
    for index in range(count):
        on = On("at", (Literal("same" if same else f"k{index}"), Variable(f"V{index}") if guarded else Anything()))
        when = Operation(Operator.GT, (Variable(f"V{index}"), Literal(index))) if guarded else None
        nodes.append(Node(f"n{index}", on=on, when=when))
    return RVAFT("top", nodes, [EVENT])


@pytest.mark.parametrize(("gate", "same"), [(Gate.AND, False), (Gate.SAND, True), (Gate.OR, True)])
def test_thousands_of_leaves(gate: Gate, same: bool) -> None:
    """Told apart by a field, or with one event in sequence or as alternatives."""
    assert check_tree(_wide(gate, 5_000, same=same)) == []


def test_scenarios_are_not_enumerated() -> None:
    """2 to the 200 branches, with guards on a common variable in each of them."""
    nodes = [
        Node("top", Gate.SAND, ("first", *(f"o{i}" for i in range(200)))),
        Node("first", on=On("at", (Literal(0), Variable("V")))),
    ]
    for index in range(200):
        nodes += [Node(f"o{index}", Gate.OR, (f"a{index}", f"b{index}")), Node(f"b{index}")]
        nodes.append(Node(f"a{index}", when=Operation(Operator.GT, (Variable("V"), Literal(index)))))
    assert check_tree(RVAFT("top", nodes, [EVENT])) == []


@pytest.mark.ci
def test_guards_over_some_thousand_variables() -> None:
    """More than are looked at together."""
    assert check_tree(_wide(Gate.SAND, 1_000, same=False, guarded=True)) == []
    names = [f"V{index}" for index in range(4_200)]
    on = [Node(f"n{name}", on=On("at", (Literal(name), Variable(name)))) for name in names]
    when = [Node(f"w{name}", when=Operation(Operator.GT, (Variable(name), Literal(1)))) for name in names]
    top = Node("top", Gate.SAND, tuple(node.name for node in (*on, *when)))
    assert check_tree(RVAFT("top", [top, *on, *when], [EVENT])) == []
    top = Node("top", Gate.SAND, tuple(node.name for node in (*on[:-1], *when)))
    (unbound,) = check_tree(RVAFT("top", [top, *on[:-1], *when], [EVENT]))
    assert unbound.nodes == (when[-1].name,)
