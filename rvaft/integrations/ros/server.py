"""The WebSocket server of the oracle, with a session per connection or a shared one; needs
`websockets`.
"""

import asyncio
import errno
import json
import logging
import resource
import socket
from collections.abc import Callable, Collection
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, Any, Final

from rvaft.errors import installed
from rvaft.integrations.ros.connections_page import ConnectionsPage
from rvaft.integrations.ros.protocol import Protocol, Session
from rvaft.model.verdict import Verdict
from rvaft.stream.detection import counted
from rvaft.support.network import LOCAL, allowed, unavailable

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
    """Answers the messages of all connections; `fresh` returns the session of a new connection.

    `say` receives reports on connections, refused messages and detections. Port 0 is any free port.
    `origins` are allowed in addition to programs. Browsers get the `page`, if there is one.
    """

    protocol: Protocol
    fresh: Callable[[], Session]
    say: Callable[[str], object]
    host: str = LOCAL
    port: int = PORT
    origins: Collection[str] = ()
    connections: int = CONNECTIONS
    page: ConnectionsPage | None = None

    def __post_init__(self) -> None:
        self._stop = asyncio.Event()
        self.present: set[ServerConnection] = set()
        self._full = False
        self._numbers = count(1)

    def _tell(self, line: str) -> None:
        self.say(line)
        if self.page is not None:
            self.page.say(line)

    async def admit(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        """Refuse a connection of a foreign origin or without room; answer plain requests with the
        page.
        """
        hosts = request.headers.get_all("Host")
        plain = not any("websocket" in one.lower() for one in request.headers.get_all("Upgrade"))
        if plain and self.page is not None and not request.headers.get_all("Origin"):
            return await self.page.answer(connection, request, self.origins, self._stop)
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
        session = self.fresh()
        self.present.add(connection)
        self._full = False
        number = next(self._numbers)
        name = f"connection {number}"
        self._tell(f"{name} from {_peer(connection)} opened")
        if self.page is not None:
            self.page.opened(number, _peer(connection), session)
        read = refused = 0
        try:
            async for message in connection:
                events, detected, verdict = session.events, session.count.notified, session.verdict()
                doubts, failures = len(session.data_warnings.found), len(session.failures)
                reply = self.protocol.reply(message, session)
                if session.events == events:
                    refused += 1
                    if refused <= _MAX_REPORTED:
                        more = "; further ones are not reported" if refused == _MAX_REPORTED else ""
                        self._tell(f"{name}: message refused: {reply['error']}{more}")
                elif session.count.notified > detected:
                    branch = [] if reply.get("branch") is None else [f"branch {reply['branch']}"]
                    how = ", ".join([*branch, *reply.get("kinds", [])])
                    which = f" (detection {session.count.notified})" if session.repeat else ""
                    self._tell(f"{name}: detected at event {session.events}{f': {how}' if how else ''}{which}")
                elif session.verdict() is Verdict.FALSE is not verdict:
                    why = f"under {session.semantics} no detection is possible after event {session.events}"
                    self._tell(f"{name}: {why}; consecutive and scattered continue (--semantics)")
                for label, failure in list(session.failures.items())[failures:]:
                    self._tell(f"{name}: the monitor of {label} failed after event {session.events}: {failure}")
                for line in list(session.data_warnings.lines)[doubts:]:
                    self._tell(f"{name}: {line}")
                read += session.events - events
                await self._send(connection, name, json.dumps(reply))
        except _library("exceptions").ConnectionClosed:
            pass
        except Exception as error:
            _LOG.error("rvaft: error: a defect in rvaft ended a connection: %s: %s", type(error).__name__, error)
            raise
        finally:
            self.present.discard(connection)
            doubtful = "".join(f"; {line}" for line in session.data_warnings.lines)
            if self.page is not None:
                self.page.closed(session)
            self._tell(f"{name} closed after {counted(read)}{doubtful}")

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
                max_size=self.protocol.longest * _OVERSIZE,
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
            await stop.wait()
            for connection in self.present:  # a client that reads no replies does not read the close frame either
                loop.call_later(2 * _PATIENCE, connection.transport.abort)


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
