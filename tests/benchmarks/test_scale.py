"""Seconds per event for trees of 10 to 10,000 leaves: what a tree costs where nothing happens in it, and where something does.

`pytest tests/benchmarks/test_scale.py -s` prints the table.
"""

import contextlib
import io
import json
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from rvaft import dumps
from rvaft.cli import main
from rvaft.engine import Engine
from rvaft.model.nodes import Gate
from tests.benchmarks.trees import flat

SIZES = (10, 100, 1_000, 10_000)
GATES = (Gate.AND, Gate.OR, Gate.VOT, Gate.SAND)
SEMANTICS = ("scattered", "projected")
NOISE = [{"event": "something else", "time": number} for number in range(1_000)]


def best(measured: Callable[[], float], rounds: int) -> float:
    return min(measured() for _ in range(rounds))


def fresh(gate: Gate, size: int, semantics: str) -> Engine:
    return Engine(flat(gate, size, size // 2 if gate is Gate.VOT else None), semantics)


def idle(monitor: Engine) -> float:
    """Seconds per event that fits nothing."""
    start = time.perf_counter()
    for event in NOISE:
        monitor.step(event)
    return (time.perf_counter() - start) / len(NOISE)


@cache
def measured(gate: Gate, size: int, semantics: str) -> tuple[float, float, float]:
    """Seconds per event that fits nothing, per event that fits, and for a whole trace that ends with detection."""
    count = {Gate.OR: 1, Gate.VOT: size // 2}.get(gate, size)
    trace = [{"event": f"e{number}", "time": number} for number in range(count)]
    monitor = fresh(gate, size, semantics)

    def total() -> float:
        monitor = fresh(gate, size, semantics)
        start = time.perf_counter()
        for event in trace:
            monitor.step(event)
        taken = time.perf_counter() - start
        assert monitor.verdict.value == "true"
        return taken

    whole = best(total, 2 if size == SIZES[-1] else 5)
    return best(lambda: idle(monitor), 7), whole / count, whole


@pytest.mark.benchmark
def test_table(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{'':14} {'leaves':>7} {'µs/other event':>15} {'µs/event taken':>15} {'s to detection':>15}"]
    for semantics in SEMANTICS:
        for gate in GATES:
            for size in SIZES:
                miss, hit, whole = measured(gate, size, semantics)
                rows.append(f"{gate:4} {semantics:9} {size:7} {miss * 1e6:15.2f} {hit * 1e6:15.2f} {whole:15.4f}")
    with capsys.disabled():
        print("", *rows, sep="\n")


@pytest.mark.benchmark
@pytest.mark.parametrize("gate", GATES)
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_an_event_that_fits_nothing_costs_the_same_in_every_tree(gate: Gate, semantics: str) -> None:
    assert measured(gate, 10_000, semantics)[0] < 2 * measured(gate, 10, semantics)[0]


@pytest.mark.benchmark
@pytest.mark.parametrize("gate", [Gate.AND, Gate.VOT, Gate.SAND])
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_total_work_is_linear(gate: Gate, semantics: str) -> None:
    """A hundred times the events in a hundred times the tree: about a hundred times the work, where quadratic is ten thousand."""
    assert measured(gate, 10_000, semantics)[2] < 400 * measured(gate, 100, semantics)[2]


def end_to_end(folder: Path, size: int, semantics: str) -> float:
    """Seconds of `rvaft monitor` for an AND of so many leaves, each of which has one event, without reading the tree."""
    tree, log = folder / f"{size}.rvaft", folder / f"{size}.jsonl"
    tree.write_text(dumps(flat(Gate.AND, size, None)), encoding="utf-8")
    log.write_text("".join(json.dumps({"event": f"e{number}"}) + "\n" for number in range(size)), encoding="utf-8")
    (empty := folder / "empty.jsonl").touch()

    def seconds(trace: Path) -> float:
        start = time.perf_counter()
        with contextlib.redirect_stdout(io.StringIO()):
            main(["monitor", str(tree), str(trace), "--semantics", semantics], standalone_mode=False)
        return time.perf_counter() - start

    return best(lambda: seconds(log), 3) - best(lambda: seconds(empty), 3)


@pytest.mark.benchmark
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_total_work_from_file_to_verdict_is_linear(semantics: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("scale")
    assert end_to_end(folder, 10_000, semantics) < 40 * end_to_end(folder, 1_000, semantics)
