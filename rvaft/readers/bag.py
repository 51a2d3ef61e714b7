"""ROS recordings, read by `rosbags`: ROS 1 bags, rosbag2 folders and files, MCAP.

Messages in JSON and Protocol Buffers of MCAP are read by `mcap`. An event has the fields of a
message, `topic`, and `time`, the recording time in nanoseconds. Times in messages of ROS are objects
with `sec` and `nanosec`, also for ROS 1.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from keyword import iskeyword
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Final, cast

from rvaft.core.fields_to_read import TreeReads
from rvaft.errors import OptionError, ToolMissing, TraceError
from rvaft.model.event_time import TimeFormat
from rvaft.model.values import Json
from rvaft.readers.json_lines import decode, settled
from rvaft.readers.log import BAG_METADATA, InputOptions, Log, LogReader, suffix
from rvaft.readers.protocol_buffers import decoder

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Typestore
    from rosbags.interfaces.typing import Typesdict

TOPIC: Final = "topic"
TIME: Final = "time"
ELSEWHERE: Final = {name: f"message_{name}" for name in (TOPIC, TIME)}
_PLAIN: Final = frozenset({str, int, float, bool})
_IDL: Final = "=" * 80 + "\n"
"""The line before each part of a definition in IDL."""
_OF_FOXGLOVE: Final = "a file of --foxglove is for Foxglove, and --format jsonl writes detections that rvaft reads"
_FLOATS: Final = frozenset({"float32", "float64", "float128"})


class BagReader(LogReader):
    """ROS 1 and ROS 2 recordings.

    >>> BagReader.suffixes, BagReader.unit, BagReader.needs_file
    (('.bag', '.mcap', '.db3'), 'message', True)
    """

    name: ClassVar[str] = "bag"
    suffixes: ClassVar[tuple[str, ...]] = (".bag", ".mcap", ".db3")
    unit: ClassVar[str] = "message"
    needs_file: ClassVar[bool] = True
    takes: ClassVar[frozenset[str]] = frozenset({"messages"})

    @classmethod
    def suits(cls, path: Path, options: InputOptions) -> bool:  # noqa: ARG003
        """Whether the path has a suffix, or is a rosbag2 folder."""
        return suffix(path) in cls.suffixes or (path / BAG_METADATA).is_file()

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json] | None]]:
        """Yield the messages with their numbers, in time order."""
        try:
            from rosbags import rosbag1, rosbag2  # noqa: PLC0415
        except ImportError as error:
            raise ToolMissing("rosbags", remedy="pip install '.[bags]' in a checkout of rvaft") from error
        require_nanoseconds(log, "a recording")
        if log.path.is_file() and log.path.suffix.lower() == ".mcap" and _encodings(log) & _DECODED:
            yield from _mcap_events(log)
            return
        number, ros2 = 0, log.path.suffix != ".bag"
        try:
            with rosbag2.Reader(log.path) if ros2 else rosbag1.Reader(log.path) as bag:
                types = _RecordedTypes(bag.connections, ros2=ros2, folder=self.options.messages)
                decoders: dict[int, _Decoder] = {}
                for connection, stamp, data in bag.messages():
                    number += 1
                    decoder = decoders.get(id(connection))
                    if decoder is None:
                        decoder = decoders[id(connection)] = _Decoder(connection, types, log)
                    try:
                        event = None if decoder.idle else decoder.event(stamp, data)
                    except Exception as error:  # noqa: BLE001 (bytes that are no message raise anything)
                        log.reject(number, str(error) if isinstance(error, _Unread) else decoder.refusal(error))
                    else:
                        yield number, event
                if (lost := bag.message_count - number) > 0:
                    log.reject(
                        number + 1, f"the recording has {bag.message_count} by its index, but no more are found", lost
                    )
        except (OptionError, TraceError, ToolMissing):
            raise
        except Exception as error:
            reason = " ".join(str(error).split()).removesuffix(".") or type(error).__name__
            if reason == "Profile is not ros2":
                reason = f"it has no messages of ROS 2; {_OF_FOXGLOVE}"
            stored = sorted(one.name for one in log.path.glob("*") if suffix(one) in self.suffixes)
            mend = f"; read the storage file instead: {', '.join(stored)}" if stored else ""
            raise log.error_at(
                f"the recording cannot be read: {reason}{mend}", number + 1 if number else None
            ) from error


_DECODED: Final = frozenset({"json", "protobuf"})
"""The encodings of messages in MCAP that are read beside those of ROS."""


def _encodings(log: Log) -> frozenset[str]:
    """Return the encodings of the messages in a file of MCAP; none if it has no index."""
    try:
        from mcap.reader import make_reader  # noqa: PLC0415 -- imported on use
    except ImportError:
        return frozenset()
    with log.path.open("rb") as stream, suppress(Exception):  # a malformed file raises anything, and is read below
        summary = make_reader(stream).get_summary()
        channels = [] if summary is None else list(summary.channels.values())
        ours = channels and all(one.topic.startswith("/rvaft/") for one in channels)  # of --foxglove
        return frozenset() if ours else frozenset(one.message_encoding for one in channels)
    return frozenset()


def _mcap_events(log: Log) -> Iterator[tuple[int, dict[str, Json] | None]]:
    """Yield the messages in JSON and Protocol Buffers of a file of MCAP, in the order of their times."""
    from mcap.reader import make_reader  # noqa: PLC0415

    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    with log.path.open("rb") as stream:
        for number, (schema, channel, message) in enumerate(make_reader(stream).iter_messages(), 1):
            if not log.interest.may_be(TOPIC, channel.topic):
                yield number, None
                continue
            if channel.id not in decoders:
                decoders[channel.id] = _mcap_decoder(channel.message_encoding, schema, log, number, channel.topic)
            decode = decoders[channel.id]
            if decode is None:
                continue
            try:
                found = decode(message.data)
                fields = found if isinstance(found, dict) else {"value": found}
            except Exception as error:  # noqa: BLE001 (bytes that are no message raise anything)
                log.reject(number, f"no message on {channel.topic}: {' '.join(str(error).split())}")
                continue
            own = {ELSEWHERE.get(name, name): value for name, value in fields.items()}
            yield number, settled({TOPIC: channel.topic, TIME: message.log_time, **own}, log)


def _mcap_decoder(encoding: str, schema: Any, log: Log, number: int, topic: str) -> Callable[[bytes], Any] | None:
    """Return the function from bytes to fields of a channel, or None and a reason in the log."""
    if encoding == "json":
        return decode
    reason = f"messages in {encoding or 'no encoding'} are not read beside those in JSON and Protocol Buffers"
    if encoding == "protobuf":
        try:
            return decoder(schema.data, schema.name)
        except Exception as error:  # noqa: BLE001 (malformed descriptors raise anything)
            shown = " ".join(str(error).split()) or type(error).__name__
            reason = shown if isinstance(error, ToolMissing) else f"its schema cannot be used: {shown}"
    log.reject(number, f"{topic} is left out: {reason}")
    return None


def require_nanoseconds(log: Log, whose: str) -> None:
    """Raise `OptionError` if the tree of a log reads the field `time`, which has nanoseconds, in another format."""
    for time in log.reads.times if isinstance(log.reads, TreeReads) else ():
        if time.field == (TIME,) and time.format is not TimeFormat.NANOSECONDS:
            problem = f"the tree reads `{TIME}` as {time.format}, but {whose} has it as ns"
            raise OptionError(f"{problem}: write `time {TIME} as ns`")


class _Unread(ValueError):
    """The reason why a message was rejected."""


class _RecordedTypes:
    """The message types of a recording and, for those that it does not define, of the latest ROS.

    `broken` has the reason for each type whose definition cannot be used.
    """

    def __init__(self, connections: "Iterable[Connection]", *, ros2: bool, folder: str | None = None) -> None:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

        self.store: Typestore = get_typestore(Stores.EMPTY)
        self.deserialize = self.store.deserialize_cdr if ros2 else self.store.deserialize_ros1
        self.broken: dict[str, str] = {}
        for connection in connections:
            try:
                self.store.register(_defined(connection))
                name, digest = connection.msgtype, connection.digest
                own = self.store.hash_rihs01 if ros2 else lambda one: self.store.generate_msgdef(one)[1]
                if digest and name in self.store.fielddefs and own(name) != digest:
                    self.broken[name] = "the hash of its definition is not the recorded one"
            except Exception as error:  # noqa: BLE001 (a malformed definition raises anything)
                self.broken[connection.msgtype] = " ".join(str(error).split()) or type(error).__name__
        for name, found in _in_folder(folder).items() if folder is not None else ():
            if name not in self.store.fielddefs:
                self.store.register({name: found})
        usual = get_typestore(Stores.LATEST).fielddefs
        self.store.register({name: one for name, one in usual.items() if name not in self.store.fielddefs})


def _in_folder(folder: str) -> "Typesdict":
    """Return the types that the files `PACKAGE/msg/NAME.msg` below a folder define; raises `OptionError`."""
    from rosbags.typesys import get_types_from_msg  # noqa: PLC0415

    types = dict[str, Any]()
    if not Path(folder).is_dir():
        raise OptionError(f"{folder} is no folder with message definitions")
    for file in sorted(Path(folder).rglob("msg/*.msg")):
        name = f"{file.parent.parent.name}/msg/{file.stem}"
        try:
            types.update(get_types_from_msg(file.read_text(encoding="utf-8"), name))
        except Exception as error:
            raise OptionError(f"{file} defines no message: {' '.join(str(error).split())}") from error
    return types


def _defined(connection: "Connection") -> "Typesdict":
    """Return the types that a connection defines."""
    from rosbags.interfaces import MessageDefinitionFormat  # noqa: PLC0415
    from rosbags.typesys import get_types_from_idl, get_types_from_msg  # noqa: PLC0415

    text, types = connection.msgdef.data, dict[str, Any]()
    match connection.msgdef.format:
        case MessageDefinitionFormat.NONE:
            pass
        case MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(text, connection.msgtype))
        case MessageDefinitionFormat.IDL:
            parts = text.split(_IDL)[1:] if text.startswith(f"{_IDL}IDL: ") else [f"\n{text}"]
            for part in parts:
                types.update(get_types_from_idl(part.partition("\n")[2]))
    return types


class _Decoder:
    """The decoder of one connection, `idle` without interest."""

    def __init__(self, connection: "Connection", recorded: _RecordedTypes, log: Log) -> None:
        self._connection = connection  # its id must stay unique
        self._topic, self._type, self._log = connection.topic, connection.msgtype, log
        self._deserialize, types = recorded.deserialize, recorded.store
        self.idle = not log.interest.may_be(TOPIC, connection.topic)
        self._names: tuple[str, ...] = ()
        self._keys: tuple[str, ...] = ()
        self._odd, self._unread = False, ""
        if not self.idle and connection.msgtype in recorded.broken:
            reason = recorded.broken[connection.msgtype]
            self._unread = f"{self._topic} is left out: the definition of {self._type} cannot be used: {reason}"
        elif not self.idle:
            try:
                defined = [name for name, _ in types.fielddefs[connection.msgtype][1]]
                wanted = log.interest.fields
                self._names = tuple(one for one in defined if wanted is None or ELSEWHERE.get(one, one) in wanted)
                self._keys = tuple(ELSEWHERE.get(name, name) for name in self._names)
                self._odd = not _FLOATS.isdisjoint(_parts(types, connection.msgtype, self._names))
            except KeyError as error:
                self._unread = f"the type {error.args[0]}, of {self._topic}, is not defined in the recording"

    def event(self, stamp: int, data: bytes) -> dict[str, Json]:
        """Return the event of a message; raises any exception of the library."""
        if self._unread:
            raise _Unread(self._unread)
        event: dict[str, Json] = {TOPIC: self._topic, TIME: stamp}
        if self._names:
            event |= _fields(self._deserialize(data, self._type), self._names, self._keys)
        return settled(event, self._log) if self._odd else event

    def refusal(self, error: Exception) -> str:
        """Return the reason for rejecting a message after an error."""
        return (
            f"no message of the type {self._type} on {self._topic}: "
            f"{' '.join(str(error).split()) or type(error).__name__}"
        )


def message_event(message: object, topic: str, time: int) -> dict[str, Json]:
    """Return the event of a ROS message: its fields, `topic`, and `time` in nanoseconds.

    Raises `OptionError` for an object that is no message of `rclpy` or `rosbags`.

    >>> from dataclasses import make_dataclass
    >>> Command = make_dataclass("Command", ["name", "waypoint"])
    >>> message_event(Command("inspect", 3), "/command", 1772438401_000000000)
    {'topic': '/command', 'time': 1772438401000000000, 'name': 'inspect', 'waypoint': 3}
    """
    return {TOPIC: topic, TIME: time, **_object(message, ELSEWHERE)}


def _object(message: object, elsewhere: Mapping[str, str] = MappingProxyType({})) -> dict[str, Json]:
    kind: Any = type(message)
    names = _field_names(kind)
    return _fields(message, names, [elsewhere.get(name, name) for name in names])


@cache
def _field_names(kind: type) -> Sequence[str]:
    if (fields_of_message := getattr(kind, "get_fields_and_field_types", None)) is not None:
        return tuple(fields_of_message())
    if not is_dataclass(kind):
        raise OptionError(f"{kind.__name__} is not a ROS message")
    names = [one.name for one in fields(kind) if "ClassVar" not in str(one.type)]  # class variables are constants
    return tuple(name[:-1] if iskeyword(name[:-1]) else name for name in names)


def _fields(message: object, names: Sequence[str], keys: Sequence[str]) -> dict[str, Json]:
    values = _getter(names)(message)
    return {key: value if type(value) in _PLAIN else _json(value) for key, value in zip(keys, values, strict=True)}


@cache
def _getter(names: Sequence[str]) -> Callable[[object], Sequence[object]]:
    own = [f"{name}_" if iskeyword(name) else name for name in names]
    return attrgetter(*own) if len(own) > 1 else lambda message: [getattr(message, name) for name in own]


def _json(value: object) -> Json:
    match value:
        case str() | int() | float():
            return value
        case bytes():
            return value[0] if len(value) == 1 else list(value)
        case list() | tuple():
            return [one if type(one) in _PLAIN else _json(one) for one in value]
        case _ if hasattr(value, "tolist"):
            found: Json = value.tolist()
            return found
        case _:
            return _object(value)


def _parts(types: "Typestore", name: str, fields: Collection[str] | None = None) -> set[str]:
    """Return the basic types in a message type; raises `KeyError`."""
    agenda: list[tuple[str, Collection[str] | None]] = [(name, fields)]
    found, seen = set[str](), {name}
    while agenda:
        one, chosen = agenda.pop()
        for own, how in types.fielddefs[one][1]:
            kind, about = cast("tuple[Any, Any]", how)  # rosbags nests types in several ways
            base, of = (kind, about) if kind.name in ("BASE", "NAME") else about[0]
            if chosen is not None and own not in chosen:
                continue
            if base.name == "BASE":
                found.add(of[0])
            elif of not in seen:
                seen.add(of)
                agenda.append((of, None))
    return found
