"""`rvaft report`: one page about what happened in logs, to be opened in a browser."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

from rvaft.api import narrowed
from rvaft.cli import FAILED, Failures, options, warn
from rvaft.cli.monitor import limit_option, plan_of, require_companions, source_of, stream_options
from rvaft.cli.monitor_output import MonitorSettings, Reporter, Sink, SummaryRow, held
from rvaft.cli.monitor_run import run
from rvaft.errors import OptionError
from rvaft.model.nodes import Kind
from rvaft.model.values import Json
from rvaft.monitoring.detection import Hooks
from rvaft.monitoring.monitor_set import Per
from rvaft.monitoring.report import PLACES, LogReport
from rvaft.monitoring.run import MonitoredTrace, Totals, VerdictChange
from rvaft.readers.log import expanded
from rvaft.support.files import deliver

_OUTPUT: Final = "Write the page to this file instead of standard output."


class PageReporter(Reporter):
    """Makes a page of what it is told, once all logs have been read."""

    concerned = sums = True

    def __init__(self, settings: MonitorSettings, sink: Sink, most: int = PLACES) -> None:
        super().__init__(settings, sink)
        self.report = LogReport(settings.tree, settings.plan, most=most)
        self.page: bytes | None = None
        sink.kept = []

    def begin(self, watch: MonitoredTrace) -> None:
        """A log begins, or the first event of a key came."""
        self.report.begin(watch)

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """An event concerned the tree and changed no verdict."""
        self.report.event(watch, number, event)

    def change(self, change: VerdictChange) -> None:
        """An event changed verdicts."""
        self.report.change(change)

    def end(self, watch: MonitoredTrace) -> None:
        """A log ends."""
        self.report.end(watch)

    def stop(self, watch: MonitoredTrace) -> None:
        """A log cannot be read further."""
        self.report.stop(watch)

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:  # noqa: ARG002 (the interface)
        """All logs have been read, one at least to its end: make the page."""
        hindsight = totals.hindsight
        for line in self.report.left_out:
            self.sink.warn(line)
        doubts = [f"warning: {line}" for line in totals.oversights.lines]
        meant = [f"note: {hindsight.line}"] if hindsight is not None and hindsight.line else []
        summed = [] if totals.statistics is None else list(held(totals.statistics))
        self.page = self.report.page(
            self.settings.name, {"said": self.sink.kept or [], "held": [*summed, *meant, *doubts]}
        )


@click.command("report")
@options.tree_argument
@options.semantics_option
@options.part_options
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@options.choice("--per", words=Per, default=Per.TREE, text="Monitor also each branch or each kind.")
@options.repeat_options
@stream_options
@options.log_format
@options.strict_json
@limit_option
@options.number("--max-events", default=PLACES, text="Events that have a place on the page.")
@click.option("-o", "--output", metavar="FILE", help=_OUTPUT)
def report_command(
    *, tree: str, logs: tuple[str, ...], branch: int | None, kind: Kind | None, output: str | None, **given: Any
) -> int:
    """Write a page about what happened in each LOG: the tree, event by event, detections, and what could have been missed.

    A LOG is as for `monitor`. The page is one HTML file that needs no network. The exit status is 1 when the tree is detected in some log.
    """
    options.refuse(tree == "-", "TREE is a file: what standard input has is the log")
    require_companions(given)
    options.require_writable([output or "-"], [tree])
    whole = options.load_tree(tree)
    plan = plan_of(narrowed(whole, branch, kind), whole, given)
    missing = Failures()
    found = list(missing.collect(expanded, logs))
    files = [file for some in found for file in some]
    traces = [source_of(*one) for one in zip(files, given["log_format"].readers(files), strict=True)]
    read = {Path(one.file).resolve() for one in traces if one.file is not None}
    if output is not None and Path(output).resolve() in read:
        raise OptionError(f"{output} would be written over, but it is one of the logs: name another file")
    settings = MonitorSettings(
        plan,
        whole,
        name=click.format_filename(tree),
        per=given["per"],
        form="text",
        several=len(traces) + len(logs) - len(found) > 1,
        detections=False,
        drawn=False,
        drawing=None,
        hooks=Hooks(),
        checkpoints=None,
        follow=False,
        unchosen=given["semantics"] is None and whole.semantics is None,
    )
    made: list[PageReporter] = []

    def reporter(settings: MonitorSettings, sink: Sink) -> Reporter:
        made.append(PageReporter(settings, sink, given["max_events"]))
        return made[0]

    status = run(settings, traces, report=reporter)
    if made[0].page is None:
        warn(f"{output or 'the page'} is not written: no log was read to its end")
    else:
        deliver(made[0].page, output)
    return FAILED if missing.met else status
