"""The pages of `rvaft serve` for browsers: the page of `rvaft report` with connections as logs, for each tree.

The WebSocket library sends each HTTP answer as a whole, so the event stream is a sequence of
answers: each has the changes, and the browser asks for the next.
"""

import asyncio
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from rvaft.integrations.live_page import (
    BROWSERS,
    PERIOD,
    Resource,
    cursor_of,
    headers,
    message,
    moved_to,
    refusal,
    resource_of,
)
from rvaft.integrations.ros.protocol import Session
from rvaft.model.tree import RVAFT
from rvaft.reports.index import Row, index_page, page_names
from rvaft.reports.log_report import LATEST, LogReport, Messages
from rvaft.stream.keys import Key
from rvaft.stream.plan import MonitoringPlan
from rvaft.support.network import own
from rvaft.support.wording import counted

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

UNIT: Final = "connection"
_LINES: Final = 200
_WAIT: Final = 3.0
"""Seconds that a request waits for updates; less than the timeout for opening a connection."""
_AGAIN: Final = b"retry: 200\n\n"
"""The delay before the next request, in milliseconds."""


class ConnectionsPage:
    """The page of a server for a tree or part; with `shared` there is a single session.

    >>> import rvaft
    >>> tree = rvaft.loads("top and a b;")
    >>> page = ConnectionsPage("tree.rvaft", tree, Session(tree))
    >>> page.say("connection 1 opened")
    >>> page.messages["held"]
    ['connection 1 opened']
    """

    def __init__(self, name: str, tree: RVAFT, session: Session, *, shared: bool = False) -> None:
        self.name = name
        self.shared = shared
        plan = MonitoringPlan(session.looked_at, None if shared else Key.parse([UNIT]))
        self.report = LogReport(tree, plan, most=LATEST, grows=True, unit=UNIT)
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._earlier = 0
        if shared:
            session.notify(self.report, "all connections")

    def opened(self, number: int, peer: str, session: Session) -> None:
        """Register an opened connection."""
        if not self.shared:
            session.notify(self.report, "", (f"{number} from {peer}",))

    def closed(self, session: Session) -> None:
        """Note that a connection was closed."""
        if not self.shared:
            self.report.end(session.watch)

    def say(self, line: str) -> None:
        """Add a message of the server."""
        self._earlier += len(self._lines) == _LINES
        self._lines.append(line)

    @property
    def messages(self) -> Messages:
        """The recent messages of the server."""
        earlier = [f"{counted(self._earlier, 'line')} before these are no longer on this page"] if self._earlier else []
        return {"said": [], "held": [*(f"warning: {one}" for one in self.report.left_out), *earlier, *self._lines]}

    def text(self, home: str = "") -> bytes:
        """Return the page; `home` is the address of the page of all trees."""
        return self.report.page(self.name, self.messages, live=True, home=home)


class ConnectionsPages:
    """The page of the tree, or those of several trees with one that lists them."""

    def __init__(self, pages: Sequence[ConnectionsPage]) -> None:
        self._pages = dict(zip(page_names(one.name for one in pages), pages, strict=True))
        self._names = tuple(self._pages) if len(pages) > 1 else ()
        self._asking = 0

    def opened(self, number: int, peer: str, sessions: Mapping[str, Session]) -> None:
        """Register an opened connection."""
        for page, session in zip(self._pages.values(), sessions.values(), strict=True):
            page.opened(number, peer, session)

    def closed(self, sessions: Mapping[str, Session]) -> None:
        """Note that a connection was closed."""
        for page, session in zip(self._pages.values(), sessions.values(), strict=True):
            page.closed(session)

    def say(self, line: str) -> None:
        """Add a message of the server."""
        for page in self._pages.values():
            page.say(line)

    def _text(self, found: Resource) -> bytes:
        if found.kind == "index":
            rows = [Row(page.name, f"{name}/", *page.report.detects) for name, page in self._pages.items()]
            return index_page(rows, next(iter(self._pages.values())).messages["held"], live=True)
        return self._page(found).text("../" if self._names else "")

    def _page(self, found: Resource) -> ConnectionsPage:
        return self._pages[found.page] if self._names else next(iter(self._pages.values()))

    async def answer(
        self, connection: "ServerConnection", request: "Request", origins: Collection[str], stop: asyncio.Event
    ) -> "Response":
        """Answer a plain HTTP request."""
        found = resource_of(request.path, live=True, pages=self._names)
        kind, status, more = None if found is None else found.kind, HTTPStatus.OK, ""
        if not own(request.headers.get_all("Host"), origins):
            status = HTTPStatus.FORBIDDEN
        elif getattr(request, "method", "GET") != "GET":  # websockets before 16 accepts GET only
            status = HTTPStatus.METHOD_NOT_ALLOWED
        elif kind is None and moved_to(request.path, self._names):
            status = HTTPStatus.PERMANENT_REDIRECT
        elif kind is None:
            status, more = HTTPStatus.NOT_FOUND, ", and WebSocket"
        elif kind == "events" and self._asking >= BROWSERS:
            status = HTTPStatus.SERVICE_UNAVAILABLE
        response = connection.respond(status, "" if status is HTTPStatus.OK else refusal(status, more))
        fields = dict(headers(kind if status is HTTPStatus.OK else None, live=True))
        if status is HTTPStatus.OK and found is not None:
            stream = found.kind == "events"
            response.body = await self._news(request, self._page(found), stop) if stream else self._text(found)
            fields["Content-Length"] = str(len(response.body))
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            fields["Allow"] = "GET"
        if status is HTTPStatus.PERMANENT_REDIRECT:
            fields["Location"] = moved_to(request.path, self._names)
        for name, value in fields.items():
            if name in response.headers:
                del response.headers[name]
            response.headers[name] = value
        return response

    async def _news(self, request: "Request", page: ConnectionsPage, stop: asyncio.Event) -> bytes:
        last = request.headers.get_all("Last-Event-ID")
        cursor = cursor_of(request.path, last[0] if last else None)
        self._asking += 1
        try:
            for _ in range(int(_WAIT / PERIOD)):
                new = page.report.since(cursor, page.name, page.messages)
                if new[1] or stop.is_set():
                    return _AGAIN + message(new) if new[1] else _AGAIN
                await asyncio.sleep(PERIOD)
        finally:
            self._asking -= 1
        return _AGAIN
