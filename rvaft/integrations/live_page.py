"""A page over HTTP: what a request is answered, whoever asks it, and a small server that answers one log's browsers.

There is a page at `/`, and where it is live a stream of server-sent events at `/events`: each has
as its `id` the cursor with which a browser that lost the stream asks again, and as JSON what is new
since the cursor before. Nothing else is there, nothing can be sent, and no text of a request comes
back.
"""

import socket
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from queue import Empty, SimpleQueue
from threading import BoundedSemaphore, Event, Thread
from time import monotonic
from typing import Any, Final, Literal
from urllib.parse import parse_qs, urlsplit

from rvaft.reports.log_report import policy
from rvaft.support.network import LOCAL, own, unavailable

PERIOD: Final = 0.25
"""Seconds between two looks for what is new."""
BROWSERS: Final = 32
"""Requests that are answered at once; a page holds one."""
_PATIENCE: Final = 10.0
"""Seconds that a browser has to say what it wants, or to take what it is sent."""
_HEARTBEAT: Final = 5.0
"""Seconds after which something is sent, to find out who is gone."""
_REFUSALS: Final = {
    HTTPStatus.FORBIDDEN: "this server goes by its address or by localhost; allow others with --origin",
    HTTPStatus.NOT_FOUND: "there is only the page, at /",
    HTTPStatus.METHOD_NOT_ALLOWED: "only GET",
    HTTPStatus.SERVICE_UNAVAILABLE: "too many browsers; close another one",
}
Told = tuple[str, bytes]
"""A cursor, and what is new up to it."""
Asked = Literal["page", "events"]


def asked(target: str, *, live: bool) -> Asked | None:
    """What the target of a request asks for, if that is there.

    >>> asked("/", live=True), asked("/events?after=1", live=True), asked("/../etc/passwd", live=True)
    ('page', 'events', None)
    """
    path = target.partition("?")[0]
    return "page" if path == "/" else "events" if path == "/events" and live else None


def cursor_of(target: str, last: str | None) -> str:
    """The cursor of a request for events: that of the last event that the browser had, or else what the target says."""
    with suppress(ValueError):
        return last or parse_qs(urlsplit(target).query).get("after", [""])[0]
    return ""


def message(told: Told) -> bytes:
    r"""What is new as one event of a stream.

    >>> message(("7", b"{}"))
    b'id: 7\ndata: {}\n\n'
    """
    cursor, new = told
    return b"id: %s\ndata: %s\n\n" % (cursor.encode(), new)


def headers(kind: Asked | None, *, live: bool) -> Mapping[str, str]:
    """What every answer says of itself: what it is, what a browser may do with it, and that it is not to be kept."""
    types = {"page": "text/html", "events": "text/event-stream", None: "text/plain"}
    return {
        "Content-Type": f"{types[kind]}; charset=utf-8",
        "Content-Security-Policy": f"{policy(live=live)}; frame-ancestors 'none'",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


def refusal(status: HTTPStatus, more: str = "") -> str:
    r"""What a request that is refused is told, in one line; `more` is said of what there is here.

    >>> refusal(HTTPStatus.NOT_FOUND, ", and WebSocket")
    '404 there is only the page, at /, and WebSocket\n'
    """
    return f"{status.value} {_REFUSALS[status]}{more}\n"


class Questions:
    """What browsers ask, each in a thread of its own, and the thread that reads the log answers when it has time."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[str | None, Future[Any]]] = SimpleQueue()

    def ask(self, cursor: str | None) -> Any:
        """The answer, which is waited for: what is new since a cursor, or without one the page."""
        future: Future[Any] = Future()
        self._waiting.put((cursor, future))
        return future.result()

    def answer(self, make: Callable[[str | None], Any], *, wait: float = 0.0) -> None:
        """Answer all that is asked now; for the first it may be waited so many seconds."""
        with suppress(Empty):
            while True:
                cursor, future = self._waiting.get(timeout=wait) if wait else self._waiting.get_nowait()
                wait = 0.0
                try:
                    future.set_result(make(cursor))
                except BaseException as error:
                    future.set_exception(error)
                    raise

    def close(self) -> None:
        """Nobody answers any more."""
        with suppress(Empty):
            while True:
                self._waiting.get_nowait()[1].cancel()


class PageServer(ThreadingHTTPServer):
    """Gives browsers a page, and where it is `live` what is new: `ask` is given a cursor, or None for the page.

    Port 0 is any that is free; `origins` are those whose hosts this server may be called by, beside
    addresses. Raises `OSError` where the address cannot be listened at.
    """

    daemon_threads = True
    request_queue_size = 64

    def __init__(
        self,
        ask: Callable[[str | None], Any],
        *,
        live: bool,
        host: str = LOCAL,
        port: int = 0,
        origins: Collection[str] = (),
    ) -> None:
        self.ask = ask
        self.live = live
        self.origins = origins
        self.closing = Event()
        self.room = BoundedSemaphore(BROWSERS)
        shown = f"[{host}]" if ":" in host else host
        try:
            self.address_family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            super().__init__((str(address[0]), int(address[1])), _Answering)
        except OSError as error:
            raise unavailable(error, f"http://{shown}:{port}") from error
        self.url = f"http://{shown}:{self.server_address[1]}/"

    def server_bind(self) -> None:
        """Bind, without asking any name server for a name."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002 (the interface)
        """A browser that is gone is no error; a defect is one line."""
        error = sys.exception()
        if not isinstance(error, OSError | CancelledError):
            print(f"rvaft: error: a defect in rvaft ended a request: {type(error).__name__}: {error}", file=sys.stderr)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Within, browsers are answered."""
        thread = Thread(target=self.serve_forever, kwargs={"poll_interval": PERIOD}, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self.closing.set()
            self.shutdown()
            self.server_close()


class _Answering(BaseHTTPRequestHandler):
    """One request; the connection ends with it."""

    server: PageServer
    server_version, sys_version = "rvaft", ""
    default_request_version = "HTTP/1.1"
    """Also what is no request gets an answer with a status."""
    protocol_version = "HTTP/1.1"
    error_content_type = "text/plain; charset=utf-8"
    error_message_format = "%(code)d %(message)s\n"
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """The page, or the stream of what is new."""
        server = self.server
        kind = asked(self.path, live=server.live)
        if not own(self.headers.get_all("Host", []), server.origins):
            self._refuse(HTTPStatus.FORBIDDEN)
        elif kind is None:
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not server.room.acquire(blocking=False):
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE)
        else:
            try:
                if kind == "page":
                    self._send(HTTPStatus.OK, server.ask(None), "page")
                elif self.command == "HEAD":
                    self._begin(HTTPStatus.OK, "events")
                else:
                    self._stream(cursor_of(self.path, self.headers.get("Last-Event-ID")))
            finally:
                server.room.release()

    do_HEAD = do_GET  # noqa: N815 (the interface)

    def do_POST(self) -> None:
        """Nothing is taken."""
        self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, " and HEAD")

    do_PUT = do_DELETE = do_PATCH = do_OPTIONS = do_TRACE = do_CONNECT = do_POST  # noqa: N815 (the interface)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002
        """What is no request is told so; the message would repeat it."""
        super().send_error(code)

    def _stream(self, cursor: str) -> None:
        self._begin(HTTPStatus.OK, "events")
        spoken = monotonic()
        while not self.server.closing.is_set():
            new, sent = self.server.ask(cursor), b""
            if new[1]:
                cursor, sent = new[0], message(new)
            elif monotonic() - spoken > _HEARTBEAT:
                sent = b":\n\n"
            if sent:
                self.wfile.write(sent)
                spoken = monotonic()
            self.server.closing.wait(PERIOD)

    def _refuse(self, status: HTTPStatus, more: str = "") -> None:
        self._send(status, refusal(status, more).encode(), None)

    def _send(self, status: HTTPStatus, body: bytes, kind: Asked | None) -> None:
        self._begin(status, kind, len(body))
        if self.command != "HEAD":
            self.wfile.write(body)

    def _begin(self, status: HTTPStatus, kind: Asked | None, length: int | None = None) -> None:
        self.send_response(status)
        for name, value in headers(kind, live=self.server.live).items():
            self.send_header(name, value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            self.send_header("Allow", "GET, HEAD")
        self.send_header("Connection", "close")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 (the interface)
        """Who asks for what is nobody's business."""
