"""Servers and live runs under attack: output that nobody reads, and clients that do not behave.

Every process listens at 127.0.0.1, and has to answer or to end within `LONG` seconds.
"""

import fcntl
import json
import os
import re
import resource
import signal
import socket
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest

from rvaft.support.output import ROOM, LogStream

TREE: Final = "top sand a b; a attack; b fault;\n"
LONG: Final = 30.0
UPGRADE: Final = (
    "GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n{more}\r\n"
)
SIGNALS: Final = (signal.SIGTERM, signal.SIGINT)


def soon(what: Callable[[], object], seconds: float = LONG) -> bool:
    """Whether something comes true within so many seconds."""
    until = time.monotonic() + seconds
    while not what():
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


@contextmanager
def started(*args: object, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """The command as a process with pipes that nobody reads, unless the test does."""
    words = [sys.executable, "-m", "rvaft", *map(str, args)]
    given = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    with subprocess.Popen(words, **given) as running:
        try:
            yield running
        finally:
            running.kill()
            for stream in (running.stdout, running.stderr):
                if stream is not None:
                    stream.close()


def ends(running: subprocess.Popen[bytes], sign: signal.Signals) -> tuple[int, float]:
    """The status after one signal, and the seconds that it took."""
    begun = time.monotonic()
    running.send_signal(sign)
    return running.wait(LONG), time.monotonic() - begun


def pending(stream: Any) -> int:
    """The number of bytes in a pipe."""
    return int(struct.unpack("i", fcntl.ioctl(stream, termios.FIONREAD, bytes(4)))[0])


def is_full(stream: Any) -> bool:
    """Whether a pipe holds much, and no more for a while."""
    before = pending(stream)
    time.sleep(0.3)
    return before > 60_000 and pending(stream) == before


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def memory(running: subprocess.Popen[bytes]) -> int:
    """The largest resident size of a process so far, in MiB."""
    status = Path(f"/proc/{running.pid}/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) // 1024


def endpoint(url: str) -> tuple[str, int]:
    host, port = urlsplit(url).netloc.split(":")
    return host, int(port)


def frame(payload: bytes) -> bytes:
    """A masked message of text."""
    size = len(payload)
    if size < 126:
        return b"\x81" + bytes([0x80 | size, 0, 0, 0, 0]) + payload
    if size < 1 << 16:
        return b"\x81\xfe" + size.to_bytes(2) + bytes(4) + payload
    return b"\x81\xff" + size.to_bytes(8) + bytes(4) + payload


def upgraded(url: str, more: str = "") -> tuple[socket.socket, bytes]:
    """A WebSocket connection by hand, and the first line of the answer."""
    connection = socket.create_connection(endpoint(url), timeout=LONG)
    connection.sendall(UPGRADE.format(host=urlsplit(url).netloc, more=more).encode())
    head = b""
    while b"\r\n\r\n" not in head:
        data = connection.recv(4096)
        if not data:
            break
        head += data
    return connection, head.split(b"\r\n")[0]


def answer(connection: socket.socket) -> dict[str, Any]:
    """The next short message of the server."""
    data = b""
    while len(data) < 2 or len(data) < 2 + (data[1] & 0x7F):
        data += connection.recv(4096)
        if data[1] & 0x7F == 126 and len(data) >= 4:
            size = int.from_bytes(data[2:4])
            while len(data) < 4 + size:
                data += connection.recv(65536)
            return dict(json.loads(data[4 : 4 + size]))
    return dict(json.loads(data[2:]))


@contextmanager
def serving(folder: Path, *more: object, **options: Any) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """`rvaft serve`, and the URL of the server."""
    pytest.importorskip("websockets", reason="needs websockets")
    tree = written(folder / "tree.rvaft", TREE)
    with started("serve", tree, "--port", 0, *more, **options) as running:
        assert running.stdout is not None
        yield running, running.stdout.readline().decode().split()[-1]


# -- output that nobody reads -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", SIGNALS)
def test_serve_answers_and_ends_while_nobody_reads_its_log(sign: signal.Signals, tmp_path: Path) -> None:
    with serving(tmp_path) as (running, url):
        for _ in range(900):  # each is a line in the log
            connection, status = upgraded(url, "Origin: http://evil.example\r\n")
            assert b" 403 " in status
            connection.close()
        assert soon(lambda: is_full(running.stderr))
        connection, status = upgraded(url)
        assert b" 101 " in status
        connection.sendall(frame(b'{"event": "a"}'))
        assert answer(connection)["verdict"] == "currently_true"
        status_, took = ends(running, sign)
        assert status_ == 0
        assert took < 10
        connection.close()


def test_lines_for_a_log_that_nobody_reads_are_dropped_and_counted() -> None:
    reading, writing = os.pipe()
    stream = LogStream(writing)
    begun, count = time.monotonic(), 0
    while count * 100 < 2 * ROOM:
        stream.write(f"{count:099}\n")
        count += 1
    assert time.monotonic() - begun < 10
    assert not stream.finish(0.2)
    said = b""
    while b"not read\n" not in said:
        said += os.read(reading, 1 << 16)
    lines = said.decode().splitlines()
    assert stream.finish(LONG)
    stream.write("again\n")
    assert stream.finish(LONG)
    assert os.read(reading, 100) == b"again\n"
    dropped = re.fullmatch(r"rvaft: warning: (\d+) lines were dropped here: standard error was not read", lines[-1])
    assert dropped is not None
    assert [int(line) for line in lines[:-1]] == list(range(count - int(dropped[1])))
    os.close(reading)
    stream.write("lost\n")  # nobody can read it
    assert stream.finish(LONG)
    os.close(writing)


@pytest.mark.parametrize("sign", SIGNALS)
@pytest.mark.parametrize("form", ["jsonl", "text"])
def test_one_signal_ends_a_run_whose_output_nobody_reads(sign: signal.Signals, form: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREE)
    log = written(tmp_path / "log.jsonl", '{"event": "a"}\n{"event": "b"}\n' * 10_000)
    with started("monitor", tree, log, "--follow", "--repeat", "--format", form) as running:
        assert soon(lambda: is_full(running.stdout))
        status, took = ends(running, sign)
        assert running.stderr is not None
        said = running.stderr.read().decode()
    assert (status, took < 10) == (2, True)
    assert said.splitlines()[-1].startswith("rvaft: error: standard output: cannot write: nothing reads it")


@pytest.mark.parametrize("sign", SIGNALS)
@pytest.mark.parametrize(
    "command", ["yes >&2", "sleep 1000", "trap '' TERM INT; while :; do sleep 1; done", "exec cat /dev/zero"]
)
def test_one_signal_ends_a_run_whose_commands_never_end(sign: signal.Signals, command: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREE)
    log = written(tmp_path / "log.jsonl", '{"event": "a"}\n{"event": "b"}\n' * 3)
    with started(
        "monitor", tree, log, "--follow", "--repeat", "--exec", f"echo > {tmp_path}/begun; {command}"
    ) as running:
        assert soon((tmp_path / "begun").exists)
        _, took = ends(running, sign)
    assert took < 15


@pytest.mark.parametrize("more", [(), ("--order-by", "t", "--window", "50"), ("--input", "regex")])
def test_after_one_signal_no_event_is_read_and_no_command_started(more: tuple[str, ...], tmp_path: Path) -> None:
    tree, state = written(tmp_path / "tree.rvaft", TREE), tmp_path / "state"
    line = "{} {}\n" if "regex" in more else '{{"event": "{}", "t": {}}}\n'
    log = written(tmp_path / "log.jsonl", "".join(line.format("ab"[number % 2], number) for number in range(8_000)))
    more += ("--pattern", r"(?P<event>\w) (?P<t>\d+)") if "regex" in more else ()
    words = ("monitor", tree, log, *more, "--repeat", "--format", "jsonl", "--detections", "--checkpoint", state)
    with started(*words, "--follow", "--exec", f"echo >> {tmp_path}/begun; sleep 60") as running:
        assert soon((tmp_path / "begun").exists)
        _, took = ends(running, signal.SIGTERM)
        said, warned = (stream.read().decode() for stream in (running.stdout, running.stderr) if stream is not None)
    assert took < 10
    assert len((tmp_path / "begun").read_text()) < 4
    assert "was not read: the monitor was stopped" in warned
    with started(*words) as running:
        rest, failed = (text.decode() for text in running.communicate(timeout=4 * LONG))
    assert (running.returncode, failed) == (1, "")
    reported = [record for text in (said, rest) for record in map(json.loads, text.splitlines())]
    found = [record["event"] for record in reported if "again" not in record]
    assert found == list(range(2, 8_001, 2))


def test_a_command_that_reads_slowly_or_nothing_gets_a_large_detection(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREE)
    log = written(tmp_path / "log.jsonl", json.dumps({"event": "a", "x": "y" * 2_000_000}) + '\n{"event": "b"}\n')
    for command in ("sleep 0.5; cat > found", "true"):
        with started("monitor", tree, log, "--exec", command, cwd=tmp_path) as running:
            _, said = running.communicate(timeout=LONG)
        assert (running.returncode, said) == (1, b"")
    assert len(json.loads((tmp_path / "found").read_text())["events"]["1"]["x"]) == 2_000_000


# -- clients that do not behave ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("clients", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_clients_that_read_no_replies_cost_little_and_are_disconnected(clients: int, tmp_path: Path) -> None:
    with serving(tmp_path) as (running, url), ExitStack() as stack:
        before = memory(running)
        message = frame(json.dumps({"event": "x", "more": "y" * 1_000_000}).encode())
        connections = []
        for _ in range(clients):
            connection, _ = upgraded(url)
            stack.callback(connection.close)
            connection.setblocking(False)
            connections.append((connection, bytearray(message * 20)))
        log = b""
        assert running.stderr is not None
        os.set_blocking(running.stderr.fileno(), False)
        until = time.monotonic() + 4 * LONG  # to send and read so much takes long
        gone = b"disconnected, because it has not read its replies"
        while log.count(gone) < clients and time.monotonic() < until:
            for connection, left in connections:
                with suppress(OSError):
                    del left[: connection.send(left[: 1 << 18])]
            with suppress(OSError):
                log += running.stderr.read() or b""
            time.sleep(0.02)
        assert log.count(gone) == clients
        assert memory(running) - before < 100 + 6 * clients
        connection, _ = upgraded(url)
        connection.sendall(frame(b'{"event": "a"}'))
        assert answer(connection)["verdict"] == "currently_true"
        connection.close()
        assert ends(running, signal.SIGTERM)[0] == 0


def test_serve_answers_after_long_and_deep_messages(tmp_path: Path) -> None:
    with serving(tmp_path) as (running, url):
        for text in ("[" * 400_000, '{"a":' * 150_000, json.dumps({"event": "a", "x": "y" * 1_200_000})):
            connection, _ = upgraded(url)
            connection.sendall(frame(text.encode()))
            assert "error" in answer(connection)
            connection.sendall(frame(b'{"event": "a"}'))
            assert answer(connection)["verdict"] == "currently_true"
            connection.close()
        connection, _ = upgraded(url)
        with suppress(OSError):
            connection.sendall(frame(b" " * 10_000_000))
        with suppress(OSError):
            assert b"\x03\xf1" in connection.recv(4096)  # 1009
        connection.close()
        assert memory(running) < 300


@contextmanager
def viewing(folder: Path, *more: object, files: int) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """`rvaft view` with at most so many open files."""
    tree, log = written(folder / "tree.rvaft", TREE), written(folder / "log.jsonl", '{"event": "a"}\n')
    limit = partial(resource.setrlimit, resource.RLIMIT_NOFILE, (files, files))
    with started("view", tree, log, *more, preexec_fn=limit) as running:
        assert running.stdout is not None
        yield running, running.stdout.readline().decode().split()[-1]


def drip(connections: Sequence[socket.socket]) -> int:
    """Send a byte of a header on each connection; return how many are still open."""
    still = 0
    for connection in connections:
        with suppress(OSError):
            connection.send(b"x")
            still += connection.fileno() >= 0 and not _is_closed(connection)
    return still


def _is_closed(connection: socket.socket) -> bool:
    try:
        return not connection.recv(4096)
    except BlockingIOError:
        return False
    except OSError:
        return True


@pytest.mark.parametrize("more", [(), ("--follow",)])
def test_view_outlives_clients_that_never_finish_their_requests(more: tuple[str, ...], tmp_path: Path) -> None:
    with viewing(tmp_path, *more, files=64) as (running, url), ExitStack() as stack:
        connections = []
        for _ in range(100):
            connection = stack.enter_context(socket.create_connection(endpoint(url), timeout=LONG))
            with suppress(OSError):
                connection.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ")
            connection.setblocking(False)
            connections.append(connection)
        assert soon(lambda: not drip(connections))
        with urlopen(url, timeout=LONG) as page:
            assert b"<html" in page.read()
        assert running.poll() is None
        assert ends(running, signal.SIGTERM) < (1, 10)


def test_view_ends_while_nobody_reads_the_page_or_the_updates(tmp_path: Path) -> None:
    with viewing(tmp_path, "--follow", files=256) as (running, url), ExitStack() as stack:
        for target in ("/", "/events") * 10:
            connection = stack.enter_context(socket.create_connection(endpoint(url), timeout=LONG))
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
            connection.sendall(f"GET {target} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        with urlopen(url, timeout=LONG) as page:
            assert b"<html" in page.read()
        assert ends(running, signal.SIGINT) < (1, 10)
