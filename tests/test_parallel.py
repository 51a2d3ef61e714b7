"""Work in several processes: results in order, whatever happens to a process."""

import os
import signal
import time
from contextlib import closing

import pytest

from rvaft.support.processes import Killed, in_processes


def test_results_come_in_the_order_of_the_things() -> None:
    def work(number: int) -> tuple[int, int]:
        time.sleep(0.05 if number % 3 == 0 else 0)
        return number * number, os.getpid()

    found = list(in_processes(work, range(20), jobs=3))
    assert [item for item, _ in found] == list(range(20))
    assert all(isinstance(result, tuple) and result[0] == item * item for item, result in found)
    assert 1 < len({result[1] for _, result in found if isinstance(result, tuple)}) <= 3


def test_a_process_that_is_killed_leaves_things_without_a_result() -> None:
    def work(number: int) -> int:
        if number == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.2)
        return number

    found = list(in_processes(work, range(4), jobs=2))
    assert [item for item, _ in found] == [0, 1, 2, 3]
    assert isinstance(found[0][1], Killed)


def test_what_the_work_raises_is_raised_here() -> None:
    def work(number: int) -> int:
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        list(in_processes(work, range(2), jobs=2))


def test_stopping_early_ends_the_processes() -> None:
    def work(number: int) -> int:
        time.sleep(0 if number == 0 else 60)
        return os.getpid()

    start = time.monotonic()
    with closing(in_processes(work, range(8), jobs=2)) as running:
        assert next(running)[0] == 0
    assert time.monotonic() - start < 20
