"""Seconds to enumerate the branches of long chains of choices."""

import time

import pytest

from rvaft.analysis.branches import branch, branches
from tests.benchmarks.trees import chain


def seconds(gates: int) -> float:
    """The better of three runs over all branches."""
    tree = chain(gates)
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        assert sum(1 for _ in branches(tree)) == gates + 1
        taken.append(time.perf_counter() - start)
    return min(taken)


@pytest.mark.benchmark
def test_a_chain_of_choices_takes_quadratic_time(capsys: pytest.CaptureFixture[str]) -> None:
    short, long = seconds(100), seconds(300)
    tree = chain(300)
    start = time.perf_counter()
    assert branch(tree, 300).number == 300
    with capsys.disabled():
        print(f"\n300 gates: {long:.2f} s for all branches, {time.perf_counter() - start:.2f} s for one")
    assert long / short < 18  # 9 is quadratic, 27 cubic
