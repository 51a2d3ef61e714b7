"""`rvaft view`: serves the page of `rvaft report` over HTTP, also while a log grows."""

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
from rvaft.support import network, output
from rvaft.support.network import LOCAL, require_host
from rvaft.support.terminal import visible

_LATEST: Final = f"{MOST}  [default: {PLACES}; with --follow {SHOWN}, the latest]"
_LINES: Final = 500


class LivePageReporter(PageReporter):
    """Answers browsers while a log grows."""

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
        """Answer browsers."""
        if self.run is None:
            self._ready()
        self.run = run
        self._questions.answer(self.answer)

    def answer(self, cursor: str | None) -> Any:
        """Return the page, or the changes since a cursor."""
        kept = self.sink.kept or []
        self._gone += max(len(kept) - _LINES, 0)
        del kept[: max(len(kept) - _LINES, 0)]
        gone = [f"{counted(self._gone, 'line')} before these are no longer on this page"] if self._gone else []
        odd = [f"rvaft: warning: {line}" for line in self.run.warnings] if self.run and not self.run.ended else []
        lines = self.collected_messages([*gone, *odd, *(f"rvaft: warning: {line}" for line in self.report.left_out)])
        name = self.settings.name
        return self.report.page(name, lines, live=True) if cursor is None else self.report.since(cursor, name, lines)

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:
        """Do nothing: the page already has all warnings."""


@click.command("view")
@page_options
@options.number("--max-events", text=_LATEST)
@click.option("--follow", is_flag=True, help="Keep reading as the log grows, and update the page.")
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

    Prints the address of the page. The exit status is 1 if a log detects the tree.
    """
    options.refuse(tree == "-", "TREE is a file: standard input is read as a log")
    require_companions(given)
    require_host(host)
    origins = [f"http://{host}", *map(network.origin, origin)]
    request = PageRequest(tree, logs, branch, kind, follow=follow, given=given)
    questions, made = Questions(), list[PageReporter]()
    output.unblock()
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
                if shown and reporter.stopped:
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
