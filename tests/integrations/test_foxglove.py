"""Detections and verdicts for Foxglove: a file of MCAP read back, a client of the server, and what goes wrong."""

import json
import socket
import struct
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import rvaft
from rvaft.integrations import foxglove
from rvaft.integrations.foxglove import FoxgloveSink
from tests.cli.runs import SAND, failed, jsonl, lines, run, soon, started, written
from tests.docs.examples import ROOT
from tests.readers.samples import LOGS

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
MISSION = ROOT / "trees" / "remote_inspection" / "mission.rvaft"
TIMED = "time t as ms; semantics consecutive; top sand a b; b attack;"
EVENTS = [{"event": name, "t": 1000 * t} for t, name in enumerate("xababx")]


def logged(path: Path) -> list[tuple[str, int, Any]]:
    """The messages of a file: topic, time, content."""
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    with path.open("rb") as stream:
        found = [(schema, channel, message) for schema, channel, message in reader.make_reader(stream).iter_messages()]
    for schema, channel, message in found:
        content = json.loads(message.data)
        declared = json.loads(schema.data)
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert (
            schema.name
            == declared["title"]
            == f"rvaft.{channel.topic.removeprefix('/rvaft/').removesuffix('s').capitalize()}"
        )
        assert content.keys() <= declared["properties"].keys()
    return [(channel.topic, message.log_time, json.loads(message.data)) for _, channel, message in found]


def unlined(found: dict[str, Any]) -> dict[str, Any]:
    """A detection without the lines of its events, which a file of recordings does not have."""
    return {**found, "matched": [{name: one[name] for name in one if name != "line"} for one in found["matched"]]}


def test_a_file_has_what_the_command_tells(tmp_path: Path) -> None:
    tree, log = written(tmp_path / "t.rvaft", TIMED), written(tmp_path / "log.jsonl", lines(EVENTS))
    path = tmp_path / "run.mcap"
    told = jsonl(tree, log, "--repeat", "--detections", "--foxglove", path)
    found = logged(path)
    assert [(topic, time, one["event"]) for topic, time, one in found] == [
        (f"/rvaft/{topic}", time, event)
        for time, event in ((2 * 10**9, 3), (4 * 10**9, 5))
        for topic in ("verdicts", "detections")
    ]
    detections = [one for topic, _, one in found if topic == "/rvaft/detections"]
    left_out = ("tree", "trace", "events", "line")
    assert [unlined({name: value for name, value in one.items() if name != "line"}) for one in told] == [
        unlined({name: value for name, value in {**one, "verdict": "true"}.items() if name not in left_out})
        for one in detections
    ]
    assert detections[0]["events"] == {"2": EVENTS[1], "3": EVENTS[2]}
    assert {one["trace"] for one in detections} == {str(log)}
    # The same from Python, with the tree's own name.
    with FoxgloveSink(rvaft.loads(TIMED), tmp_path / "own.mcap") as sink:
        step = sink.on_detection(repeat=True)
        assert [step(event).symbol for event in EVENTS] == ["?", "?", "⊤", "?", "⊤", "?"]
    again = logged(tmp_path / "own.mcap")
    assert sorted((topic, time, one["event"]) for topic, time, one in again) == sorted(
        (topic, time, one["event"]) for topic, time, one in found
    )
    every = [unlined(one)["matched"] for topic, _, one in again if "matched" in one]
    assert every == [unlined(one)["matched"] for one in detections]
    assert sorted(one.name for one in tmp_path.iterdir()) == ["log.jsonl", "own.mcap", "run.mcap", "t.rvaft"]


def test_keys_branches_and_times_of_recordings(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    path = tmp_path / "run.mcap"
    run("monitor", MISSION, LOGS / "mission.mcap", "--per", "branch", "--key", "topic", "--foxglove", path)
    assert logged(path) == []
    assert run("monitor", MISSION, LOGS / "mission.mcap", "--per", "branch", "--foxglove", path).exit_code == 1
    (_, time, verdict), (_, same, detection) = logged(path)
    assert time == same == 1_772_438_413_000_000_000
    assert verdict["verdicts"] == {"tree": "true", "1": "unknown", "2": "true", "3": "unknown", "4": "unknown"}
    assert (detection["branch"], detection["kinds"], detection["events"]["5"]["name"]) == (2, ["fault"], "move")


def test_a_written_file_is_not_read_and_the_message_says_what_is(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    tree, log = written(tmp_path / "t.rvaft", TIMED), written(tmp_path / "log.jsonl", lines(EVENTS))
    run("monitor", tree, log, "--foxglove", tmp_path / "det.mcap")
    result = run("monitor", tree, tmp_path / "det.mcap")
    assert result.exit_code == 2
    assert "it has no messages of ROS 2; a file of --foxglove is for Foxglove, and --format jsonl" in result.stderr


def test_without_a_time_in_the_tree_it_is_now(tmp_path: Path) -> None:
    path, log = tmp_path / "run.mcap", written(tmp_path / "log", lines([{"event": "b", "time": 1}]))
    run("monitor", SAND, log, "--semantics", "strict", "--foxglove", path)
    ((topic, time, verdict),) = logged(path)
    assert (topic, verdict["verdict"]) == ("/rvaft/verdicts", "false")
    assert time > 1.7e18


def test_foxglove_connects_and_sees_what_is_detected(tmp_path: Path) -> None:
    client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
    tree = written(tmp_path / "t.rvaft", TIMED)
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        failed(run("monitor", tree, "--foxglove", port, data=b""), f"no server for Foxglove at 127.0.0.1:{port}: ")
    with started("monitor", tree, "--repeat", "--foxglove", f"localhost:{port}") as running:
        url = running.stderr.readline().split()[-1]
        assert url == f"ws://localhost:{port}"
        with client.connect(url, subprotocols=["foxglove.sdk.v1"]) as connection:
            channels: dict[str, int] = {}
            while len(channels) < 2:
                told = json.loads(connection.recv(timeout=10))
                channels |= {one["topic"]: one["id"] for one in told.get("channels", ())}
            wanted = [{"id": 7, "channelId": channels["/rvaft/detections"]}]
            connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            data: list[bytes] = []

            def arrived() -> bool:
                """Subscribing has no answer: events are sent until one is seen."""
                running.stdin.write(lines(EVENTS[1:3]))
                running.stdin.flush()
                try:
                    answer = connection.recv(timeout=0.2)
                except TimeoutError:
                    return False
                data.extend([answer] if isinstance(answer, bytes) else [])
                return bool(data)

            assert soon(arrived)
            code, number, time = struct.unpack_from("<BIQ", data[0])
            detection = json.loads(data[0][struct.calcsize("<BIQ") :])
            assert (code, number, time, detection["kinds"]) == (1, 7, 2_000_000_000, ["attack"])
        running.stdin.close()
        assert running.wait(20) == 1


WRONG = [
    ("x.txt", "'x.txt' is neither a port (8765 or HOST:8765) nor a file named .mcap"),
    ("99999", "neither a port"),
    ("8765", "--foxglove PORT needs live events"),
    ("none/run.mcap", "none is not a folder"),
    ("folder.mcap", "folder.mcap: cannot write: a folder is not a regular file"),
    ("run.mcap --jobs 2", "--foxglove needs a single process"),
]


@pytest.mark.parametrize(("target", "said"), WRONG)
def test_what_is_wrong_is_one_line(target: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.mcap").mkdir()
    log = written(tmp_path / "log", lines(EVENTS))
    failed(run("monitor", SAND, log, "--foxglove", *target.split()), said)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["folder.mcap", "log"]


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    failed(
        run("monitor", SAND, written(tmp_path / "log", ""), "--foxglove", "x.mcap"),
        "foxglove-sdk is not installed: pip install '.[foxglove]'",
    )


def test_a_full_disk_stops_no_monitor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full")
    tree, path = rvaft.loads(TIMED), tmp_path / "run.mcap"
    full = path.with_name(".run.mcap.new"), Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115 (the sink closes it)
    monkeypatch.setattr(foxglove, "temporary_beside", lambda _: full)
    said: list[str] = []
    sink = FoxgloveSink(tree, path, warn=said.append)
    step = sink.on_detection(repeat=True)
    many = [{**event, "text": "x" * 1000 * number} for number in range(200) for event in EVENTS[1:3]]
    assert [step(event).symbol for event in many] == ["?", "⊤"] * 200
    assert said == [f"{path}: cannot be written: No space left on device"]
    with pytest.raises(OSError, match="cannot write: No space left on device"):
        sink.close()
    assert list(tmp_path.iterdir()) == []
