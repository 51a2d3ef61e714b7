"""A server in this process and clients that speak to it."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from functools import wraps
from typing import Any, Final

import pytest

from rvaft import RVAFT, loads
from rvaft.model.values import Json
from rvaft.monitoring.monitor_set import Per
from rvaft.ros.protocol import Polarity, Protocol, Session, Vocabulary
from rvaft.ros.server import Address, serve

websockets = pytest.importorskip("websockets", reason="needs websockets")
from websockets.asyncio.client import ClientConnection, connect  # noqa: E402 -- after the question whether it is there

SEQUENCE: Final = loads("top sand a b; a attack; b fault;")
A: Final = {"event": "a"}
B: Final = {"event": "b"}


def live(scenario: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """A test that is a coroutine; `live` stands closest to it."""

    @wraps(scenario)
    def test(**fixtures: Any) -> None:
        asyncio.run(asyncio.wait_for(scenario(**fixtures), 60))

    return test


@asynccontextmanager
async def served(
    tree: RVAFT = SEQUENCE,
    *,
    semantics: str = "projected",
    per: Per = Per.TREE,
    shared: bool = False,
    origins: Sequence[str] = (),
    polarity: Polarity = Polarity.PROPERTY,
    vocabulary: Vocabulary = Vocabulary.RML,
    longest: int = 1024 * 1024,
) -> AsyncIterator[str]:
    """The URL of a server, which is stopped at the end and has then let go of everything."""
    stop = asyncio.Event()
    url: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    first = Session(tree, semantics, per=per)
    running = asyncio.create_task(
        serve(
            Protocol(tree, polarity=polarity, vocabulary=vocabulary, longest=longest),
            (lambda: first) if shared else first.fork,
            stop,
            address=Address(port=0, origins=origins),
            listening=url.set_result,
        )
    )

    def failed(done: "asyncio.Task[None]") -> None:
        if not url.done():
            url.set_exception(done.exception() or AssertionError("it ended before it had a URL"))

    running.add_done_callback(failed)
    try:
        yield await url
    finally:
        stop.set()
        await asyncio.wait_for(running, 20)


def connected(url: str, **options: Any) -> connect:
    """A connection to a server, to be entered."""
    return connect(url, proxy=None, max_size=None, **options)


async def asked(connection: ClientConnection, *messages: Json) -> list[Json]:
    """The replies to messages: bytes and text as they are, anything else as JSON."""
    replies = []
    for message in messages:
        await connection.send(message if isinstance(message, str | bytes) else json.dumps(message))
        replies.append(json.loads(await asyncio.wait_for(connection.recv(), 20)))
    return replies
