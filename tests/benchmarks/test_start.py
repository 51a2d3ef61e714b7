"""Cold start: the median of eleven fresh processes, against that of an empty Python in the same run."""

import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROUNDS = 11
TREE = Path(__file__).parents[2] / "trees" / "remote_inspection" / "pruned.rvaft"


def median(*arguments: str) -> float:
    taken = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], input="", capture_output=True, text=True, check=True)
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("arguments", "seconds"),
    [(["--help"], 0.2), (["check", str(TREE)], 0.6), (["monitor", str(TREE)], 0.6)],
    ids=["help", "check", "monitor"],
)
def test_cold_start(arguments: list[str], seconds: float, capsys: pytest.CaptureFixture[str]) -> None:
    bare = median("-c", "pass")
    ours = median("-c", "from rvaft.cli import main; main()", *arguments)
    with capsys.disabled():
        print(f"\nrvaft {arguments[0]}: {ours:.3f} s (aim {seconds} s), {ours / bare:.1f} x an empty Python")
    assert ours / bare < 60
