"""`rvaft view`: serves the page of `rvaft report` over HTTP, also while a log grows."""

import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any, Final

import click

from rvaft.cli import options
from rvaft.cli.log_report import MOST, PageReporter, PageRequest, page_options
from rvaft.cli.monitor_output import MonitorSettings, Reporter, Sink, SummaryRow
from rvaft.cli.trees import TreesCommand
from rvaft.integrations.live_page import Asked, PageServer, Questions
from rvaft.model.nodes import Kind
from rvaft.reports.log_report import LATEST, PLACES
from rvaft.stream.follow import POLL, stopping
from rvaft.stream.plan import Totals
from rvaft.stream.run import TraceRun
from rvaft.support import network, output
from rvaft.support.network import LOCAL, require_host
from rvaft.support.terminal import visible
from rvaft.support.wording import counted

_LATEST: Final = f"{MOST}  [default: {PLACES}; with --follow {LATEST}, the latest]"
_LINES: Final = 500


class LivePages:
    """Answers browsers while a log grows, with the page of one tree or those of several.

    `ready` is called once there is something to show.
    """

    def __init__(self, request: PageRequest, questions: Questions, ready: Callable[[], object]) -> None:
        self.request = request
        self._questions = questions
        self._ready = ready
        self._gone = 0
        self.begun = False
        """Whether there is something to show."""
        self.reporters: list[LivePageReporter] = []

    @property
    def stopped(self) -> bool:
        """Whether a log cannot be read further."""
        return all(one.stopped for one in self.reporters)

    def pause(self) -> None:
        """Answer browsers."""
        if not self.begun:
            self.begun = True
            self._ready()
        self._questions.answer(self.answer)

    def answer(self, page: str, cursor: str | None) -> Any:
        """Return a page, or its changes since a cursor."""
        kept = self.reporters[0].sink.kept or []
        self._gone += max(len(kept) - _LINES, 0)
        del kept[: max(len(kept) - _LINES, 0)]
        gone = [f"{counted(self._gone, 'line')} before these are no longer on this page"] if self._gone else []
        names = {name: place for place, name in enumerate(self.request.pages.values())}
        if page in names:
            return self.reporters[names[page]].answer(cursor, gone)
        if len(names) == 1:
            return self.reporters[0].answer(cursor, gone)
        return self.request.index([*gone, *kept], live=True)


class LivePageReporter(PageReporter):
    """Makes the page of one tree while its log grows."""

    def __init__(self, settings: MonitorSettings, sink: Sink, pages: LivePages) -> None:
        super().__init__(settings, sink, pages.request)
        self._pages = pages
        self.run: TraceRun | None = None

    def pause(self, run: TraceRun) -> None:
        """Answer browsers, once for all trees."""
        self.run = run
        if self is self._pages.reporters[-1]:
            self._pages.pause()

    def answer(self, cursor: str | None, gone: Sequence[str]) -> Any:
        """Return the page, or the changes since a cursor."""
        odd = [f"rvaft: warning: {line}" for line in self.run.warnings] if self.run and not self.run.ended else []
        lines = self.collected_messages([*gone, *odd, *(f"rvaft: warning: {line}" for line in self.report.left_out)])
        name = self.settings.name
        if cursor is None:
            return self.report.page(name, lines, live=True, home=self.request.home)
        return self.report.since(cursor, name, lines)

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:
        """Do nothing: the page already has all warnings."""


@click.command("view", cls=TreesCommand)
@page_options
@options.number("--max-events", text=_LATEST)
@click.option("--follow", is_flag=True, help="Keep reading as the log grows, and update the page.")
@options.clock_option
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Listen at this address.")
@click.option("--origin", multiple=True, metavar="URL", help="An allowed origin for browsers; repeatable.")
@options.number(
    "--port",
    least=0,
    most=65535,
    default=0,
    metavar="INTEGER RANGE",
    text="The port of the page; 0 is any free port.",
)
def view_command(
    *,
    tree: str,
    logs: tuple[str, ...],
    branch: int | None,
    kind: Kind | None,
    follow: bool,
    host: str,
    port: int,
    origin: tuple[str, ...],
    **given: Any,
) -> int:
    """Serve the page of `rvaft report` to browsers until Ctrl-C; --follow updates it as the log
    grows.

    Prints the address of the page; of several trees, a page lists theirs. The exit status is 1 if a log detects a
    tree.
    """
    require_host(host)
    origins = [f"http://{host}", *map(network.origin, origin)]
    request = PageRequest(tree, logs, branch, kind, follow=follow, served=True, given=given)
    questions, made = Questions(), list[PageReporter]()
    names = tuple(request.pages.values()) if len(request.pages) > 1 else ()
    output.unblock()
    with PageServer(questions.ask, live=follow, pages=names, host=host, port=port, origins=origins) as server:

        def ready() -> None:
            click.echo(visible(f"the page is at {server.url}"))
            sys.stdout.flush()

        live = LivePages(request, questions, ready)

        def make(settings: MonitorSettings, sink: Sink) -> Reporter:
            if follow:
                live.reporters.append(LivePageReporter(settings, sink, live))
                return live.reporters[-1]
            made.append(PageReporter(settings, sink, request))
            return made[-1]

        with server.listening() if follow else nullcontext():
            status = request.run(make)
            if live.begun and live.stopped:
                _answer_until_stopped(questions, live.answer)
            questions.close()
        pages = {request.pages[one.settings.name]: one.page for one in made if one.page is not None}
        if pages:
            if names:
                pages[""] = request.index(made[0].sink.kept or [])
            else:
                pages[""] = next(iter(pages.values()))
            with server.listening():
                ready()
                _answer_until_stopped(questions, lambda page, _: pages[page])
        if pages or live.begun:
            click.echo(visible(f"rvaft: the page at {server.url} is closed"), err=True)
    return status


def _answer_until_stopped(questions: Questions, make: Asked) -> None:
    with stopping() as stop:
        while not stop():
            questions.answer(make, wait=POLL)
