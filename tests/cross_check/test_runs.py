"""Many comparisons: one order, whatever the number of processes, and nothing lost when one dies."""

import os
from dataclasses import dataclass, replace

from cross_check.campaign import Task, campaign, catalogue, run
from cross_check.comparison import Roster
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
