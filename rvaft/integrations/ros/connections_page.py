"""What a server says of itself to browsers.

The page of `rvaft report`, whose places are what the messages of its connections did.

It is given plain HTTP by the library that speaks WebSocket, which sends an answer as a whole: a
stream of events is one answer after the other, each with what is new, and a browser asks for the
next by itself.
"""

import asyncio
from collections import deque
from collections.abc import Collection
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from rvaft.integrations.live_page import BROWSERS, PERIOD, asked, cursor_of, headers, message, refusal
from rvaft.integrations.ros.protocol import Session
from rvaft.model.tree import RVAFT
from rvaft.reports.log_report import SHOWN, LogReport, Told
from rvaft.stream.detection import counted
from rvaft.stream.keys import Key
from rvaft.stream.plan import MonitoringPlan
from rvaft.support.network import own

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

UNIT: Final = "connection"
_LINES: Final = 200
"""Lines of what the server said that are on the page."""
_WAIT: Final = 3.0
"""Seconds that a browser waits for something new, less than it may take to open a connection."""
_AGAIN: Final = b"retry: 200\n\n"
"""How soon a browser asks for the next, in milliseconds."""


class ConnectionsPage:
    """The page of a server for a tree, or the part of one, whose sessions are like this one; with
    `shared` it is the only one.

    >>> import rvaft
    >>> tree = rvaft.loads("top and a b;")
    >>> page = ConnectionsPage("tree.rvaft", tree, Session(tree))
    >>> page.say("connection 1 opened")
    >>> page.told["held"]
    ['connection 1 opened']
    """

    def __init__(self, name: str, tree: RVAFT, session: Session, *, shared: bool = False) -> None:
        self.name = name
        self.shared = shared
        plan = MonitoringPlan(session.looked_at, None if shared else Key.parse([UNIT]))
        self.report = LogReport(tree, plan, most=SHOWN, grows=True, unit=UNIT)
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._earlier = self._asking = 0
        if shared:
            session.tell(self.report, "all connections")

    def opened(self, number: int, peer: str, session: Session) -> None:
        """A connection opened."""
        if not self.shared:
            session.tell(self.report, "", (f"{number} from {peer}",))

    def closed(self, session: Session) -> None:
        """A connection closed."""
        if not self.shared:
            self.report.end(session.watch)

    def say(self, line: str) -> None:
        """The server says something."""
        self._earlier += len(self._lines) == _LINES
        self._lines.append(line)

    @property
    def told(self) -> Told:
        """What the server said lately."""
        earlier = [f"{counted(self._earlier, 'line')} before these are no longer here"] if self._earlier else []
        return {"said": [], "held": [*(f"warning: {one}" for one in self.report.left_out), *earlier, *self._lines]}

    async def answer(
        self, connection: "ServerConnection", request: "Request", origins: Collection[str], stop: asyncio.Event
    ) -> "Response":
        """What a plain request is answered."""
        kind, status, more = asked(request.path, live=True), HTTPStatus.OK, ""
        if not own(request.headers.get_all("Host"), origins):
            status = HTTPStatus.FORBIDDEN
        elif getattr(request, "method", "GET") != "GET":  # websockets before 16 takes no other
            status = HTTPStatus.METHOD_NOT_ALLOWED
        elif kind is None:
            status, more = HTTPStatus.NOT_FOUND, ", and WebSocket"
        elif kind == "events" and self._asking >= BROWSERS:
            status = HTTPStatus.SERVICE_UNAVAILABLE
        response = connection.respond(status, "" if status is HTTPStatus.OK else refusal(status, more))
        found = dict(headers(kind if status is HTTPStatus.OK else None, live=True))
        if status is HTTPStatus.OK:
            page = kind == "page"
            response.body = (
                self.report.page(self.name, self.told, live=True) if page else await self._news(request, stop)
            )
            found["Content-Length"] = str(len(response.body))
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            found["Allow"] = "GET"
        for name, value in found.items():
            if name in response.headers:
                del response.headers[name]
            response.headers[name] = value
        return response

    async def _news(self, request: "Request", stop: asyncio.Event) -> bytes:
        last = request.headers.get_all("Last-Event-ID")
        cursor = cursor_of(request.path, last[0] if last else None)
        self._asking += 1
        try:
            for _ in range(int(_WAIT / PERIOD)):
                new = self.report.since(cursor, self.name, self.told)
                if new[1] or stop.is_set():
                    return _AGAIN + message(new) if new[1] else _AGAIN
                await asyncio.sleep(PERIOD)
        finally:
            self._asking -= 1
        return _AGAIN
