"""What trees, translations, comparisons and starts cost: seconds, memory, sizes, and how they grow.

`pytest tests/benchmarks/test_speed.py -s` prints the tables. What is asserted are ratios within one run.
"""

import contextlib
import io
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rvaft import Gate, Semantics, dumps, loads
from rvaft.backend import backend
from rvaft.cli import main
from rvaft.core.branches import branch, branches
from rvaft.engine import Engine
from tests.benchmarks.conftest import Ratios
from tests.benchmarks.logs import TREE
from tests.benchmarks.trees import chain, flat, text_of_size

pytestmark = pytest.mark.benchmark

SIZES = (10, 100, 1_000, 10_000)
GATES = (Gate.AND, Gate.OR, Gate.VOT, Gate.SAND)
SEMANTICS = ("scattered", "projected")
NOISE = [{"event": "something else", "time": number} for number in range(1_000)]


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def shortest(call: Callable[[], object], rounds: int) -> float:
    return min(seconds(call) for _ in range(rounds))


# -- events ---------------------------------------------------------------------------------------------------------


@cache
def measured(gate: Gate, size: int, semantics: str) -> tuple[float, float, float]:
    """Seconds per event that fits nothing, per event that fits, and for a whole trace that ends with detection."""
    count = {Gate.OR: 1, Gate.VOT: size // 2}.get(gate, size)
    trace = [{"event": f"e{number}", "time": number} for number in range(count)]

    def fresh() -> Engine:
        return Engine(flat(gate, size, size // 2 if gate is Gate.VOT else None), semantics)

    def total() -> float:
        monitor = fresh()
        taken = seconds(lambda: [monitor.step(event) for event in trace])
        assert monitor.verdict.value == "true"
        return taken

    monitor, whole = fresh(), min(total() for _ in range(2 if size == SIZES[-1] else 5))
    idle = shortest(lambda: [monitor.step(event) for event in NOISE], 7) / len(NOISE)
    return idle, whole / count, whole


def test_table_of_events(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{'':14} {'leaves':>7} {'µs/other event':>15} {'µs/event taken':>15} {'s to detection':>15}"]
    for semantics in SEMANTICS:
        for gate in GATES:
            for size in SIZES:
                miss, hit, whole = measured(gate, size, semantics)
                rows.append(f"{gate:4} {semantics:9} {size:7} {miss * 1e6:15.2f} {hit * 1e6:15.2f} {whole:15.4f}")
    with capsys.disabled():
        print("", *rows, sep="\n")


@pytest.mark.parametrize("gate", GATES)
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_an_event_that_fits_nothing_costs_the_same_in_every_tree_and_total_work_is_linear(
    gate: Gate, semantics: str
) -> None:
    """A hundred times the events in a hundred times the tree: about a hundred times the work, where
    quadratic is ten thousand.
    """
    assert measured(gate, 10_000, semantics)[0] < 2 * measured(gate, 10, semantics)[0]
    assert gate is Gate.OR or measured(gate, 10_000, semantics)[2] < 400 * measured(gate, 100, semantics)[2]


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_total_work_from_file_to_verdict_is_linear(semantics: str, tmp_path: Path) -> None:
    """`rvaft monitor` for an AND of so many leaves, each of which has one event, without reading the tree."""

    def end_to_end(size: int) -> float:
        tree, log, empty = tmp_path / f"{size}.rvaft", tmp_path / f"{size}.jsonl", tmp_path / "empty.jsonl"
        tree.write_text(dumps(flat(Gate.AND, size, None)), encoding="utf-8")
        log.write_text("".join(json.dumps({"event": f"e{number}"}) + "\n" for number in range(size)), encoding="utf-8")
        empty.touch()

        def monitor(trace: Path) -> None:
            with contextlib.redirect_stdout(io.StringIO()):
                main(["monitor", str(tree), str(trace), "--semantics", semantics], standalone_mode=False)

        return shortest(lambda: monitor(log), 3) - shortest(lambda: monitor(empty), 3)

    assert end_to_end(10_000) < 40 * end_to_end(1_000)


# -- trees and translations -----------------------------------------------------------------------------------------


def test_a_chain_of_choices_takes_quadratic_time(capsys: pytest.CaptureFixture[str]) -> None:
    def taken(gates: int) -> float:
        tree = chain(gates)
        return shortest(lambda: deque(branches(tree), maxlen=0), 3)

    short, long, tree = taken(100), taken(300), chain(300)
    assert sum(1 for _ in branches(tree)) == 301
    alone = seconds(lambda: branch(tree, 300))
    with capsys.disabled():
        print(f"\n300 gates: {long:.2f} s for all branches, {alone:.2f} s for one")
    assert long / short < 18  # 9 is quadratic, 27 cubic


def test_and_12_to_hoa(benchmark: BenchmarkFixture) -> None:
    """Aim: under 3 s."""
    spec = benchmark.pedantic(backend("automaton").translate, (flat(Gate.AND, 12), Semantics.STRICT), rounds=3)
    benchmark.extra_info.update(states=spec.metrics.states, bytes=len(spec.text))
    assert spec.metrics.states == 2**12 + 2


def test_loading_ten_thousand_nodes(benchmark: BenchmarkFixture) -> None:
    tree = benchmark.pedantic(loads, (text_of_size(10_000),), rounds=3)
    assert len(tree.nodes) >= 9_999


# -- processes ------------------------------------------------------------------------------------------------------

PEAK = """import resource, sys
from rvaft.cli import main
main(standalone_mode=False)
print('peak', max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))
"""


@pytest.mark.parametrize(
    ("arguments", "aim"),
    [
        ("", 10),
        # Trees of up to 8 occurrences, 20 traces each, all participants that need no tool, all semantics.
        ("--random 100 --max-nodes 9 --traces 20 --seed 1", 18),
        ("--random 1000 --max-nodes 9 --traces 20 --seed 1", 180),
    ],
)
def test_cross_check(arguments: str, aim: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Seconds, and the largest memory of a process."""
    command = [sys.executable, "-c", PEAK, "cross-check", *arguments.split(), "--json", "/dev/stderr"]
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    taken = time.perf_counter() - start
    peak = re.search(r"peak (\d+)", done.stdout)
    assert peak is not None
    totals = json.loads(done.stderr)["totals"]
    memory = int(peak[1]) / 1024
    with capsys.disabled():
        print(f"\n{arguments or 'no argument'}: {taken:.1f} s (aim {aim} s), largest process {memory:.0f} MB, {totals}")
    assert totals["disagreements"] == 0
    assert memory < 500


@pytest.mark.parametrize(
    ("arguments", "aim"),
    [("--help", 0.2), (f"check {TREE}", 0.6), (f"monitor {TREE}", 0.6)],
    ids=lambda one: str(one)[:7],
)
def test_cold_start(arguments: str, aim: float, capsys: pytest.CaptureFixture[str]) -> None:
    """The median of eleven fresh processes, against that of an empty Python in the same run."""

    def median(*words: str) -> float:
        def process() -> None:
            subprocess.run([sys.executable, *words], input="", capture_output=True, text=True, check=True)

        return statistics.median(seconds(process) for _ in range(11))

    bare, ours = median("-c", "pass"), median("-c", "from rvaft.cli import main; main()", *arguments.split())
    with capsys.disabled():
        print(f"\nrvaft {arguments[:7]}: {ours:.3f} s (aim {aim} s), {ours / bare:.1f} x an empty Python")
    assert ours / bare < 60


STARTS = {
    "--version": (1.6, ["--version"]),
    "check": (2.8, ["check", str(TREE)]),
    "emit to Sigma": (3.2, ["emit", str(TREE), "--to", "sigma", "--semantics", "scattered"]),
    "emit to LTLf": (3.2, ["emit", str(TREE), "--to", "ltlf"]),
    "monitor": (3.5, ["monitor", str(TREE), str(TREE.with_suffix(".traces") / "table2_row3.jsonl")]),
}
"""Commands, each with the most processor time as a multiple of what their libraries take."""


@pytest.mark.parametrize("title", STARTS)
def test_the_start_costs_little_more_than_its_libraries(title: str, ratios: Ratios, tmp_path: Path) -> None:
    """The least processor time of eleven processes in turn, with byte code, against `import click, lark`."""
    most, arguments = STARTS[title]
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(tmp_path)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)

    def processor(*words: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *words], capture_output=True, env=environment, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    calls = [("-c", "import click, lark"), ("-m", "rvaft", *arguments)]
    found = [[processor(*words) for words in calls] for _ in range(12)][1:]  # the first round writes byte code
    libraries, ours = (min(times) for times in zip(*found, strict=True))
    ratios.add(f"start: rvaft {title}", "import click, lark", ours / libraries, most)
    assert ours / libraries < most


STARTED = """import sys
from rvaft.cli import main
status = main(sys.argv[1:], standalone_mode=False)
print("imported", *sorted({"duckdb", "networkx", "pyarrow", "rich", "sympy"} & set(sys.modules)))
"""


def test_the_start_of_monitor(capsys: pytest.CaptureFixture[str]) -> None:
    """Processor time of the command on five events, against a Python that imports `argparse` and `json`."""
    log = TREE.with_suffix(".traces") / "table2_row3.jsonl"

    def processor(*words: str) -> float:
        def process() -> float:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            assert not done.stdout or done.stdout.splitlines()[-1] == "imported"
            return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

        return statistics.median(process() for _ in range(11))

    bare, ours = processor("-c", "import argparse, json"), processor("-c", STARTED, "monitor", str(TREE), str(log))
    with capsys.disabled():
        print(f"\nrvaft monitor: {ours:.3f} s of processor time (aim 0.35 s), {ours / bare:.1f} x a small Python")
    assert ours / bare < 17


# -- SQL ------------------------------------------------------------------------------------------------------------

JOINED = """
event x(u: text) = { event: "x", u: u }; event y(u: text) = { event: "y", u: u };
event z(u: text) = { event: "z", u: u };
assume types, present; time t as s;
top sand a b c within 1 s; a on x(U); b on y(U); c on z(U);
"""
BY_HAND = """
SELECT x.t, y.t, z.t, x.u FROM log x JOIN log y ON x.u = y.u AND y.t > x.t AND y.t <= x.t + 1
JOIN log z ON z.u = y.u AND z.t > y.t AND z.t <= x.t + 1 AND z.t <= y.t + 1
WHERE x.event = 'x' AND y.event = 'y' AND z.event = 'z'
"""


def test_a_query_on_typed_columns_costs_what_a_query_by_hand_costs(ratios: Ratios) -> None:
    """300,000 events of 500 users; ten within a second. At most 1.5 times, in the median of pairs of runs."""
    duckdb = pytest.importorskip("duckdb", reason="DuckDB is not installed")
    log = duckdb.connect(config={"threads": "1"})
    log.execute("SELECT setseed(0.5)")
    kind, user = "['x', 'y', 'z'][1 + (hash(i) % 3)::INT]", "'u' || hash(i + 1000000) % 500"
    log.execute(
        f"CREATE TABLE log AS SELECT {kind} AS event, {user} AS u, i / 10.0::DOUBLE AS t FROM range(300000) r(i)"
    )
    columns = {"table": "log", "time": "t:double"}
    query = backend("sql-duckdb").mapped(columns).translate(loads(JOINED), Semantics.SCATTERED).text
    assert {row[0] for row in log.execute(query).fetchall()}
    found = []
    for _ in range(7):
        hand, ours = (shortest(lambda text=text: log.execute(text).fetchall(), 1) for text in (BY_HAND, query))  # type: ignore[misc]
        found.append(ours / hand)
    ratios.add("a join of three within 1 s, query on typed columns", "DuckDB by hand", statistics.median(found), 1.5)
    assert statistics.median(found) < 1.5


LOADED = "CREATE TABLE log AS SELECT * FROM read_json(?, columns = {event: 'VARCHAR', u: 'VARCHAR', t: 'DOUBLE'})"


def test_a_whole_log_in_duckdb_costs_what_loading_and_a_query_by_hand_cost(tmp_path: Path, ratios: Ratios) -> None:
    """The same log as JSON Lines, by `rvaft monitor --engine duckdb --repeat`: at most 3 times, of processor time."""
    duckdb = pytest.importorskip("duckdb", reason="DuckDB is not installed")
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(JOINED, encoding="utf-8")
    kind, user = "['x', 'y', 'z'][1 + (hash(i) % 3)::INT]", "'u' || hash(i + 1000000) % 500"
    made = f"SELECT {kind} AS event, {user} AS u, i / 10.0::DOUBLE AS t FROM range(300000) r(i)"
    duckdb.connect(config={"threads": "1"}).execute(f"COPY ({made}) TO '{log}' (FORMAT JSON)")
    printed = ""

    def hand() -> None:
        connection = duckdb.connect()
        connection.execute(LOADED, [str(log)])
        assert connection.execute(BY_HAND).fetchall()

    def ours() -> None:
        nonlocal printed
        with contextlib.redirect_stdout(io.StringIO()) as output:
            arguments = ["monitor", str(tree), str(log), "--semantics", "scattered", "--engine", "duckdb", "--repeat"]
            assert main(arguments, standalone_mode=False) == 1
        printed = output.getvalue()

    found = []
    for number in range(6):
        times = []
        for call in (hand, ours):
            start = time.process_time()
            call()
            times.append(time.process_time() - start)
        found += [times[1] / times[0]] if number else []
    assert "300000 events" in printed
    ratios.add("the same, rvaft monitor --engine duckdb", "loading, DuckDB by hand", statistics.median(found), 3)
    assert statistics.median(found) < 3
