"""The WebSocket server, with one session per connection or one for all, and whom it lets in; needs the library `websockets`.

A page in somebody's browser must not be able to speak to a monitor on their machine. A browser says with `Origin` where a page comes from.
Programs say nothing there, or, like the client that ROSMonitoring uses, the address they connect to. A name that an attacker can point at this
machine is no proof of that, so only addresses, `localhost` and what was allowed are taken; and of these only with the port that the
request went to, since other servers have other pages.
"""

import asyncio
import errno
import json
import logging
import os
import re
import resource
import socket
from collections.abc import Callable, Collection, Sequence
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from http import HTTPStatus
from ipaddress import ip_address
from itertools import count
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from rvaft.errors import OptionError, installed
from rvaft.model.verdict import Verdict
from rvaft.monitoring.detection import counted
from rvaft.ros.protocol import Protocol, Session

if TYPE_CHECKING:
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
_PORTS: Final = {"http": 80, "https": 443}
"""The schemes of web pages, and the ports that their origins do not name."""
_ADDRESS: Final = re.compile(r"[0-9A-Fa-f.:]+(?:%[A-Za-z0-9._-]+)?")
_NAME: Final = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(?:\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*\.?")
_NUMBER: Final = re.compile(r"(?:.*\.)?(?:[0-9]+|0[xX][0-9A-Fa-f]*)\.?")
"""The system reads `0` and `0x7f.1` as addresses, the first as all of this machine; no name ends so."""

_LOG: Final = logging.getLogger("rvaft.ros")
_LIBRARY: Final = logging.getLogger("rvaft.ros.websockets")
_LIBRARY.addHandler(logging.NullHandler())
_LIBRARY.propagate = False


def require_host(text: str) -> None:
    """Raise `OptionError` for what is no IP address and no host name (RFC 1123, and `_`, which containers have)."""
    if not is_address(text) and (len(text) > 253 or not _NAME.fullmatch(text) or _NUMBER.fullmatch(text)):
        raise OptionError(f'"{text}" is no IP address and no host name: write it alone, as in 127.0.0.1 or robot.local')


def is_address(text: str) -> bool:
    """Whether a text is an IP address, of IPv6 also with a zone."""
    try:
        return bool(_ADDRESS.fullmatch(text) and ip_address(text))
    except ValueError:
        return False


def origin(text: str) -> str:
    """An origin as a browser sends it: a final slash and the scheme's own port are dropped; raises `OptionError` for what is none."""
    try:
        parts = urlsplit(text.lower())
        name, port = parts.hostname or "", parts.port
        require_host(name)
    except ValueError:  # an `OptionError` is one
        parts, name, port = urlsplit(""), "", None
    number = "" if port in (None, _PORTS.get(parts.scheme)) else f":{port}"
    plain = f"{parts.scheme}://{f'[{name}]' if ':' in name else name}"
    if parts.scheme not in _PORTS or text.lower().removesuffix("/") not in (f"{plain}{number}", f"{plain}:{port}"):
        raise OptionError(f'"{text}" is no origin: write http:// or https://, a host and, where there is one, a port')
    return f"{plain}{number}"


def allowed(origins: Sequence[str], host: str | None, extra: Collection[str]) -> bool:
    """Whether a request with these `Origin` headers and this `Host` header is taken; `extra` are allowed, as `origin` gives them."""
    if len(origins) != 1 or origins[0].lower() in extra:
        return len(origins) < 2
    if host is None or origins[0] != f"http://{host}":
        return False
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    return name == "localhost" or is_address(name)  # nothing that is looked up


@dataclass(eq=False)
class Server:
    """Answers the messages of all connections; `fresh` gives the session of a new one.

    `say` is told, a line each, of connections, of messages that are no events, and of detections. Port 0 is any that is free; `origins` are
    allowed beside those of programs, as `origin` gives them; `connections` is how many there may be at once.
    """

    protocol: Protocol
    fresh: Callable[[], Session]
    say: Callable[[str], object]
    host: str = LOCAL
    port: int = PORT
    origins: Collection[str] = ()
    connections: int = CONNECTIONS

    def __post_init__(self) -> None:
        self.present: set[ServerConnection] = set()
        self._full = False
        self._numbers = count(1)

    def admit(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        """Refuse a connection whose origin is not allowed, or for which there is no room."""
        hosts = request.headers.get_all("Host")
        if len(self.present) >= self.connections:
            why = f"there are {len(self.present)}, the most that --max-connections allows"
            status, answer = HTTPStatus.SERVICE_UNAVAILABLE, "too many connections; try again later"
        elif not allowed(request.headers.get_all("Origin"), hosts[0] if len(hosts) == 1 else None, self.origins):
            why = "its origin is not allowed; allow it with --origin"
            status, answer = HTTPStatus.FORBIDDEN, "this origin is not allowed; allow it with --origin"
        else:
            return None
        self.say(f"connection from {_peer(connection)} refused: {why}")
        return connection.respond(status, f"{answer}\n")

    async def handle(self, connection: "ServerConnection") -> None:
        """Answer the messages of one connection."""
        peer = connection.transport.get_extra_info("socket")
        if peer is not None:  # let the system notice a client whose machine is gone
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        session = self.fresh()
        self.present.add(connection)
        self._full = False
        name = f"connection {next(self._numbers)}"
        self.say(f"{name} from {_peer(connection)} opened")
        read = refused = 0
        try:
            async for message in connection:
                events, detected, verdict = session.events, session.count.told, session.verdict()
                doubts = len(session.oversights.found)
                reply = self.protocol.reply(message, session)
                if session.events == events:
                    refused += 1
                    if refused <= _TOLD:
                        more = "; of more it is not told" if refused == _TOLD else ""
                        self.say(f"{name}: message refused: {reply['error']}{more}")
                elif session.count.told > detected:
                    branch = [] if reply.get("branch") is None else [f"branch {reply['branch']}"]
                    how = ", ".join([*branch, *reply.get("kinds", [])])
                    number = f" (detection {session.count.told})" if session.repeat else ""
                    self.say(f"{name}: detected at event {session.events}{f': {how}' if how else ''}{number}")
                elif session.verdict() is Verdict.FALSE is not verdict:
                    why = f"under {session.semantics} nothing can be detected after event {session.events}"
                    self.say(f"{name}: {why}; consecutive and scattered go on (--semantics)")
                for line in list(session.oversights.lines)[doubts:]:
                    self.say(f"{name}: {line}")
                read += session.events - events
                await connection.send(json.dumps(reply))
        except _library("exceptions").ConnectionClosed:
            pass
        except Exception as error:
            _LOG.error("rvaft: error: a defect in rvaft ended a connection: %s: %s", type(error).__name__, error)
            raise
        finally:
            self.present.discard(connection)
            doubtful = "".join(f"; {line}" for line in session.oversights.lines)
            self.say(f"{name} closed after {counted(read)}{doubtful}")

    def failed(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Say once, until one gets in, that there is no room for another connection; anything else as `asyncio` does."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            if not self._full:  # `asyncio` tries a thousand times a second
                self.say("too many open files: new connections have to wait; allow more with ulimit -n")
            self._full = True
        else:
            loop.default_exception_handler(context)

    async def serve(self, stop: asyncio.Event, listening: Callable[[str], object]) -> None:
        """Answer messages until `stop` is set; `listening` is told the URL.

        Raises `ToolMissing` without the library, and `OSError` where the address cannot be listened at.
        """
        library = _library("asyncio.server")
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
                compression=None,
                ping_interval=None,  # the client of ROSMonitoring answers pings only while it waits for a reply
                open_timeout=_HANDSHAKE,
                close_timeout=_PATIENCE,
                max_size=self.protocol.longest * _OVERSIZE,
                logger=_LIBRARY,
                backlog=_BACKLOG,
            )
            try:
                listener = await stack.enter_async_context(serving)
            except OSError as error:
                code = error.errno or 0
                remedy = {
                    errno.EADDRINUSE: "the port is in use: choose another with --port",
                    errno.EACCES: "not permitted: choose a --port above 1023",
                    errno.EADDRNOTAVAIL: "no address of this machine: choose another --host",
                }
                unknown = f"no such host: {error.strerror}" if isinstance(error, socket.gaierror) else os.strerror(code)
                raise OSError(code, remedy.get(code, unknown), f"ws://{host}:{self.port}") from error
            listening(f"ws://{host}:{listener.sockets[0].getsockname()[1]}")
            await stop.wait()
            for connection in self.present:  # who reads no replies does not read either that the server goes away
                loop.call_later(2 * _PATIENCE, connection.transport.abort)


def _library(part: str) -> Any:
    return installed(f"websockets.{part}", "websockets", REMEDY)


def _peer(connection: "ServerConnection") -> str:
    found = connection.remote_address
    return "somewhere" if not found else f"[{found[0]}]:{found[1]}" if ":" in found[0] else f"{found[0]}:{found[1]}"
