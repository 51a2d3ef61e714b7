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
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest
import yaml

from rvaft import Verdict, load, monitor
from rvaft.model.values import Json
from rvaft.monitoring.reader import read
from tests.cli.runs import PRUNED, TREES, run
from tests.ros.test_server import serving

CHECKOUT: Final = Path(os.environ.get("ROSMONITORING", ""))
ROS: Final = TREES / "remote_inspection" / "ros.rvaft"
TRACES: Final = PRUNED.parent / "pruned.traces"
TYPES: Final = {
    "gazebo_radiation_plugins.msg": ["Command", "Simulated_Radiation_Msg"],
    "move_base_msgs.msg": ["MoveBaseActionGoal", "MoveBaseActionResult"],
}

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
    """The module of one monitor as it is generated, with an oracle at this port and packages of messages to import from."""
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

    def __init__(self, module: ModuleType, folder: Path) -> None:
        self.monitor = getattr(module, f"ROSMonitor_{module.MONITOR_ID}").__new__(
            getattr(module, f"ROSMonitor_{module.MONITOR_ID}")
        )
        self.interfaces = {interface["name"]: interface for interface in module.INTERFACES}
        self.warnings: list[str] = []
        self.monitor.lock = threading.Lock()
        self.monitor.log_file = (folder / "events.jsonl").open("w", encoding="utf-8")
        self.monitor.status_file = (folder / "status.jsonl").open("w", encoding="utf-8")
        self.status = folder / "status.jsonl"
        self.monitor._log_info = str
        self.monitor._log_warning = self.warnings.append
        self.monitor._shutdown_runtime = str
        self.monitor.oracle = self.monitor._connect_oracle()
        assert self.monitor.oracle is not None, self.warnings

    def receive(self, event: dict[str, Json]) -> tuple[bool, str]:
        """Whether the message of an event passes, and the verdict."""
        interface = self.interfaces[event["topic"]]
        made = self.monitor._event(
            interface, {key: value for key, value in event.items() if key not in ("topic", "time")}
        )
        made["time"] = event.get("time", made["time"])
        passes = self.monitor._handle_event(interface, made, object())
        last = json.loads(self.status.read_text(encoding="utf-8").splitlines()[-1])
        return passes, self.monitor._normalize_verdict(last["verdict_raw"])

    def close(self) -> None:
        """Let go of files and connection."""
        self.monitor.oracle.close()
        self.monitor.log_file.close()
        self.monitor.status_file.close()


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


@pytest.mark.parametrize(
    ("options", "part", "trace"),
    [
        ([], {}, "table2_row1"),
        (["--branch", 1], {"branch": 1}, "table2_row1"),
        (["--kind", "attack"], {"kind": "attack"}, "table2_row3"),
        ([], {}, "low_reading_breaks"),
    ],
)
def test_the_commands_and_the_monitor_work_together(
    options: list[object], part: dict[str, Any], trace: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (entry,) = written(tmp_path, *options)
    alone = monitor(load(ROS), **part)
    raw = {Verdict.TRUE: "false", Verdict.FALSE: "true", Verdict.UNKNOWN: "currently_true"}
    (line, *_) = [line for line in (tmp_path / "run.txt").read_text().splitlines() if line.startswith("rvaft serve")]
    words = shlex.split(line)[2:]
    del words[words.index("--port") : words.index("--port") + 2]
    with serving(*words) as (_, url):
        module = generated(tmp_path, entry["id"], int(url.rpartition(":")[2]), monkeypatch)
        with closing(Client(module, tmp_path)) as client:
            for event in read(TRACES / f"{trace}.jsonl"):
                verdict = alone.step(event)
                blocked = verdict is Verdict.TRUE and event["topic"] == "/command"
                assert client.receive(event) == (not blocked, raw[verdict])
            command = {"topic": "/command", "name": "move", "waypoint": 1, "time": 9000.5}
            verdict = alone.step(command)
            assert client.receive(command) == (verdict is not Verdict.TRUE, raw[verdict])


@contextmanager
def rml_oracle(line: str, folder: Path, port: int) -> Iterator[None]:
    """The RML oracle, started as run.txt says but at a free port, until it listens."""
    words = [os.path.expandvars(word) for word in shlex.split(line)[:-1]]
    with subprocess.Popen(
        [*words, str(port)], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as running:
        try:
            deadline = time.monotonic() + 30
            while time.monotonic() < deadline:
                with socket.socket() as probe:
                    if probe.connect_ex(("127.0.0.1", port)) == 0:
                        break
                assert running.poll() is None
                time.sleep(0.1)
            yield
        finally:
            running.kill()


@pytest.mark.skipif(shutil.which("swipl") is None, reason="needs SWI-Prolog")
@pytest.mark.parametrize("branch", [None, 3])
def test_the_rml_oracle_can_be_asked_instead(
    branch: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (entry,) = written(tmp_path, "--oracle", "rml", *([] if branch is None else ["--branch", branch]))
    monkeypatch.setenv("ROSMONITORING_HOME", str(CHECKOUT))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    line = (tmp_path / "run.txt").read_text(encoding="utf-8").splitlines()[1]
    alone = monitor(load(ROS), branch=branch)
    raw = {Verdict.TRUE: "true", Verdict.FALSE: "false", Verdict.UNKNOWN: "currently_false"}
    with rml_oracle(line, tmp_path, port):
        module = generated(tmp_path, entry["id"], port, monkeypatch)
        with closing(Client(module, tmp_path)) as client:
            for event in read(TRACES / "table2_row3.jsonl"):
                assert client.receive(event) == (True, raw[alone.step(event)])
            assert alone.verdict is Verdict.TRUE
            assert client.warnings == []


# -- the monitor that its generator writes, without ROS -----------------------------------------------------------------


@pytest.fixture
def importable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The checkout that ROSMONITORING names can be imported from."""
    pytest.importorskip("websocket", reason="needs websocket-client")
    monkeypatch.syspath_prepend(str(CHECKOUT / "src"))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosmonitoring"]:
        del sys.modules[name]


def loaded(folder: Path, url: str, *, action: str) -> ModuleType:
    """The module that ROSMonitoring generates for one monitor of one topic."""
    config, generator = (importlib.import_module(f"rosmonitoring.{name}") for name in ("config", "generator"))
    host, port = url.removeprefix("ws://").split(":")
    topic = {"name": "command", "type": "std_msgs.msg.String", "action": action}
    oracle = {"url": host, "port": int(port), "action": "nothing", "timeout": 20}
    parsed = config.parse_config(
        {"monitors": [{"monitor": {"id": "damaged", "log": "x", "oracle": oracle, "topics": [topic]}}]}
    )
    (file := folder / "damaged.py").write_text(
        generator.render_monitor_source(parsed.monitors[0], "ros2"), encoding="utf-8"
    )
    spec = importlib.util.spec_from_file_location("damaged", file)
    assert spec is not None
    assert spec.loader is not None
    spec.loader.exec_module(module := importlib.util.module_from_spec(spec))
    return module


class OwnClient:
    """A generated monitor of which ROS has been left out."""

    def __init__(self, module: ModuleType, folder: Path) -> None:
        self.monitor = module.ROSMonitor_damaged.__new__(module.ROSMonitor_damaged)
        self.interface = module.INTERFACES[0]
        self.shutdowns = 0
        self.warnings: list[str] = []
        self.monitor.lock = threading.Lock()
        self.monitor.log_file = (folder / "events.jsonl").open("w", encoding="utf-8")
        self.monitor.status_file = (folder / "status.jsonl").open("w", encoding="utf-8")
        self.status = folder / "status.jsonl"
        self.monitor._log_info = str
        self.monitor._log_warning = self.warnings.append
        self.monitor._shutdown_runtime = self._shut_down
        self.monitor.oracle = self.monitor._connect_oracle()
        assert self.monitor.oracle is not None, self.warnings

    def _shut_down(self) -> None:
        self.shutdowns += 1

    def event(self, event: dict[str, Any]) -> bool:
        """Whether the monitor lets the message of an event pass."""
        allowed: bool = self.monitor._handle_event(self.interface, event, object())
        return allowed

    def statuses(self) -> list[dict[str, Any]]:
        """What it wrote of each event."""
        lines = map(json.loads, self.status.read_text(encoding="utf-8").splitlines())
        return [line for line in lines if line["status"] == "event"]

    def close(self) -> None:
        """Let go of files and connection."""
        self.monitor.oracle.close()
        self.monitor.log_file.close()
        self.monitor.status_file.close()


@pytest.fixture(scope="module", params=["rml", "strings"])
def speaking(request: pytest.FixtureRequest) -> Iterator[str]:
    """The URL of a server that says definitive verdicts in either way."""
    with serving(PRUNED, "--vocabulary", request.param) as (_, url):
        yield url


@pytest.mark.parametrize("trace", sorted(path.name for path in TRACES.iterdir()))
@pytest.mark.usefixtures("importable")
def test_it_reads_our_verdicts_as_they_are_meant(trace: str, speaking: str, tmp_path: Path) -> None:
    alone = monitor(load(PRUNED))
    raw = {Verdict.TRUE: "false", Verdict.FALSE: "true", Verdict.UNKNOWN: "currently_true"}
    with closing(OwnClient(loaded(tmp_path, speaking, action="filter"), tmp_path)) as client:
        for event in read(TRACES / trace):
            sent = {key: value.removeprefix("/") if key == "topic" else value for key, value in event.items()}
            verdict = alone.step(event)
            assert client.event(sent) is (verdict is not Verdict.TRUE)
            status = client.statuses()[-1]
            assert client.monitor._normalize_verdict(status["verdict_raw"]) == raw[verdict]
            assert {key: status["oracle_response"][key] for key in sent} == sent
            assert ("matched" in status["oracle_response"]) is (verdict is Verdict.TRUE)
            assert status["terminal"] is verdict.final
        assert bool(client.warnings) is (alone.verdict is Verdict.TRUE)


@pytest.mark.usefixtures("importable")
def test_an_error_reply_neither_stops_it_nor_counts_as_a_violation(tmp_path: Path) -> None:
    with serving(PRUNED) as (_, url), closing(OwnClient(loaded(tmp_path, url, action="log"), tmp_path)) as client:
        assert client.event({"topic": "/image", "data": "x" * 2_000_000})
        assert "error" in client.statuses()[-1]["oracle_response"]
        assert client.event({"topic": "/other"})
        assert [status["verdict_raw"] for status in client.statuses()] == ["currently_true", "currently_true"]
        assert (client.shutdowns, client.warnings) == (0, [])


@pytest.mark.usefixtures("importable")
def test_a_passive_monitor_stops_at_a_detection(tmp_path: Path) -> None:
    events = list(read(TRACES / "table2_row1.jsonl"))
    detected = [verdict.final for verdict in monitor(load(PRUNED)).run(events)].index(True)
    with serving(PRUNED) as (_, url), closing(OwnClient(loaded(tmp_path, url, action="log"), tmp_path)) as client:
        for event in events[:detected]:
            client.event(event)
        assert client.shutdowns == 0
        client.event(events[detected])
        assert client.shutdowns == 1
