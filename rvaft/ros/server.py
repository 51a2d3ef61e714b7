"""The WebSocket server: one session per connection, or one for all; needs the library `websockets`."""

import asyncio
import errno
import json
import logging
import os
import resource
import socket
from collections.abc import Callable, Collection
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, Any, Final

from rvaft.errors import ToolMissing
from rvaft.model.verdict import Verdict
from rvaft.monitoring.detection import counted
from rvaft.ros.addresses import allowed
from rvaft.ros.addresses import host as checked
from rvaft.ros.protocol import Protocol, Session

if TYPE_CHECKING:
    from types import ModuleType

    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


LOCAL: Final = "127.0.0.1"
"""Reached from this machine alone."""
REMEDY: Final = "pip install '.[ros]' in a checkout of rvaft"
"""What installs the libraries that this needs."""
PORT: Final = 8080
"""Where ROSMonitoring looks for an oracle unless told otherwise."""

CONNECTIONS: Final = 1000
"""How many connections there may be at once unless told otherwise."""
_SPARE: Final = 64
"""Open files beside the connections."""
_TOLD: Final = 10
"""Messages of a connection that are told to be refused."""
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
    """Where to listen; port 0 is any that is free. `origins` are allowed beside those of programs, as `rvaft.ros.addresses.origin` gives them.

    `connections` is how many there may be at once. Raises `OptionError` for what is no host.
    """

    host: str = LOCAL
    port: int = PORT
    origins: Collection[str] = field(default=())
    connections: int = CONNECTIONS

    def __post_init__(self) -> None:
        checked(self.host)


class OracleServer:
    """Answers the messages of all connections; `fresh` gives the session of a new one, `say` is told what happens, a line each."""

    def __init__(
        self, protocol: Protocol, fresh: Callable[[], Session], address: Address, say: Callable[[str], object]
    ) -> None:
        self.protocol = protocol
        self.fresh = fresh
        self.address = address
        self.say = say
        self.present: set[ServerConnection] = set()
        self._numbers = count(1)

    def admit(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        """Refuse a connection whose origin is not allowed, or for which there is no room."""
        if len(self.present) >= self.address.connections:
            full = f"there are {len(self.present)}, the most that --max-connections allows"
            self.say(f"connection from {_peer(connection)} refused: {full}")
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "too many connections; try again later\n")
        hosts = request.headers.get_all("Host")
        origins = request.headers.get_all("Origin")
        if allowed(origins, hosts[0] if len(hosts) == 1 else None, self.address.origins):
            return None
        self.say(f"connection from {_peer(connection)} refused: its origin is not allowed; allow it with --origin")
        return connection.respond(HTTPStatus.FORBIDDEN, "this origin is not allowed; allow it with --origin\n")

    async def handle(self, connection: "ServerConnection") -> None:
        """Answer the messages of one connection."""
        peer = connection.transport.get_extra_info("socket")
        if peer is not None:  # let the system notice a client whose machine is gone
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        session = self.fresh()
        self.present.add(connection)
        name = f"connection {next(self._numbers)}"
        self.say(f"{name} from {_peer(connection)} opened")
        read = refused = 0
        try:
            async for message in connection:
                events, detected = session.events, session.whole.verdict is Verdict.TRUE
                reply = self.protocol.reply(message, session)
                if session.events == events:
                    refused += 1
                    if refused <= _TOLD:
                        more = "; of more it is not told" if refused == _TOLD else ""
                        self.say(f"{name}: message refused: {reply['error']}{more}")
                elif session.whole.verdict is Verdict.TRUE and not detected:
                    branch = [] if reply.get("branch") is None else [f"branch {reply['branch']}"]
                    how = ", ".join([*branch, *reply.get("kinds", [])])
                    self.say(f"{name}: detected at event {session.events}{f': {how}' if how else ''}")
                read += session.events - events
                await connection.send(json.dumps(reply))
        except _library().exceptions.ConnectionClosed:
            pass
        except Exception as error:
            _LOG.error("rvaft: error: a defect in rvaft ended a connection: %s: %s", type(error).__name__, error)
            raise
        finally:
            self.present.discard(connection)
            self.say(f"{name} closed after {counted(read)}")

    def failed(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Say in one line that there is no room for another connection; anything else as `asyncio` does."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            self.say("too many open files: new connections have to wait; allow more with ulimit -n")
        else:
            loop.default_exception_handler(context)

    def hang_up(self) -> None:
        """End the connections that are left."""
        for connection in tuple(self.present):
            connection.transport.abort()


async def serve(
    protocol: Protocol,
    fresh: Callable[[], Session],
    stop: asyncio.Event,
    *,
    address: Address = Address(),
    listening: Callable[[str], object] = lambda url: None,  # noqa: ARG005 (the interface)
    say: Callable[[str], object] = lambda line: None,  # noqa: ARG005 (the interface)
) -> None:
    """Answer messages until `stop` is set; `fresh` gives the session of a new connection, `listening` is told the URL.

    `say` is told, a line each, of connections, of messages that are no events, and of detections. Raises `ToolMissing` without the
    library, and `OSError` where the address cannot be listened at.
    """
    library = _library()
    make_room(address.connections)
    oracle = OracleServer(protocol, fresh, address, say)
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(oracle.failed)
    async with AsyncExitStack() as stack:
        serving = library.asyncio.server.serve(
            oracle.handle,
            address.host,
            address.port,
            process_request=oracle.admit,
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
        loop.call_later(2 * _PATIENCE, oracle.hang_up)


def _library() -> "ModuleType":
    """The library, imported now."""
    try:
        import websockets.asyncio.server  # noqa: PLC0415 -- imported on use
        import websockets.exceptions  # noqa: PLC0415 -- imported on use
    except ImportError:
        raise ToolMissing("websockets", remedy=REMEDY) from None
    return websockets


def make_room(connections: int) -> None:
    """Let this process have as many open files as that many connections need, if the system allows it."""
    least, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = connections + _SPARE
    if least != resource.RLIM_INFINITY and least < wanted:
        with suppress(ValueError, OSError):
            resource.setrlimit(
                resource.RLIMIT_NOFILE, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most)
            )


def _peer(connection: "ServerConnection") -> str:
    found = connection.remote_address
    return "somewhere" if not found else f"[{found[0]}]:{found[1]}" if ":" in found[0] else f"{found[0]}:{found[1]}"


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
