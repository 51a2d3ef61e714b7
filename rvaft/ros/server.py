"""The WebSocket server: one session per connection, or one for all; needs the library `websockets`."""

import asyncio
import errno
import logging
import os
import socket
from collections.abc import Callable, Collection
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from rvaft.errors import ToolMissing
from rvaft.ros.addresses import allowed
from rvaft.ros.addresses import host as checked
from rvaft.ros.protocol import Protocol, Session, encoded

if TYPE_CHECKING:
    from types import ModuleType

    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


LOCAL: Final = "127.0.0.1"
"""Reached from this machine alone."""
PORT: Final = 8080
"""Where ROSMonitoring looks for an oracle unless told otherwise."""

_OVERSIZE: Final = 16
"""A message up to this many times the longest that is read gets an error reply; a longer one ends its connection."""
_BACKLOG: Final = 1024
"""Connections that may wait to be taken: all monitors of a robot start at once."""
_HANDSHAKE: Final = 5.0
"""Seconds that a client has to say what it wants."""
_PATIENCE: Final = 1.0
"""Seconds that a client has to take leave."""

_LOG: Final = logging.getLogger("rvaft.ros")
_LIBRARY: Final = logging.getLogger("rvaft.ros.websockets")
_LIBRARY.addHandler(logging.NullHandler())
_LIBRARY.propagate = False


@dataclass(frozen=True, slots=True)
class Address:
    """Where to listen; port 0 is any that is free. `origins` are allowed beside those of programs, as `rvaft.serving.origins.origin` gives them.

    Raises `OptionError` for what is no host.
    """

    host: str = LOCAL
    port: int = PORT
    origins: Collection[str] = field(default=())

    def __post_init__(self) -> None:
        checked(self.host)


async def serve(
    protocol: Protocol,
    fresh: Callable[[], Session],
    stop: asyncio.Event,
    *,
    address: Address = Address(),
    listening: Callable[[str], object] = lambda url: None,  # noqa: ARG005 (the interface)
) -> None:
    """Answer messages until `stop` is set; `fresh` gives the session of a new connection, `listening` is told the URL.

    Raises `ToolMissing` without the library, and `OSError` where the address cannot be listened at.
    """
    library = _library()
    present: set[ServerConnection] = set()

    async def handle(connection: "ServerConnection") -> None:
        _keep_alive(connection)
        session = fresh()
        present.add(connection)
        try:
            async for message in connection:
                await connection.send(encoded(protocol.reply(message, session)))
        except library.exceptions.ConnectionClosed:
            pass
        except Exception as error:
            _LOG.error("rvaft: error: a defect in rvaft ended a connection: %s: %s", type(error).__name__, error)
            raise
        finally:
            present.discard(connection)

    def hang_up() -> None:
        for connection in tuple(present):
            connection.transport.abort()

    def admit(connection: "ServerConnection", request: "Request") -> "Response | None":
        hosts = request.headers.get_all("Host")
        if allowed(request.headers.get_all("Origin"), hosts[0] if len(hosts) == 1 else None, address.origins):
            return None
        return connection.respond(HTTPStatus.FORBIDDEN, "this origin is not allowed; allow it with --origin\n")

    async with AsyncExitStack() as stack:
        serving = library.asyncio.server.serve(
            handle,
            address.host,
            address.port,
            process_request=admit,
            compression=None,
            ping_interval=None,  # the client of ROSMonitoring answers pings only while it waits for a reply
            open_timeout=_HANDSHAKE,
            close_timeout=_PATIENCE,
            max_size=protocol.longest * _OVERSIZE,
            logger=_LIBRARY,
            backlog=_BACKLOG,
        )
        try:
            server = await stack.enter_async_context(serving)
        except OSError as error:
            raise _refused(error, address) from error
        listening(_url(address.host, server.sockets[0].getsockname()[1]))
        await stop.wait()
        # who reads no replies does not read either that the server goes away
        asyncio.get_running_loop().call_later(2 * _PATIENCE, hang_up)


def _library() -> "ModuleType":
    """The library, imported now."""
    try:
        import websockets.asyncio.server  # noqa: PLC0415 -- imported on use
        import websockets.exceptions  # noqa: PLC0415 -- imported on use
    except ImportError:
        raise ToolMissing("websockets", remedy="pip install 'rvaft[ros]'") from None
    return websockets


def _keep_alive(connection: "ServerConnection") -> None:
    """Let the system notice a client whose machine is gone."""
    peer = connection.transport.get_extra_info("socket")
    if peer is not None:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)


def _url(host: str, port: int) -> str:
    return f"ws://[{host}]:{port}" if ":" in host else f"ws://{host}:{port}"


def _refused(error: OSError, address: Address) -> OSError:
    """The same error in one line that says what to do."""
    code = error.errno or 0
    match code:
        case errno.EADDRINUSE:
            reason = "the port is in use: choose another with --port"
        case errno.EACCES:
            reason = "not permitted: choose a --port above 1023"
        case errno.EADDRNOTAVAIL:
            reason = "no address of this machine: choose another --host"
        case _ if isinstance(error, socket.gaierror):
            reason = f"no such host: {error.strerror}"
        case _:
            reason = os.strerror(code)
    return OSError(code, reason, _url(address.host, address.port))
