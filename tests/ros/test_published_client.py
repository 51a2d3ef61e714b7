"""ROSMonitoring's own client: the monitor that its generator writes, without ROS, speaks to a server of ours."""

import importlib
import importlib.util
import json
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest

from rvaft import Verdict, load, monitor
from rvaft.monitoring.reader import read
from tests.cli.runs import PRUNED
from tests.ros.test_serve import serving

SOURCE: Final = Path(os.environ.get("ROSMONITORING", ""), "src")
TRACES: Final = PRUNED.parent / "pruned.traces"

pytestmark = pytest.mark.published


@pytest.fixture
def rosmonitoring(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The checkout that ROSMONITORING names can be imported from."""
    if not (SOURCE / "rosmonitoring" / "generator.py").is_file():
        pytest.skip("ROSMONITORING names no checkout")
    pytest.importorskip("websocket", reason="needs websocket-client")
    monkeypatch.syspath_prepend(str(SOURCE))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosmonitoring"]:
        del sys.modules[name]


def generated(folder: Path, url: str, *, action: str) -> ModuleType:
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


class Client:
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


@pytest.mark.parametrize("vocabulary", ["rml", "strings"])
@pytest.mark.parametrize("trace", sorted(path.name for path in TRACES.iterdir()))
@pytest.mark.usefixtures("rosmonitoring")
def test_it_reads_our_verdicts_as_they_are_meant(trace: str, vocabulary: str, tmp_path: Path) -> None:
    alone = monitor(load(PRUNED))
    raw = {Verdict.TRUE: "false", Verdict.FALSE: "true", Verdict.UNKNOWN: "currently_true"}
    with (
        serving(PRUNED, "--vocabulary", vocabulary) as (_, url),
        closing(Client(generated(tmp_path, url, action="filter"), tmp_path)) as client,
    ):
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


@pytest.mark.usefixtures("rosmonitoring")
def test_an_error_reply_neither_stops_it_nor_counts_as_a_violation(tmp_path: Path) -> None:
    with serving(PRUNED) as (_, url), closing(Client(generated(tmp_path, url, action="log"), tmp_path)) as client:
        assert client.event({"topic": "/image", "data": "x" * 2_000_000})
        assert "error" in client.statuses()[-1]["oracle_response"]
        assert client.event({"topic": "/other"})
        assert [status["verdict_raw"] for status in client.statuses()] == ["currently_true", "currently_true"]
        assert (client.shutdowns, client.warnings) == (0, [])


@pytest.mark.usefixtures("rosmonitoring")
def test_a_passive_monitor_stops_at_a_detection(tmp_path: Path) -> None:
    events = list(read(TRACES / "table2_row1.jsonl"))
    detected = [verdict.final for verdict in monitor(load(PRUNED)).run(events)].index(True)
    with serving(PRUNED) as (_, url), closing(Client(generated(tmp_path, url, action="log"), tmp_path)) as client:
        for event in events[:detected]:
            client.event(event)
        assert client.shutdowns == 0
        client.event(events[detected])
        assert client.shutdowns == 1
