"""Fleets on Spark: the detections of `rvaft monitor --key`, from tables and from streams that are killed and go on."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rvaft import OptionError, load, loads
from tests.cli.runs import run

pytest.importorskip("pyspark", reason="PySpark is not installed")
pytest.importorskip("pyarrow", reason="pyarrow is not installed")
pytestmark = [
    pytest.mark.skipif(shutil.which("java") is None, reason="Java is not installed"),
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.xdist_group("spark"),
]

TREE = """
semantics scattered;
time t as ms;
event fail(n) = { event: "fail", n: n };
event sudo(n) = { event: "sudo", n: n };
toplevel taken;
taken sand guessed root within 10 min;
guessed on fail(N) times 3;
root on sudo(N) when N > 0;
"""
KEYS = [1, 1.0, "1", True, {"b": 1, "a": 2.0}, {"a": 2, "b": 1}, None, *range(2, 14)]
QUICK = "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC"
"""Of so short a run the machine code that Java makes for long ones, and its threads that collect,
cost more than they spare.
"""
RUN = "import sys; from tests.integrations import test_spark as t; t.query(t.session_of(), *sys.argv[1:3])"


def log(events: int, keys: list[Any], seed: int) -> list[str]:
    """Lines of a log, in the order of their times, a few without the key and one that is no JSON."""
    dice = random.Random(seed)
    lines = []
    for number in range(events):
        event = {"t": 10 * number, "event": dice.choice(["fail", "fail", "sudo", "x"]), "n": dice.randrange(4)}
        if number % 97:
            event["user"] = dice.choice(keys)
        lines.append(json.dumps(event))
    return [*lines, "not json"]


def whole(value: Any) -> Any:
    """A key as Spark tells it: 1.0 is 1."""
    if isinstance(value, dict):
        return {name: whole(part) for name, part in value.items()}
    return int(value) if isinstance(value, float) else value


def told(path: Path, tree: Path, *options: str) -> Counter[tuple[Any, ...]]:
    """What `rvaft monitor` detects: how often which key at which time by events of which times."""
    found = run("monitor", tree, path, "--key", "user", "--format", "jsonl", "--detections", *options)
    times = [json.loads(line).get("t") if line[:1] == "{" else None for line in path.read_text().splitlines()]
    rows = map(json.loads, found.stdout.splitlines())
    return Counter(
        (json.dumps(whole(row["key"]), sort_keys=True), times[row["event"] - 1], row.get("detection"), row["branch"])
        for row in rows
        if row["verdict"] == "true"
    )


def of_rows(rows: list[Any]) -> Counter[tuple[Any, ...]]:
    """The same of rows that Spark gives."""
    return Counter((row.key, int(row.time), row.detection, row.branch) for row in rows if row.warning is None)


def session_of() -> Any:
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = sys.executable
    os.environ["JAVA_TOOL_OPTIONS"] = QUICK
    made = SparkSession.builder.master("local[2]").config("spark.ui.enabled", "false")
    return made.config("spark.sql.shuffle.partitions", "2").getOrCreate()


def query(spark: Any, tree: str, folder: str, name: str = "taken") -> None:
    """A streaming query over the files of a folder, one for each batch."""
    from rvaft.integrations import spark as fleets

    events = spark.readStream.option("maxFilesPerTrigger", "1").text(f"{folder}/in")
    found = fleets.monitor(events, load(tree), key="user", repeat=True, name=name)
    writer = found.writeStream.format("parquet").option("path", f"{folder}/out")
    writer = writer.option("checkpointLocation", f"{folder}/state").trigger(availableNow=True)
    writer.start().awaitTermination()


@pytest.fixture(scope="module")
def session() -> Iterator[Any]:
    spark = session_of()
    spark.sparkContext.setLogLevel("OFF")
    yield spark
    spark.stop()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    path = tmp_path / "taken.rvaft"
    path.write_text(TREE)
    return path


@pytest.mark.ci
@pytest.mark.parametrize("options", [{}, {"repeat": True}, {"repeat": True, "cooldown": "3 s"}, {"per": "branch"}])
def test_a_table_has_the_detections_of_the_command(
    session: Any, tree: Path, tmp_path: Path, options: dict[str, Any]
) -> None:
    from rvaft.integrations import spark as fleets

    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(log(2_000, KEYS, 1)))
    asked = [word for name, value in options.items() for word in ([f"--{name}"] + [value] * (value is not True))]
    expected = told(path, tree, *asked)
    rows = fleets.monitor(session.read.text(str(path)), loads(TREE), key="user", **options).collect()
    assert of_rows(rows) == expected
    assert sum(expected.values()) >= 15
    warnings = [row.warning for row in rows if row.warning is not None]
    assert "21 events without the field user, not monitored" in warnings
    assert any(line.startswith("1 event rejected (first: not JSON") for line in warnings)


@pytest.mark.ci
def test_a_key_that_falls_silent_is_found_by_the_times_of_the_table(session: Any, tmp_path: Path) -> None:
    """The keys that `rvaft monitor --key` detects, if none repeats; without an end, the last to send is not one."""
    from rvaft.integrations import spark as fleets

    text = "semantics scattered; time t as s; event e(x) = { e: x }; lost on e(X) without e(X) for 5 s after;"
    sent = {"silent": range(10), "lasting": range(0, 100, 2), "new": [98]}
    events = [{"t": time, "e": 1, "user": user} for time in range(100) for user in sent if time in sent[user]]
    (tree := tmp_path / "lost.rvaft").write_text(text)
    (path := tmp_path / "log.jsonl").write_text("".join(f"{json.dumps(one)}\n" for one in events))
    for complete in (False, True):
        words = ["--complete"] if complete else []
        found = run("monitor", tree, path, "--key", "user", "--format", "jsonl", "--detections", *words).stdout
        expected = {json.dumps(json.loads(line)["key"]) for line in found.splitlines()}
        rows = fleets.monitor(session.read.text(str(path)), loads(text), key="user", complete=complete).collect()
        assert {row.key for row in rows if row.record is not None} == expected
        assert expected == {json.dumps(user) for user in (sent if complete else ["silent"])}
    with pytest.raises(OptionError, match="omit order_by"):
        fleets.monitor(session.read.text(str(path)), loads(text), key="user", order_by="t")
    with pytest.raises(OptionError, match="a stream of Spark has no time of all keys"):
        fleets.monitor(session.readStream.text(str(tmp_path)), loads(text), key="user")


@pytest.mark.ci
def test_rows_are_events_and_a_number_is_their_order(session: Any) -> None:
    from rvaft.integrations import spark as fleets

    tree = loads("top sand a b;")
    rows = [("x", 2, "b"), ("x", 1, "a"), ("y", 1, "b"), ("y", 2, "a"), (None, 3, "a")]
    table = session.createDataFrame(rows, "host string, n int, event string")
    detected, lacking = fleets.monitor(table, tree, key=["host"], order_by="n").orderBy("warning").collect()
    assert (detected.key, detected.event, detected.time, detected.detection) == ('"x"', 2, None, None)
    assert json.loads(detected.record)["matched"] == [
        {"node": "a", "occurrence": 1, "event": 1},
        {"node": "b", "occurrence": 1, "event": 2},
    ]
    assert lacking.warning == "1 event without the field host, not monitored"


def test_what_is_not_counted_is_told(session: Any) -> None:
    from rvaft.integrations import spark as fleets

    tree = loads('event e(x) = { e: "e", x: x }; top and a b; a on e(X); b on e(Y) when Y > X + 1;')
    lines = [
        json.dumps({"k": key, "n": number, "e": "e", "x": x})
        for number, (key, x) in enumerate(zip("ppqq", (1, "s", 1, 9), strict=True))
    ]
    table = session.createDataFrame([(line,) for line in lines], "log string")
    rows = fleets.monitor(table, tree, key="k", order_by="n", column="log", semantics="scattered").collect()
    assert {row.key for row in rows if row.warning is None} == {'"q"'}
    assert [row.key for row in rows if row.warning and "Y > X + 1" in row.warning] == ['"p"']


def test_a_monitor_that_grows_too_large_is_told_and_stops_no_other(session: Any) -> None:
    from rvaft.integrations import spark as fleets

    tree = loads(
        'event e(x) = { e: "e", x: x }; top and a b c; a on e(X); b on e(Y) when Y != X; c on e(Z) when Z '
        "* Y == 0 and X * Z > 90;"
    )
    lines = [
        json.dumps({"k": key, "n": number, "e": "e", "x": number})
        for number in range(1, 40)
        for key in "pq"
        if key == "p" or number < 3
    ]
    table = session.createDataFrame([(line,) for line in lines], "log string")
    rows = fleets.monitor(table, tree, key="k", order_by="n", column="log", semantics="scattered", limit=20).collect()
    ended = {row.key: row.warning for row in rows}
    assert ended['"p"'].startswith("not monitored from event ")
    assert "not monitored" not in ended.get('"q"', "")


def test_a_table_without_order_is_refused(session: Any) -> None:
    from rvaft.integrations import spark as fleets

    table = session.createDataFrame([("x",)], "host string")
    with pytest.raises(OptionError, match="a table has no order"):
        fleets.monitor(table, loads("top and a b;"), key="host")


def killed_and_resumed(session: Any, tree: Path, folder: Path, lines: list[str], batches: int) -> list[Any]:
    """The rows of a stream whose query is killed after its first batch, and started again."""
    (folder / "in").mkdir()
    size = -(-len(lines) // batches)
    for number in range(batches):
        path = folder / "in" / f"{number:03}.jsonl"
        path.write_text("\n".join(lines[number * size : (number + 1) * size]))
        os.utime(path, (number, number))
    words = [sys.executable, "-c", RUN, str(tree), str(folder)]
    with (folder / "errors").open("wb") as errors:
        running = subprocess.Popen(words, start_new_session=True, stdout=errors, stderr=errors)
    end = time.monotonic() + 300
    while not (folder / "state" / "commits" / "0").exists():
        assert running.poll() is None, (folder / "errors").read_text()[-3000:]
        assert time.monotonic() < end
        time.sleep(0.1)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    assert len(list((folder / "state" / "commits").glob("[0-9]*"))) < batches
    query(session, str(tree), str(folder))
    found: list[Any] = session.read.parquet(str(folder / "out")).collect()
    return found


@pytest.mark.ci
def test_a_stream_that_is_killed_goes_on_and_tells_each_detection_once(
    session: Any, tree: Path, tmp_path: Path
) -> None:
    lines = log(3_000, KEYS, 2)
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(lines))
    rows = killed_and_resumed(session, tree, tmp_path, lines, 4)
    expected = told(path, tree, "--repeat")
    assert of_rows(rows) == expected
    assert sum(expected.values()) >= 40
    # The state belongs to one tree and its options.
    (tmp_path / "in" / "new.jsonl").write_text(lines[-2])
    with pytest.raises(Exception, match="use another checkpointLocation to start again"):
        query(session, str(tree), str(tmp_path), "other")


@pytest.mark.slow
def test_a_million_events_of_five_thousand_keys(session: Any, tree: Path, tmp_path: Path) -> None:
    from rvaft.integrations import spark as fleets

    lines = log(1_000_000, list(range(5_000)), 3)
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(lines))
    expected = told(path, tree, "--repeat")
    table = fleets.monitor(session.read.text(str(path)), loads(TREE), key="user", repeat=True)
    assert of_rows(table.collect()) == expected
    assert of_rows(killed_and_resumed(session, tree, tmp_path, lines, 8)) == expected
