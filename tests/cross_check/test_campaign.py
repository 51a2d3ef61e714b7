"""Campaigns: what the catalogue has, one order of results, nothing lost when a process dies; and
`fork`, on which they stand.
"""

import os
from dataclasses import dataclass
from itertools import product
from random import Random

import pytest

from cross_check.campaign import Task, campaign, catalogue, in_turn, run
from cross_check.comparison import Roster
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import random_tree
from cross_check.participants import Absent, Participant
from cross_check.results import Job, Result, Status
from cross_check.traces import Effort
from rvaft import Causality, Gate, Semantics, dumps, loads
from rvaft.model.guards import Operation, Operator, walk
from rvaft.model.values import Json
from rvaft.rules.validity import require_valid

ROSTER = Roster(backends=("rml",))
ENTRIES = list(catalogue())
NODES = [(entry.tree, node) for entry in ENTRIES for node in entry.tree.top_down()]


def test_every_tree_keeps_the_rules_and_has_a_name_of_its_own() -> None:
    for entry in ENTRIES:
        require_valid(entry.tree)
    assert len({(entry.name, entry.branch, entry.kind) for entry in ENTRIES}) == len(ENTRIES)


def test_every_gate_with_one_to_four_children_without_and_with_its_own_event() -> None:
    shapes = {
        (node.gate, len(node.children), node.threshold, tree.causality if node.on else None)
        for tree, node in NODES
        if node.gate is not None and all(tree.nodes[child].leaf for child in node.children)
    }
    votes = {(Gate.VOT, n, k) for n in (1, 2, 3, 4) for k in range(1, n + 1)}
    expected = votes | {(gate, n, None) for gate in Gate if gate is not Gate.VOT for n in (1, 2, 3, 4)}
    assert {(*shape, causality) for shape in expected for causality in (None, *Causality)} <= shapes


def test_every_ordered_pair_of_gates_is_nested_and_under_every_gate_something_is_shared() -> None:
    nested = {(node.gate, tree.nodes[child].gate) for tree, node in NODES for child in node.children}
    assert set(product(Gate, repeat=2)) <= nested
    assert {entry.tree.nodes[entry.tree.root].gate for entry in ENTRIES if entry.tree.shared} == set(Gate)
    events = [
        (node, [tree.pattern(child) for child in node.children if tree.nodes[child].has_event]) for tree, node in NODES
    ]
    assert {node.gate for node, patterns in events if len(set(patterns)) < len(patterns)} == set(Gate)


def test_a_run_without_arguments_has_each_tree_once_and_each_gate_under_each_semantics() -> None:
    turns = [*in_turn(ENTRIES)]
    assert [entry for entry, _ in turns] == ENTRIES
    found = {(node.gate, semantics) for entry, semantics in turns for node in entry.tree.top_down() if node.gate}
    assert found == {*product(Gate, Semantics)}


def test_branches_kinds_and_guards() -> None:
    assert {entry.branch for entry in ENTRIES} >= {1, 2, 3}
    assert {str(entry.kind) for entry in ENTRIES} >= {"fault", "attack"}
    assert any(entry.tree.ignores for entry in ENTRIES)
    guarded = [node for _, node in NODES if node.when is not None]
    assert any(node.gate for node in guarded)
    assert any(node.leaf and node.on is None for node in guarded)


def tasks() -> list[Task]:
    entries = ENTRIES[:6]
    return [Task(e.tree, Job(e.name, Semantics.STRICT, e.branch, e.kind), ROSTER, Effort(traces=2)) for e in entries]


@dataclass(frozen=True, slots=True)
class Deadly(Task):
    """A comparison that takes its process with it."""

    def run(self) -> list[Result]:
        os._exit(3)


def test_a_process_that_dies_is_said_and_the_others_come_in_order() -> None:
    first, *others = tasks()
    done = list(run([Deadly(first.tree, first.job, first.roster, first.effort), *others], jobs=2))
    assert [task.job for task, _ in done] == [task.job for task in tasks()]
    assert [result.status for result in done[0][1]] == [Status.COULD_NOT_RUN]
    assert "killed" in done[0][1][0].why


def test_a_part_that_is_not_there_is_a_result() -> None:
    task = Task(loads("toplevel r; r or a b;"), Job("tree", Semantics.STRICT, branch=3), ROSTER, Effort())
    (result,) = task.run()
    assert result.status is Status.COULD_NOT_RUN
    assert "branch 3" in result.why


def test_campaigns_depend_on_their_seed_alone() -> None:
    trees, same, others = ([dumps(entry.tree) for entry in campaign(*asked)] for asked in ((20, 1), (5, 1), (20, 2)))
    assert trees[:5] == same
    assert trees != others


def left_open(participant: Participant, trace: list[Json]) -> str:
    """Why a participant has no verdict for a trace, if it says so."""
    return "" if participant.left_open is None else participant.left_open(trace)


@pytest.mark.parametrize("semantics", Semantics)
def test_a_fork_goes_on_alone(semantics: Semantics) -> None:
    """Two monitors that have read the same events know nothing of each other."""
    random = Random(semantics)
    tree = random_tree(random)
    for name, enlist in Roster().candidates(tree, Job("tree", semantics)):
        participant = enlist()
        if isinstance(participant, Absent):
            continue
        assert isinstance(participant, Participant)
        drawn = ([random_trace(random, tree, max_length=5) for _ in range(3)] for _ in range(200))
        told = [some for some in drawn if not any(left_open(participant, [*some[0], *way]) for way in some[1:])]
        assert len(told) >= 6, name
        for first, *ways in told[:6]:
            monitors = [participant.start() for _ in range(3)]
            for monitor in monitors:
                list(monitor.run(first))
            twin, late = monitors[0].fork(), monitors[0].fork()
            said = [[*one.run(way)] for one, way in zip((twin, monitors[0], late), (*ways, ways[0]), strict=True)]
            fresh = [[*one.run(way)] for one, way in zip(monitors[1:], ways, strict=True)]
            assert said == [*fresh, fresh[0]], name
            assert (twin.state, late.state, monitors[0].state) == tuple(monitors[one].state for one in (1, 1, 2)), name


def test_each_operator_is_drawn() -> None:
    left = set(Operator)
    for seed in range(3_000):
        guards = [part for node in random_tree(Random(seed)).top_down() for part in walk(node.when)]
        left -= {part.operator for part in guards if isinstance(part, Operation)}
        if not left:
            break
    assert left == set()
