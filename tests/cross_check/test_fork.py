"""`fork`: two monitors that have read the same events and know nothing of each other."""

from random import Random

import pytest

from cross_check.comparison import Roster
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import random_tree
from cross_check.participants import Absent, Participant
from cross_check.results import Job
from rvaft.model.verdict import Semantics


@pytest.mark.parametrize("seed", range(9))
def test_a_fork_goes_on_alone(seed: int) -> None:
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
