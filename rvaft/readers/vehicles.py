"""Recordings of vehicles, read by libraries of the extra `vehicles`: ULog of PX4, MAVLink and DataFlash of ArduPilot,
and CAN logs of Vector, whose frames a DBC file decodes.

An event has the fields of a message, its name in `message`, and `time` in nanoseconds.
"""

import logging
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, redirect_stdout
from functools import partial
from heapq import merge
from importlib import import_module
from io import StringIO, TextIOWrapper
from typing import Any, ClassVar, Final

from rvaft.errors import OptionError, RvaftError, ToolMissing
from rvaft.model.values import Json, as_json
from rvaft.readers.bag import TIME, require_nanoseconds
from rvaft.readers.json_lines import settled
from rvaft.readers.log import Log, LogReader

MESSAGE: Final = "message"
"""The field with the name of a message."""
_ELSEWHERE: Final = {MESSAGE: "message_field", TIME: "time_field"}
"""The names of fields of messages that have those of an event."""
_MICROSECOND: Final = 1_000
_DATAFLASH: Final = b"\xa3\x95"
"""The first bytes of each message of a DataFlash log."""


class RecordingReader(LogReader):
    """A recording that a library reads from a file."""

    unit: ClassVar[str] = "message"
    needs_file: ClassVar[bool] = True
    what: ClassVar[str]

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json] | None]]:
        """Yield the messages with their numbers, None if irrelevant."""
        require_nanoseconds(log, self.what)
        number = 0
        try:
            for name, time, fields in self.messages(log):
                number += 1
                if not log.interest.may_be(MESSAGE, name):
                    yield number, None
                    continue
                own = {_ELSEWHERE.get(key, key): value for key, value in fields.items()}
                yield number, settled(dict(as_json({MESSAGE: name, TIME: time, **own})), log)
        except RvaftError:
            raise
        except Exception as error:  # a malformed recording raises anything
            reason = " ".join(str(error).split()).removesuffix(".") or type(error).__name__
            raise log.error_at(f"{self.what} cannot be read: {reason}", number + 1 if number else None) from error
        if not number:
            raise log.error_at(f"{self.what} has no message", None)

    @abstractmethod
    def messages(self, log: Log) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Yield the name of each message, its time in nanoseconds, and its fields."""


class ULogReader(RecordingReader):
    """ULog of PX4; a message has the name of its topic, and `instance` the number of its sender.

    >>> ULogReader.suffixes, ULogReader.needs_file
    (('.ulg',), True)
    """

    name: ClassVar[str] = "ulog"
    suffixes: ClassVar[tuple[str, ...]] = (".ulg",)
    what: ClassVar[str] = "the ULog"

    def messages(self, log: Log) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Yield the messages of all topics in the order of their times."""
        with log.path.open("rb") as stream:
            found = _quietly(_library("pyulog").ULog, stream)
        rows = [_rows(one.name, one.multi_id, one.data) for one in found.data_list]
        return merge(*rows, key=lambda row: row[1])


def _rows(name: str, instance: int, data: Mapping[str, Any]) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
    times = data["timestamp"].tolist()
    columns = {field: values.tolist() for field, values in data.items() if field != "timestamp"}
    for place, time in enumerate(times):
        yield name, time * _MICROSECOND, {"instance": instance, **{key: one[place] for key, one in columns.items()}}


class MavlinkReader(RecordingReader):
    """Logs of MAVLink (`.tlog`), and DataFlash logs of ArduPilot (`.bin`).

    >>> MavlinkReader.suffixes
    ('.tlog', '.bin')
    """

    name: ClassVar[str] = "mavlink"
    suffixes: ClassVar[tuple[str, ...]] = (".tlog", ".bin")
    what: ClassVar[str] = "the log of MAVLink"

    def messages(self, log: Log) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Yield the messages in their order; bytes that are no message are left out."""
        connect = _library("pymavlink.mavutil").mavlink_connection
        with log.path.open("rb") as stream:
            if log.path.suffix.lower() == ".bin" and stream.read(2) != _DATAFLASH:
                raise log.error_at("no DataFlash log of ArduPilot: it begins otherwise", None)
        with closing(_quietly(connect, str(log.path))) as recording:
            while (message := _quietly(recording.recv_match, blocking=False)) is not None:
                fields = message.to_dict()
                kind = fields.pop("mavpackettype")
                if kind == "BAD_DATA":
                    continue
                yield kind, round(message._timestamp * 1_000_000) * _MICROSECOND, fields  # noqa: SLF001 (as documented)


class CanReader(RecordingReader):
    """CAN logs of Vector (`.asc`, `.blf`); a DBC file names the messages and their signals.

    Without it, `message` is the identifier in hexadecimal digits and `data` has the bytes.

    >>> CanReader.suffixes, sorted(CanReader.takes)
    (('.asc', '.blf'), ['dbc'])
    """

    name: ClassVar[str] = "can"
    suffixes: ClassVar[tuple[str, ...]] = (".asc", ".blf")
    takes: ClassVar[frozenset[str]] = frozenset({"dbc"})
    what: ClassVar[str] = "the CAN log"

    def messages(self, log: Log) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Yield the frames in their order; those that the DBC file does not name are left out."""
        decode = _raw if self.options.dbc is None else partial(_decoded, _signals(self.options.dbc), log)
        library = _library("can")
        logging.getLogger("can").setLevel(logging.ERROR)
        with log.path.open("rb") as stream:
            text = log.path.suffix.lower() == ".asc"
            lines = partial(library.ASCReader, TextIOWrapper(stream, "utf-8", "replace"), relative_timestamp=False)
            for place, frame in enumerate(lines() if text else library.BLFReader(stream), 1):
                if frame.is_error_frame or frame.is_remote_frame:
                    continue
                found = decode(place, frame)
                if found is not None:
                    name, fields = found
                    time = round(frame.timestamp * 1_000_000) * _MICROSECOND
                    yield name, time, {"channel": frame.channel, **fields}


def _raw(_place: int, frame: Any) -> tuple[str, Mapping[str, Any]]:
    return f"{frame.arbitration_id:X}", {"data": frame.data.hex()}


def _signals(file: str) -> Any:
    """Load a DBC file; raises `OptionError`."""
    cantools = _library("cantools")
    try:
        return cantools.database.load_file(file)
    except OSError as error:
        raise OptionError(f"{file}: {error.strerror}") from error
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise OptionError(f"{file} is no DBC file that cantools reads: {reason}") from error


def _decoded(signals: Any, log: Log, place: int, frame: Any) -> tuple[str, Mapping[str, Any]] | None:
    try:
        known = signals.get_message_by_frame_id(frame.arbitration_id)
    except KeyError:
        return None
    try:
        values = known.decode(bytes(frame.data), decode_choices=True, allow_truncated=False)
    except Exception as error:  # noqa: BLE001 (a frame that does not fit raises several errors)
        log.reject(place, f"a frame is no {known.name}: {' '.join(str(error).split())}")
        return None
    return known.name, {key: getattr(value, "name", value) for key, value in values.items()}


def _quietly(call: Callable[..., Any], *args: Any, **options: Any) -> Any:
    """Return the result of a call that may print what it skips."""
    with redirect_stdout(StringIO()):
        return call(*args, **options)


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ToolMissing(package, remedy="pip install '.[vehicles]' in a checkout of rvaft") from error
