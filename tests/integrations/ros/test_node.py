"""The node of `docs/how-to/ros.md`, with stand-ins for `rclpy`; and what a message is as an event, which
is the same as in a recording.
"""

# ruff: noqa: ARG002 (what stands in for others takes what they take)

import array
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import rvaft
from tests.cli.runs import run
from tests.docs.examples import ROOT
from tests.readers.samples import BY_TOPIC, LOGS

MISSION = ROOT / "trees" / "remote_inspection" / "mission.rvaft"
TOPICS = "".join(f'topic "{topic}" type "robot_msgs.msg.{name}";\n' for topic, name in BY_TOPIC.items())
STAMP = 1_772_438_401_000_000_000


class Text:
    """What a string is as a message."""

    def __init__(self, data: str) -> None:
        self.data = data


class StandIn:
    """What the node asks of `rclpy.node.Node`."""

    tree: Path

    def __init__(self, name: str) -> None:
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.kinds: dict[str, type] = {}
        self.published: list[str] = []
        self.warned: list[str] = []
        self.timers: list[Callable[[], None]] = []
        self.now = STAMP

    def declare_parameter(self, name: str, value: str) -> SimpleNamespace:
        return SimpleNamespace(value=str(self.tree))

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        return SimpleNamespace(publish=lambda message: self.published.append(message.data))

    def create_subscription(self, kind: type, topic: str, callback: Callable[[Any], None], depth: int) -> None:
        self.callbacks[topic], self.kinds[topic] = callback, kind

    def create_timer(self, period: float, callback: Callable[[], None]) -> None:
        self.timers.append(callback)

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.now))

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(warning=self.warned.append)


def messages() -> list[tuple[Any, int, str]]:
    """The messages of the mission with their times and topics, as `rosbags` decodes them."""
    highlevel = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    with highlevel.AnyReader([LOGS / "mission.mcap"]) as bag:
        return [(bag.deserialize(data, one.msgtype), stamp, one.topic) for one, stamp, data in bag.messages()]


def test_a_message_is_the_event_that_a_recording_has() -> None:
    found = [rvaft.message_event(message, topic, stamp) for message, stamp, topic in messages()]
    assert repr(found) == repr([{**event} for event in rvaft.read_log(LOGS / "mission.mcap")])


def test_the_names_of_fields_are_those_of_the_definitions() -> None:
    """Neither the constants of a type nor the signs that Python needs after a word of its own."""
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
    from rvaft.readers.bag import _field_names

    for store in (typesys.Stores.LATEST, typesys.Stores.ROS1_NOETIC):
        types = typesys.get_typestore(store)
        for name, kind in types.types.items():
            assert _field_names(kind) == tuple(own for own, _ in types.fielddefs[name][1]), name


def of(kind: str, **values: Any) -> Any:
    """A message that says its fields as those of `rclpy` do."""
    made = type(kind, (), {"get_fields_and_field_types": staticmethod(lambda: dict.fromkeys(values, ""))})()
    vars(made).update(values)
    return made


def test_the_values_of_a_message_are_json() -> None:
    inner = [of("Status", level=b"\x02", hardware=["a", ""], values=[])]
    ranges, tags = array.array("f", [0.5, float("inf")]), [b"\x00", b"\x07"]
    message = of(
        "Scan",
        time=3,
        ranges=ranges,
        raw=array.array("B", [1, 2]),
        tags=tags,
        status=inner,
        ok=True,
        sole=of("One", x=1.5),
    )
    assert rvaft.message_event(message, "/scan", 7) == {
        "topic": "/scan",
        "time": 7,
        "message_time": 3,
        "ranges": [0.5, float("inf")],
        "raw": [1, 2],
        "tags": [0, 7],
        "status": [{"level": 2, "hardware": ["a", ""], "values": []}],
        "ok": True,
        "sole": {"x": 1.5},
    }
    assert rvaft.message_event(of("Empty"), "/scan", 7) == {"topic": "/scan", "time": 7}
    with pytest.raises(rvaft.OptionError, match="dict is not a ROS message"):
        rvaft.message_event({"data": 1}, "/scan", 7)


def node_of_the_page(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The node for a tree with the topics of the recording."""
    page = (ROOT / "docs" / "how-to" / "ros.md").read_text(encoding="utf-8").split("## A node of your own")[1]
    found = re.search(r"```py\n(.*?)```", page, re.DOTALL)
    assert found is not None
    tree = tmp_path / "mission.rvaft"
    tree.write_text(text + TOPICS, encoding="utf-8")
    spun: list[Any] = []
    monkeypatch.setattr(StandIn, "tree", tree, raising=False)
    kinds = {name: type(name, (), {}) for name in BY_TOPIC.values()}
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda: None, "spin": spun.append},
        "rclpy.node": {"Node": StandIn},
        "std_msgs": {},
        "std_msgs.msg": {"String": Text},
        "robot_msgs": {},
        "robot_msgs.msg": kinds,
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    names: dict[str, Any] = {}
    exec(found[1], names)
    names["main"]()
    (node,) = spun
    assert node.kinds == {topic: kinds[name] for topic, name in BY_TOPIC.items()}
    return node


def test_a_silent_topic_is_found_by_the_clock_of_ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The deadline counts from the time of arrival, and no further message comes."""
    topic = next(iter(BY_TOPIC))
    text = (
        f'semantics scattered; time time as ns; event beat() = {{ topic: "{topic}" }};'
        "lost fault on beat() without beat() for 2 s after;"
    )
    node = node_of_the_page(text, tmp_path, monkeypatch)
    (timer,) = node.timers
    timer()
    node.callbacks[topic](next(message for message, _, name in messages() if name == topic))
    for seconds, published in ((1, 0), (2, 0), (2.5, 1), (3, 1)):
        node.now = STAMP + int(seconds * 10**9)
        timer()
        assert len(node.published) == published, seconds
    assert node.published == ['{"branch": 1, "kinds": ["fault"], "matched": {"lost": [1]}}']


def test_the_node_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    node = node_of_the_page(MISSION.read_text(encoding="utf-8"), tmp_path, monkeypatch)
    assert node.timers == []
    tree = tmp_path / "mission.rvaft"
    for message, _, topic in messages():
        node.callbacks[topic](message)
    assert len(node.published) == 1
    recorded = run("monitor", tree, LOGS / "mission.mcap", "--repeat", "--format", "jsonl", "--detections").stdout
    assert '"branch": 2' in recorded
    assert node.published == ['{"branch": 2, "kinds": ["fault"], "matched": ' + matched(recorded) + "}"]
    assert node.warned


def matched(recorded: str) -> str:
    """The matched events in a line of `rvaft monitor`, as a text of JSON by node."""
    (line,) = recorded.splitlines()
    return json.dumps({one["node"]: [one["event"]] for one in json.loads(line)["matched"]})
