"""Messages of MQTT as they come, read by `paho-mqtt`.

`mqtt://HOST[:PORT]/TOPIC`, where the topic may have the wildcards `+` and `#`.

An event is a payload, a JSON object, with `topic` and `time`, the nanoseconds at which it came, as
in recordings of ROS. What MQTT loses is told where it was lost: messages while the connection was,
those for which there was no room, a payload that is no JSON object, and a message that was retained
from before, which is no event.
"""

import os
import re
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from functools import partial
from secrets import token_hex
from threading import Condition, Event, Thread
from time import monotonic, time_ns
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, Self
from urllib.parse import parse_qsl, unquote, urlsplit

from rvaft.errors import OptionError, RvaftError, ToolMissing, installed
from rvaft.model.values import Json
from rvaft.readers.bag import ELSEWHERE, TIME, TOPIC
from rvaft.readers.json_lines import HINT, RepeatingObject, decode
from rvaft.readers.log import Log, LogReader

if TYPE_CHECKING:
    from paho.mqtt.client import MQTTMessage

ROOM: Final = 64 * 1024 * 1024
"""Bytes of messages that wait for the monitor; others are lost, and that is told."""
USER: Final = "MQTT_USERNAME"
PASSWORD: Final = "MQTT_PASSWORD"  # noqa: S105 (the name of the variable that has it)
_EACH: Final = 500
"""Bytes that a message takes beside its payload."""
_POLL: Final = 0.2
"""Seconds between two looks at whether somebody asked for the end."""
_PATIENCE: Final = 15.0
"""Seconds in which a broker has to answer."""
_ALIVE: Final = 30
"""Seconds of silence after which the broker is asked whether it is there."""
_SESSION: Final = 3600
"""Seconds for which the broker shall keep messages for a connection that was lost."""
_QOS: Final = {"0": 0, "1": 1, "2": 2}
_VERSIONS: Final = {"3.1.1": 4, "5": 5}
_FILTER: Final = re.compile(r"(?:(?:[^+#/\0]*|\+)/)*(?:[^+#/\0]*|\+|#)")
_HOW: Final = "a URL of MQTT is mqtt://HOST[:PORT]/TOPIC or mqtts://…, with / and @ in a password as %2F and %40"


class Address(NamedTuple):
    """What a URL says: where the broker is, who asks, and for which messages.

    >>> address = Address.parse("mqtts://bob:secret@broker.example/doors/+/#?qos=1")
    >>> address.host, address.port, address.topic, address.qos, address.shown
    ('broker.example', 8883, 'doors/+/#', 1, 'mqtts://broker.example/doors/+/#')
    """

    secure: bool
    host: str
    port: int
    user: str | None
    password: str | None
    topic: str
    qos: int
    version: int
    shown: str

    @classmethod
    def parse(cls, url: str, environment: Mapping[str, str] = os.environ) -> Self:
        """The user and the password that the URL does not name are in the environment; raises
        `OptionError`, which does not repeat the URL.
        """
        scheme, _, rest = url.partition("://")
        authority, _, path = rest.partition("/")
        said, _, place = authority.rpartition("@")
        written, _, query = path.partition("?")
        secure, topic = scheme.lower() == "mqtts", unquote(written)
        try:
            found = urlsplit(f"//{place}")
            host, port = found.hostname, found.port
            asked = dict(parse_qsl(query, keep_blank_values=True, strict_parsing=True)) if query else {}
        except ValueError:
            raise OptionError(_HOW) from None
        if not host or not topic:
            raise OptionError(_HOW)
        if not _FILTER.fullmatch(topic) or len(topic.encode()) > 0xFFFF:
            why = "+ stands for a whole level, # for all at the end"
            raise OptionError(f"{topic[:80]!r} is no topic filter of MQTT: {why}")
        for name, value in asked.items():
            known = {"qos": _QOS, "version": _VERSIONS}.get(name)
            if known is None or value not in known:
                raise OptionError(
                    "behind ? a URL of MQTT says qos=0, 1 or 2, and version=3.1.1 or 5; a ? in a topic is %3F"
                )
        user, _, password = said.partition(":")
        return cls(
            secure,
            host,
            port or (8883 if secure else 1883),
            unquote(user) or environment.get(USER),
            unquote(password) or environment.get(PASSWORD),
            topic,
            _QOS[asked.get("qos", "2")],
            _VERSIONS[asked.get("version", "5")],
            f"{scheme}://{place}/{written}",
        )


class MqttReader(LogReader):
    """Messages of MQTT as they come.

    >>> MqttReader.schemes, MqttReader.unit, MqttReader.shown("mqtt://bob:secret@localhost/doors/#")
    (('mqtt', 'mqtts'), 'message', 'mqtt://localhost/doors/#')
    """

    name: ClassVar[str] = "mqtt"
    schemes: ClassVar[tuple[str, ...]] = ("mqtt", "mqtts")
    unit: ClassVar[str] = "message"
    lenient: ClassVar[bool] = True

    @classmethod
    def shown(cls, name: str) -> str:
        """The URL without user and password; raises `OptionError` for what is none."""
        return Address.parse(name).shown

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """The messages as they come, each with its number; those that are there when the end is asked for come, too."""
        connection, number, odd = _Connection(Address.parse(log.url), log), 0, Counter[str]()

        def tell(what: str, place: str) -> None:
            odd[what] += 1
            if odd[what] == 1:
                log.live.warn(f"{log.name}: {place}: {what}")

        try:
            connection.open()
            log.live.began()
            while (arrival := connection.next()) is not None:
                if isinstance(arrival, str):
                    log.live.warn(f"{log.name}: after message {number}: {arrival}")
                    continue
                if isinstance(arrival, RvaftError):
                    raise arrival
                came, message = arrival
                if message.retain:
                    tell("a message that was retained from before is no event", f"after message {number}")
                    continue
                number += 1
                if message.dup:
                    tell("the broker says that it may have come before, so it may count twice", f"message {number}")
                try:
                    event = _event(message, came, log)
                except ValueError as error:
                    log.reject(number, str(error).removesuffix(f"; {HINT}"))
                else:
                    yield number, event
        finally:
            connection.close()
        for what, count in odd.items():
            if count > 1:
                log.live.warn(f"{log.name}: {count} messages in all: {what}")


def _event(message: "MQTTMessage", came: int, log: Log) -> dict[str, Json]:
    """The event that a message is; raises `ValueError` for what is none."""
    placed = partial(_placed, message.topic, came)
    return decode(bytes(message.payload), reads=log.reads, strict=log.strict, placed=placed)


def _placed(topic: str, time: int, payload: dict[str, Json]) -> dict[str, Json]:
    """The object of a payload with its topic and time; its own fields by these names stand
    elsewhere, as of messages in a recording.
    """
    event = {TOPIC: topic, TIME: time, **{ELSEWHERE.get(name, name): value for name, value in payload.items()}}
    if len(event) < len(payload) + 2:
        raise ValueError(f"it has a field and message_… of the same name, of {' and '.join(ELSEWHERE)}")
    if isinstance(payload, RepeatingObject):
        event = RepeatingObject(event)
        event.repeated = frozenset(ELSEWHERE.get(name, name) for name in payload.repeated)
    return event


class _Waiting:
    """What came and has not been looked at: messages as far as there is room, and what is to be
    told at its place among them.
    """

    def __init__(self) -> None:
        self._held = deque[tuple[Any, int]]()
        self._changed = Condition()
        self._size = self._lost = 0

    def put(self, item: Any, size: int = 0) -> None:
        """Take a message of that size, or what is to be told."""
        with self._changed:
            if size and self._held and self._size + size > ROOM:
                self._lost += 1
                return
            self._note_lost()
            self._held.append((item, size))
            self._size += size
            self._changed.notify()

    def get(self, timeout: float) -> Any:
        """The next of them, None if nothing comes within these seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._held or self._lost, timeout)
            if not self._held:
                self._note_lost()
            if not self._held:
                return None
            item, size = self._held.popleft()
            self._size -= size
            return item

    def _note_lost(self) -> None:
        if self._lost:
            said = f"{self._lost} message{'s' * (self._lost != 1)} came while {ROOM >> 20} MiB waited, and were lost"
            self._held.append((said, 0))
            self._lost = 0


class _Connection:
    """A subscription, which a thread of its own keeps up.

    It connects again whenever the connection is lost, and tells that.
    """

    def __init__(self, address: Address, log: Log) -> None:
        remedy = "pip install '.[mqtt]' in a checkout of rvaft"
        self._paho = installed("paho.mqtt.client", "paho-mqtt", remedy)
        if not hasattr(self._paho, "CallbackAPIVersion"):
            raise ToolMissing("paho-mqtt 2", remedy=remedy)
        self._address, self._log = address, log
        self._waiting = _Waiting()
        self._answered = Event()
        self._refusal = ""
        self._told = ""
        self._lost_at: float | None = None
        self._closing = False
        self._thread: Thread | None = None
        self._client = self._made()

    def _made(self) -> Any:
        paho, address, modern = self._paho, self._address, self._address.version == 5
        client = paho.Client(
            paho.CallbackAPIVersion.VERSION2,
            client_id=f"rvaft-{token_hex(6)}",
            protocol=address.version,
            clean_session=None if modern else True,
        )
        client.connect_timeout = _PATIENCE
        client.reconnect_delay_set(1, 30)
        client.username_pw_set(address.user, address.password)
        if address.secure:
            client.tls_set()
        client.on_connect, client.on_disconnect = self._connected, self._disconnected
        client.on_subscribe, client.on_message = self._subscribed, self._came
        return client

    def open(self) -> None:
        """Connect and subscribe; raises `TraceError` where that is refused or nobody answers."""
        address = self._address
        try:
            kept = self._expiry("CONNECT", _SESSION)
            self._client.connect(address.host, address.port, keepalive=_ALIVE, properties=kept)
        except (OSError, ValueError) as error:
            reason = getattr(error, "verify_message", None) or getattr(error, "strerror", None) or error
            raise self._log.error_at(f"no connection: {reason}", None) from error
        self._thread = Thread(target=self._serve, name="mqtt", daemon=True)
        self._thread.start()
        until = monotonic() + _PATIENCE
        while not self._answered.wait(_POLL):
            if self._log.live.stop():
                return
            if monotonic() > until:
                raise self._log.error_at("nobody answers as a broker of MQTT does", None)
        if self._refusal:
            raise self._log.error_at(self._refusal, None)

    def next(self) -> "tuple[int, MQTTMessage] | str | RvaftError | None":
        """The next message with its time, or what is to be told, or the error that ends it all;
        None after the last one, once the end was asked for.
        """
        while True:
            if not self._closing and self._log.live.stop():
                self.close()
            item: tuple[int, MQTTMessage] | str | RvaftError | None = self._waiting.get(0 if self._closing else _POLL)
            if item is not None or self._closing:
                return item

    def close(self) -> None:
        """End the subscription; the broker keeps nothing for it."""
        self._closing = True
        self._client.disconnect(properties=self._expiry("DISCONNECT", 0))
        if self._thread is not None:
            self._thread.join(_PATIENCE)

    def _expiry(self, packet: str, seconds: int) -> Any:
        """What says for how long the broker keeps messages; nothing before version 5."""
        if self._address.version < 5:
            return None
        from paho.mqtt.packettypes import PacketTypes  # noqa: PLC0415 -- imported on use
        from paho.mqtt.properties import Properties  # noqa: PLC0415 -- imported on use

        found: Any = Properties(getattr(PacketTypes, packet))  # type: ignore[no-untyped-call]
        found.SessionExpiryInterval = seconds
        return found

    def _serve(self) -> None:
        try:
            self._client.loop_forever()
        except Exception as error:  # noqa: BLE001 (in a thread: else nobody would know that nothing comes any more)
            self._end(f"{type(error).__name__}: {error}")

    def _end(self, reason: str) -> None:
        """There is no going on."""
        if self._answered.is_set():
            self._waiting.put(self._log.error_at(reason, None))
        else:
            self._refusal = reason
            self._answered.set()

    def _connected(self, client: Any, _data: object, flags: Any, reason: Any, _properties: object) -> None:
        if reason.is_failure:
            who = (
                f" (the URL, or {USER} and {PASSWORD}, say who asks)"
                if "uthori" in str(reason) or "user" in str(reason)
                else ""
            )
            if not self._answered.is_set():
                self._end(f"the broker refuses the connection: {reason}{who}")
            elif self._told != str(reason):
                self._told = str(reason)
                self._waiting.put(f"the broker refuses to connect again: {reason}; trying on")
            return
        self._told = ""
        if self._lost_at is not None:
            kept = (
                "the broker kept those of QoS 1 and 2 as far as its queue goes"
                if flags.session_present
                else "it kept none"
            )
            seconds, self._lost_at = monotonic() - self._lost_at, None
            self._waiting.put(f"connected again after {seconds:.1f} s: messages may have been missed ({kept})")
        if not flags.session_present:
            client.subscribe(self._address.topic, self._address.qos)

    def _subscribed(self, _client: object, _data: object, _number: object, reasons: Any, _properties: object) -> None:
        refused = [reason for reason in reasons if reason.is_failure]
        if refused:
            self._end(f"the broker refuses the subscription: {refused[0]}")
            return
        granted = min((reason.value for reason in reasons), default=0)
        if granted < self._address.qos:
            self._waiting.put(f"the broker grants QoS {granted} only: messages may be missed or come again")
        self._answered.set()

    def _disconnected(self, _client: object, _data: object, _flags: object, reason: Any, _properties: object) -> None:
        if self._closing:
            return
        if not self._answered.is_set():
            self._end(f"the connection was closed: {reason}")
        elif self._lost_at is None:
            self._lost_at = monotonic()
            self._waiting.put(f"the connection is lost ({reason}); connecting again")

    def _came(self, _client: object, _data: object, message: "MQTTMessage") -> None:
        self._waiting.put((time_ns(), message), _EACH + len(message.payload))
