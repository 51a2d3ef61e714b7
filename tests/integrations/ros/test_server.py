"""The server: connections that share nothing, or one state; clients that misbehave; whom it lets
in; what the process says.
"""

import asyncio
import json
import re
import resource
import signal
import socket
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePath
from time import time
from typing import Any, Final
from urllib.parse import urlsplit

import pytest

from rvaft import OptionError, loads
from rvaft.integrations.ros import connections_page, server
from rvaft.integrations.ros.connections_page import ConnectionsPage
from rvaft.integrations.ros.protocol import Session
from rvaft.reports import log_report as report
from rvaft.stream.monitor_set import Per
from rvaft.support.network import allowed, require_host
from rvaft.support.network import origin as origin_of
from tests.cli.runs import SAND, TREES, failed, run, written
from tests.integrations.ros.clients import SEQUENCE, A, B, asked, connected, live, served, serving, websockets
from tests.tables import rows

MANY: Final = 60
FEW_FILES: Final = partial(resource.setrlimit, resource.RLIMIT_NOFILE, (40, 40))
UPGRADE: Final = (
    "GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n{more}\r\n"
)


def endpoint(url: str) -> tuple[str, int]:
    host, port = urlsplit(url).netloc.split(":")
    return host, int(port)


async def opened(url: str, more: str = "") -> tuple[asyncio.StreamReader, asyncio.StreamWriter, str]:
    """A connection by hand and the first line of the answer to its handshake."""
    reader, writer = await asyncio.open_connection(*endpoint(url))
    writer.write(UPGRADE.format(host=urlsplit(url).netloc, more=more).encode())
    head = await reader.readuntil(b"\r\n\r\n")
    return reader, writer, head.decode().splitlines()[0]


def sessions(*, shared: bool) -> Callable[[], Session]:
    first = Session(SEQUENCE)
    return (lambda: first) if shared else first.fork


@pytest.mark.parametrize("shared", [False, True])
@live
async def test_state_per_connection_or_one_for_all(shared: bool) -> None:
    async with served(sessions(shared=shared)) as url:
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
            for event, verdict in ((A, "currently_true"), (B, False) if number % 2 else (A, "currently_true")):
                (reply,) = await asked(connection, {**event, "number": number})
                assert (reply["number"], reply["verdict"]) == (number, verdict)

    async with served() as url:
        ready = asyncio.Barrier(MANY)
        await asyncio.gather(*(client(url, number, ready) for number in range(MANY)))


# -- clients that misbehave --------------------------------------------------------------------------------------------


def frame(payload: bytes) -> bytes:
    """A masked message of text."""
    length = bytes([0x80 | len(payload)]) if len(payload) < 126 else b"\xfe" + len(payload).to_bytes(2)
    return b"\x81" + length + bytes(4) + payload


@pytest.mark.parametrize(
    ("upgraded", "sent", "answer"),
    [
        pytest.param(True, frame(b" " * 4096)[:30], None, id="vanishes in a message"),
        pytest.param(True, frame(b'{"event": "c"}'), None, id="vanishes before the reply"),
        pytest.param(True, b"\xff" * 64, b"\x88", id="breaks the protocol"),
        pytest.param(True, frame(b"\xff\xff"), b"\x03\xef", id="text that is none: 1007, as RFC 6455 has it"),
        pytest.param(True, frame(b" " * 60_000), b"\x03\xf1", id="far too much: 1009"),
        pytest.param(False, b"\x16\x03\x01 hello\r\n\r\n", b"HTTP/1.1 400 ", id="speaks something else"),
    ],
)
@pytest.mark.parametrize("shared", [False, True])
@live
async def test_what_one_client_does_costs_the_others_nothing(
    upgraded: bool, sent: bytes, answer: bytes | None, shared: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    async with served(sessions(shared=shared), longest=1000) as url, connected(url) as connection:
        await asked(connection, A)
        reader, writer = (await opened(url))[:2] if upgraded else await asyncio.open_connection(*endpoint(url))
        writer.write(sent)
        if answer is not None:
            assert answer in await asyncio.wait_for(reader.read(), 20)
        writer.transport.abort()
        await asyncio.sleep(0.05)
        (reply,) = await asked(connection, B)
        assert reply["verdict"] is False
    assert capfd.readouterr() == ("", "")


@live
async def test_who_never_reads_or_never_speaks_is_left_behind_when_it_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_HANDSHAKE", 1.0)
    monkeypatch.setattr(server, "_PATIENCE", 0.5)
    async with served() as url, connected(url) as connection:
        reader, silent = await asyncio.open_connection(*endpoint(url))
        _, writer, _ = await opened(url)
        message = frame(json.dumps({"x": "y" * 60_000}).encode())
        for _ in range(200):
            writer.write(message)
        await asyncio.sleep(0.2)
        (reply,) = await asked(connection, A)
        assert reply["verdict"] == "currently_true"
    assert b"101" not in await reader.read()
    silent.close()
    writer.transport.abort()


@live
async def test_a_defect_is_said_and_ends_its_connection_alone(caplog: pytest.LogCaptureFixture) -> None:
    class Defective(Session):
        def read(self, event: object, came: object) -> None:  # noqa: ARG002 (the interface)
            raise ZeroDivisionError(f"no way with {event}")

    async with served(partial(next, iter([Defective(SEQUENCE), Session(SEQUENCE)]))) as url:
        async with connected(url) as bad:
            with pytest.raises(websockets.ConnectionClosedError):
                await asked(bad, A)
        async with connected(url) as fine:
            await asked(fine, A)
    said = [record.getMessage() for record in caplog.records if record.name == "rvaft.ros"]
    assert said == ["rvaft: error: a defect in rvaft ended a connection: ZeroDivisionError: no way with {'event': 'a'}"]


# -- the page ----------------------------------------------------------------------------------------------------------


async def told(url: str, target: str = "/", *, method: str = "GET", host: str = "localhost", more: str = "") -> str:
    """What a plain request is answered, whole."""
    reader, writer = await asyncio.open_connection(*endpoint(url))
    writer.write(f"{method} {target} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n".encode())
    answer = await asyncio.wait_for(reader.read(), 20)
    writer.close()
    return answer.decode()


@pytest.mark.parametrize(
    ("status", "asks"),
    [
        (200, {}),
        (200, {"target": "/?x"}),
        (200, {"host": "dashboard.example"}),
        (403, {"host": "evil.example"}),
        (403, {"more": "Origin: http://evil.example\r\n"}),
        (403, {"more": "Host: evil.example\r\n"}),
        (404, {"target": "/../etc/passwd"}),
        (404, {"target": "http://[/"}),
        (400, {"target": "two words"}),
        (400, {"method": "POST", "more": "Content-Length: 2\r\n"}),
        (405, {"method": "POST"}),
        (414, {"target": "/" + "y" * 70_000}),
        (431, {"more": f"X: {'y' * 70_000}\r\n"}),
        (426, {"more": "Origin: https://dashboard.example\r\n"}),
    ],
)
@live
async def test_a_browser_is_given_the_page_and_others_an_error(status: int, asks: dict[str, str]) -> None:
    page = ConnectionsPage("<b>.rvaft", SEQUENCE, Session(SEQUENCE))
    async with served(page=page, origins=["https://dashboard.example"]) as url, connected(url) as connection:
        answer = await told(url, **asks)
        assert answer.startswith(f"HTTP/1.1 {status} ")
        assert ("<!DOCTYPE html>" in answer) is (status == 200)
        (reply,) = await asked(connection, A)
        assert reply["verdict"] == "currently_true"


@live
async def test_of_connections_that_are_closed_the_page_has_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "ENDED", 4)
    first = Session(SEQUENCE, "scattered")
    page = ConnectionsPage("tree", SEQUENCE, first)
    async with served(first.fork, page=page) as url, connected(url) as lasting:
        await asked(lasting, A)
        for _ in range(20):
            async with connected(url) as passing:
                await asked(passing, {})
        await asked(lasting, B)
        data = json.loads((await told(url, "/events")).partition("data: ")[2])
    rows = {row[1][0].split()[0]: row[2:] for row in data["watches"]}
    assert rows["1"] == [2, [["⊤", 2, 1]], False]
    assert len(rows) < 10
    (said,) = [line for line in data["told"]["held"] if line.startswith("warning: ")]
    assert said == f"warning: {21 - len(rows)} connections that ended are no longer listed"


@pytest.mark.parametrize(
    ("shared", "per", "rows"),
    [
        (False, Per.TREE, [[["?", None, 0]], [["⊤", 2, 1]]]),
        (True, Per.TREE, [[["⊤", 2, 1]]]),
        (
            False,
            Per.KIND,
            [[["?", None, 0], ["?", None, 0], ["?", None, 0]], [["⊤", 1, 1], ["?", None, 0], ["⊤", 1, 1]]],
        ),
    ],
)
@live
async def test_the_page_has_what_each_connection_did(
    shared: bool, per: Per, rows: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections_page, "_WAIT", 0.5)
    tree = SEQUENCE if per is Per.TREE else loads("top or a b; a fault; b attack;")
    first = Session(tree, "scattered", per=per)
    page = ConnectionsPage("tree", tree, first, shared=shared)
    async with served((lambda: first) if shared else first.fork, page=page) as url:
        async with connected(url), connected(url) as other:
            await asked(other, *([A, B] if per is Per.TREE else [B]), "nonsense")
            stream = (await told(url, "/events?after=x")).partition("data: ")[2]
            data = json.loads(stream)
            assert [row[3] for row in data["watches"]] == rows
            assert ("message refused" in " ".join(data["told"]["held"]), data["changes"] != []) == (True, True)
            empty = await told(url, "/events", more=f"Last-Event-ID: {data['cursor']}\r\n")
            assert "data: " not in empty
        later = await told(url, f"/events?after={data['cursor']}")
        assert "closed after" in later


@pytest.mark.parametrize("shared", [False, True])
@live
async def test_what_did_not_happen_is_found_while_no_message_comes(shared: bool) -> None:
    """It is on the page; with one session for all, also when the robot has gone."""
    tree = loads("semantics scattered; time t as s; event e(x) = { e: x }; lost on e(X) without e(X) for 1 s after;")
    first = Session(tree)
    page = ConnectionsPage("tree", tree, first, shared=shared)
    fresh, alone = ((lambda: first), {"tree": first}) if shared else (first.fork, None)
    async with served(fresh, tree=tree, page=page, clock=50_000_000, shared=alone) as url:
        async with connected(url) as robot:
            (reply,) = await asked(robot, {"e": 1, "t": time()})
            assert reply["verdict"] == "currently_true"
            if not shared:
                await asyncio.sleep(1.5)
                (reply,) = await asked(robot, {})
                assert (reply["verdict"], reply["variables"]) == (False, {"X": 1})
        await asyncio.sleep(1.5 if shared else 0)
        data = json.loads((await told(url, "/events?after=x")).partition("data: ")[2])
    (change,) = data["changes"]
    assert change["passed"].startswith("time ")
    assert change["detections"][0]["absent"] == ["no e(X) for 1 s after event 1"]
    assert any("detected at time " in line for line in data["told"]["held"])


@live
async def test_each_of_several_trees_is_told_and_has_a_page(tmp_path: Path) -> None:
    (tmp_path / "trees").mkdir()
    for name, text in {"ab": "top sand a b; a attack; b fault;", "ba": "top sand b a;"}.items():
        written(tmp_path / "trees" / f"{name}.rvaft", f"semantics scattered; {text}")
    with serving(tmp_path / "trees", cwd=tmp_path) as (running, url):
        async with connected(url) as connection:
            *_, last = await asked(connection, A, B)
            assert last["verdict"] == "currently_false"
            assert {PurePath(name).name: one["verdict"] for name, one in last["trees"].items()} == {
                "ab.rvaft": False,
                "ba.rvaft": "currently_true",
            }
            index = await told(url, "/")
            assert re.findall('<a href="(.*?)">.*?class="number">(.*?)</td>', index) == [("ab/", "1"), ("ba/", "0")]
            for page, symbol in (("ab", "⊤"), ("ba", "?")):
                assert "all trees" in await told(url, f"/{page}/")
                data = json.loads((await told(url, f"/{page}/events?after=x")).partition("data: ")[2])
                assert [row[3][0][0] for row in data["watches"]] == [symbol]
            assert (await told(url, "/events")).startswith("HTTP/1.1 404 ")
            moved = await told(url, "/ab")
            assert moved.startswith("HTTP/1.1 308 ")
            assert "Location: /ab/" in moved
        running.send_signal(signal.SIGTERM)
        assert running.wait(20) == 0
        assert running.stderr is not None
        assert f"{tmp_path / 'trees' / 'ab.rvaft'}: detected at event 2: branch 1" in running.stderr.read()
    failed(run("serve", tmp_path / "trees", "--branch", 1), "--branch is for one tree")
    failed(run("serve", tmp_path / "trees", "--clock", "1s"), "--clock needs the time of events")


# -- who is let in -----------------------------------------------------------------------------------------------------


@live
async def test_an_origin_that_is_not_allowed_is_refused_and_other_machines_are_not_heard() -> None:
    async with served(origins=["https://dashboard.example"]) as url:
        for more, status in (
            ("", "101"),
            ("Origin: https://dashboard.example\r\n", "101"),
            ("Origin: http://evil.example\r\n", "403"),
            (f"Origin: http://{urlsplit(url).netloc}\r\nOrigin: http://evil.example\r\n", "403"),
        ):
            _, writer, line = await opened(url, more)
            writer.transport.abort()
            assert status in line, more
        with pytest.raises(OSError):  # noqa: PT011 -- refused or unreachable, as the system has it
            await asyncio.open_connection("127.0.0.2", endpoint(url)[1])


@pytest.mark.parametrize(("what", "first", "second"), rows(__file__, "names.txt"))
def test_hosts_and_origins(what: str, first: str, second: str | None) -> None:
    match what:
        case "own" | "foreign":  # an address vouches for itself, and what is no address for nobody
            assert allowed([first], second, ()) is (what == "own")
            assert allowed([first], second, (first,))
        case "origin":
            assert second is not None
            assert allowed([second], "127.0.0.1:8080", (origin_of(first),))
        case "no origin":
            with pytest.raises(OptionError, match="is not an origin"):
                origin_of(first)
        case "host":
            require_host(first)
        case "no host":
            with pytest.raises(OptionError, match="is not an IP address or a host name"):
                require_host(first)
        case _:
            raise AssertionError(what)


# -- as a process
# -------------------------------------------------------------------------------------------------------


@live
async def test_the_options_reach_the_replies_and_an_interrupt_ends_it() -> None:
    words = "--polarity detection --vocabulary strings --semantics scattered --per branch --max-message 2 --quiet"
    with serving(TREES / "gates" / "or.rvaft", *words.split()) as (running, url):
        async with connected(url) as connection:
            first, last = await asked(connection, {"x": "y" * 1_500_000}, B)
            running.send_signal(signal.SIGINT)
            await asyncio.wait_for(connection.wait_closed(), 20)
        assert running.stderr is not None
        assert (connection.close_code, running.wait(20), running.stderr.read()) == (1001, 0, "")
    detected = {"1": "currently_false", "2": "true", "3": "currently_false"}
    assert (first["verdict"], last["verdict"], last["verdicts"]) == ("currently_false", "true", detected)


@live
async def test_rosmonitoring_writes_seconds_whatever_the_tree_reads(tmp_path: Path) -> None:
    """A tree for recordings has nanoseconds: 100.0 and 9000.0 are then no second apart."""
    tree = written(tmp_path / "tree.rvaft", "time time as ns; bad sand a b within 1 s; a; b;")
    for option, expected in (("seconds", "currently_true"), ("declared", False)):
        with serving(tree, "--message-time", option) as (_, url):
            async with connected(url) as connection:
                replies = await asked(connection, {"event": "a", "time": 100.0}, {"event": "b", "time": 9000.0})
        assert [reply["verdict"] for reply in replies] == ["currently_true", expected]
        assert replies[1]["time"] == 9000.0
    failed(run("serve", tree), "reads `time` as ns", "--message-time seconds", "--message-time declared")
    tree.write_text("time time as ns; event e(t) = { time: t }; bad sand a b within 1 s; a on e(1); b;")
    failed(run("serve", tree, "--message-time", "seconds"), "uses `time`, whose values would be in ns")


@live
async def test_each_repeated_detection_is_said_and_that_there_can_be_no_other() -> None:
    with serving(TREES / "gates" / "sand.rvaft", "--repeat") as (running, url):
        async with connected(url) as connection:
            replies = await asked(connection, *({"event": name} for name in "abcxabcb"))
        running.send_signal(signal.SIGTERM)
        assert running.wait(20) == 0
        assert running.stderr is not None
        said = [line.removeprefix("rvaft: connection 1: ") for line in running.stderr.read().splitlines()]
    told = [number for number, reply in enumerate(replies, 1) if reply["verdict"] != "currently_true"]
    assert (told, [replies[number - 1]["detection"] for number in told]) == ([3, 7], [1, 2])
    assert said[1:4] == [
        "detected at event 3: branch 1 (detection 1)",
        "detected at event 7: branch 1 (detection 2)",
        "under projected no detection is possible after event 8; consecutive and scattered continue (--semantics)",
    ]


@pytest.mark.ci
@live
async def test_what_happens_is_said(tmp_path: Path) -> None:
    """Also of connections beyond what is allowed, and beyond the files that there may be; it goes on all the same."""
    tree = written(tmp_path / "tree.rvaft", "top or f s; f fault; s sand a b; a attack; b;")
    words = "--kind attack --semantics scattered --shared --max-connections 2"
    with serving(tree, *words.split(), preexec_fn=FEW_FILES) as (running, url):
        assert running.stderr is not None
        async with connected(url) as one, connected(url) as other:
            await asked(one, "", {"event": "f"}, A)
            with pytest.raises(websockets.exceptions.InvalidStatus, match="503"):
                await connected(url)
            await asked(other, B)
            await asked(one, B)
        lines: list[str] = []
        for times in (1, 2):
            clients = [socket.create_connection(endpoint(url)) for _ in range(60)]
            while sum("too many" in line for line in lines) < times:
                lines.append(await asyncio.to_thread(running.stderr.readline))
                assert lines[-1], lines
            for client in clients:
                client.close()
            async with connected(url) as late:
                assert (await asked(late, {}))[0]["verdict"] is False
        running.send_signal(signal.SIGTERM)
        lines += await asyncio.to_thread(running.stderr.readlines)
        assert running.wait(20) == 0
    assert sorted(re.sub("^rvaft: | from [0-9.:]+|\n", "", line) for line in lines) == [
        "connection 1 closed after 3 events",
        "connection 1 opened",
        "connection 1: message refused: not JSON: expecting value",
        "connection 2 closed after 1 event",
        "connection 2 opened",
        "connection 2: detected at event 3: branch 2, attack",
        "connection 3 closed after 1 event",
        "connection 3 opened",
        "connection 4 closed after 1 event",
        "connection 4 opened",
        "connection refused: there are 2, the most that --max-connections allows",
        *["too many open files: new connections wait; raise the limit with ulimit -n"] * 2,
    ]


@pytest.mark.ci
@live
async def test_it_ends_at_the_limit_of_open_files_while_clients_hold_connections_and_nobody_reads_stderr() -> None:
    with serving(SAND, preexec_fn=FEW_FILES) as (running, url):
        assert running.stderr is not None
        clients = [socket.create_connection(endpoint(url)) for _ in range(MANY)]
        said = await asyncio.to_thread(running.stderr.readline)
        running.send_signal(signal.SIGTERM)
        assert await asyncio.to_thread(running.wait, 20) == 0
        said += running.stderr.read()
        for client in clients:
            client.close()
    assert said == "rvaft: too many open files: new connections wait; raise the limit with ulimit -n\n"


@live
async def test_what_could_be_missed_is_said_at_first_and_counted_at_the_end(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "event e(v) = { e: v }; top sand a b; a on e(X) when X > 1; b on e(2);")
    with serving(tree) as (running, url):
        assert running.stderr is not None
        async with connected(url) as one:
            await asked(one, {"e": "x"}, {"e": "y"}, '{"e": NaN}')
        running.send_signal(signal.SIGTERM)
        said = [line.removeprefix("rvaft: connection 1") for line in running.stderr.read().splitlines()]
    guard, example = "undefined guard in {}: X > 1 of a, where X is", 'a string ("x") (first: event 1)'
    assert said[1:] == [
        f": {guard.format('1 event')} {example}",
        ": undefined number in 1 event: e is NaN (first: event 3)",
        (
            f" closed after 3 events; {guard.format('2 events')} {example}; undefined number in 1 event: e is "
            "NaN (first: event 3)"
        ),
    ]


def test_a_port_in_use() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = run("serve", SAND, "--port", port)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"rvaft: error: ws://127.0.0.1:{port}: the port is in use: choose another with --port\n"


def test_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    failed(run("serve", SAND), "websockets is not installed: pip install '.[ros]' in a checkout")


@live
async def test_the_client_that_rosmonitoring_uses() -> None:
    """It names the address that it connects to as its origin, and answers pings only while it waits for a reply."""
    client = pytest.importorskip("websocket")

    def talk(url: str) -> list[Any]:
        oracle = client.create_connection(url, timeout=20, http_no_proxy=["127.0.0.1"])
        replies = []
        for event in (A, B, {}):
            oracle.send(json.dumps(event))
            replies.append(json.loads(oracle.recv())["verdict"])
        oracle.close()
        return replies

    async with served() as url:
        assert await asyncio.to_thread(talk, url) == ["currently_true", False, False]
