"""The logs of `docs/logs` that are no text; `python -m tests.readers.samples` writes them anew.

And recordings as large as a test wants them.
"""

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.docs.examples import ROOT

LOGS: Final = ROOT / "docs" / "logs"
DOORS: Final = LOGS / "doors.csv"
MISSION: Final = ROOT / "trees" / "remote_inspection" / "mission.traces" / "ten_seconds.jsonl"
TYPES: Final = {
    "robot_msgs/msg/Command": "std_msgs/Header header\nstring name\nint32 waypoint\n",
    "robot_msgs/msg/Result": "std_msgs/Header header\nint32 waypoint\nstring result\n",
    "robot_msgs/msg/Radiation": "std_msgs/Header header\nfloat64 value\n",
    "robot_msgs/msg/Goal": "std_msgs/Header header\nint32 goal\n",
    "robot_msgs/msg/Battery": "std_msgs/Header header\nfloat64 voltage\nfloat64 temperature\n"
    "float64 current\nfloat64 charge\nfloat64 percentage\n",
}
"""The messages of the mission, in types of its own."""
INERTIA: Final = ("orientation", "angular_velocity", "linear_acceleration")
BY_TOPIC: Final = {
    "/command": "Command",
    "/move_base/result": "Result",
    "/radiation_sensor_plugin/sensor_0": "Radiation",
    "/move_base/goal": "Goal",
    "/battery_state": "Battery",
}


def mission() -> Iterator[dict[str, Any]]:
    """The events of a short mission."""
    return map(json.loads, MISSION.read_text(encoding="utf-8").splitlines())


def write_table(path: Path) -> None:
    """The table of doors in Parquet, with times that are times."""
    import pyarrow as pa
    from pyarrow import compute, parquet

    rows = list(csv.DictReader(DOORS.read_text(encoding="utf-8").splitlines()))
    table = pa.Table.from_pylist(rows)
    stamps = compute.strptime(table["time"], format="%Y-%m-%dT%H:%M:%SZ", unit="ms").cast(pa.timestamp("ms", "UTC"))
    badges = pa.array([int(row["badge"]) if row["badge"] else None for row in rows])
    parquet.write_table(table.set_column(0, "time", stamps).set_column(2, "badge", badges), path)


def write_recording(path: Path, events: list[dict[str, Any]], *, ros1: bool = False, mcap: bool = True) -> None:
    """A recording of events of the mission, one every second."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in TYPES.items():
        types.register(get_types_from_msg(text, name))
    make: dict[str, Any] = types.types
    serialize = types.serialize_ros1 if ros1 else types.serialize_cdr
    plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
    with rosbag1.Writer(path) if ros1 else rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}
        for number, event in enumerate(events):
            topic, fields = event["topic"], {name: event[name] for name in event if name not in ("topic", "header")}
            kind = f"robot_msgs/msg/{BY_TOPIC[topic]}"
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=types)
            stamp = make["builtin_interfaces/msg/Time"](**event["header"]["stamp"])
            header = {"stamp": stamp, "frame_id": "", **({"seq": number} if ros1 else {})}
            message = make[kind](header=make["std_msgs/msg/Header"](**header), **fields)
            writer.write(topics[topic], 1772438400_000000000 + number * 1_000_000_000, serialize(message, kind))


def write_telemetry(path: Path, messages: int) -> None:
    """A recording of a robot that is mostly measured: of twenty messages nineteen are of its
    inertia, and one moves it or inspects a place.
    """
    import numpy
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(TYPES["robot_msgs/msg/Command"], "robot_msgs/msg/Command"))
    make: dict[str, Any] = types.types
    command, imu = "robot_msgs/msg/Command", "sensor_msgs/msg/Imu"
    vector, zeros = make["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=9.81), [0.0] * 9
    with Writer(path, version=9) as writer:
        topics = {"/command": command, "/imu": imu}
        connections = {kind: writer.add_connection(topic, kind, typestore=types) for topic, kind in topics.items()}
        for number in range(messages):
            stamp = make["builtin_interfaces/msg/Time"](sec=1_772_438_400 + number // 100, nanosec=number % 100 * 10**7)
            header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
            kind = imu if number % 20 else command
            if kind == command:
                name = ("move", "inspect")[number // 20 % 2]
                message = make[command](header=header, name=name, waypoint=number // 40)
            else:
                turned = make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
                covariance = {f"{one}_covariance": numpy.array(zeros) for one in INERTIA}
                message = make[imu](
                    header=header, orientation=turned, angular_velocity=vector, linear_acceleration=vector, **covariance
                )
            time = 1_772_438_400_000_000_000 + number * 10_000_000
            writer.write(connections[kind], time, types.serialize_cdr(message, kind))


if __name__ == "__main__":
    write_table(LOGS / "doors.parquet")
    folder = LOGS / "mission"
    write_recording(folder, list(mission()))
    shutil.move(next(folder.glob("*.mcap")), LOGS / "mission.mcap")
    shutil.rmtree(folder)
