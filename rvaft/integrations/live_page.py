"""The live page over HTTP: answers to requests, and a small server for the browsers of one log.

`/` is the page, and `/events` a stream of server-sent events for a live page. The `id` of an event
is a cursor with which a browser reconnects; its data are the changes as JSON. Of several pages,
`/` lists them, and each has a folder, as in `/NAME/` and `/NAME/events`. Requests cannot change
anything, and answers never contain text of a request.
"""

import errno
import io
import resource
import socket
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from queue import Empty, SimpleQueue
from threading import BoundedSemaphore, Event, Thread
from time import monotonic, sleep
from typing import Any, Final, Literal, NamedTuple, cast
from urllib.parse import parse_qs, urlsplit

from rvaft.reports import index, log_report
from rvaft.reports.page import policy
from rvaft.support.network import LOCAL, own, unavailable

PERIOD: Final = 0.25
BROWSERS: Final = 32
"""Maximum number of concurrent requests; an open page needs one."""
CONNECTIONS: Final = 2 * BROWSERS
"""Maximum number of connections, also of those that have not sent a request."""
_PATIENCE: Final = 10.0
"""Seconds for a whole request, and for each write of an answer."""
_RETRY: Final = 0.2
"""Seconds between attempts to accept a connection without a free file descriptor."""
_HEARTBEAT: Final = 5.0
"""Seconds between messages that detect closed connections."""
_REFUSALS: Final = {
    HTTPStatus.FORBIDDEN: "host not allowed: use the server's address or localhost, or allow the host with --origin",
    HTTPStatus.PERMANENT_REDIRECT: "its address ends in /",
    HTTPStatus.NOT_FOUND: "not found: there is only the page at /",
    HTTPStatus.METHOD_NOT_ALLOWED: "allowed methods: GET",
    HTTPStatus.SERVICE_UNAVAILABLE: "too many open pages; close another one",
}
Changes = tuple[str, bytes]
ResourceKind = Literal["index", "page", "events"]


class Resource(NamedTuple):
    """The list of several pages, a page by its name ("" for the only one), or the stream of its changes."""

    page: str
    kind: ResourceKind


def resource_of(target: str, *, live: bool, pages: Collection[str] = ()) -> Resource | None:
    """Return the resource at a request target, or None; `pages` are the names, if there are several.

    >>> [resource_of(target, live=True) for target in ("/", "/events?after=1", "/../etc/passwd")]
    [Resource(page='', kind='page'), Resource(page='', kind='events'), None]
    >>> [resource_of(target, live=True, pages=["a"]) for target in ("/", "/events", "/a/events", "/b/")]
    [Resource(page='', kind='index'), None, Resource(page='a', kind='events'), None]
    """
    folder, _, last = target.partition("?")[0].rpartition("/")
    page = folder.removeprefix("/")
    if folder and (folder != f"/{page}" or page not in pages):
        return None
    if last == "":
        return Resource(page, "index" if pages and not page else "page")
    return Resource(page, "events") if last == "events" and live and (page or not pages) else None


def moved_to(target: str, pages: Collection[str]) -> str:
    """Return the address of the page whose final slash the target lacks, or "".

    >>> moved_to("/a?x", ["a"]), moved_to("/b", ["a"])
    ('/a/', '')
    """
    name = target.partition("?")[0].removeprefix("/")
    return f"/{name}/" if name in pages else ""


def cursor_of(target: str, last: str | None) -> str:
    """Return the cursor of a request: the last event id, or else the cursor in the target."""
    with suppress(ValueError):
        return last or parse_qs(urlsplit(target).query).get("after", [""])[0]
    return ""


def message(changes: Changes) -> bytes:
    r"""Return changes as a server-sent event.

    >>> message(("7", b"{}"))
    b'id: 7\ndata: {}\n\n'
    """
    cursor, new = changes
    return b"id: %s\ndata: %s\n\n" % (cursor.encode(), new)


def headers(kind: ResourceKind | None, *, live: bool) -> Mapping[str, str]:
    """Return the headers of an answer: type, content policy, and no caching."""
    types = {"index": "text/html", "page": "text/html", "events": "text/event-stream", None: "text/plain"}
    rules = policy(index.PAGE) if kind == "index" else policy(log_report.PAGE, live=live)
    return {
        "Content-Type": f"{types[kind]}; charset=utf-8",
        "Content-Security-Policy": f"{rules}; frame-ancestors 'none'",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


def refusal(status: HTTPStatus, more: str = "") -> str:
    r"""Return the text of a refusal; `more` completes the list of resources.

    >>> refusal(HTTPStatus.NOT_FOUND, ", and WebSocket")
    '404 not found: there is only the page at /, and WebSocket\n'
    """
    return f"{status.value} {_REFUSALS[status]}{more}\n"


Asked = Callable[[str, str | None], Any]
"""Receives the name of a page and a cursor, and returns the changes since; for None, it returns the page."""


class Questions:
    """Requests from browser threads to the reading thread."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[str, str | None, Future[Any]]] = SimpleQueue()

    def ask(self, page: str, cursor: str | None) -> Any:
        """Wait for the changes of a page since a cursor, or for the page if that is None, and return them."""
        future: Future[Any] = Future()
        self._waiting.put((page, cursor, future))
        return future.result()

    def answer(self, make: Asked, *, wait: float = 0.0) -> None:
        """Answer all pending requests; wait up to so many seconds for the first."""
        with suppress(Empty):
            while True:
                page, cursor, future = self._waiting.get(timeout=wait) if wait else self._waiting.get_nowait()
                wait = 0.0
                try:
                    future.set_result(make(page, cursor))
                except BaseException as error:
                    future.set_exception(error)
                    raise

    def close(self) -> None:
        """Cancel pending requests."""
        with suppress(Empty):
            while True:
                self._waiting.get_nowait()[2].cancel()


class PageServer(ThreadingHTTPServer):
    """Serves a page to browsers and, if `live`, updates; of several, `pages` has the names.

    Port 0 is any free port; `origins` are the allowed host names besides addresses. Raises
    `OSError`.
    """

    daemon_threads = True
    request_queue_size = 64

    def __init__(
        self,
        ask: Asked,
        *,
        live: bool,
        pages: Collection[str] = (),
        host: str = LOCAL,
        port: int = 0,
        origins: Collection[str] = (),
    ) -> None:
        self.ask = ask
        self.live = live
        self.pages = pages
        self.origins = origins
        self.closing = Event()
        self.room = BoundedSemaphore(BROWSERS)
        files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)  # half is for the log, and for the other files
        few = CONNECTIONS if files == resource.RLIM_INFINITY else min(CONNECTIONS, max(files // 2, 1))
        self._connections = BoundedSemaphore(few)
        self._full = False
        shown = f"[{host}]" if ":" in host else host
        try:
            self.address_family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            super().__init__((str(address[0]), int(address[1])), _Answering)
        except OSError as error:
            raise unavailable(error, f"http://{shown}:{port}") from error
        self.url = f"http://{shown}:{self.server_address[1]}/"

    def server_bind(self) -> None:
        """Bind without a name server look-up."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()

    def get_request(self) -> tuple[Any, Any]:
        """Accept a connection; wait if there is no free file descriptor."""
        try:
            found = super().get_request()
        except OSError as error:
            if error.errno in (errno.EMFILE, errno.ENFILE):
                if not self._full:
                    print("rvaft: warning: too many open files: new connections wait", file=sys.stderr)
                self._full = True
                sleep(_RETRY)  # the connection still waits to be accepted
            raise
        self._full = False
        return found

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, unless there are too many connections."""
        if self._connections.acquire(blocking=False):
            try:
                super().process_request(request, client_address)
            except RuntimeError:  # no thread can be started
                self._connections.release()
                self.shutdown_request(request)
            return
        text = refusal(HTTPStatus.SERVICE_UNAVAILABLE).encode()
        head = b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain\r\nConnection: close\r\n"
        with suppress(OSError):
            request.setblocking(False)
            request.send(b"%sContent-Length: %d\r\n\r\n%s" % (head, len(text), text))
        self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Ignore closed connections; report defects in one line."""
        error = sys.exception()
        if not isinstance(error, OSError | CancelledError):
            print(f"rvaft: error: a defect in rvaft ended a request: {type(error).__name__}: {error}", file=sys.stderr)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Answer browsers within the context."""
        thread = Thread(target=self.serve_forever, kwargs={"poll_interval": PERIOD}, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self.closing.set()
            self.shutdown()
            self.server_close()


class _UntilDeadline(io.RawIOBase):
    """The bytes of a connection; raises `TimeoutError` after a deadline for all of them."""

    def __init__(self, connection: socket.socket, seconds: float) -> None:
        self._connection = connection
        self._until = monotonic() + seconds

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left = self._until - monotonic()
        if left <= 0:
            raise TimeoutError
        self._connection.settimeout(left)
        try:
            return self._connection.recv_into(buffer)
        finally:
            self._connection.settimeout(_PATIENCE)


class _Answering(BaseHTTPRequestHandler):
    server: PageServer
    server_version, sys_version = "rvaft", ""
    default_request_version = "HTTP/1.1"
    protocol_version = "HTTP/1.1"
    error_content_type = "text/plain; charset=utf-8"
    error_message_format = "%(code)d %(message)s\n"
    timeout = _PATIENCE

    def setup(self) -> None:
        """Read the request with a deadline for the whole of it."""
        super().setup()
        self.rfile.close()
        self.rfile = io.BufferedReader(cast("Any", _UntilDeadline(self.connection, _PATIENCE)))

    def do_GET(self) -> None:
        """Send the page or the stream of updates."""
        server = self.server
        found = resource_of(self.path, live=server.live, pages=server.pages)
        if not own(self.headers.get_all("Host", []), server.origins):
            self._refuse(HTTPStatus.FORBIDDEN)
        elif found is None:
            moved = moved_to(self.path, server.pages)
            self._refuse(HTTPStatus.PERMANENT_REDIRECT if moved else HTTPStatus.NOT_FOUND)
        elif not server.room.acquire(blocking=False):
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE)
        else:
            try:
                if found.kind != "events":
                    self._send(HTTPStatus.OK, server.ask(found.page, None), found.kind)
                elif self.command == "HEAD":
                    self._begin(HTTPStatus.OK, "events")
                else:
                    self._stream(found.page, cursor_of(self.path, self.headers.get("Last-Event-ID")))
            finally:
                server.room.release()

    do_HEAD = do_GET  # noqa: N815

    def do_POST(self) -> None:
        """Refuse all methods but GET and HEAD."""
        self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, " and HEAD")

    do_PUT = do_DELETE = do_PATCH = do_OPTIONS = do_TRACE = do_CONNECT = do_POST  # noqa: N815

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002
        """Answer a malformed request without repeating it."""
        super().send_error(code)

    def _stream(self, page: str, cursor: str) -> None:
        self._begin(HTTPStatus.OK, "events")
        spoken = monotonic()
        while not self.server.closing.is_set():
            new, sent = self.server.ask(page, cursor), b""
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

    def _send(self, status: HTTPStatus, body: bytes, kind: ResourceKind | None) -> None:
        self._begin(status, kind, len(body))
        if self.command != "HEAD":
            self.wfile.write(body)

    def _begin(self, status: HTTPStatus, kind: ResourceKind | None, length: int | None = None) -> None:
        self.send_response(status)
        for name, value in headers(kind, live=self.server.live).items():
            self.send_header(name, value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            self.send_header("Allow", "GET, HEAD")
        if status is HTTPStatus.PERMANENT_REDIRECT:
            self.send_header("Location", moved_to(self.path, self.server.pages))
        self.send_header("Connection", "close")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Do not log requests."""
