"""Many comparisons: one order, whatever the number of processes, nothing lost when one dies; and `fork`, on which they stand."""

import os
from dataclasses import dataclass
from random import Random

import pytest

from cross_check.campaign import Task, campaign, catalogue, run
from cross_check.comparison import Roster
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import random_tree
from cross_check.participants import Absent, Participant
from cross_check.results import Job, Result, Status
from cross_check.traces import Effort
from rvaft import loads
from rvaft.analysis.scenarios import most_scenarios
from rvaft.language.printer import dumps
from rvaft.model.verdict import Semantics
from rvaft.semantics import scenarios

ROSTER = Roster(backends=("rml",))


def tasks() -> list[Task]:
    entries = list(catalogue())[:6]
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


def test_the_bound_on_scenarios_is_their_number_in_a_tree_without_sharing() -> None:
    for text in ("r or a b c;", "r 2of4 a b c d;", "r and p q; p or a b; q 2of3 c d e;", "r 1of2 p c; p or a b;"):
        tree = loads(f"toplevel r; {text}")
        assert most_scenarios(tree) == len(list(scenarios(tree)))


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
        for _ in range(6):
            first, *ways = (random_trace(random, tree, max_length=5) for _ in range(3))
            monitors = [participant.start() for _ in range(3)]
            for monitor in monitors:
                list(monitor.run(first))
            twin, late = monitors[0].fork(), monitors[0].fork()
            said = [[*one.run(way)] for one, way in zip((twin, monitors[0], late), (*ways, ways[0]), strict=True)]
            fresh = [[*one.run(way)] for one, way in zip(monitors[1:], ways, strict=True)]
            assert said == [*fresh, fresh[0]], name
            assert (twin.state, late.state, monitors[0].state) == tuple(monitors[one].state for one in (1, 1, 2)), name
