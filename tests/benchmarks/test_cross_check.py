"""The run without arguments and a random campaign: seconds, memory, and how they compare with each other."""

import json
import re
import subprocess
import sys
import time

import pytest


def run(*arguments: str) -> tuple[float, float, dict[str, int]]:
    """Seconds, the largest memory of a process in MB, and the totals of a run in processes of its own."""
    command = "import sys; from rvaft.cli import main; main(standalone_mode=False); import resource;"
    command += "print('peak', max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))"
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", command, "cross-check", *arguments, "--json", "/dev/stderr"],
        capture_output=True,
        text=True,
        check=True,
    )
    seconds = time.perf_counter() - start
    peak = re.search(r"peak (\d+)", done.stdout)
    assert peak is not None
    totals: dict[str, int] = json.loads(done.stderr)["totals"]
    assert totals["disagreements"] == 0
    return seconds, int(peak[1]) / 1024, totals


@pytest.mark.benchmark
def test_the_run_without_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    seconds, memory, totals = run()
    with capsys.disabled():
        print(f"\nno argument: {seconds:.1f} s (aim 10 s), largest process {memory:.0f} MB, {totals}")
    assert memory < 500


@pytest.mark.benchmark
@pytest.mark.parametrize("trees", [100, 1000])
def test_a_campaign(trees: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Trees of up to 8 occurrences, 20 traces each, all participants that need no tool, all semantics."""
    seconds, memory, totals = run("--random", str(trees), "--max-nodes", "9", "--traces", "20", "--seed", "1")
    with capsys.disabled():
        print(
            f"\n{trees} random trees: {seconds:.1f} s (aim {180 * trees // 1000} s), largest process {memory:.0f} MB, {totals}"
        )
    assert memory < 500
