"""Live MQTT messages from `mqtt://HOST[:PORT]/TOPIC` (wildcards `+` and `#`), read by `paho-mqtt`.

An event is a JSON object with `topic`, and with `time`, its arrival in nanoseconds, as in ROS
recordings. Lost messages are reported in place: after a lost connection, when the buffer is full,
and for payloads that are not JSON objects. Retained messages are reported and ignored.
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
from rvaft.readers.bag import ELSEWHERE, TIME, TOPIC, require_nanoseconds
from rvaft.readers.json_lines import HINT, RepeatingObject, decode
from rvaft.readers.log import Log, LogReader

if TYPE_CHECKING:
    from paho.mqtt.client import MQTTMessage

ROOM: Final = 64 * 1024 * 1024
"""Bytes of buffered messages; further messages are dropped and reported."""
USER: Final = "MQTT_USERNAME"
PASSWORD: Final = "MQTT_PASSWORD"  # noqa: S105 (the name of the variable that has it)
_EACH: Final = 500
_POLL: Final = 0.2
_PATIENCE: Final = 15.0
_ALIVE: Final = 30
_SESSION: Final = 3600
"""Seconds for which the broker keeps messages after a lost connection."""
_QOS: Final = {"0": 0, "1": 1, "2": 2}
_VERSIONS: Final = {"3.1.1": 4, "5": 5}
_FILTER: Final = re.compile(r"(?:(?:[^+#/\0]*|\+)/)*(?:[^+#/\0]*|\+|#)")
_HOW: Final = "a URL of MQTT is mqtt://HOST[:PORT]/TOPIC or mqtts://…, with / and @ in a password as %2F and %40"


class Address(NamedTuple):
    """The parts of a URL: broker, credentials and topic filter.

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
        """Parse a URL; missing credentials come from the environment.

        Raises `OptionError` without the URL in its message.
        """
        scheme, _, rest = url.partition("://")
        authority, _, path = rest.partition("/")
        credentials, _, place = authority.rpartition("@")
        written, _, query = path.partition("?")
        secure, topic = scheme.lower() == "mqtts", unquote(written)
        try:
            found = urlsplit(f"//{place}")
            host, port = found.hostname, found.port
            options = dict(parse_qsl(query, keep_blank_values=True, strict_parsing=True)) if query else {}
        except ValueError:
            raise OptionError(_HOW) from None
        if not host or not topic:
            raise OptionError(_HOW)
        if not _FILTER.fullmatch(topic) or len(topic.encode()) > 0xFFFF:
            why = "+ must be a whole level, # must be the last level"
            raise OptionError(f"{topic[:80]!r} is not an MQTT topic filter: {why}")
        for name, value in options.items():
            known = {"qos": _QOS, "version": _VERSIONS}.get(name)
            if known is None or value not in known:
                raise OptionError(
                    "the query of an MQTT URL may have qos=0, 1 or 2, and version=3.1.1 or 5; write ? in a topic as %3F"
                )
        user, _, password = credentials.partition(":")
        return cls(
            secure,
            host,
            port or (8883 if secure else 1883),
            unquote(user) or environment.get(USER),
            unquote(password) or environment.get(PASSWORD),
            topic,
            _QOS[options.get("qos", "2")],
            _VERSIONS[options.get("version", "5")],
            f"{scheme}://{place}/{written}",
        )


_REPEATED: Final = (
    "the broker marks it as a possible duplicate: monitored twice, it may hide or forge a detection, or end it for "
    "good; skip it with --distinct FIELD"
)


class MqttReader(LogReader):
    """Live MQTT messages.

    >>> MqttReader.schemes, MqttReader.unit, MqttReader.shown("mqtt://bob:secret@localhost/doors/#")
    (('mqtt', 'mqtts'), 'message', 'mqtt://localhost/doors/#')
    """

    name: ClassVar[str] = "mqtt"
    schemes: ClassVar[tuple[str, ...]] = ("mqtt", "mqtts")
    unit: ClassVar[str] = "message"
    lenient: ClassVar[bool] = True

    @classmethod
    def shown(cls, name: str) -> str:
        """Return the URL without credentials; raises `OptionError`."""
        return Address.parse(name).shown

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the messages with their numbers, including those buffered at the stop."""
        require_nanoseconds(log, "a message of MQTT")
        connection, number, odd = _Connection(Address.parse(log.url), log), 0, Counter[str]()

        def warn_once(what: str, place: str) -> None:
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
                    warn_once("a retained message is ignored", f"after message {number}")
                    continue
                number += 1
                if message.dup:
                    warn_once(_REPEATED, f"message {number}")
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
    placed = partial(_placed, message.topic, came)
    return decode(bytes(message.payload), reads=log.reads, strict=log.strict, placed=placed)


def _placed(topic: str, time: int, payload: dict[str, Json]) -> dict[str, Json]:
    """Return a payload with topic and time; its own fields of these names are renamed."""
    event = {TOPIC: topic, TIME: time, **{ELSEWHERE.get(name, name): value for name, value in payload.items()}}
    if len(event) < len(payload) + 2:
        raise ValueError(f"the payload has a field and message_… of the same name, for {' and '.join(ELSEWHERE)}")
    if isinstance(payload, RepeatingObject):
        event = RepeatingObject(event)
        event.repeated = frozenset(ELSEWHERE.get(name, name) for name in payload.repeated)
    return event


class _Waiting:
    """A bounded queue of messages, with notices at their places among them."""

    def __init__(self) -> None:
        self._held = deque[tuple[Any, int]]()
        self._changed = Condition()
        self._size = self._lost = 0

    def put(self, item: Any, size: int = 0) -> None:
        """Add a message of that size, or a notice; without room, count it as lost."""
        with self._changed:
            if size and self._held and self._size + size > ROOM:
                self._lost += 1
                return
            self._note_lost()
            self._held.append((item, size))
            self._size += size
            self._changed.notify()

    def get(self, timeout: float) -> Any:
        """Return the next item, or None after a timeout in seconds."""
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
            notice = f"{self._lost} message{'s' * (self._lost != 1)} lost: the buffer of {ROOM >> 20} MiB was full"
            self._held.append((notice, 0))
            self._lost = 0


class _Connection:
    """A subscription kept up by a thread."""

    def __init__(self, address: Address, log: Log) -> None:
        remedy = "pip install '.[mqtt]' in a checkout of rvaft"
        self._paho = installed("paho.mqtt.client", "paho-mqtt", remedy)
        if not hasattr(self._paho, "CallbackAPIVersion"):
            raise ToolMissing("paho-mqtt 2", remedy=remedy)
        self._address, self._log = address, log
        self._waiting = _Waiting()
        self._answered = Event()
        self._refusal = ""
        self._reported = ""
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
        """Connect and subscribe; raises `TraceError`."""
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
                raise self._log.error_at("no MQTT broker answers", None)
        if self._refusal:
            raise self._log.error_at(self._refusal, None)

    def next(self) -> "tuple[int, MQTTMessage] | str | RvaftError | None":
        """Return the next message with its time, a notice or the final error, or None."""
        while True:
            if not self._closing and self._log.live.stop():
                self.close()
            item: tuple[int, MQTTMessage] | str | RvaftError | None = self._waiting.get(0 if self._closing else _POLL)
            if item is not None or self._closing:
                return item

    def close(self) -> None:
        """End the subscription, and discard messages kept by the broker."""
        self._closing = True
        self._client.disconnect(properties=self._expiry("DISCONNECT", 0))
        if self._thread is not None:
            self._thread.join(_PATIENCE)

    def _expiry(self, packet: str, seconds: int) -> Any:
        if self._address.version < 5:
            return None
        from paho.mqtt.packettypes import PacketTypes  # noqa: PLC0415
        from paho.mqtt.properties import Properties  # noqa: PLC0415

        found: Any = Properties(getattr(PacketTypes, packet))  # type: ignore[no-untyped-call]
        found.SessionExpiryInterval = seconds
        return found

    def _serve(self) -> None:
        try:
            self._client.loop_forever()
        except Exception as error:  # noqa: BLE001 (an exception in the thread must reach the reader)
            self._end(f"{type(error).__name__}: {error}")

    def _end(self, reason: str) -> None:
        if self._answered.is_set():
            self._waiting.put(self._log.error_at(reason, None))
        else:
            self._refusal = reason
            self._answered.set()

    def _connected(self, client: Any, _data: object, flags: Any, reason: Any, _properties: object) -> None:
        if reason.is_failure:
            who = (
                f" (give credentials in the URL, or in {USER} and {PASSWORD})"
                if "uthori" in str(reason) or "user" in str(reason)
                else ""
            )
            if not self._answered.is_set():
                self._end(f"the broker refuses the connection: {reason}{who}")
            elif self._reported != str(reason):
                self._reported = str(reason)
                self._waiting.put(f"the broker refuses to connect again: {reason}; retrying")
            return
        self._reported = ""
        if self._lost_at is not None:
            kept = (
                "the broker kept messages of QoS 1 and 2 as far as its queue allows"
                if flags.session_present
                else "the broker kept none"
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
            self._waiting.put(f"the broker grants QoS {granted} only: messages may be lost or repeated")
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
