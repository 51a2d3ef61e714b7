"""`rvaft report`: an HTML page about the events and detections in logs."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import click

from rvaft.api import narrowed
from rvaft.cli import FAILED, log_options, options, warn
from rvaft.cli.monitor import TracesGiven, limit_option, plan_of, require_companions, stream_options
from rvaft.cli.monitor_output import MonitorSettings, Reporter, Sink, SummaryRow, held, read_afresh
from rvaft.cli.monitor_run import run
from rvaft.model.nodes import Kind
from rvaft.reports.log_report import PLACES, SHOWN, LogReport, Messages
from rvaft.stream.detection import Hooks
from rvaft.stream.listeners import MonitoredTrace
from rvaft.stream.monitor_set import Per
from rvaft.stream.plan import Totals
from rvaft.support.files import deliver

_OUTPUT: Final = "Write the page to this file instead of standard output."
MOST: Final = "Maximum number of events on the page."


class PageReporter(Reporter):
    """Makes the page from the messages of a run."""

    sums = True

    def __init__(self, settings: MonitorSettings, sink: Sink, report: LogReport) -> None:
        super().__init__(settings, sink)
        self.report = report
        self.page: bytes | None = None
        self.stopped = False
        sink.kept = []

    def stop(self, watch: MonitoredTrace) -> None:  # noqa: ARG002
        """Note that a log cannot be read further."""
        self.stopped = True

    def collected_messages(self, messages: Sequence[str] = ()) -> Messages:
        """Return all messages so far, these additional ones, and the summary of the logs."""
        totals, kept = self.totals, self.sink.kept or []
        assert totals is not None
        semantics_hint = totals.semantics_hint
        doubts = [f"warning: {line}" for line in totals.data_warnings.lines]
        meant = [f"note: {semantics_hint.line}"] if semantics_hint is not None and semantics_hint.line else []
        summed = [] if totals.statistics is None else list(held(totals.statistics))
        return {"said": [*kept, *messages], "held": [*summed, *meant, *doubts]}

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:  # noqa: ARG002
        """Make the page."""
        for line in (*self.report.left_out, *read_afresh(rows)):
            self.sink.warn(line)
        self.page = self.report.page(self.settings.name, self.collected_messages())


_OPTIONS: Final = (
    options.tree_argument,
    options.semantics_option,
    options.part_options,
    click.argument("logs", nargs=-1, required=True, metavar="LOG..."),
    options.choice("--per", words=Per, default=Per.TREE, text="Also monitor each branch or each kind."),
    options.repeat_options,
    stream_options,
    log_options.log_format,
    log_options.strict_json,
    limit_option,
)


def page_options(function: options.F) -> options.F:
    """Add the options for what is monitored."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


class PageRequest:
    """The logs of a page and how they are monitored."""

    def __init__(
        self, tree: str, logs: Sequence[str], branch: int | None, kind: Kind | None, *, follow: bool, given: Any
    ) -> None:
        whole = options.load_tree(tree)
        plan = plan_of(narrowed(whole, branch, kind), whole, given)
        self._traces = TracesGiven(logs, given["log_format"], live=follow)
        if follow:
            self._traces.require_growing("--follow", "LOG")
        most = given["max_events"] or (SHOWN if follow else PLACES)
        self.report = LogReport(whole, plan, most=most, grows=follow)
        self.settings = MonitorSettings(
            plan,
            whole,
            name=click.format_filename(tree),
            per=given["per"],
            form="text",
            several=self._traces.several,
            detections=False,
            drawn=False,
            drawing=None,
            hooks=Hooks(),
            checkpoints=None,
            follow=follow,
            unchosen=given["semantics"] is None and whole.semantics is None,
            others=(self.report,),
        )

    def run(self, make: Callable[[MonitorSettings, Sink], Reporter]) -> int:
        """Read the logs and return the exit status."""
        status = run([self.settings], self._traces.sources, report=make)
        return FAILED if self._traces.missing.met else status


@click.command("report")
@page_options
@options.number("--max-events", default=PLACES, text=MOST)
@click.option("-o", "--output", metavar="FILE", help=_OUTPUT)
def report_command(
    *, tree: str, logs: tuple[str, ...], branch: int | None, kind: Kind | None, output: str | None, **given: Any
) -> int:
    """Write an HTML page about the events in each LOG: the tree, the events, detections and near
    misses.

    A LOG is given as for `monitor`. The page is one file and needs no network. The exit status is 1
    if a log detects the tree.
    """
    options.refuse(tree == "-", "TREE is a file: standard input is read as a log")
    require_companions(given)
    request = PageRequest(tree, logs, branch, kind, follow=False, given=given)
    options.require_writable([output or "-"])
    made: list[PageReporter] = []

    def make(settings: MonitorSettings, sink: Sink) -> Reporter:
        made.append(PageReporter(settings, sink, request.report))
        return made[0]

    status = request.run(make)
    if made[0].page is None:
        warn(f"{output or 'the page'} is not written: no log was read to its end")
    else:
        deliver(made[0].page, output)
    return status
