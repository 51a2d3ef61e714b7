"""Messages of MQTT: what an event is, what is told of the rest and of what may have been missed,
who refuses what; with a broker of Debian and with none.
"""

import asyncio
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

import rvaft
from rvaft.integrations import mqtt
from rvaft.integrations.mqtt import Address
from tests.cli.pages import fetched
from tests.cli.runs import SAND, failed, process, run, soon, started

pytest.importorskip("paho.mqtt.client", reason="paho-mqtt is not installed")
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
broker_needed = pytest.mark.skipif(MOSQUITTO is None, reason="mosquitto is not installed")


def free_port() -> int:
    with closing(socket.socket()) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


class Broker:
    """A broker at a port of its own, and who publishes there."""

    def __init__(self, folder: Path, *lines: str) -> None:
        self.port, self.said, self.config = free_port(), folder / "log", folder / "conf"
        root = ["user root"] if os.getuid() == 0 else []
        self.config.write_text("\n".join([*root, f"listener {self.port} 127.0.0.1", *lines]) + "\n")
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        with self.said.open("w") as said:
            self._running = subprocess.Popen([str(MOSQUITTO), "-v", "-c", str(self.config)], stdout=said, stderr=said)
        assert soon(self._answers), self.said.read_text()

    def _answers(self) -> bool:
        with suppress(OSError), closing(socket.create_connection(("127.0.0.1", self.port), 1)):
            return True
        return False

    def stop(self) -> None:
        self._running.kill()
        self._running.wait()

    def listened(self, topic: str) -> bool:
        """Whether somebody of ours has subscribed since the broker began."""
        return soon(
            lambda: any("rvaft-" in line and line.endswith(f" {topic}") for line in self.said.read_text().splitlines())
        )

    def sending(self, topic: str, *messages: tuple[str, Any]) -> Thread:
        """A thread that publishes as soon as somebody of ours listens."""

        def send() -> None:
            assert self.listened(topic)
            self.send(*messages)

        made = Thread(target=send)
        made.start()
        return made

    def send(self, *messages: tuple[str, Any], **options: Any) -> None:
        """Publish; what is no text as JSON."""
        from paho.mqtt import publish

        sent = [(topic, one if isinstance(one, (str, bytes)) else json.dumps(one)) for topic, one in messages]
        publish.multiple([(topic, data, 1, bool(options)) for topic, data in sent], port=self.port)


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    made = Broker(tmp_path, "allow_anonymous true")
    yield made
    made.stop()


def events(url: str, told: list[str]) -> Iterator[dict[str, Any]]:
    """The events of a URL, in a thread's stead: the first is asked for when the subscription is there."""
    return iter(rvaft.read_log(url, warn=told.append))


def listening(broker: Broker, topic: str, told: list[str], *messages: tuple[str, Any]) -> Iterator[dict[str, Any]]:
    """The events, after these are sent once somebody listens."""
    sender = broker.sending(topic, *messages)
    yield from events(f"{broker.url}/{topic}", told)
    sender.join()


URLS = [
    ("mqtt://h/x", "h", 1883, None, "x", 2, "mqtt://h/x"),
    (
        "mqtts://bob:s%2Fe%40c@h.example/a/+/%23?qos=0",
        "h.example",
        8883,
        "bob",
        "a/+/#",
        0,
        "mqtts://h.example/a/+/%23",
    ),
    ("MQTT://[::1]:99//x/%3F/#?version=3.1.1&qos=1", "::1", 99, None, "/x/?/#", 1, "MQTT://[::1]:99//x/%3F/#"),
]


@pytest.mark.parametrize("row", URLS, ids=lambda row: row[0])
def test_what_a_url_says(row: tuple[Any, ...]) -> None:
    found = Address.parse(row[0], {})
    assert (found.host, found.port, found.user, found.topic, found.qos, found.shown) == row[1:]


def test_who_asks_is_said_by_the_environment_or_the_url() -> None:
    known = {"MQTT_USERNAME": "ann", "MQTT_PASSWORD": "one"}
    found = [Address.parse(url, known)[3:5] for url in ("mqtt://h/x", "mqtt://bob@h/x", "mqtt://bob:two@h/x")]
    assert found == [("ann", "one"), ("bob", "one"), ("bob", "two")]


WRONG = [
    ("mqtt://localhost:1/x", "mqtt://localhost:1/x: no connection: "),
    ("mqtt://bob:secret@127.0.0.1:1/x", "mqtt://127.0.0.1:1/x: no connection: "),
    ("mqtt://no-such-host.invalid/x", "no connection: "),
    *(
        (url, "mqtt://HOST[:PORT]/TOPIC")
        for url in ("mqtt://h", "mqtt:///x", "mqtt://h:99999/x", "mqtt://u:sec/ret@h/x")
    ),
    *((f"mqtt://h/{topic}", "not an MQTT topic filter") for topic in ("a#", "#/a", "a+", "+a/b")),
    *((f"mqtt://h/x?{asked}", "qos=0, 1 or 2") for asked in ("qos=3", "retain=1", "version=4")),
    ("mqts://bob:secret@h/x", "unknown URL scheme mqts://; known: mqtt://"),
    ("mqtt://h/x mqtt://h/y", "name one TRACE"),
    ("mqtt://h/x --checkpoint c", "--checkpoint needs a log that can be read again"),
    ("x --input mqtt", "mqtt://HOST[:PORT]/TOPIC"),
    ("- --input mqtt", "mqtt is read from a URL"),
]


@pytest.mark.parametrize(("words", "said"), WRONG)
def test_what_is_wrong_is_one_line(words: str, said: str) -> None:
    result = run("monitor", SAND, *words.split())
    failed(result, said)
    assert "sec" not in result.output.replace("second", "")


def test_a_tree_that_reads_seconds_is_refused_before_it_connects(tmp_path: Path) -> None:
    (tmp_path / "tree.rvaft").write_text("time time as s; top sand a b within 1 s; a; b;")
    said = "but a message of MQTT has it as ns: write `time time as ns`"
    failed(run("monitor", tmp_path / "tree.rvaft", "mqtt://127.0.0.1:1/x"), said)


def test_only_monitor_reads_without_end() -> None:
    failed(run("coverage", SAND, "mqtt://h/x"), "only rvaft monitor and rvaft view --follow read URLs")
    with pytest.raises(rvaft.OptionError, match="live events need a URL"):
        rvaft.live_events("day.jsonl")


def test_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    failed(run("monitor", SAND, "mqtt://h/x"), "paho-mqtt is not installed: pip install '.[mqtt]'")


PAYLOADS: list[tuple[Any, dict[str, Any] | str]] = [
    ({"event": "a", "v": 1.50}, {"event": "a", "v": 1.5}),
    ({"topic": "own", "time": 5, "w": None}, {"message_topic": "own", "message_time": 5, "w": None}),
    (b"23.5", "not a JSON object but a number"),
    (b"", "not JSON: expecting value (column 1)"),
    (b"\xff", "not UTF-8 (byte 1 of the line)"),
    (b'{"time": 1, "time": 2}', 'the key "message_time" is repeated'),
    (b'{"time": 1, "message_time": 2}', "the payload has a field and message_"),
]


@broker_needed
def test_an_event_is_a_payload_with_its_topic_and_time(broker: Broker) -> None:
    told: list[str] = []
    broker.send(("x/old", {"event": "a"}), ("x/older", {"event": "a"}), retain=True)
    sent = [*PAYLOADS, ({"event": "end"}, {"event": "end"})]
    messages = [(f"x/{number}", payload) for number, (payload, _) in enumerate(sent)]
    found = []
    for event in listening(broker, "x/#", told, *messages):
        found.append(event)
        if event.get("event") == "end":
            break
    assert all(type(event["time"]) is int and 1.7e18 < event.pop("time") < 3e18 for event in found)
    expected = [{"topic": f"x/{n}", **event} for n, (_, event) in enumerate(sent) if isinstance(event, dict)]
    assert found == expected
    assert told == [f"{broker.url}/x/#: after message 0: a retained message is ignored"]
    reasons = [mqtt_reason(payload) for payload, event in PAYLOADS if isinstance(event, str)]
    assert [reason[: len(event)] for reason, (_, event) in zip(reasons, PAYLOADS[2:], strict=True)] == [
        event for _, event in PAYLOADS[2:]
    ]


def mqtt_reason(payload: bytes) -> str:
    """Why a payload is no event."""
    from paho.mqtt.client import MQTTMessage

    from rvaft.readers.log import Log

    message = MQTTMessage(topic=b"x")
    message.payload = payload
    with pytest.raises(ValueError, match=r".") as found:
        mqtt._event(message, 1, Log(mqtt.MqttReader(), "mqtt://h/x", "x"))
    return str(found.value)


@broker_needed
def test_the_command_monitors_until_it_is_asked_to_end(broker: Broker, tmp_path: Path) -> None:
    words = ["--key", "topic", "--repeat", "--format", "jsonl", "--detections", "--exec", f"cat >> {tmp_path}/ran"]
    with started("monitor", SAND, f"{broker.url.replace('//', '//bob:secret@')}/doors/+", *words) as running:
        assert running.stderr.readline() == f"rvaft: listening to {broker.url}/doors/+ (Ctrl-C ends)\n"
        broker.send(*((f"doors/{door}", {"event": event}) for event in "abc" for door in "ns"), ("doors/n", "[]"))
        told = [json.loads(running.stdout.readline()) for _ in "ns"]
        assert [(one["key"], one["event"], one["detection"]) for one in told] == [("doors/n", 5, 1), ("doors/s", 6, 1)]
        assert running.stderr.readline().endswith(
            "message 7: not a JSON object but a list; skipped, as are later ones like it\n"
        )
        running.send_signal(signal.SIGTERM)
        rest = running.communicate(timeout=20)
    assert running.returncode == 1
    assert rest == (
        "",
        f"rvaft: warning: {broker.url}/doors/+: message 7: not a JSON object but a list (1 message left out)\n",
    )
    ran = [json.loads(line) for line in (tmp_path / "ran").read_text().splitlines()]
    assert [one["trace"] for one in ran] == [f"{broker.url}/doors/+"] * 2
    assert ran[0]["events"]["1"]["topic"] == "doors/n"


@broker_needed
def test_a_silent_sender_is_found_by_the_clock(broker: Broker, tmp_path: Path) -> None:
    text = "semantics scattered; time time as ns; event e(x) = { e: x }; lost on e(X) without e(X) for 200 ms after;"
    (tree := tmp_path / "tree.rvaft").write_text(text, encoding="utf-8")
    words = ["--clock", "100 ms", "--format", "jsonl", "--detections"]
    with started("monitor", tree, f"{broker.url}/doors/#", *words) as running:
        running.stderr.readline()
        broker.send(("doors/1", {"e": 7}))
        found = json.loads(running.stdout.readline())
        running.send_signal(signal.SIGTERM)
        assert running.wait(20) == 1
    assert (found["event"], found["variables"], found["passed"][:5]) == (1, {"X": 7}, "time ")


@pytest.mark.ci
@broker_needed
def test_a_page_shows_messages_as_they_come(broker: Broker) -> None:
    with started("view", SAND, f"{broker.url}/doors/#", "--follow", "--semantics", "scattered") as running:
        url = running.stdout.readline().split()[-1]
        assert fetched(url)["places"]["number"] == []
        broker.send(*[("doors/1", {"event": event}) for event in ("a", "b", "c")])
        assert soon(lambda: fetched(url)["watches"] == [[0, None, 3, [["⊤", 3, 1]], False]])
        running.send_signal(signal.SIGTERM)
        assert running.wait(20) == 1


@broker_needed
def test_a_tree_watches_asynchronously(broker: Broker) -> None:
    async def watched() -> list[str]:
        sending = broker.sending("x", *(("x", {"event": one}) for one in "abcz"))
        found = []
        async for event, verdict in rvaft.watch(rvaft.load(SAND), rvaft.live_events(f"{broker.url}/x")):
            found.append(f"{event['event']} {verdict.symbol}")
            if verdict.final:
                break
        sending.join()
        return found

    assert asyncio.run(watched()) == ["a ?", "b ?", "c ⊤"]

    async def first() -> dict[str, Any]:
        return await anext(rvaft.live_events(f"{broker.url}/nothing"))

    async def cancelled() -> None:
        waiting = asyncio.create_task(first())
        assert await asyncio.to_thread(broker.listened, "nothing")
        waiting.cancel()
        await waiting

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(cancelled())
    # A goodbye may be lost where the broker was still sending: that the connections are gone is what counts.
    ended = re.compile(r"lient (rvaft-\w+)[^\n]*(?:disconnect|closed)")
    assert soon(lambda: len(set(ended.findall(broker.said.read_text()))) == 2)


@broker_needed
def test_what_may_have_been_missed_while_the_broker_was_gone_is_told(broker: Broker) -> None:
    told: list[str] = []
    found = listening(broker, "x", told, ("x", {"event": "a"}))
    assert next(found)["event"] == "a"
    broker.stop()
    broker.start()
    again = broker.sending("x", ("x", {"event": "b"}))
    assert next(found)["event"] == "b"
    again.join()
    assert [line.removeprefix(f"{broker.url}/x: after message 1: ")[:22] for line in told] == [
        "the connection is lost",
        "connected again after ",
    ]
    assert told[1].endswith("messages may have been missed (the broker kept none)")


class Cable:
    """A connection to a broker that can be cut."""

    def __init__(self, to: int) -> None:
        self._to, self._ends = to, list[socket.socket]()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                ends = [self._listener.accept()[0], socket.create_connection(("127.0.0.1", self._to))]
                self._ends += ends
                for one, other in (ends, ends[::-1]):
                    Thread(target=self._pass_on, args=(one, other), daemon=True).start()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(4096):
                other.sendall(data)

    def cut(self) -> None:
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self._ends.clear()


@pytest.mark.ci
@broker_needed
def test_a_broker_keeps_messages_for_a_connection_that_was_cut(broker: Broker) -> None:
    cable, told = Cable(broker.port), list[str]()
    found = events(f"mqtt://127.0.0.1:{cable.port}/x", told)
    sender = broker.sending("x", ("x", {"event": "a"}))
    assert next(found)["event"] == "a"
    sender.join()
    assert soon(lambda: "Received PUBACK from rvaft-" in broker.said.read_text())
    cable.cut()
    broker.send(("x", {"event": "b"}))
    assert next(found)["event"] == "b"
    assert told[1].endswith(
        "messages may have been missed (the broker kept messages of QoS 1 and 2 as far as its queue allows)"
    )


@broker_needed
def test_messages_without_room_are_counted(broker: Broker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "ROOM", 2_000)
    told: list[str] = []
    found = listening(broker, "x", told, *(("x", {"n": number}) for number in range(8)))
    sent = [next(found)["n"]]
    assert soon(lambda: broker.said.read_text().count("Received PUBACK from rvaft-") == 8)
    sent += [next(found)["n"], next(found)["n"]]
    broker.send(("x", {"n": 8}))
    while sent[-1] != 8:
        sent.append(next(found)["n"])
    assert all(line.endswith(" lost: the buffer of 0 MiB was full") for line in told)
    assert sum(int(line.split(": ")[2].split()[0]) for line in told) == 9 - len(sent) > 0


@pytest.mark.ci
@broker_needed
def test_a_broker_that_asks_who_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if shutil.which("mosquitto_passwd") is None:
        pytest.skip("mosquitto_passwd is not installed")
    users = tmp_path / "users"
    subprocess.run(["mosquitto_passwd", "-b", "-c", str(users), "bob", "secret"], check=True, capture_output=True)
    broker = Broker(tmp_path, f"password_file {users}")
    try:
        for version in ("5", "3.1.1"):
            failed(
                run("monitor", SAND, f"{broker.url}/x?version={version}"),
                "the broker refuses the connection: ",
                "MQTT_USERNAME",
            )
        failed(run("monitor", SAND, f"{broker.url.replace('//', '//bob:wrong@')}/x"), "refuses the connection")
        monkeypatch.setenv("MQTT_USERNAME", "bob")
        monkeypatch.setenv("MQTT_PASSWORD", "secret")
        with started("monitor", SAND, f"{broker.url}/x") as running:
            assert running.stderr.readline().startswith("rvaft: listening to ")
    finally:
        broker.stop()


@pytest.mark.ci
@broker_needed
def test_a_connection_that_is_encrypted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    words = "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=127.0.0.1 -addext subjectAltName=IP:127.0.0.1"
    files = ["-keyout", tmp_path / "key", "-out", tmp_path / "certificate"]
    subprocess.run(["openssl", *words.split(), *map(str, files)], check=True, capture_output=True)
    secure = [f"certfile {tmp_path}/certificate", f"keyfile {tmp_path}/key", "allow_anonymous true"]
    broker = Broker(tmp_path, *secure)
    try:
        url = f"{broker.url.replace('mqtt', 'mqtts')}/x"
        refused = process("monitor", SAND, url)  # of its own, since the library leaves a socket to the collector
        assert refused.stderr == f"rvaft: error: {url}: no connection: self-signed certificate\n"
        assert refused.returncode == 2
        monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "certificate"))
        with started("monitor", SAND, url) as running:
            assert running.stderr.readline().startswith("rvaft: listening to mqtts://")
    finally:
        broker.stop()


@contextmanager
def answering(*answers: bytes) -> Iterator[str]:
    """The URL of a peer that answers each packet in turn, as a broker might or as none does, and then is silent."""
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:

        def serve() -> None:
            with suppress(OSError), closing(listener.accept()[0]) as peer:
                for answer in answers:
                    asked = peer.recv(4096)
                    if answer == b"-":
                        return
                    number = asked[2:4] if asked[0] == 0x82 else b""
                    peer.sendall(answer.replace(b"NN", number))
                peer.recv(4096)

        Thread(target=serve, daemon=True).start()
        yield f"mqtt://127.0.0.1:{listener.getsockname()[1]}/x?version=3.1.1"


ACCEPTED = b"\x20\x02\x00\x00"
PEERS = [
    ([ACCEPTED, b"\x90\x03NN\x80"], "the broker refuses the subscription: "),
    ([b"-"], "the connection was closed: "),
    ([b"HTTP/1.1 400 Bad Request\r\n\r\n"], "no MQTT broker answers"),
    ([b""], "no MQTT broker answers"),
]


@pytest.mark.parametrize(("answers", "said"), PEERS)
def test_peers_that_do_not_do_what_a_broker_does(
    answers: list[bytes], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt, "_PATIENCE", 0.5)
    with answering(*answers) as url:
        failed(run("monitor", SAND, url), said)


def test_what_comes_again_or_may_be_missed_is_told() -> None:
    payload = b'{"event": "a"}'
    again = b"\x3a" + bytes([5 + len(payload)]) + b"\x00\x01x\x00\x01" + payload
    told: list[str] = []
    with answering(ACCEPTED, b"\x90\x03NN\x00" + again) as url:
        found = events(url, told)
        assert next(found)["event"] == "a"
    assert told[0].endswith("after message 0: the broker grants QoS 0 only: messages may be lost or repeated")
    assert "message 1: the broker marks it as a possible duplicate: monitored twice, it may hide" in told[1]
    assert told[1].endswith("skip it with --distinct FIELD")
