"""A server, in this process or in one of its own, and clients that speak to it."""

import asyncio
import json
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from functools import wraps
from typing import Any, Final

import pytest

from rvaft import RVAFT, loads
from rvaft.integrations.ros.connections_page import ConnectionsPage, ConnectionsPages
from rvaft.integrations.ros.protocol import MessageProtocol, Session
from rvaft.integrations.ros.server import Server
from rvaft.model.values import Json
from tests.cli.runs import started

websockets = pytest.importorskip("websockets", reason="needs websockets")
from websockets.asyncio.client import ClientConnection, connect  # noqa: E402 -- after the question whether it is there

SEQUENCE: Final = loads("top sand a b; a attack; b fault;")
A: Final = {"event": "a"}
B: Final = {"event": "b"}
LIBRARY_ON_USE: Final = (
    "import sys, rvaft.integrations.ros.commands; assert 'websockets' not in sys.modules; rvaft.cli.main()"
)


def live(scenario: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """A test that is a coroutine; `live` stands closest to it."""

    @wraps(scenario)
    def test(**fixtures: Any) -> None:
        asyncio.run(asyncio.wait_for(scenario(**fixtures), 60))

    return test


@asynccontextmanager
async def served(
    fresh: Callable[[], Session] | None = None,
    *,
    tree: RVAFT = SEQUENCE,
    origins: Sequence[str] = (),
    longest: int = 1024 * 1024,
    page: ConnectionsPage | None = None,
    clock: int | None = None,
    shared: Mapping[str, Session] | None = None,
) -> AsyncIterator[str]:
    """The URL of a server, which is stopped at the end and has then let go of everything; each
    connection has a `fresh` session.
    """
    stop = asyncio.Event()
    url: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    speaking, make = {"tree": MessageProtocol(tree, longest=longest)}, fresh or Session(tree).fork
    pages = None if page is None else ConnectionsPages([page])
    async with asyncio.TaskGroup() as group:
        server = Server(
            speaking,
            lambda: {"tree": make()},
            lambda _: None,
            port=0,
            origins=origins,
            pages=pages,
            clock=clock,
            shared=shared,
        )
        group.create_task(server.serve(stop, url.set_result))
        try:
            yield await url
        finally:
            stop.set()


@contextmanager
def serving(*args: object, **options: Any) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """A server as a process of its own, and its URL."""
    words = [sys.executable, "-c", LIBRARY_ON_USE, "serve", *map(str, args), "--port", "0"]
    with started(args=words, **options) as running:
        said = running.stdout.readline()
        assert said.startswith("listening at ws://127.0.0.1:")
        yield running, said.split()[-1]


def connected(url: str) -> connect:
    """A connection to a server, to be entered."""
    return connect(url, proxy=None, max_size=None)


async def asked(connection: ClientConnection, *messages: Json) -> list[Any]:
    """The replies to messages: bytes and text as they are, anything else as JSON."""
    replies = []
    for message in messages:
        await connection.send(message if isinstance(message, str | bytes) else json.dumps(message))
        replies.append(json.loads(await asyncio.wait_for(connection.recv(), 20)))
    return replies
