"""What each format makes of a log, and what it tells of the rest; by `rvaft.read_log` and by the
commands, which say the same.
"""

import gzip
import io
import json
import os
import re
import shlex
import signal
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
import zstandard

import rvaft
from rvaft import LogReader
from rvaft.readers import json_document, registry
from rvaft.readers.log import Log
from tests.cli.runs import SAND, failed, jsonl, run, started, written
from tests.docs.examples import ROOT
from tests.readers.samples import LOGS, mission
from tests.tables import rows

FORMATS = rows(__file__, "formats.txt")
SAMPLES = {
    "doors.csv": "doors.rvaft",
    "doors.parquet": "doors.rvaft",
    "auth.syslog": "ssh.rvaft",
    "orders.xes": "orders.rvaft",
    "mission.mcap": "../../trees/remote_inspection/mission.rvaft",
}
"""The logs of the page and the trees that are detected in them."""
NEEDS = {".parquet": "pyarrow", ".mcap": "rosbags"}

LONG_TEXTS = {"@DIGITS@": "9" * 4301, "@DEEP@": "[" * 500 + "]" * 500, "@CONTAINERS@": "<container key='c'>" * 5_000}
LONG = re.compile("|".join(LONG_TEXTS))


def options(row: str) -> tuple[str, dict[str, Any]]:
    """The format and the options of a row, as `read_log` takes them."""
    form, *words = shlex.split(row)
    given: dict[str, Any] = {
        name.removeprefix("--"): value for name, value in zip(words[::2], words[1::2], strict=True)
    }
    if "types" in given:
        given["types"] = dict(part.split("=") for part in given["types"].split(","))
    return form, given


def read(source: Any, *form: str, **given: Any) -> tuple[list[dict[str, Any]], str]:
    """The events of a log, and what is told of the rest."""
    found: list[dict[str, Any]] = []
    told: list[str] = []
    try:
        for event in rvaft.read_log(source, *form, warn=told.append, **given):
            found.append(event)  # noqa: PERF402 (up to the error)
    except rvaft.TraceError as error:
        return found, str(error)
    return found, "".join(f"warning: {said}" for said in told)


@pytest.mark.parametrize("row", FORMATS, ids=lambda row: f"{row[0][:12]} {row[1][:30]!r}")
def test_events_and_what_is_told_of_the_rest(row: list[Any], tmp_path: Path) -> None:
    form, given = options(row[0])
    data = LONG.sub(lambda found: LONG_TEXTS[found[0]], row[1]).encode("latin-1")
    found, told = read(io.BytesIO(data), form, name="x", **given)
    assert found == row[2]
    assert told == row[3] or (row[3] and told.startswith(row[3]))
    log = tmp_path / "x"
    log.write_bytes(data)
    result = run("monitor", SAND, log, "--format", "jsonl", "--input", *shlex.split(row[0]))
    assert len([line for line in result.stdout.splitlines() if line.startswith("{")]) == len(row[2])
    said = [line for line in result.stderr.splitlines() if " left out)" in line or "error" in line]
    assert [re.sub(r"^rvaft: (error: )?", "", line).replace(str(log), "x") for line in said] == [told] * bool(told)
    assert (result.exit_code == 2) == (bool(told) and not told.startswith("warning"))


@pytest.mark.ci
@pytest.mark.parametrize("size", [1, 2, 7, 64])
def test_a_document_is_read_in_pieces(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    events = [
        {"i": i * 10**i, "s": 'ä\u2028\\"]},' * (i % 4), "f": -1.5e-7, "n": [None, True, {"": []}]} for i in range(40)
    ]
    text = json.dumps(
        {"skipped": ['\\"', {"Records": [0]}], "Records": events, "z": 1}, ensure_ascii=False, indent=size % 3
    )
    monkeypatch.setattr(json_document, "_BLOCK", size)
    assert read(io.BytesIO(text.encode()), "json") == (events, "")
    for cut in range(0, len(text) - 2, 97):
        found, told = read(io.BytesIO(text[:cut].encode()), "json")
        assert found == events[: len(found)]
        assert told


@pytest.mark.ci
def test_a_document_of_which_nothing_is_kept(tmp_path: Path) -> None:
    """A hundred times the items take no more room."""
    import tracemalloc

    def peak(items: int) -> int:
        log = tmp_path / f"{items}.json"
        log.write_text(json.dumps([{"event": "a", "text": "x" * 1000}] * items), encoding="utf-8")
        tracemalloc.start()
        assert sum(1 for _ in rvaft.read_log(log)) == items
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    assert peak(20_000) < 2 * peak(2_000)


@pytest.mark.ci
@pytest.mark.parametrize("name", SAMPLES)
def test_each_command_reads_each_log(name: str, tmp_path: Path) -> None:
    pytest.importorskip(NEEDS.get(Path(name).suffix, "csv"))
    log, tree = LOGS / name, LOGS / SAMPLES[name]
    plain = run("monitor", tree, log)
    assert plain.exit_code == 1, plain.output
    packed: dict[str, Callable[[bytes], bytes]] = {".gz": gzip.compress, ".zst": zstandard.compress}
    for suffix, compress in packed.items():
        copy = tmp_path / f"{name}{suffix}"
        copy.write_bytes(compress(log.read_bytes()))
        assert run("monitor", tree, copy).stdout == plain.stdout
        copy.write_bytes(compress(log.read_bytes())[:-9])
        cut = run("monitor", tree, copy)
        assert cut.exit_code == 2
        assert cut.stderr.count("error: ") == 1, cut.stderr
    told = run("monitor", tree, log, "--format", "jsonl", "--detections").stdout
    assert json.loads(told.splitlines()[0])["verdict"] == "true"
    both = run("monitor", tree, log, log, "--jobs", 2, "--repeat", "--per", "branch", "--explain")
    assert both.exit_code == 1
    assert both.stdout.count(" true (detection 1)") >= 2
    assert run("coverage", tree, log, "--format", "json").stdout.count('"detected": 1') == 1
    if Path(name).suffix not in NEEDS:
        form = {".csv": "csv", ".syslog": "syslog", ".xes": "xes"}[Path(name).suffix]
        piped = run("monitor", tree, "--input", form, data=log.read_bytes())
        assert piped.stdout == plain.stdout
        assert run("coverage", tree, "-", "--input", form, data=log.read_bytes()).exit_code == 0
    else:
        form = {".parquet": "parquet", ".mcap": "bag"}[Path(name).suffix]
        failed(run("monitor", tree, "--input", form, data=b""), f"{form} is read from a file")
    drawn = run("show", tree, "--highlight", log)
    assert drawn.exit_code == 0, drawn.output


def test_logs_of_several_formats_in_one_run(tmp_path: Path) -> None:
    written(tmp_path / "a.csv", "event\na\nb\nc\n")
    written(tmp_path / "b.json", '[{"event": "a"}]')
    written(tmp_path / "c.json", '{"event": "a"}\n{"event": "b"}\n')
    written(tmp_path / "e.json", '{ \n"Records": []}\n')
    written(tmp_path / "d.log", '{"event": "c"}\n')
    result = run("monitor", SAND, tmp_path / "*", "--format", "text", "--types", "event=text")
    assert result.exit_code == 1
    assert [line.split()[1:3] for line in result.stdout.splitlines()[-5:]] == [
        ["3", "true"],
        ["1", "unknown"],
        ["2", "unknown"],
        ["1", "false"],
        ["0", "unknown"],
    ]


def test_traces_beside_a_tree(tmp_path: Path) -> None:
    tree = written(tmp_path / "t.rvaft", "t sand a b;")
    (tmp_path / "t.traces").mkdir()
    written(tmp_path / "t.traces" / "one.csv", "event\na\nb\n")
    written(tmp_path / "t.traces" / "two.jsonl", '{"event": "a"}\n')
    written(tmp_path / "t.traces" / "notes", "nothing")
    assert run("test", tree, "--update").exit_code == 0
    assert json.loads((tmp_path / "t.verdicts.json").read_text(encoding="utf-8")).keys() == {"one.csv", "two"}
    assert run("test", tree).exit_code == 0
    written(tmp_path / "t.traces" / "one.csv", "event\nb\nb\n")
    assert "one.csv: " in run("test", tree).stdout


# -- following, going on, order, keys ----------------------------------------------------------------------------------

LINES = [f"2026-03-02T08:00:0{number}Z web1 sand: {name}\n" for number, name in enumerate("abc")]


@pytest.fixture
def syslog_tree(tmp_path: Path) -> Path:
    return written(
        tmp_path / "t.rvaft",
        'event said(m) = { app: "sand", message: m }; t sand x y z; x on said("a"); y on said("b"); z on said("c");',
    )


def test_a_log_of_lines_goes_on_from_a_checkpoint(syslog_tree: Path, tmp_path: Path) -> None:
    log = written(tmp_path / "l.syslog", "noise\n" + "".join(LINES[:2]))
    check = ("monitor", syslog_tree, log, "--checkpoint", tmp_path / "c", "--checkpoint-every", 1)
    first = run(*check)
    assert "verdict unknown after 2 events" in first.stdout
    with log.open("a", encoding="utf-8") as stream:
        stream.write(f"more noise\n{LINES[2]}")
    again = run(*check)
    assert again.exit_code == 1
    assert "verdict true after 3 events" in again.stdout
    assert f"{log}:4: not a syslog line (1 line left out)" in again.stderr
    failed(
        run(*check, "--input", "regex", "--pattern", "(?P<a>.)"), "this is a checkpoint of a run with --input syslog"
    )
    failed(run(*check, "--input", "jsonl"), "this is a checkpoint of a run with --input syslog")


def test_a_log_of_lines_is_followed(syslog_tree: Path, tmp_path: Path) -> None:
    log = written(tmp_path / "l.syslog", "".join(LINES[:2]))
    with started("monitor", syslog_tree, log, "--follow", "--format", "jsonl") as running:
        assert json.loads(running.stdout.readline())["event"] == 1
        assert json.loads(running.stdout.readline())["event"] == 2
        with log.open("a", encoding="utf-8") as stream:
            stream.write(f"noise\nnoise\n{LINES[2]}")
        assert json.loads(running.stdout.readline())["verdict"] == "true"
        told = f"rvaft: warning: {log}:3: not a syslog line"
        assert running.stderr.readline() == f"{told}; skipped, as are later ones like it\n"
        running.send_signal(signal.SIGINT)
        assert running.stderr.read() == f"{told} (2 lines left out)\n"


def test_standard_input_as_it_comes() -> None:
    with started("monitor", SAND, "--input", "csv", "--format", "jsonl") as running:
        for text, verdict in (("event,v\na,1\n", "unknown"), ("b,1\n", "unknown"), ("c,1\n", "true")):
            running.stdin.write(text)
            running.stdin.flush()
            assert json.loads(running.stdout.readline())["verdict"] == verdict


def test_keys_and_order(tmp_path: Path) -> None:
    log = written(tmp_path / "l.csv", "t,u,event\n2,x,b\n1,x,a\n3,x,c\n4,y,b\n")
    found = jsonl(SAND, log, "--key", "u", "--order-by", "t")
    assert [(one["key"], one["verdict"]) for one in found][-2:] == [("x", "true"), ("y", "false")]
    failed(run("monitor", SAND, log, "--key", "nobody"), "l.csv: there is no column nobody")


def test_what_a_match_consisted_of_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.stream.event_buffer.BOUND", 2)
    log = written(
        tmp_path / "l.csv",
        "time,event\n" + "".join(f"{n},{'a' if n == 0 else 'b' if n < 9 else 'c'}\n" for n in range(10)),
    )
    told = run("monitor", SAND, log, "--semantics", "scattered").stdout
    assert "event 1 (line 2) at 0 is a" in told
    assert "event 10 (line 11) at 9 is c" in told


def test_a_year_is_that_of_the_file(tmp_path: Path) -> None:
    log = written(tmp_path / "l.syslog", "Dec 31 23:59:59 h a: x\nJan  1 00:00:00 h a: x\nFeb 29 00:00:00 h a: x\n")
    stamp = time.mktime((2026, 1, 1, 12, 0, 0, 0, 0, 0))
    os.utime(log, (stamp, stamp))
    found, told = read(log)
    assert [event["time"] for event in found] == ["2025-12-31T23:59:59", "2026-01-01T00:00:00", "2024-02-29T00:00:00"]
    assert told == ""


# -- tables and recordings ---------------------------------------------------------------------------------------------


def test_values_of_parquet(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from datetime import UTC, date, datetime
    from decimal import Decimal

    from pyarrow import parquet

    at = datetime(2026, 3, 2, 8, 0, 0, 123456, tzinfo=UTC)
    table = pa.table(
        {
            "us": pa.array([at, None], pa.timestamp("us", "Europe/Berlin")),
            "ns": pa.array([1_772_438_400_123_456_789, None], pa.timestamp("ns")),
            "day": [date(2026, 3, 2), None],
            "lasted": pa.array([2, None], pa.duration("ms")),
            "price": [Decimal("1.50"), None],
            "bytes": pa.array([b"x", b"\xff\xfe"]),
            "word": pa.array(["x", None]).dictionary_encode(),
            "object": [{"a": 1, "b": None, "c": {"at": at}}, None],
            "list": [[{"at": at}], []],
            "map": pa.array([[("k", 1), ("l", None)], []], pa.map_(pa.string(), pa.int64())),
            "pairs": pa.array([[(5, 1)], None], pa.map_(pa.int64(), pa.int64())),
            "long": pa.array([[("k", 1)], None], pa.map_(pa.large_string(), pa.int64())),
            "flag": [True, None],
            "large": pa.array([2**64 - 1, None], pa.uint64()),
            "nothing": pa.nulls(2),
        }
    )
    parquet.write_table(table, tmp_path / "t.parquet")
    moment = "2026-03-02T08:00:00.123456Z"
    assert read(tmp_path / "t.parquet")[0] == [
        {
            "us": moment,
            "ns": "2026-03-02T08:00:00.123456789",
            "day": "2026-03-02",
            "lasted": 2_000_000,
            "price": 1.5,
            "bytes": "x",
            "word": "x",
            "object": {"a": 1, "c": {"at": moment}},
            "list": [{"at": moment}],
            "map": {"k": 1},
            "pairs": [{"key": 5, "value": 1}],
            "long": {"k": 1},
            "flag": True,
            "large": 2**64 - 1,
        },
        {"bytes": "//4=", "list": [], "map": {}},
    ]


def test_what_is_wrong_in_parquet(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    log = tmp_path / "t.parquet"
    pairs = pa.array([[("k", 1)], [("k", 1), ("k", 2)]], pa.map_(pa.string(), pa.int64()))
    parquet.write_table(pa.table({"map": pairs}), log)
    assert read(log) == ([{"map": {"k": 1}}], f"{log}: row 2: a key of a map is repeated (1 row left out)")
    table = pa.table({"event": ["a", "b", "c"] * 1000})
    parquet.write_table(table, log, write_page_checksum=True, compression="none", use_dictionary=False)
    log.write_bytes(log.read_bytes().replace(b"\x01\0\0\0c", b"\x01\0\0\0x", 1))
    failed(run("monitor", SAND, log), f"{log}: not Parquet, or damaged: ", "CRC")
    for form, usual in (("parquet", ".parquet"), ("bag", ".bag")):
        failed(run("monitor", SAND, tmp_path, "--input", form), f"for example '{tmp_path}/*{usual}'")


def test_only_the_columns_that_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    import rvaft.readers.parquet as module

    parquet.write_table(pa.table({"event": ["a", "b", "c"], "v": [1, 2, 3], "time": [1, 2, 3]}), tmp_path / "t.parquet")
    seen: set[str] = set()
    values = module._events

    def events(batch: Any, *rest: Any) -> Any:
        seen.update(batch.schema.names)
        return values(batch, *rest)

    monkeypatch.setattr(module, "_events", events)
    assert run("monitor", SAND, tmp_path / "t.parquet").exit_code == 1
    assert seen == {"event", "time"}
    assert run("monitor", SAND, tmp_path / "t.parquet", "--key", "v").exit_code == 0
    assert "v" in seen
    other = written(tmp_path / "o.rvaft", "event e(x) = { other: x }; top on e(X);")
    assert "verdict unknown after 3 events" in run("monitor", other, tmp_path / "t.parquet").stdout


def not_finite(found: list[dict[str, Any]]) -> list[Any]:
    return [getattr(event, "field", None) for event in found]


def test_numbers_that_are_not_finite(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    table = pa.table({"event": ["a", "b"], "v": [1.0, float("nan")], "w": [[1.0], [float("inf")]]})
    parquet.write_table(table, tmp_path / "t.parquet")
    logs = {
        tmp_path / "t.parquet": [],
        written(tmp_path / "t.csv", "event,v\na,1\nb,NaN\n"): ["--types", "v=number"],
        written(tmp_path / "t.xes", "<log><event/><event><float key='v' value='NaN'/></event></log>"): [],
        written(tmp_path / "t.txt", "1\nnan\n"): ["--input", "regex", "--pattern", "(?P<v>.*)", "--types", "v=number"],
    }
    tree = written(tmp_path / "t.rvaft", "event e(v) = { v: v }; top on e(V) when V > 5;")
    for log, more in logs.items():
        told = run("monitor", tree, log, *more)
        assert "undefined number in 1 event: v is NaN (first: event 2)" in told.stdout, told.output
        strict = run("monitor", tree, log, *more, "--strict-json")
        assert "a number in it is not finite (1 " in strict.stderr
        assert "verdict unknown after 1 event\n" in strict.stdout


@pytest.mark.parametrize("kind", ["folder", "file", "sqlite", "ros1"])
def test_recordings(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from tests.readers.samples import write_recording

    events = list(mission())
    path = tmp_path / ("m.bag" if kind == "ros1" else "m")
    write_recording(path, events, ros1=kind == "ros1", mcap=kind != "sqlite")
    log = next(path.glob("*.mcap")) if kind == "file" else path
    found, told = read(log)
    assert told == ""
    assert [event.pop("time") for event in found] == [1_772_438_400_000_000_000 + 10**9 * n for n in range(7)]
    assert [event["header"].pop("frame_id") for event in found] == [""] * 7
    assert [event["header"].pop("seq", None) is not None for event in found] == [kind == "ros1"] * 7
    assert not_finite(found) == [None, None, "temperature", None, None, None, None]
    assert repr([{**event} for event in found]) == repr([{"topic": event["topic"], **event} for event in events])
    tree = ROOT / "trees" / "remote_inspection" / "mission.rvaft"
    assert "verdict true after 7 events" in run("monitor", tree, log).stdout
    assert "verdict true after 7 events" in run("monitor", tree, tmp_path / "m*").stdout


def test_a_tree_that_reads_seconds_is_refused_for_a_recording(tmp_path: Path) -> None:
    """Its windows of seconds would never hold between times in nanoseconds."""
    pytest.importorskip("rosbags")
    for form in ("s", "ms", "iso8601", "ns"):
        tree = written(tmp_path / f"{form}.rvaft", f"time time as {form}; top sand a b within 1 s; a; b;")
        for command in ("monitor", "coverage"):
            result = run(command, tree, LOGS / "mission.mcap")
            assert ("but a recording has it as ns: write `time time as ns`" in result.stderr) is (form != "ns")
            assert (result.exit_code == 2) is (form != "ns")


def test_damaged_files(tmp_path: Path) -> None:
    """One line each, whatever is wrong; what can be read is monitored."""
    pytest.importorskip("rosbags")
    pytest.importorskip("pyarrow")
    for name in ("mission.mcap", "doors.parquet"):
        whole = (LOGS / name).read_bytes()
        for data in (b"", b"nothing of the kind", whole[: len(whole) // 2], whole[:-5]):
            bad = tmp_path / name
            bad.write_bytes(data)
            failed(run("monitor", SAND, bad, "--format", "jsonl"), str(bad))
            failed(run("coverage", SAND, bad), str(bad))
    failed(run("monitor", SAND, tmp_path / "no.bag"), "no.bag: No such file")
    failed(run("monitor", SAND, tmp_path / "no.csv"), "no.csv: No such file")
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "recording_0.db3").touch()  # its metadata.yaml was never written
    failed(run("monitor", SAND, folder), "recording: Is a directory", "recording/*.db3'")


def test_a_definition_that_cannot_be_parsed_leaves_out_its_topic(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from tests.readers.samples import write_recording

    write_recording(tmp_path / "m", list(mission()), mcap=False)
    storage = next((tmp_path / "m").glob("*.db3"))
    with sqlite3.connect(storage) as table:
        broken = "UPDATE message_definitions SET encoded_message_definition = ? WHERE topic_type = ?"
        assert table.execute(broken, ("bool[ ???", "robot_msgs/msg/Command")).rowcount == 1
    found, told = read(tmp_path / "m")
    assert {event["topic"] for event in found} == {event["topic"] for event in mission()} - {"/command"}
    assert "/command is left out: the definition of robot_msgs/msg/Command cannot be used: " in told
    (tree := tmp_path / "other.rvaft").write_text('event e() = { topic: "/radiation" }; top or a; a on e();')
    other = run("monitor", tree, tmp_path / "m", "--semantics", "scattered")
    assert "/command is left out" not in other.stderr  # no node observes it


def test_a_folder_that_cannot_be_read_names_its_storage_files(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from tests.readers.samples import write_recording

    write_recording(tmp_path / "m", list(mission()), mcap=False)
    about = tmp_path / "m" / "metadata.yaml"
    about.write_text(about.read_text().replace("version: 9", "version: 99"))
    failed(run("monitor", SAND, tmp_path / "m"), "m: ", "read the storage file instead: m.db3")


def test_messages_that_are_lost_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Reader

    found = Reader.messages
    monkeypatch.setattr(Reader, "messages", lambda self: (one for _, one in zip(range(5), found(self), strict=False)))
    result = run("monitor", LOGS / SAMPLES["mission.mcap"], LOGS / "mission.mcap")
    assert result.exit_code == 2
    assert "message 6: the recording has 7 by its index, but no more are found (2 messages left out)" in result.stderr
    assert "verdict true after 5 events" in result.stdout


# -- which format ------------------------------------------------------------------------------------------------------


class Shouting(LogReader):
    """A format of somebody else: the words of a line."""

    name = "shouting"
    suffixes = (".shout",)

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Any]]]:
        for number, word in enumerate(log.stream.read().decode().split(), 1):
            if word.isupper():
                yield number, {"event": word.lower()}
            else:
                log.reject(number, "too quiet")


def test_a_format_of_somebody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = {
        **registry.all_readers(),
        "shouting": EntryPoint("shouting", f"{__name__}:Shouting", registry.GROUP),
        "broken": EntryPoint("broken", "nowhere:Nothing", registry.GROUP),
    }
    monkeypatch.setattr(registry, "all_readers", lambda: known)
    log = written(tmp_path / "l.shout", "A b B C")
    result = run("monitor", SAND, log)
    assert (result.exit_code, result.stdout.splitlines()[0]) == (2, "event 3 (line 4): true")
    assert result.stderr == f"rvaft: error: {log}:2: too quiet (1 line left out)\n"
    failed(run("monitor", SAND, log, "--input", "broken"), "the reader of broken failed: it cannot be loaded")
    failed(run("monitor", SAND, log, "--input", "xml"), "unknown format xml; known: bag, can, csv,", "shouting")


@pytest.mark.parametrize(
    ("library", "log", "extra"), [("rosbags", "mission.mcap", "bags"), ("pyarrow", "doors.parquet", "parquet")]
)
def test_a_library_that_is_not_there(library: str, log: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    told = f"rvaft: error: {library} is not installed: pip install '.[{extra}]' in a checkout of rvaft\n"
    assert run("monitor", SAND, LOGS / log).stderr == told


def test_what_python_is_told(tmp_path: Path) -> None:
    log = written(tmp_path / "l.syslog", "".join(("x\n", *LINES)))
    with pytest.warns(UserWarning, match="1: not a syslog line"):
        assert len(list(rvaft.read_log(log))) == 3
    with pytest.raises(rvaft.OptionError, match="types: 'int' is not a valid FieldType; known: number, text, bool"):
        rvaft.read_log(log, "csv", types={"a": "int"})
    with pytest.raises(rvaft.WrongType, match="a path or a binary stream"):
        rvaft.read_log(5)  # type: ignore[arg-type]
    with pytest.raises(rvaft.OptionError, match="parquet is read from a file"):
        rvaft.read_log(io.BytesIO(), "parquet")
    with pytest.raises(FileNotFoundError):
        list(rvaft.read_log(tmp_path / "none.csv"))


def test_a_type_that_nobody_defines(tmp_path: Path) -> None:
    """Messages of it are told; where nothing is asked of them they do no harm."""
    pytest.importorskip("rosbags")
    import sqlite3

    from tests.readers.samples import TYPES, write_recording

    write_recording(tmp_path / "m", list(mission()), mcap=False)
    file = next((tmp_path / "m").glob("*.db3"))
    with sqlite3.connect(file) as database:
        database.execute(
            "DELETE FROM message_definitions WHERE topic_type LIKE '%Radiation' OR topic_type LIKE '%Battery'"
        )
    database.close()
    result = run("monitor", LOGS / SAMPLES["mission.mcap"], file)
    assert result.exit_code == 2
    told = "message 3: the type robot_msgs/msg/Battery, of /battery_state, is not defined in the recording"
    assert f"{file}: {told} (3 messages left out)" in result.stderr  # of all of them the time counts: some may be late
    assert "verdict unknown after 4 events" in result.stdout
    assert run("monitor", SAND, file).exit_code == 2
    other = written(tmp_path / "t.rvaft", 'event goal(g) = { topic: "/move_base/goal", goal: g }; top on goal(1);')
    assert run("monitor", other, file).exit_code == 1
    messages = tmp_path / "ws" / "robot_msgs" / "msg"
    messages.mkdir(parents=True)
    for name, text in TYPES.items():
        written(messages / f"{name.rpartition('/')[2]}.msg", text)
    whole = run("monitor", LOGS / SAMPLES["mission.mcap"], file, "--messages", tmp_path / "ws")
    assert (whole.exit_code, whole.stderr) == (1, "")
    written(messages / "Battery.msg", "[[[ nothing")
    failed(run("monitor", SAND, file, "--messages", tmp_path / "ws"), "Battery.msg defines no message")
    failed(run("monitor", SAND, file, "--messages", tmp_path / "none"), "is no folder with message definitions")


@pytest.mark.ci
def test_an_expression_that_never_ends_is_stopped_at_its_line(tmp_path: Path) -> None:
    log = written(tmp_path / "door.log", "by a\nby " + "a" * 60 + "b\nby a\n")
    tree = written(tmp_path / "tree.rvaft", "top or a b; a; b;")
    done = run("monitor", tree, log, "--input", "regex", "--pattern", "by (?P<event>(a+)+)$")
    assert done.exit_code == 2
    assert done.stderr.startswith(f"rvaft: error: {log}:2: the pattern takes more than 1 s on this line")
    assert "event 1: true" in done.stdout


def test_a_document_that_looks_like_one_event_is_hinted_at(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "top or a b; a; b;")
    one = written(tmp_path / "one.json", '{"hits": {"hits": [{"event": "a"}]}}\n')
    done = run("monitor", tree, one)
    assert "events read: 1;" in done.stdout
    assert done.stderr == (
        f"rvaft: warning: {one} was read as JSON Lines with one event; "
        "for a JSON document name its list of events with --records PATH\n"
    )
    assert run("monitor", tree, one, "--records", "hits.hits").stderr == ""
    assert run("monitor", tree, written(one, '{"event": "a"}')).stderr == ""


@pytest.mark.parametrize("name", ["log.xml", "drive.mf4", "table.XLSX", "dump.pcap.gz"])
def test_a_format_without_a_reader_is_no_json_lines(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"\xff\xfe<a/>")
    with pytest.raises(rvaft.OptionError, match=r"rvaft does not read .*: convert it to JSON Lines, CSV or Parquet"):
        next(rvaft.read_log(tmp_path / name))
    (tmp_path / name).write_bytes(b'{"a": 1}\n')
    if not name.endswith("gz"):
        assert next(rvaft.read_log(tmp_path / name, "jsonl")) == {"a": 1}
