"""What else finds the same in the same log, in one run: libraries, databases, and programs by hand.

`PEER_LINES=1000000 pytest tests/benchmarks/test_peers.py -s -m slow` prints the table; the default is 200,000
lines. Times are processor time without imports and starts. A peer that is not installed is skipped. Each answer
is checked.
"""

import os
import shutil
import subprocess
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

import msgspec
import orjson
import pytest

from rvaft import load
from tests.benchmarks.conftest import Ratios
from tests.benchmarks.logs import SSHD_TREE, TREE, sshd, telemetry
from tests.benchmarks.test_many_trees import written
from tests.benchmarks.test_native import decoding, running
from tests.cli.runs import COMMAND

pytestmark = [pytest.mark.benchmark, pytest.mark.slow]

LINES: Final = int(os.environ.get("PEER_LINES", "200000"))
ROUNDS: Final = 3
WINDOW: Final = 10.0
STEPS_TREE: Final = """event x(user) = { event: "x", user: user };
event y(user) = { event: "y", user: user };
event z(user) = { event: "z", user: user };
time ts as s late 0 s;
semantics scattered;
top sand a b c within 10 s;
a on x(U); b on y(U); c on z(U);
"""
"""Three steps of one user within ten seconds."""


class Known(NamedTuple):
    """The detections of a log: with a monitor for each entity, and where a detection restarts all; None: not asked."""

    apart: int | None = None
    together: int | None = None


class Answer(NamedTuple):
    """The detections that a peer found, if it finds any, and its processor time in seconds, also that of its start."""

    found: int | None
    seconds: float
    start: float = 0.0


class Peer(NamedTuple):
    """How a peer reads a log, what it needs, and the most time as a multiple of `orjson.loads`.

    `expected` is the answer; without one the peer only reads, or finds more, as a query that does not restart.
    """

    run: Callable[[Path], Answer]
    expected: Callable[[Known], int | None] = lambda _: None
    most: float | None = None
    module: str = ""
    program: str = ""


# -- logs -----------------------------------------------------------------------------------------------------------


def steps(file: Path, lines: int) -> None:
    """Write events of 500 users, 100 a second, of four types."""
    random = Random(1)
    with file.open("wb") as out:
        for number in range(lines):
            event = {"event": random.choice("wxyz"), "user": f"user{random.randrange(500)}", "ts": number / 100}
            out.write(orjson.dumps({**event, "host": "h1", "path": "/usr/bin/ls"}) + b"\n")


TYPED: Final = "typed.rvaft"
"""The tree with types, for typed columns in DuckDB."""


def _write_trees(log: Path, text: str, parameter: str) -> None:
    log.with_suffix(".rvaft").write_text(text, encoding="utf-8")
    typed_text = text.replace(f"{parameter}) =", f"{parameter}: text) =") + "assume types, present;\n"
    log.with_name(TYPED).write_text(typed_text, encoding="utf-8")


def _sshd(log: Path) -> Known:
    _write_trees(log, SSHD_TREE, "ip")
    known = sshd(log, LINES).total()
    return Known(known, failures_by_hand(log, all_restart=True))


def _steps(log: Path) -> Known:
    _write_trees(log, STEPS_TREE, "user")
    steps(log, LINES)
    return Known(steps_by_hand(log), steps_by_hand(log, all_restart=True))


def _rules(log: Path) -> Known:
    written(log.parent, LINES // 10)
    return Known(together=rules_by_hand(log))


def _telemetry(log: Path) -> Known:
    shutil.copy(TREE, log.with_suffix(".rvaft"))
    telemetry(log, LINES)
    return Known(together=1)


# -- by hand --------------------------------------------------------------------------------------------------------


def events(log: Path) -> Iterator[Any]:
    with log.open("rb") as lines:
        yield from map(orjson.loads, lines)


def failures_by_hand(log: Path, *, all_restart: bool = False) -> int:
    failures: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=5))
    detections = 0
    for event in events(log):
        kind = event["event"]
        if kind == "failed":
            failures[event["ip"]].append(event["time"])
        elif kind == "accepted":
            recent = failures[event["ip"]]
            if len(recent) == 5 and round(event["time"] * 1000) - round(recent[0] * 1000) <= 60_000:
                detections += 1
                (failures if all_restart else recent).clear()
    return detections


def steps_by_hand(log: Path, *, all_restart: bool = False) -> int:
    first: dict[str, float] = {}
    second: dict[str, float] = {}  # the latest first step before a second one
    detections = 0
    for event in events(log):
        kind, user = event["event"], event["user"]
        if kind == "x":
            first[user] = event["ts"]
        elif kind == "y":
            if user in first:
                second[user] = first[user]
        elif kind == "z" and user in second and round((event["ts"] - second[user]) * 100) <= WINDOW * 100:
            detections += 1
            for started in (first, second):
                if all_restart:
                    started.clear()
                else:
                    started.pop(user, None)
    return detections


@cache
def rules(folder: Path) -> tuple[tuple[str, ...], ...]:
    """The three actions of each rule."""
    trees = [load(file) for file in sorted(folder.glob("rule*.rvaft"))]
    return tuple(tuple(str(tree.nodes[node].on.event) for node in "xyz") for tree in trees)  # type: ignore[union-attr]


def rules_by_hand(log: Path) -> int:
    places: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    for rule, actions in enumerate(rules(log.parent)):
        for place, action in enumerate(actions):
            places[action].append((rule, place))
    started: list[dict[tuple[int, str], float]] = [{} for _ in rules(log.parent)]
    detections = 0
    for event in events(log):
        for rule, place in places.get(event["action"], ()):
            mine, user, now = started[rule], event["user"], event["time"]
            begin = now if place == 0 else mine.get((place - 1, user))
            if begin is not None and place < 2:
                mine[place, user] = begin
            elif begin is not None and now - begin <= 1_800:
                detections += 1
                mine.clear()
    return detections


@cache
def compiled(folder: Path) -> Path:
    """The program in C by hand."""
    source, program = Path(__file__).with_name("sshd_by_hand.c"), folder / "by_hand"
    subprocess.run(["gcc", "-O2", "-o", program, source], check=True)
    return program


def in_c(log: Path) -> Answer:
    program = compiled(log.parent)
    found = int(subprocess.run([program, log], capture_output=True, check=True).stdout)
    return Answer(found, running(program, log))


def here(call: Callable[[Path], int | None]) -> Callable[[Path], Answer]:
    """A peer that is a function of this process."""

    def timed(log: Path) -> Answer:
        begun = time.process_time()
        found = call(log)
        return Answer(found, time.process_time() - begun)

    return timed


# -- libraries and databases ----------------------------------------------------------------------------------------


def decode_all(log: Path) -> None:
    deque(events(log), maxlen=0)


def read_lines(log: Path) -> None:
    with log.open("rb") as lines:
        deque(lines, maxlen=0)


class Record(msgspec.Struct):
    """The fields of a record that some tree reads."""

    event: str = ""
    ip: str = ""
    user: str = ""
    topic: str = ""
    action: str = ""


def typed(log: Path) -> None:
    decode = msgspec.json.Decoder(Record).decode
    with log.open("rb") as lines:
        deque(map(decode, lines), maxlen=0)


def searched(word: str) -> Callable[[Path], Answer]:
    return lambda log: Answer(None, running("rg", "-c", word, log))


def in_duckdb(columns: str, *queries: str) -> Callable[[Path], int]:
    """The sum of what the queries count, loading included."""

    def call(log: Path) -> int:
        import duckdb

        connection = duckdb.connect(config={"threads": "1"})
        loaded = f"CREATE TABLE log AS SELECT * FROM read_json(?, format='newline_delimited', columns={{{columns}}})"
        connection.execute(loaded, [str(log)])
        return sum(int(connection.execute(query).fetchall()[0][0]) for query in queries)

    return call


FAILURES_SQL: Final = """
WITH failed AS (SELECT ip, time, lag(time, 4) OVER (PARTITION BY ip ORDER BY time) AS first FROM log
                WHERE event = 'failed')
SELECT count(*) FROM (SELECT ip, time FROM log WHERE event = 'accepted') AS accepted
ASOF JOIN failed ON accepted.ip = failed.ip AND accepted.time >= failed.time WHERE accepted.time - failed.first <= 60
"""
STEPS_SQL: Final = """
WITH x AS (SELECT user, ts FROM log WHERE event = 'x'), y AS (SELECT user, ts FROM log WHERE event = 'y'),
     z AS (SELECT user, ts FROM log WHERE event = 'z'),
     xy AS (SELECT y.user, y.ts, x.ts AS begin FROM y ASOF JOIN x ON x.user = y.user AND y.ts > x.ts)
SELECT count(*) FROM z ASOF JOIN xy ON z.user = xy.user AND z.ts > xy.ts WHERE z.ts - xy.begin <= 10
"""


def rules_in_duckdb(log: Path) -> int:
    steps = "SELECT user, time FROM log WHERE action = "
    queries = [
        f"WITH x AS ({steps}'{x}'), y AS ({steps}'{y}'), z AS ({steps}'{z}'), "
        "xy AS (SELECT y.user, y.time, x.time AS begin FROM y ASOF JOIN x ON x.user = y.user AND y.time > x.time) "
        "SELECT count(*) FROM z ASOF JOIN xy ON z.user = xy.user AND z.time > xy.time WHERE z.time - xy.begin <= 1800"
        for x, y, z in rules(log.parent)
    ]
    return in_duckdb("time: 'DOUBLE', action: 'VARCHAR', user: 'VARCHAR'", *queries)(log)


def failures_in_polars(log: Path) -> int:
    polars: Any = import_module("polars")
    read = polars.scan_ndjson(log, schema={"time": polars.Float64, "event": polars.String, "ip": polars.String})
    failed = read.filter(polars.col("event") == "failed").with_columns(
        first=polars.col("time").shift(4).over("ip"), last=polars.col("time")
    )
    accepted = read.filter(polars.col("event") == "accepted")
    both = accepted.join_asof(failed, on="time", by="ip", check_sortedness=False)
    return int(both.filter(polars.col("time") - polars.col("first") <= 60).collect().height)


def topics_in_polars(log: Path) -> None:
    polars: Any = import_module("polars")
    read = polars.scan_ndjson(log, schema={"topic": polars.String, "time": polars.Float64})
    read.group_by("topic").len().collect()


def in_eql(log: Path) -> int:
    eql: Any = import_module("eql")
    text = "sequence by user with maxspan=10s " + " ".join(f"[any where event == '{name}']" for name in "xyz")
    found: list[object] = []
    engine = eql.PythonEngine({"time_unit": 1_000})
    engine.add_output_hook(found.append)
    engine.add_queries([eql.parse_query(text, implied_any=True)])
    engine.stream_events(eql.Event("any", round(event["ts"] * 1_000), event) for event in events(log))
    return len(found)


# -- rvaft ----------------------------------------------------------------------------------------------------------


def monitored(*options: str, tree: str = "log.rvaft") -> Callable[[Path], Answer]:
    """`rvaft monitor` as a process, without its start: the time for an empty log."""

    def call(log: Path) -> Answer:
        empty = log.with_name("empty.jsonl")
        empty.touch()
        words = [*COMMAND, "monitor", str(log.parent / tree), *options, "--repeat"]
        done = subprocess.run([*words, str(log)], capture_output=True, text=True, check=False)
        assert done.returncode == 1, done.stderr
        counts = [line.split()[-1] for line in done.stdout.splitlines() if line.startswith("detections: ")]
        found = sum(map(int, counts)) if counts else done.stdout.count(": true")
        return Answer(found, running(*words, log), running(*words, empty))

    return call


def apart(known: Known) -> int | None:
    return known.apart


def together(known: Known) -> int | None:
    return known.together


READING: Final[Mapping[str, Peer]] = {
    "reading lines": Peer(here(read_lines), most=0.5),
    "orjson.loads": Peer(here(decode_all)),
    "msgspec, typed": Peer(here(typed)),
}
SSHD_COLUMNS: Final = "time: 'DOUBLE', event: 'VARCHAR', ip: 'VARCHAR'"
STEPS_COLUMNS: Final = "ts: 'DOUBLE', event: 'VARCHAR', user: 'VARCHAR'"
WORKLOADS: Final[Mapping[str, tuple[Callable[[Path], Known], Mapping[str, Peer]]]] = {
    "sshd": (
        _sshd,
        {
            **READING,
            "ripgrep": Peer(searched("failed"), program="rg"),
            "C by hand": Peer(in_c, apart, program="gcc"),
            "Python by hand": Peer(here(failures_by_hand), apart),
            "DuckDB by hand": Peer(here(in_duckdb(SSHD_COLUMNS, FAILURES_SQL)), module="duckdb"),
            "Polars by hand": Peer(here(failures_in_polars), module="polars"),
            "engine": Peer(monitored(), together, most=12),
            "engine, --key": Peer(monitored("--key", "ip"), apart, most=25),
            "--native": Peer(monitored("--native"), together, most=1.2, program="gcc"),
            "--native --key": Peer(monitored("--native", "--key", "ip"), apart, most=6, program="gcc"),
            "--engine duckdb": Peer(monitored("--engine", "duckdb", tree=TYPED), together, most=50, module="duckdb"),
            "--engine duckdb --key": Peer(
                monitored("--engine", "duckdb", "--key", "ip", tree=TYPED), apart, most=80, module="duckdb"
            ),
        },
    ),
    "three steps": (
        _steps,
        {
            **READING,
            "Python by hand": Peer(here(steps_by_hand), apart),
            "DuckDB by hand": Peer(here(in_duckdb(STEPS_COLUMNS, STEPS_SQL)), module="duckdb"),
            "eql": Peer(here(in_eql), module="eql"),
            "engine": Peer(monitored(), together, most=15),
            "engine, --key": Peer(monitored("--key", "user"), apart, most=34),
            "--native": Peer(monitored("--native"), together, most=2.6, program="gcc"),
            "--native --key": Peer(monitored("--native", "--key", "user"), apart, most=18, program="gcc"),
            "--engine duckdb": Peer(monitored("--engine", "duckdb", tree=TYPED), together, most=20, module="duckdb"),
            "--engine duckdb --key": Peer(
                monitored("--engine", "duckdb", "--key", "user", tree=TYPED), apart, most=32, module="duckdb"
            ),
        },
    ),
    "100 rules": (
        _rules,
        {
            **READING,
            "Python by hand": Peer(here(rules_by_hand), together),
            "DuckDB by hand": Peer(here(rules_in_duckdb), module="duckdb"),
            "engine": Peer(monitored(tree="."), together, most=55),
        },
    ),
    "telemetry": (
        _telemetry,
        {
            **READING,
            "ripgrep": Peer(searched("radiation"), program="rg"),
            "DuckDB, grouped": Peer(
                here(in_duckdb("topic: 'VARCHAR', time: 'DOUBLE'", "SELECT count(DISTINCT topic) FROM log")),
                module="duckdb",
            ),
            "Polars, grouped": Peer(here(topics_in_polars), module="polars"),
            "engine": Peer(monitored("--semantics", "scattered"), together, most=1.4),
            "--native": Peer(monitored("--semantics", "scattered", "--native"), together, most=0.7, program="gcc"),
        },
    ),
}
"""The workloads, each with its log and its peers."""
CASES: Final = [(workload, name) for workload, (_, peers) in WORKLOADS.items() for name in peers]


@pytest.fixture(scope="module")
def log_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Known]]:
    """The log of a workload, in a folder with its tree, and the detections in it."""

    @cache
    def made(workload: str) -> tuple[Path, Known]:
        log = tmp_path_factory.mktemp("peers") / "log.jsonl"
        return log, WORKLOADS[workload][0](log)

    return made


@pytest.mark.parametrize("case", CASES, ids=": ".join)
def test_peers(
    case: tuple[str, str],
    log_of: Callable[[str], tuple[Path, Known]],
    ratios: Ratios,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    workload, name = case
    peer = WORKLOADS[workload][1][name]
    if peer.module:
        pytest.importorskip(peer.module)
    if peer.program and shutil.which(peer.program) is None:
        pytest.skip(f"{peer.program} is not installed")
    log, known = log_of(workload)
    monkeypatch.setenv("XDG_CACHE_HOME", str(log.parent / "cache"))
    rounds = [(peer.run(log), decoding(log)) for _ in range(ROUNDS)]
    seconds = min(answer.seconds for answer, _ in rounds) - min(answer.start for answer, _ in rounds)
    unit = min(decoded for _, decoded in rounds)
    found = rounds[0][0].found
    with capsys.disabled():
        row = f"{workload:12} {name:22} {seconds:8.3f} s {seconds / unit:8.2f}"
        print(f"\n{row} {'' if found is None else found:>6}", end="")
    ratios.add(f"{workload}: {name}", "orjson.loads", seconds / unit, peer.most)
    expected = peer.expected(known)
    assert expected is None or found == expected
    assert peer.most is None or seconds / unit < peer.most
