"""`rvaft view`: the page of `rvaft report` over HTTP, also while a log grows."""

import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any, Final

import click

from rvaft.cli import options
from rvaft.cli.log_report import MOST, PageReporter, PageRequest, page_options
from rvaft.cli.monitor import require_companions
from rvaft.cli.monitor_output import MonitorSettings, Reporter, Sink, SummaryRow
from rvaft.integrations.live_page import PageServer, Questions
from rvaft.model.nodes import Kind
from rvaft.reports.log_report import PLACES, SHOWN, LogReport
from rvaft.stream.detection import counted
from rvaft.stream.follow import POLL, stopping
from rvaft.stream.plan import Totals
from rvaft.stream.run import TraceRun
from rvaft.support import network
from rvaft.support.network import LOCAL, require_host
from rvaft.support.terminal import visible

_LATEST: Final = f"{MOST}  [default: {PLACES}; with --follow {SHOWN}, the latest]"
_LINES: Final = 500
"""Lines of what was said that a page has while a log grows."""


class LivePageReporter(PageReporter):
    """Answers what browsers ask while a log grows, whenever nothing of it is being read."""

    def __init__(
        self,
        settings: MonitorSettings,
        sink: Sink,
        report: LogReport,
        questions: Questions,
        ready: Callable[[], object],
    ) -> None:
        super().__init__(settings, sink, report)
        self._questions = questions
        self._ready = ready
        self._gone = 0
        self.run: TraceRun | None = None

    def pause(self, run: TraceRun) -> None:
        """Nothing is being read."""
        if self.run is None:
            self._ready()
        self.run = run
        self._questions.answer(self.answer)

    def answer(self, cursor: str | None) -> Any:
        """The page, or what is new since a cursor."""
        kept = self.sink.kept or []
        self._gone += max(len(kept) - _LINES, 0)
        del kept[: max(len(kept) - _LINES, 0)]
        gone = [f"{counted(self._gone, 'line')} before these are no longer here"] if self._gone else []
        odd = [f"rvaft: warning: {line}" for line in self.run.warnings] if self.run and not self.run.ended else []
        told = self.told([*gone, *odd, *(f"rvaft: warning: {line}" for line in self.report.left_out)])
        name = self.settings.name
        return self.report.page(name, told, live=True) if cursor is None else self.report.since(cursor, name, told)

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:
        """The log is not followed any more; what is left out was told on the page."""


@click.command("view")
@page_options
@options.number("--max-events", text=_LATEST)
@click.option("--follow", is_flag=True, help="Go on as the log grows; the page then shows what comes.")
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Listen at this address.")
@click.option("--origin", multiple=True, metavar="URL", help="A name by which browsers reach it; may be repeated.")
@options.number(
    "--port",
    least=0,
    most=65535,
    default=0,
    metavar="INTEGER RANGE",
    text="Where browsers find it; 0 is any that is free.",
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
    """Show the page of `rvaft report` to browsers, until Ctrl-C; with --follow it is kept up to date as the log grows.

    The address of the page is printed once it is there. The exit status is 1 when the tree is detected in some log.
    """
    options.refuse(tree == "-", "TREE is a file: what standard input has is the log")
    require_companions(given)
    require_host(host)
    origins = [f"http://{host}", *map(network.origin, origin)]
    request = PageRequest(tree, logs, branch, kind, follow=follow, given=given)
    questions, made = Questions(), list[PageReporter]()
    with PageServer(questions.ask, live=follow, host=host, port=port, origins=origins) as server:

        def ready() -> None:
            click.echo(visible(f"the page is at {server.url}"))
            sys.stdout.flush()

        def make(settings: MonitorSettings, sink: Sink) -> Reporter:
            made.append(
                LivePageReporter(settings, sink, request.report, questions, ready)
                if follow
                else PageReporter(settings, sink, request.report)
            )
            return made[0]

        with server.listening() if follow else nullcontext():
            status = request.run(make)
            reporter, shown = made[0], False
            if isinstance(reporter, LivePageReporter):
                shown = reporter.run is not None
                if shown and reporter.stopped:  # the page says why it goes no further
                    _answer_until_stopped(questions, reporter.answer)
            questions.close()
        if not follow and reporter.page is not None:
            shown = True
            with server.listening():
                ready()
                _answer_until_stopped(questions, lambda _: reporter.page)
        if shown:
            click.echo(visible(f"rvaft: the page at {server.url} is closed"), err=True)
    return status


def _answer_until_stopped(questions: Questions, make: Callable[[str | None], Any]) -> None:
    with stopping() as stop:
        while not stop():
            questions.answer(make, wait=POLL)
