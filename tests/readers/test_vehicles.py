"""Recordings of vehicles: ULog of PX4, MAVLink, DataFlash of ArduPilot, CAN logs with and without a DBC file."""

import struct
from pathlib import Path
from typing import Any

import pytest

import rvaft
from rvaft import OptionError, TraceError
from tests.cli.runs import failed, run, written

pytest.importorskip("pyulog", reason="needs the extra vehicles")
mavutil = pytest.importorskip("pymavlink.mavutil", reason="needs the extra vehicles")
can = pytest.importorskip("can", reason="needs the extra vehicles")
pytest.importorskip("cantools", reason="needs the extra vehicles")

DBC = """VERSION ""

BU_: ECU

BO_ 291 Engine: 8 ECU
 SG_ Speed : 0|16@1+ (0.1,0) [0|6000] "rpm" ECU
 SG_ Gear : 16|8@1+ (1,0) [0|5] "" ECU

VAL_ 291 Gear 0 "neutral" 1 "first" ;
"""


def ulog(path: Path) -> Path:
    """A ULog with two topics: battery at 1 s and 3 s, command at 2 s."""

    def part(kind: str, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), ord(kind)) + data

    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + part("B", bytes(40))
    formats = [b"battery:uint64_t timestamp;float voltage;", b"command:uint64_t timestamp;uint32_t id;char[4] name;"]
    subscribed = [struct.pack("<BH", 0, number) + name for number, name in enumerate((b"battery", b"command"))]
    data = [
        struct.pack("<HQf", 0, 1_000_000, 12.5),
        struct.pack("<HQI4s", 1, 2_000_000, 7, b"land"),
        struct.pack("<HQf", 0, 3_000_000, 9.5),
    ]
    parts = [
        *(part("F", one) for one in formats),
        *(part("A", one) for one in subscribed),
        *(part("D", one) for one in data),
    ]
    path.write_bytes(head + b"".join(parts))
    return path


def tlog(path: Path) -> Path:
    """A telemetry log with a heartbeat and a status text."""
    from pymavlink.dialects.v20 import common

    link = common.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = link.heartbeat_encode(2, 3, 81, 4, 4).pack(link)
    text = link.statustext_encode(4, b"low battery").pack(link)
    rows = ((1_700_000_000_000_000, beat), (1_700_000_001_500_000, text))
    path.write_bytes(b"".join(struct.pack(">Q", time) + data for time, data in rows))
    return path


def dataflash(path: Path) -> Path:
    """A DataFlash log of ArduPilot with two messages of a type BAT."""

    def form(number: int, length: int, name: bytes, types: bytes, columns: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name, types, columns)

    defined = form(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns") + form(
        1, 15, b"BAT", b"Qf", b"TimeUS,Volt"
    )
    rows = b"".join(
        b"\xa3\x95\x01" + struct.pack("<Qf", time, volt) for time, volt in ((1_000_000, 12.5), (2_000_000, 9.5))
    )
    path.write_bytes(defined + rows)
    return path


def frames(path: Path) -> Path:
    """A CAN log with two frames of Engine, one that the DBC file does not name, and a short one."""
    with can.Logger(str(path)) as log:
        for time, number, data in (
            (1.0, 291, b"\x10\x27\x01\0\0\0\0\0"),
            (1.5, 800, b"\x01"),
            (2.0, 291, b"\x00\x00\x00\0\0\0\0\0"),
            (2.5, 291, b"\x01"),
        ):
            log(can.Message(timestamp=time, arbitration_id=number, data=data, is_extended_id=False, channel=0))
    return path


def test_topics_of_px4_are_events_in_time_order(tmp_path: Path) -> None:
    events = list(rvaft.read_log(ulog(tmp_path / "flight.ulg")))
    assert [(one["message"], one["time"], one["instance"]) for one in events] == [
        ("battery", 10**9, 0),
        ("command", 2 * 10**9, 0),
        ("battery", 3 * 10**9, 0),
    ]
    assert (events[0]["voltage"], events[1]["id"], events[2]["voltage"]) == (12.5, 7, 9.5)


def test_mavlink_and_dataflash(tmp_path: Path) -> None:
    events = list(rvaft.read_log(tlog(tmp_path / "flight.tlog")))
    assert [(one["message"], one["time"]) for one in events] == [
        ("HEARTBEAT", 1_700_000_000_000_000_000),
        ("STATUSTEXT", 1_700_000_001_500_000_000),
    ]
    assert (events[0]["type"], events[1]["text"]) == (2, "low battery")
    bats = [one for one in rvaft.read_log(dataflash(tmp_path / "flight.bin")) if one["message"] == "BAT"]
    assert [one["Volt"] for one in bats] == [12.5, 9.5]
    assert bats[1]["time"] - bats[0]["time"] == 10**9


@pytest.mark.parametrize("name", ["drive.asc", "drive.blf"])
def test_can_frames_are_signals_by_a_dbc_file(tmp_path: Path, name: str) -> None:
    log, dbc = frames(tmp_path / name), written(tmp_path / "car.dbc", DBC)
    events: list[dict[str, Any]] = []
    with pytest.raises(TraceError, match=r"message 4: a frame is no Engine: .* \(1 message left out\)"):
        events.extend(rvaft.read_log(log, dbc=str(dbc)))
    assert [(one["message"], one["Speed"], one["Gear"]) for one in events] == [
        ("Engine", 1000.0, "first"),
        ("Engine", 0.0, "neutral"),
    ]
    raw = list(rvaft.read_log(log))
    assert [(one["message"], one["data"]) for one in raw][:2] == [("123", "1027010000000000"), ("320", "01")]
    assert [one["time"] - raw[0]["time"] for one in raw] == [0, 5 * 10**8, 10**9, 15 * 10**8]
    tree = written(
        tmp_path / "stall.rvaft",
        "time time as ns; semantics scattered;"
        ' event engine(speed, gear) = { message: "Engine", Speed: speed, Gear: gear };'
        ' top sand fast still; fast on engine(S, "first") when S > 900; still on engine(0, "neutral");',
    )
    found = run("monitor", tree, log, "--dbc", dbc)
    assert "event 2: true" in found.output
    assert found.exit_code == 2  # a frame was left out


def test_a_vehicle_is_monitored(tmp_path: Path) -> None:
    text = 'time time as ns; event battery(v) = { message: "battery", voltage: v }; low on battery(V) when V < 10;'
    tree = written(tmp_path / "low.rvaft", text)
    assert "event 3: true" in run("monitor", tree, ulog(tmp_path / "flight.ulg"), "--semantics", "scattered").output
    wrong = written(tmp_path / "wrong.rvaft", text.replace("as ns", "as s"))
    failed(run("monitor", wrong, tmp_path / "flight.ulg"), "the ULog has it as ns")


def test_messages_in_json_of_mcap_are_events(tmp_path: Path) -> None:
    writing = pytest.importorskip("mcap.writer", reason="needs the extra bags")
    log = tmp_path / "drive.mcap"
    with log.open("wb") as stream:
        writer = writing.Writer(stream)
        writer.start()
        schema = writer.register_schema(name="x", encoding="jsonschema", data=b"{}")
        for topic, encoding in (("/battery", "json"), ("/other", "cbor")):
            channel = writer.register_channel(topic=topic, message_encoding=encoding, schema_id=schema)
            for time, data in ((1, b'{"level": 50, "time": "x"}'), (2, b'{"level": 9}'), (3, b"no")):
                stamp = {"log_time": time * 10**9, "publish_time": 0}
                writer.add_message(channel_id=channel, data=data, **stamp)
        writer.finish()
    events: list[dict[str, Any]] = []
    with pytest.raises(TraceError, match=r"messages? left out"):
        events.extend(rvaft.read_log(log))
    assert events == [
        {"topic": "/battery", "time": 10**9, "level": 50, "message_time": "x"},
        {"topic": "/battery", "time": 2 * 10**9, "level": 9},
    ]
    text = 'time time as ns; event battery(v) = { topic: "/battery", level: v }; low on battery(V) when V < 10;'
    tree = written(tmp_path / "low.rvaft", text)
    found = run("monitor", tree, log, "--semantics", "scattered")
    assert ": true" in found.output


def protobuf_recording(file: Path, schema: str = "drone.Battery") -> Path:
    """A recording of `/battery`: one message with all kinds of fields, one with none, and bytes that are none."""
    writing = pytest.importorskip("mcap.writer", reason="needs the extra bags")
    described = pytest.importorskip("google.protobuf.descriptor_pb2", reason="needs the extra bags")
    factory = pytest.importorskip("google.protobuf.message_factory")
    pool = pytest.importorskip("google.protobuf.descriptor_pool").DescriptorPool()
    stamps = pytest.importorskip("google.protobuf.timestamp_pb2")
    kinds = described.FieldDescriptorProto
    one, many = kinds.LABEL_OPTIONAL, kinds.LABEL_REPEATED
    battery = described.FileDescriptorProto(name="battery.proto", package="drone", syntax="proto3")
    battery.dependency.append("google/protobuf/timestamp.proto")
    state = battery.enum_type.add(name="State")
    for number, name in enumerate(("OK", "LOW")):
        state.value.add(name=name, number=number)
    message = battery.message_type.add(name="Battery")
    inner = message.nested_type.add(name="CellsEntry")
    inner.options.map_entry = True
    inner.field.add(name="key", number=1, type=kinds.TYPE_INT32, label=one)
    inner.field.add(name="value", number=2, type=kinds.TYPE_DOUBLE, label=one)
    for number, (name, kind, label, type_name) in enumerate(
        [
            ("level", kinds.TYPE_INT64, one, None),
            ("time", kinds.TYPE_STRING, one, None),
            ("state", kinds.TYPE_ENUM, one, ".drone.State"),
            ("stamp", kinds.TYPE_MESSAGE, one, ".google.protobuf.Timestamp"),
            ("raw", kinds.TYPE_BYTES, one, None),
            ("volts", kinds.TYPE_DOUBLE, many, None),
            ("cells", kinds.TYPE_MESSAGE, many, ".drone.Battery.CellsEntry"),
        ],
        1,
    ):
        message.field.add(name=name, number=number, type=kind, label=label, type_name=type_name)
    time = described.FileDescriptorProto.FromString(stamps.DESCRIPTOR.serialized_pb)
    for own in (time, battery):
        pool.AddSerializedFile(own.SerializeToString())
    battery_class = factory.GetMessageClass(pool.FindMessageTypeByName("drone.Battery"))
    full = battery_class(level=2**53 + 1, time="x", state=1, raw=b"\x01\xff", volts=[3.5, 4.0], cells={2: 1.5})
    full.stamp.FromNanoseconds(1_500_000_007)
    files = described.FileDescriptorSet(file=[battery, time]).SerializeToString()  # importing before imported
    with file.open("wb") as stream:
        writer = writing.Writer(stream)
        writer.start()
        number = writer.register_schema(name=schema, encoding="protobuf", data=files)
        channel = writer.register_channel(topic="/battery", message_encoding="protobuf", schema_id=number)
        for second, data in enumerate((full.SerializeToString(), b"", b"\xff"), 1):
            writer.add_message(channel_id=channel, data=data, log_time=second * 10**9, publish_time=0)
        writer.finish()
    return file


def test_messages_of_protocol_buffers_are_events(tmp_path: Path) -> None:
    log = protobuf_recording(tmp_path / "drive.mcap")
    events: list[dict[str, Any]] = []
    with pytest.raises(TraceError, match="no message on /battery"):
        events.extend(rvaft.read_log(log))
    first = {"topic": "/battery", "time": 10**9, "level": 2**53 + 1, "message_time": "x", "state": "LOW"}
    more = {"stamp": {"sec": 1, "nanosec": 500_000_007}, "raw": [1, 255], "volts": [3.5, 4.0], "cells": {"2": 1.5}}
    unset = {"level": 0, "message_time": "", "state": "OK", "raw": [], "volts": [], "cells": {}}
    assert events == [first | more, {"topic": "/battery", "time": 2 * 10**9, **unset}]
    text = 'time time as ns; event battery(v) = { topic: "/battery", level: v }; low on battery(V) when V < 10;'
    tree = written(tmp_path / "low.rvaft", text)
    found = run("monitor", tree, log, "--semantics", "scattered")
    assert "event 2: true" in found.output
    other = protobuf_recording(tmp_path / "other.mcap", "drone.None")
    with pytest.raises(TraceError, match="/battery is left out: its schema cannot be used"):
        list(rvaft.read_log(other))


@pytest.mark.parametrize("name", ["flight.ulg", "flight.tlog", "flight.bin", "drive.asc", "drive.blf"])
@pytest.mark.parametrize("data", [b"", b"nothing of the kind", bytes(range(256)) * 20])
def test_what_is_no_recording_is_an_error(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(TraceError, match=name):
        list(rvaft.read_log(tmp_path / name))


def test_a_recording_that_is_cut_keeps_what_it_has(tmp_path: Path) -> None:
    whole = ulog(tmp_path / "flight.ulg").read_bytes()
    (tmp_path / "flight.ulg").write_bytes(whole[:-3])
    assert len(list(rvaft.read_log(tmp_path / "flight.ulg"))) == 2


def test_a_wrong_dbc_file_is_refused(tmp_path: Path) -> None:
    log = frames(tmp_path / "drive.asc")
    for name, text, why in (("no.dbc", None, "No such file"), ("bad.dbc", "BO_ nothing", "is no DBC file")):
        if text is not None:
            written(tmp_path / name, text)
        with pytest.raises(OptionError, match=why):
            list(rvaft.read_log(log, dbc=str(tmp_path / name)))
    failed(run("fields", log, "--dbc", tmp_path / "no.dbc"), "No such file")
    failed(run("fields", ulog(tmp_path / "a.ulg"), "--dbc", tmp_path / "no.dbc"), "--dbc is not for the format ulog")
