"""The server: connections that share nothing, or one state; clients that misbehave; whom it lets in."""

import asyncio
import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final
from urllib.parse import urlsplit

import pytest

from rvaft.errors import OptionError
from rvaft.model.values import Json
from rvaft.ros.protocol import Protocol, Session
from rvaft.ros.server import Address, allowed, serve
from rvaft.ros.server import origin as origin_of
from tests.cli.runs import COMMAND, PRUNED, TREES, failed, run
from tests.ros.clients import SEQUENCE, A, B, asked, connected, live, served, websockets

MANY: Final = 60
UPGRADE: Final = (
    "GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n{more}\r\n"
)


def endpoint(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    assert parts.hostname is not None
    assert parts.port is not None
    return parts.hostname, parts.port


async def opened(url: str, *, more: str = "") -> tuple[asyncio.StreamReader, asyncio.StreamWriter, str]:
    """A connection by hand and the first line of the answer to its handshake."""
    reader, writer = await asyncio.open_connection(*endpoint(url))
    writer.write(UPGRADE.format(host=urlsplit(url).netloc, more=more).encode())
    head = await reader.readuntil(b"\r\n\r\n")
    return reader, writer, head.decode().splitlines()[0]


@pytest.mark.parametrize("shared", [False, True])
@live
async def test_state_per_connection_or_one_for_all(shared: bool) -> None:
    async with served(shared=shared) as url:
        async with connected(url) as one, connected(url) as other:
            await asked(one, A)
            (reply,) = await asked(other, B)
            assert reply["verdict"] is not shared
        async with connected(url) as later:
            (reply,) = await asked(later, {})
            assert reply["verdict"] == (False if shared else "currently_true")


@live
async def test_many_connections_at_once() -> None:
    async def client(url: str, number: int, ready: asyncio.Barrier) -> None:
        async with connected(url) as connection:
            await ready.wait()
            for event, verdict in (
                [(A, "currently_true"), (B, False)] if number % 2 else [(A, "currently_true"), (A, True)]
            ):
                (reply,) = await asked(connection, {**event, "number": number})
                assert (reply["number"], reply["verdict"]) == (number, verdict)

    async with served() as url:
        ready = asyncio.Barrier(MANY)
        await asyncio.gather(*(client(url, number, ready) for number in range(MANY)))


# -- clients that misbehave --------------------------------------------------------------------------------------------


async def vanish_in_a_message(url: str) -> None:
    _, writer, status = await opened(url)
    assert "101" in status
    writer.write(b"\x81\xfe\x10\x00\x00\x00\x00\x00" + b'{"event": "b"}')  # 4096 bytes are announced
    await writer.drain()
    writer.transport.abort()


async def vanish_before_the_reply(url: str) -> None:
    _, writer, _ = await opened(url)
    payload = b'{"event": "c"}'
    writer.write(b"\x81" + bytes([0x80 | len(payload)]) + bytes(4) + payload)
    await writer.drain()
    writer.transport.abort()


async def break_the_protocol(url: str) -> None:
    reader, writer, _ = await opened(url)
    writer.write(b"\xff" * 64)
    assert (await asyncio.wait_for(reader.read(), 20))[:1] in (b"\x88", b"")
    writer.close()


async def send_text_that_is_none(url: str) -> None:
    reader, writer, _ = await opened(url)
    writer.write(b"\x81\x82\x00\x00\x00\x00\xff\xff")
    assert b"\x03\xef" in await asyncio.wait_for(reader.read(), 20)  # 1007, as RFC 6455 has it
    writer.close()


async def speak_something_else(url: str) -> None:
    reader, writer = await asyncio.open_connection(*endpoint(url))
    writer.write(b"\x16\x03\x01 hello\r\n\r\n")
    await asyncio.wait_for(reader.read(), 20)
    writer.close()


async def send_far_too_much(url: str) -> None:
    async with connected(url) as connection:
        with pytest.raises(websockets.ConnectionClosedError) as closed:
            await asked(connection, " " * 100_000)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009


@pytest.mark.parametrize(
    "misbehave",
    [
        vanish_in_a_message,
        vanish_before_the_reply,
        break_the_protocol,
        send_text_that_is_none,
        speak_something_else,
        send_far_too_much,
    ],
)
@pytest.mark.parametrize("shared", [False, True])
@live
async def test_what_one_client_does_costs_the_others_nothing(
    misbehave: Callable[[str], Awaitable[None]], shared: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    async with served(shared=shared, longest=1000) as url, connected(url) as connection:
        await asked(connection, A)
        await misbehave(url)
        await asyncio.sleep(0.05)
        (reply,) = await asked(connection, B)
        assert reply["verdict"] is False
    assert capfd.readouterr() == ("", "")


@live
async def test_a_client_that_never_reads_is_left_behind_when_the_server_stops() -> None:
    async with served() as url, connected(url) as connection:
        _, writer, _ = await opened(url)
        event = json.dumps({"x": "y" * 60_000}).encode()
        frame = b"\x81\xfe" + len(event).to_bytes(2, "big") + bytes(4) + event
        for _ in range(300):
            writer.write(frame)
        await asyncio.sleep(0.2)
        (reply,) = await asked(connection, A)
        assert reply["verdict"] == "currently_true"
    writer.transport.abort()


def test_a_defect_is_said_and_ends_its_connection_alone(caplog: pytest.LogCaptureFixture) -> None:
    class Defective(Session):
        def read(self, event: object, came: object) -> None:  # noqa: ARG002 (the interface)
            raise ZeroDivisionError(f"no way with {event}")

    async def scenario() -> None:
        stop, url = asyncio.Event(), asyncio.get_running_loop().create_future()
        good = Session(SEQUENCE)
        sessions = iter([Defective(SEQUENCE), good])
        running = asyncio.create_task(
            serve(Protocol(SEQUENCE), lambda: next(sessions), stop, address=Address(port=0), listening=url.set_result)
        )
        async with connected(await url) as bad:
            with pytest.raises(websockets.ConnectionClosedError):
                await asked(bad, A)
        async with connected(await url) as fine:
            await asked(fine, A)
        stop.set()
        await running

    asyncio.run(scenario())
    said = [record.getMessage() for record in caplog.records if record.name == "rvaft.ros"]
    assert said == ["rvaft: error: a defect in rvaft ended a connection: ZeroDivisionError: no way with {'event': 'a'}"]


# -- who is let in -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "status"),
    [
        ("", "101"),
        ("Origin: https://dashboard.example\r\n", "101"),
        ("Origin: http://evil.example\r\n", "403"),
        ("Origin: http://{host}\r\nOrigin: http://evil.example\r\n", "403"),
    ],
)
@live
async def test_an_origin_that_is_not_allowed_is_refused(more: str, status: str) -> None:
    async with served(origins=["https://dashboard.example"]) as url:
        _, writer, line = await opened(url, more=more.format(host=urlsplit(url).netloc))
        writer.transport.abort()
    assert status in line


OWN: Final = "127.0.0.1:8080 127.0.0.1 localhost:8080 [::1]:8080 10.0.0.5:8080"
FOREIGN: Final = (
    ("http://127.0.0.1:8000", "127.0.0.1:8080"),
    ("http://localhost:3000", "localhost:8080"),
    ("http://localhost:8080", "127.0.0.1:8080"),
    ("https://127.0.0.1:8080", "127.0.0.1:8080"),
    ("http://127.0.0.1:8080.evil.example", "127.0.0.1:8080"),
    ("http://rebound.example:8080", "rebound.example:8080"),
    ("http://[::1", "[::1"),
    ("http://", ""),
    ("http://127.0.0.1:8080", None),
    ("null", "127.0.0.1:8080"),
)


def test_only_an_address_vouches_for_itself() -> None:
    assert all(allowed([f"http://{host}"], host, ()) for host in OWN.split())
    for origin, host in FOREIGN:
        assert not allowed([origin], host, ()), origin
        assert allowed([origin], host, (origin,))


def test_an_origin_is_allowed_as_clients_say_it() -> None:
    for given, sent in (
        ("http://robot.local:8080", "http://robot.local:8080"),
        ("http://Robot.local:8080/", "http://Robot.local:8080"),
        ("https://dashboard.example:443", "https://dashboard.example"),
        ("http://robot:80/", "http://robot"),
        ("http://[::1]:3000", "http://[::1]:3000"),
    ):
        assert allowed([sent], "127.0.0.1:8080", (origin_of(given),)), given


NO_ORIGINS: Final = (
    "/ null * nonsense robot.local:8080 ws://robot http:// http://robot/page http://robot// http://a@robot "
    "http://robot: http://robot:0x50 http://robot:99999 http://[::1 http://robot?"
)


@pytest.mark.parametrize("text", ["", "http://ro\nbot", *NO_ORIGINS.split()])
def test_what_is_no_origin(text: str) -> None:
    with pytest.raises(OptionError, match="is no origin"):
        origin_of(text)


@pytest.mark.parametrize(
    "text", ["127.0.0.1", "::1", "fe80::1%eth0", "0.0.0.0", "localhost", "robot.local.", "my_node", "3com.example"]
)
def test_a_host(text: str) -> None:
    assert Address(text).host == text


NO_HOSTS: Final = ". 0 1.2.3 256.1.1.1 0x7f.0x1 127.1. [::1] http://x:1 x:1 x/y a..b -a é"
LONG_HOSTS: Final = ("x" * 64, ".".join(["x" * 50] * 6))


@pytest.mark.parametrize("text", ["", " ", "a b", "a\n", "::1%a b", *NO_HOSTS.split(), *LONG_HOSTS])
def test_what_is_no_host(text: str) -> None:
    with pytest.raises(OptionError, match="is no IP address and no host name"):
        Address(text)


@live
async def test_the_server_is_reached_from_this_machine_alone() -> None:
    async with served() as url:
        _, port = endpoint(url)
        with pytest.raises(OSError):  # noqa: PT011 -- refused or unreachable, as the system has it
            await asyncio.open_connection("127.0.0.2", port)


# -- as a process -------------------------------------------------------------------------------------------------------

SAND = TREES / "gates" / "sand.rvaft"
OR = TREES / "gates" / "or.rvaft"


@contextmanager
def serving(*args: object) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """A server as a process of its own, and its URL."""
    words = [*COMMAND, "serve", *map(str, args), "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout is not None
            said = running.stdout.readline()
            assert said.startswith("listening at ws://127.0.0.1:")
            yield running, said.split()[-1]
        finally:
            running.kill()


def conversation(url: str, *messages: Json) -> list[Any]:
    async def talk() -> list[Any]:
        async with connected(url) as connection:
            return await asked(connection, *messages)

    return asyncio.run(talk())


def told(running: "subprocess.Popen[str]", number: signal.Signals = signal.SIGTERM) -> list[str]:
    """What a server has said when a signal has ended it."""
    running.send_signal(number)
    assert running.wait(timeout=20) == 0
    assert running.stderr is not None
    return [line.removeprefix("rvaft: ") for line in running.stderr.read().splitlines()]


def test_a_signal_ends_it_cleanly() -> None:
    async def talk(running: "subprocess.Popen[str]", url: str) -> int | None:
        async with connected(url) as connection:
            await asked(connection, {"event": "a"})
            running.send_signal(signal.SIGINT)
            await asyncio.wait_for(connection.wait_closed(), 20)
            return connection.close_code

    with serving(SAND, "--quiet") as (running, url):
        assert asyncio.run(talk(running, url)) == 1001
        assert running.wait(timeout=20) == 0
        assert running.stderr is not None
        assert running.stderr.read() == ""


def test_what_happens_is_said() -> None:
    """More connections than allowed are refused, and clients that hold on do not keep it from ending."""

    async def crowd(url: str) -> None:
        async with connected(url) as one, connected(url):
            with pytest.raises(websockets.exceptions.InvalidStatus, match="503"):
                async with connected(url):
                    pass
            assert await asked(one, {"event": "x"})

    with serving(OR, "--shared", "--max-connections", "2") as (running, url):
        conversation(url, "", {"event": "a"}, {"event": "b"})
        conversation(url, {"event": "a"})
        asyncio.run(crowd(url))
        host, port = url.removeprefix("ws://").split(":")
        with socket.create_connection((host, int(port))) as silent, socket.create_connection((host, int(port))) as rude:
            rude.sendall(b"nonsense\r\n\r\n")
            said = told(running)
            assert silent.recv(1) == b""
    assert [line.split(" from ")[0] for line in said if " opened" in line] == [f"connection {n}" for n in range(1, 5)]
    quiet = [re.sub(r" from \S+", "", line) for line in said if " opened" not in line]
    assert quiet[:5] == [
        "connection 1: message refused: not JSON: expecting value",
        "connection 1: detected at event 1: branch 1",
        "connection 1 closed after 2 events",
        "connection 2 closed after 1 event",
        "connection refused: there are 2, the most that --max-connections allows",
    ]


def test_without_files_for_more_connections_there_is_one_line() -> None:
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40)); import rvaft.cli.ros; "
        "from rvaft.cli import main; assert not any(name.startswith('websockets') for name in sys.modules); "
        f"main(['serve', {str(SAND)!r}, '--port', '0', '--quiet'][:-1])"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        host, port = running.stdout.readline().split()[-1].removeprefix("ws://").split(":")
        clients = [socket.create_connection((host, int(port))) for _ in range(60)]
        line = running.stderr.readline()
        running.kill()
        for client in clients:
            client.close()
        rest = running.stderr.read()
    assert line == "rvaft: too many open files: new connections have to wait; allow more with ulimit -n\n"
    assert "Traceback" not in rest


def test_the_options_reach_the_replies() -> None:
    words = ["--polarity", "detection", "--vocabulary", "strings", "--semantics", "scattered", "--per", "branch"]
    with serving(OR, *words, "--max-message", "2") as (_, url):
        first, last = conversation(url, {"x": "y" * 1_500_000}, {"event": "b"})
        assert (first["verdict"], last["verdict"], last["verdicts"]["2"]) == ("currently_false", "true", "true")
        assert set(last["verdicts"].values()) == {"true", "currently_false"}
    lines = (PRUNED.parent / "pruned.traces" / "table2_row3.jsonl").read_text(encoding="utf-8").splitlines()
    with serving(PRUNED, "--kind", "attack", "--shared") as (_, url):
        assert conversation(url, *lines)[-1]["verdict"] is conversation(url, {})[0]["verdict"] is False


def test_a_port_in_use() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = run("serve", SAND, "--port", port)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"rvaft: error: ws://127.0.0.1:{port}: the port is in use: choose another with --port\n"


def test_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    failed(run("serve", SAND), "websockets is not installed: pip install '.[ros]' in a checkout")


def test_the_client_that_rosmonitoring_uses() -> None:
    """It names the address that it connects to as its origin, and answers pings only while it waits for a reply."""
    client = pytest.importorskip("websocket")
    with serving(SAND) as (_, url):
        oracle = client.create_connection(url, timeout=20, http_no_proxy=["127.0.0.1"])
        replies = []
        for name in "abc":
            oracle.send(json.dumps({"event": name}))
            replies.append(json.loads(oracle.recv()))
        oracle.close()
    assert [reply["verdict"] for reply in replies] == ["currently_true", "currently_true", False]
