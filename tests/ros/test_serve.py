"""`rvaft serve` as a process: where it listens, how it ends, what it refuses."""

import asyncio
import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from rvaft.model.values import Json
from tests.cli.runs import COMMAND, PRUNED, TREES, failed, process, run
from tests.ros.clients import asked, connected, websockets

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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(number: signal.Signals) -> None:
    async def talk(running: "subprocess.Popen[str]", url: str) -> int | None:
        async with connected(url) as connection:
            await asked(connection, {"event": "a"})
            running.send_signal(number)
            await asyncio.wait_for(connection.wait_closed(), 20)
            return connection.close_code

    with serving(SAND) as (running, url):
        assert asyncio.run(talk(running, url)) == 1001
        assert running.wait(timeout=20) == 0
        assert running.stderr is not None
        said = running.stderr.read().splitlines()
        assert [line.split(" from ")[0] for line in said] == [
            "rvaft: connection 1",
            "rvaft: connection 1 closed after 1 event",
        ]
        assert said[0].endswith(" opened")


def test_what_happens_is_said_unless_it_is_to_be_quiet() -> None:
    for options, expected in (
        (
            ["--shared"],
            [
                "connection 1: message refused: not JSON: expecting value",
                "connection 1: detected at event 1: branch 1",
                "connection 1 closed after 2 events",
                "connection 2 closed after 1 event",
            ],
        ),
        (["--quiet"], []),
    ):
        with serving(OR, *options) as (running, url):
            conversation(url, "", {"event": "a"}, {"event": "b"})
            conversation(url, {"event": "a"})
            running.send_signal(signal.SIGTERM)
            assert running.wait(timeout=20) == 0
            assert running.stderr is not None
            said = [line.removeprefix("rvaft: ") for line in running.stderr.read().splitlines()]
            assert [line for line in said if " opened" not in line] == expected


def test_more_connections_than_allowed_are_refused() -> None:
    async def talk(url: str) -> None:
        async with connected(url) as one, connected(url):
            with pytest.raises(websockets.exceptions.InvalidStatus, match="503"):
                async with connected(url):
                    pass
            assert await asked(one, {"event": "x"})
        async with connected(url) as later:
            assert await asked(later, {"event": "x"})

    with serving(SAND, "--max-connections", "2") as (running, url):
        asyncio.run(talk(url))
        running.send_signal(signal.SIGTERM)
        assert running.wait(timeout=20) == 0
        assert running.stderr is not None
        assert "refused: there are 2, the most that --max-connections allows" in running.stderr.read()


def test_without_files_for_more_connections_there_is_one_line() -> None:
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40)); from rvaft.cli import main; "
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


def test_it_ends_although_clients_hold_on() -> None:
    with serving(SAND) as (running, url):
        host, port = url.removeprefix("ws://").split(":")
        with socket.create_connection((host, int(port))) as silent, socket.create_connection((host, int(port))) as rude:
            rude.sendall(b"nonsense\r\n\r\n")
            conversation(url, {"event": "a"})
            running.send_signal(signal.SIGTERM)
            assert running.wait(timeout=20) == 0
            assert silent.recv(1) == b""
        assert running.stderr is not None
        assert len(running.stderr.read().splitlines()) == 2


def test_the_options_reach_the_replies() -> None:
    words = ["--polarity", "detection", "--vocabulary", "strings", "--semantics", "scattered", "--per", "branch"]
    with serving(OR, *words, "--max-message", "2") as (_, url):
        first, last = conversation(url, {"x": "y" * 1_500_000}, {"event": "b"})
        assert (first["verdict"], last["verdict"], last["verdicts"]["2"]) == ("currently_false", "true", "true")
        assert set(last["verdicts"].values()) == {"true", "currently_false"}
    with serving(OR, "--branch", "1", "--shared") as (_, url):
        assert [conversation(url, {"event": name})[0]["verdict"] for name in "xa"] == ["currently_true", False]
        assert conversation(url, {})[0]["verdict"] is False
    for row, expected in [("table2_row1", "currently_true"), ("table2_row3", False)]:  # a fault, an attack
        with serving(PRUNED, "--kind", "attack") as (_, url):
            lines = (PRUNED.parent / "pruned.traces" / f"{row}.jsonl").read_text(encoding="utf-8").splitlines()
            assert conversation(url, *lines)[-1]["verdict"] == expected


def test_a_port_in_use() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = process("serve", SAND, "--port", port)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"rvaft: error: ws://127.0.0.1:{port}: the port is in use: choose another with --port\n"


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--port", "65536"], "65536"),
        (["--port", "x"], "'x'"),
        (["--host", "192.0.2.1"], "choose another --host"),
        (["--host", "nowhere.invalid"], "no such host"),
        (["--host", ""], '"" is no IP address and no host name'),
        (["--host", "http://x:1"], '"http://x:1" is no IP address and no host name'),
        (["--host", "0"], '"0" is no IP address and no host name'),
        (["--origin", ""], '"" is no origin'),
        (["--origin", "nonsense"], '"nonsense" is no origin'),
        (["--branch", "9"], "branch 9"),
        (["--kind", "attack"], "attack"),
        (["--branch", "1", "--kind", "attack"], "exclude each other"),
        (["--per", "branch", "--branch", "1"], "exclude each other"),
        (["--polarity", "both"], "'both'"),
        (["--max-message", "0"], "0"),
    ],
)
def test_what_it_refuses(words: list[str], part: str) -> None:
    failed(run("serve", SAND, *words), part)


def test_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    failed(run("serve", SAND), "websockets is not installed: pip install '.[ros]' in a checkout")


def test_other_commands_do_not_import_the_library() -> None:
    code = "import sys, rvaft.cli.ros; print(any(name.startswith('websockets') for name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


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
