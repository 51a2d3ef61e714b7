"""ROSMonitoring's own tools take what we write: its validation, its generator, its monitors, its RML oracle."""

import importlib
import importlib.util
import json
import os
import shlex
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest
import yaml

from rvaft import Verdict, load, monitor
from rvaft.model.values import Json
from rvaft.readers.json_lines import read
from tests.cli.runs import LOGS, PRUNED, ROW1, TREES, run, soon, started
from tests.integrations.ros.clients import serving

CHECKOUT: Final = Path(os.environ.get("ROSMONITORING", ""))
ROS: Final = TREES / "remote_inspection" / "ros.rvaft"
TYPES: Final = {
    "gazebo_radiation_plugins.msg": ["Command", "Simulated_Radiation_Msg"],
    "move_base_msgs.msg": ["MoveBaseActionGoal", "MoveBaseActionResult"],
}

pytest.importorskip("websocket", reason="needs websocket-client")
pytestmark = [
    pytest.mark.published,
    pytest.mark.skipif(
        not (CHECKOUT / "src" / "rosmonitoring" / "cli.py").is_file(), reason="ROSMONITORING names no checkout"
    ),
]


def rosmonitoring(*words: object) -> str:
    """What ROSMonitoring's command line says; it must succeed."""
    done = subprocess.run(
        [sys.executable, "-m", "rosmonitoring.cli", *map(str, words)],
        env={**os.environ, "PYTHONPATH": str(CHECKOUT / "src")},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout


def written(folder: Path, *options: object) -> list[dict[str, Any]]:
    """The monitors of the configuration that we write."""
    assert run("rosmonitoring", ROS, "-o", folder, *options).exit_code == 0
    entries = yaml.safe_load((folder / "monitors.yaml").read_text(encoding="utf-8"))["monitors"]
    return [entry["monitor"] for entry in entries]


@pytest.mark.parametrize("version", ["ros1", "ros2"])
@pytest.mark.parametrize("per", ["tree", "branch", "kind"])
def test_it_validates_and_generates(per: str, version: str, tmp_path: Path) -> None:
    entries = written(tmp_path, "--per", per, "--ros-version", version, "--port", 9000)
    said = rosmonitoring("validate", tmp_path / "monitors.yaml")
    assert said == f"valid: {len(entries)} monitor(s)\n"
    rosmonitoring("generate", tmp_path / "monitors.yaml", "--output", tmp_path / "generated")
    sources = tmp_path / "generated" / "monitor" / ("monitor" if version == "ros2" else "src")
    assert {path.stem for path in sources.glob("*.py")} - {"__init__"} == {entry["id"] for entry in entries}
    for number, entry in enumerate(entries):
        source = (sources / f"{entry['id']}.py").read_text(encoding="utf-8")
        for package, names in TYPES.items():
            for name in names:
                assert f"    from {package} import {name}\n" in source
        assert f"ws://127.0.0.1:{9000 + number}" in source


def generated(folder: Path, id_: str, port: int, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of one monitor as it is generated, with an oracle at this port and packages of
    messages to import from.
    """
    for package, names in TYPES.items():
        for part in (package.partition(".")[0], package):
            monkeypatch.setitem(sys.modules, part, ModuleType(part))
        for name in names:
            setattr(sys.modules[package], name, type(name, (), {"__module__": package}))
    config = yaml.safe_load((folder / "monitors.yaml").read_text(encoding="utf-8"))
    for entry in config["monitors"]:
        entry["monitor"]["oracle"].update(port=port, timeout=20)
    (folder / "local.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    rosmonitoring("generate", folder / "local.yaml", "--output", folder)
    spec = importlib.util.spec_from_file_location(id_, folder / "monitor" / "monitor" / f"{id_}.py")
    assert spec is not None
    assert spec.loader is not None
    spec.loader.exec_module(module := importlib.util.module_from_spec(spec))
    return module


class Client:
    """A generated monitor of which ROS has been left out: messages come in as events and go out as names of topics."""

    def __init__(self, module: ModuleType, files: ExitStack, folder: Path) -> None:
        kind = getattr(module, f"ROSMonitor_{module.MONITOR_ID}")
        self.monitor = kind.__new__(kind)
        self.interfaces = {interface["name"]: interface for interface in module.INTERFACES}
        self.warnings: list[str] = []
        self.shutdowns: list[object] = []
        self.status: dict[str, Any] = {}
        self.statuses = folder / "status.jsonl"
        self.monitor.lock = threading.Lock()
        self.monitor.log_file = files.enter_context((folder / "events.jsonl").open("w", encoding="utf-8"))
        self.monitor.status_file = files.enter_context(self.statuses.open("w", encoding="utf-8"))
        self.monitor._log_info = str
        self.monitor._log_warning = self.warnings.append
        self.monitor._shutdown_runtime = lambda *why: self.shutdowns.append(why)
        self.monitor.oracle = self.monitor._connect_oracle()
        assert self.monitor.oracle is not None, self.warnings
        files.callback(self.monitor.oracle.close)

    def receive(self, event: dict[str, Json]) -> tuple[bool, str]:
        """Whether the message of an event passes, and the verdict."""
        interface = self.interfaces.get(event["topic"], self.interfaces["/move_base/goal"])
        if event["topic"] in self.interfaces:
            payload = {key: value for key, value in event.items() if key not in ("topic", "time")}
            made = self.monitor._event(interface, payload)
            event = {**made, "time": event.get("time", made["time"])}
        passes = self.monitor._handle_event(interface, event, object())
        lines = map(json.loads, self.statuses.read_text(encoding="utf-8").splitlines())
        self.status = [line for line in lines if line["status"] == "event"][-1]
        return passes, self.monitor._normalize_verdict(self.status["verdict_raw"])


def test_the_generated_monitor_uses_the_message_types(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(tmp_path)
    module = generated(tmp_path, "damaged", 8080, monkeypatch)
    tree = load(ROS)
    for interface in module.INTERFACES:
        declared = tree.topics[interface["name"]]
        message = getattr(module, interface["type"])
        assert f"{message.__module__}.{message.__name__}" == interface["type_fqn"] == declared.type
        assert interface["legacy_name"] == declared.name
        assert (interface["action"], interface["intercepting"]) == (
            ("filter", True) if declared.publishers else ("log", False)
        )


@contextmanager
def rml_oracle(line: str, folder: Path) -> Iterator[int]:
    """The RML oracle, started as run.txt says but at a free port, when it listens."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    words = [*(os.path.expandvars(word) for word in shlex.split(line)[:-1]), str(port)]

    def listens() -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    with started(args=words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL):
        assert soon(listens)
        yield port


@contextmanager
def asking(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *options: object, more: tuple[str, ...] = ()
) -> Iterator[Client]:
    """The generated monitor, connected to the oracle that run.txt starts, though at a free port."""
    (entry,) = written(folder, *options)
    line = (folder / "run.txt").read_text(encoding="utf-8").splitlines()[1]
    with ExitStack() as stack:
        if line.startswith("rvaft serve "):
            words = shlex.split(line)[2:]
            del words[words.index("--port") : words.index("--port") + 2]
            port = int(stack.enter_context(serving(*words, *more))[1].rpartition(":")[2])
        else:
            monkeypatch.setenv("ROSMONITORING_HOME", str(CHECKOUT))
            port = stack.enter_context(rml_oracle(line, folder))
        yield Client(generated(folder, entry["id"], port, monkeypatch), stack, folder)


@pytest.mark.parametrize(
    ("options", "part", "trace", "vocabulary"),
    [
        (["--branch", 1], {"branch": 1}, "table2_row1", "rml"),
        (["--kind", "attack"], {"kind": "attack"}, "table2_row3", "strings"),
        *(([], {}, path.stem, ("rml", "strings")[n % 2]) for n, path in enumerate(sorted(LOGS.iterdir()))),
    ],
)
def test_the_commands_and_the_monitor_work_together(
    options: list[object],
    part: dict[str, Any],
    trace: str,
    *,
    vocabulary: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    alone = monitor(load(ROS), **part)
    raw = {Verdict.TRUE: "false", Verdict.FALSE: "currently_true", Verdict.UNKNOWN: "currently_true"}
    command: dict[str, Json] = {"topic": "/command", "name": "move", "waypoint": 1, "time": 9000.5}
    with asking(tmp_path, monkeypatch, *options, more=("--vocabulary", vocabulary)) as client:
        for event in [*read(LOGS / f"{trace}.jsonl"), command]:
            verdict = alone.step(event)
            blocked = verdict is Verdict.TRUE and event["topic"] == "/command"
            assert client.receive(event) == (not blocked, raw[verdict])
            assert ("matched" in client.status["oracle_response"]) is (verdict is Verdict.TRUE)
            assert client.status["terminal"] is (verdict is Verdict.TRUE)
            told = client.status["oracle_response"]
            assert {key: told[key] for key in event if key != "topic"} | {"topic": event["topic"]} == event
        assert bool(client.warnings) is (alone.verdict is Verdict.TRUE)


def test_a_passive_monitor_stops_at_a_detection_and_not_at_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error reply does not count as a violation either."""
    events = list(read(ROW1))
    detected = [verdict.final for verdict in monitor(load(PRUNED)).run(events)].index(True)
    with asking(tmp_path, monkeypatch, "--action", "log") as client:
        assert client.receive({"topic": "/image", "data": "x" * 2_000_000}) == (True, "currently_true")
        assert "error" in client.status["oracle_response"]
        assert client.receive({"topic": "/other"}) == (True, "currently_true")
        assert client.warnings == []
        for event in events[: detected + 1]:
            assert client.shutdowns == []
            client.receive(event)
        assert len(client.shutdowns) == 1


def test_a_passive_monitor_goes_on_after_each_repeated_detection_and_when_there_can_be_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events = [*read(ROW1)]
    for semantics in ("consecutive", "projected"):
        with asking(
            tmp_path / semantics, monkeypatch, "--action", "log", "--repeat", "--semantics", semantics
        ) as client:
            told = [client.receive(event)[1] for event in [*events, *events, events[-1], events[0]]]
            assert told.count("currently_false") == len(client.warnings) == 2
            assert set(told) == {"currently_true", "currently_false"}
            assert client.shutdowns == []


@pytest.mark.skipif(shutil.which("swipl") is None, reason="needs SWI-Prolog")
@pytest.mark.parametrize("branch", [None, 3])
def test_the_rml_oracle_can_be_asked_instead(
    branch: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = monitor(load(ROS), branch=branch)
    raw = {Verdict.TRUE: "true", Verdict.FALSE: "false", Verdict.UNKNOWN: "currently_false"}
    part = [] if branch is None else ["--branch", branch]
    with asking(tmp_path, monkeypatch, "--oracle", "rml", *part) as client:
        for event in read(LOGS / "table2_row3.jsonl"):
            assert client.receive(event) == (True, raw[alone.step(event)])
        assert alone.verdict is Verdict.TRUE
        assert client.warnings == []
