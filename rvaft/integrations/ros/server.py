"""The WebSocket server of the oracle, with a session per connection or a shared one; needs
`websockets`.
"""

import asyncio
import errno
import json
import logging
import resource
import socket
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, Any, Final

from rvaft.errors import installed
from rvaft.integrations.ros.connections_page import ConnectionsPages
from rvaft.integrations.ros.protocol import MessageProtocol, Session, reply_of_all
from rvaft.model.verdict import Verdict
from rvaft.stream.verdict_change import time_told
from rvaft.support.network import LOCAL, allowed, unavailable
from rvaft.support.wording import counted

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

REMEDY: Final = "pip install '.[ros]' in a checkout of rvaft"
PORT: Final = 8080
CONNECTIONS: Final = 1000
_SPARE: Final = 64
_MAX_REPORTED: Final = 10
"""Maximum number of refused messages reported per connection."""
_OVERSIZE: Final = 2
"""A message up to so many times the maximum size gets an error reply; a longer one ends the
connection.
"""
_BACKLOG: Final = 1024
"""Length of the accept queue, because all monitors of a robot start at once."""
_ACCEPTED: Final = 1
"""Connections that `asyncio` accepts at a time, and its retries at the limit of open files."""
_HANDSHAKE: Final = 5.0
"""Seconds for the opening handshake."""
_PATIENCE: Final = 1.0
"""Seconds for the closing handshake."""
_UNREAD: Final = 10.0
"""Seconds after which a client that does not read its replies is disconnected."""
_QUEUE: Final = 1
"""Messages of a client that wait while one is answered; further ones wait in the socket."""
_LOG: Final = logging.getLogger("rvaft.ros")
_LIBRARY: Final = logging.getLogger("rvaft.ros.websockets")
_LIBRARY.addHandler(logging.NullHandler())
_LIBRARY.propagate = False


@dataclass(eq=False)
class Server:
    """Answers the messages of all connections; `fresh` returns the sessions of a new connection, by tree.

    `say` receives reports on connections, refused messages and detections. Port 0 is any free port.
    `origins` are allowed in addition to programs. Browsers get the `pages`, if there are some. With a
    `clock`, in nanoseconds, sessions are told the time so often, also `shared` ones without a connection.
    """

    protocols: Mapping[str, MessageProtocol]
    fresh: Callable[[], Mapping[str, Session]]
    say: Callable[[str], object]
    host: str = LOCAL
    port: int = PORT
    origins: Collection[str] = ()
    connections: int = CONNECTIONS
    pages: ConnectionsPages | None = None
    clock: int | None = None
    shared: Mapping[str, Session] | None = None

    def __post_init__(self) -> None:
        self._stop = asyncio.Event()
        self.present: dict[ServerConnection, tuple[str, Mapping[str, Session]]] = {}
        self._full = False
        self._numbers = count(1)

    def _tell(self, line: str) -> None:
        self.say(line)
        if self.pages is not None:
            self.pages.say(line)

    async def admit(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        """Refuse a connection of a foreign origin or without room; answer plain requests with the
        page.
        """
        hosts = request.headers.get_all("Host")
        plain = not any("websocket" in one.lower() for one in request.headers.get_all("Upgrade"))
        if plain and self.pages is not None and not request.headers.get_all("Origin"):
            return await self.pages.answer(connection, request, self.origins, self._stop)
        if len(self.present) >= self.connections:
            why = f"there are {len(self.present)}, the most that --max-connections allows"
            status, answer = HTTPStatus.SERVICE_UNAVAILABLE, "too many connections; try again later"
        elif not allowed(request.headers.get_all("Origin"), hosts[0] if len(hosts) == 1 else None, self.origins):
            why = "its origin is not allowed; allow it with --origin"
            status, answer = HTTPStatus.FORBIDDEN, "this origin is not allowed; allow it with --origin"
        else:
            return None
        self._tell(f"connection from {_peer(connection)} refused: {why}")
        return connection.respond(status, f"{answer}\n")

    async def handle(self, connection: "ServerConnection") -> None:
        """Answer the messages of one connection."""
        peer = connection.transport.get_extra_info("socket")
        if peer is not None:  # detect clients whose machine is gone
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        sessions = self.fresh()
        first = next(iter(sessions.values()))
        self._full = False
        number = next(self._numbers)
        name = f"connection {number}"
        self.present[connection] = name, sessions
        self._tell(f"{name} from {_peer(connection)} opened")
        if self.pages is not None:
            self.pages.opened(number, _peer(connection), sessions)
        read = refused = 0
        try:
            async for message in connection:
                events = first.events
                news = {f"{name}: {tree}": _News(session) for tree, session in _labelled(sessions)}
                reply = reply_of_all(self.protocols, message, sessions)
                if first.events == events:
                    refused += 1
                    if refused <= _MAX_REPORTED:
                        more = "; further ones are not reported" if refused == _MAX_REPORTED else ""
                        self._tell(f"{name}: message refused: {reply['error']}{more}")
                for label, one in news.items() if first.events > events else ():
                    for line in one.lines(f"event {first.events}"):
                        self._tell(f"{label}{line}")
                read += first.events - events
                await self._send(connection, name, json.dumps(reply))
        except _library("exceptions").ConnectionClosed:
            pass
        except Exception as error:
            _LOG.error("rvaft: error: a defect in rvaft ended a connection: %s: %s", type(error).__name__, error)
            raise
        finally:
            self.present.pop(connection, None)
            found = dict.fromkeys(line for session in sessions.values() for line in session.data_warnings.lines)
            if self.pages is not None:
                self.pages.closed(sessions)
            self._tell(f"{name} closed after {counted(read)}{''.join(f'; {line}' for line in found)}")

    async def _tell_time(self, period: int) -> None:
        """Tell the sessions the time, until the server stops."""
        while True:
            await asyncio.sleep(period / 1e9)
            now = datetime.now(tz=UTC)
            told = [("all connections", self.shared)] if self.shared is not None else [*self.present.values()]
            for name, sessions in told:
                for label, session in _labelled(sessions):
                    news = _News(session)
                    session.pass_time(now)
                    for line in news.lines(time_told(now)):
                        self._tell(f"{name}: {label}{line}")

    async def _send(self, connection: "ServerConnection", name: str, reply: str) -> None:
        """Send a reply, or disconnect a client that does not read its replies."""
        try:
            async with asyncio.timeout(_UNREAD):
                await connection.send(reply)
        except TimeoutError:
            connection.transport.abort()
            self._tell(f"{name}: disconnected, because it has not read its replies for {_UNREAD:g} s")

    def failed(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Report an exception of the event loop, as `asyncio` does.

        The limit of open files is reported once until the next connection opens. A failing retry of
        accepting during a stop is ignored.
        """
        error = context.get("exception")
        if self._stop.is_set() and "_start_serving" in context.get("message", ""):
            return
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            if not self._full:  # `asyncio` retries every second
                self.say("too many open files: new connections wait; raise the limit with ulimit -n")
            self._full = True
        else:
            loop.default_exception_handler(context)

    async def serve(self, stop: asyncio.Event, listening: Callable[[str], object]) -> None:
        """Answer messages until `stop` is set; `listening` receives the URL.

        Raises `ToolMissing` and `OSError`.
        """
        library, self._stop = _library("asyncio.server"), stop
        least, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        wanted = self.connections + _SPARE
        if least != resource.RLIM_INFINITY and least < wanted:
            with suppress(ValueError, OSError):
                enough = wanted if most == resource.RLIM_INFINITY else min(wanted, most)
                resource.setrlimit(resource.RLIMIT_NOFILE, (enough, most))
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self.failed)
        host = f"[{self.host}]" if ":" in self.host else self.host
        async with AsyncExitStack() as stack:
            serving = library.serve(
                self.handle,
                self.host,
                self.port,
                process_request=self.admit,
                create_connection=_answering(library.ServerConnection),
                compression=None,
                ping_interval=None,  # the ROSMonitoring client answers pings only while it waits for a reply
                open_timeout=_HANDSHAKE,
                close_timeout=_PATIENCE,
                max_size=max(one.longest for one in self.protocols.values()) * _OVERSIZE,
                max_queue=_QUEUE,
                logger=_LIBRARY,
                backlog=_ACCEPTED,
            )
            try:
                listener = await stack.enter_async_context(serving)
            except OSError as error:
                raise unavailable(error, f"ws://{host}:{self.port}") from error
            for listened in listener.sockets:
                with listened.dup() as same:
                    same.listen(_BACKLOG)
            listening(f"ws://{host}:{listener.sockets[0].getsockname()[1]}")
            telling = None if self.clock is None else asyncio.create_task(self._tell_time(self.clock))
            await stop.wait()
            if telling is not None:
                telling.cancel()
            for connection in self.present:  # a client that reads no replies does not read the close frame either
                loop.call_later(2 * _PATIENCE, connection.transport.abort)


def _labelled(sessions: Mapping[str, Session]) -> Iterator[tuple[str, Session]]:
    """Yield the sessions, each with the start of lines about it, which names the tree of several."""
    for tree, session in sessions.items():
        yield f"{tree}: " if len(sessions) > 1 else "", session


class _News:
    """What a session finds from now on, as lines."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._known = session.count.notified, session.verdict(), len(session.data_warnings.found), len(session.failures)

    def lines(self, where: str) -> Iterator[str]:
        """Yield the lines; `where` is the event or the time."""
        session = self._session
        detected, verdict, doubts, failures = self._known
        if session.count.notified > detected:
            how = session.count.explanation
            branch = [] if how is None or how.branch is None else [f"branch {how.branch}"]
            said = ", ".join([*branch, *sorted(kind.value for kind in (() if how is None else how.kinds))])
            which = f" (detection {session.count.notified})" if session.repeat else ""
            yield f"detected at {where}{f': {said}' if said else ''}{which}"
        elif session.verdict() is Verdict.FALSE is not verdict:
            why = f"under {session.semantics} no detection is possible after {where}"
            yield f"{why}; consecutive and scattered continue (--semantics)"
        for label, failure in list(session.failures.items())[failures:]:
            yield f"the monitor of {label} failed after {where}: {failure}"
        yield from list(session.data_warnings.lines)[doubts:]


def _library(part: str) -> Any:
    return installed(f"websockets.{part}", "websockets", REMEDY)


def _answering(connection: Any) -> Any:
    """Return a connection class that also answers malformed requests and requests with a body."""

    class Answering(connection):  # type: ignore[misc] # the library is imported on use
        def send_data(self) -> None:
            unread = isinstance(self.protocol.handshake_exc, _library("exceptions").InvalidMessage)
            if unread and self.request is None and not self.transport.is_closing():
                why = b"400 not an HTTP request, or a request with a body\n"
                head = (
                    b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: "
                    b"close\r\nContent-Length: %d\r\n\r\n"
                )
                with suppress(RuntimeError, OSError):  # the library has already answered
                    self.transport.write(head % len(why) + why)
            super().send_data()

    return Answering


def _peer(connection: "ServerConnection") -> str:
    found = connection.remote_address
    return "somewhere" if not found else f"[{found[0]}]:{found[1]}" if ":" in found[0] else f"{found[0]}:{found[1]}"
