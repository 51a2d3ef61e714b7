"""Many comparisons: one order, whatever the number of processes, nothing lost when one dies; and `fork`, on which they stand."""

import os
from dataclasses import dataclass, replace
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


def test_the_results_do_not_depend_on_the_processes() -> None:
    found = []
    for jobs in (1, 3):
        done = [
            (task.job, [replace(result, seconds=0) for result in results]) for task, results in run(tasks(), jobs=jobs)
        ]
        found.append(done)
    assert found[0] == found[1]
    assert [job for job, _ in found[0]] == [task.job for task in tasks()]


@dataclass(frozen=True, slots=True)
class Deadly(Task):
    """A comparison that takes its process with it."""

    def run(self) -> list[Result]:
        os._exit(3)


def test_a_process_that_dies_is_said() -> None:
    first = tasks()[0]
    deadly = Deadly(first.tree, first.job, first.roster, first.effort)
    done = list(run([deadly, *tasks()[:2]], jobs=2))
    assert len(done) == 3
    assert [result.status for result in done[0][1]] == [Status.COULD_NOT_RUN]
    assert "killed" in done[0][1][0].why


def test_a_part_that_is_not_there_is_a_result() -> None:
    task = Task(loads("toplevel r; r or a b;"), Job("tree", Semantics.STRICT, branch=3), ROSTER, Effort())
    (result,) = task.run()
    assert result.status is Status.COULD_NOT_RUN
    assert "branch 3" in result.why


def test_campaigns_depend_on_their_seed_alone() -> None:
    trees = [[dumps(entry.tree) for entry in campaign(20, seed)] for seed in (1, 1, 2)]
    assert trees[0] == trees[1]
    assert trees[0] != trees[2]
    assert [dumps(entry.tree) for entry in campaign(5, 1)] == trees[0][:5]


def test_the_bound_on_scenarios_is_their_number_in_a_tree_without_sharing() -> None:
    for text in ("r or a b c;", "r 2of4 a b c d;", "r and p q; p or a b; q 2of3 c d e;", "r 1of2 p c; p or a b;"):
        tree = loads(f"toplevel r; {text}")
        assert most_scenarios(tree) == len(list(scenarios(tree)))


@pytest.mark.parametrize("seed", range(6))
def test_a_fork_goes_on_alone(seed: int) -> None:
    """Two monitors that have read the same events know nothing of each other."""
    random = Random(seed)
    tree = random_tree(random)
    semantics = list(Semantics)[seed % 3]
    for _, enlist in Roster().candidates(tree, Job("tree", semantics)):
        participant = enlist()
        if isinstance(participant, Absent):
            continue
        assert isinstance(participant, Participant)
        for _ in range(4):
            first, second, third = (random_trace(random, tree, max_length=5) for _ in range(3))
            monitor = participant.start()
            list(monitor.run(first))
            twin, late = monitor.fork(), monitor.fork()
            assert type(twin) is type(monitor)
            said = [*twin.run(second)], [*monitor.run(third)], [*late.run(second)]
            fresh = [participant.start() for _ in range(2)]
            for one in fresh:
                list(one.run(first))
            assert said[0] == said[2] == [*fresh[0].run(second)]
            assert said[1] == [*fresh[1].run(third)]
            assert twin.state == late.state == fresh[0].state
            assert monitor.state == fresh[1].state
