"""`rvaft report`: an HTML page about the events and detections in logs, or one for each of several trees."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from rvaft.cli import FAILED, log_options, options, warn
from rvaft.cli.horizon import time_option
from rvaft.cli.monitor import (
    RISK,
    TracesGiven,
    limit_option,
    merge_option,
    plan_of,
    require_companions,
    require_one_by_one,
    stream_options,
)
from rvaft.cli.monitor_output import MonitorSettings, Reporter, Sink, SummaryRow, held, read_afresh
from rvaft.cli.monitor_run import run
from rvaft.cli.trees import ONE_BRANCH, TreesCommand, about, loaded, trees_given
from rvaft.model.nodes import Kind
from rvaft.reports.index import INDEX, Row, index_page, page_names
from rvaft.reports.log_report import LATEST, PLACES, LogReport, Messages
from rvaft.rules.validity import valid_part
from rvaft.stream.detection_commands import Hooks
from rvaft.stream.monitor_set import Per
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.verdict_change import MonitoredTrace
from rvaft.support.files import deliver, place, require_folder

if TYPE_CHECKING:
    from rvaft.cli.monitor_risk import RiskListener

_OUTPUT: Final = "Write the page to this file instead of standard output, or the pages of several trees to this folder."
MOST: Final = "Maximum number of events on the page."


class PageReporter(Reporter):
    """Makes the page from the messages of a run."""

    sums = True
    together = False

    def __init__(self, settings: MonitorSettings, sink: Sink, request: "PageRequest") -> None:
        super().__init__(settings, sink)
        self.request = request
        self.report = request.reports[settings.name]
        self.page: bytes | None = None
        self.stopped = False
        sink.kept = [] if sink.kept is None else sink.kept

    def stop(self, watch: MonitoredTrace) -> None:  # noqa: ARG002
        """Note that a log cannot be read further."""
        self.stopped = True

    def collected_messages(self, messages: Sequence[str] = ()) -> Messages:
        """Return all messages so far, these additional ones, and the summary of the logs."""
        totals, kept = self.totals, self.request.own_lines(self.settings.name, self.sink.kept or [])
        assert totals is not None
        semantics_hint = totals.semantics_hint
        doubts = [f"warning: {line}" for line in totals.data_warnings.lines]
        meant = [f"note: {semantics_hint.line}"] if semantics_hint is not None and semantics_hint.line else []
        summed = [] if totals.statistics is None else list(held(totals.statistics))
        return {"said": [*kept, *messages], "held": [*summed, *meant, *doubts]}

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:  # noqa: ARG002
        """Make the page; a note on several logs is for all trees."""
        afresh = () if self.settings.many else read_afresh(rows)
        for line in (*self.report.left_out, *afresh):
            self.sink.warn(f"{self.settings.of_tree}{line}")
        self.page = self.report.page(self.settings.name, self.collected_messages(), home=self.request.home)


_OPTIONS: Final = (
    click.argument("tree", metavar="TREE... [--]"),
    options.reading_options,
    options.semantics_option,
    options.part_options,
    click.argument("logs", nargs=-1, required=True, metavar="LOG..."),
    options.choice("--per", words=Per, default=Per.TREE, text="Also monitor each branch or each kind."),
    options.repeat_options,
    options.complete_option,
    stream_options,
    log_options.log_format,
    log_options.strict_json,
    merge_option,
    time_option("--risk", "risk", RISK),
    limit_option,
)


def page_options(function: options.F) -> options.F:
    """Add the options for what is monitored."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


class PageRequest:
    """The trees and logs of pages, and how they are monitored.

    `pages` has the name of each tree's page, which is a file, or a folder of a server with `served`.
    """

    def __init__(
        self,
        tree: str,
        logs: Sequence[str],
        branch: int | None,
        kind: Kind | None,
        *,
        follow: bool = False,
        served: bool = False,
        given: Any,
    ) -> None:
        options.refuse(tree == "-", "TREE is a file: standard input is read as a log")
        require_companions(given)
        if given["risk"] is not None:
            require_one_by_one(given)
        files, logs = trees_given(tree, logs)
        wholes = loaded(files)
        many = len(wholes) > 1
        options.refuse(many and branch is not None, ONE_BRANCH)
        self._traces = TracesGiven(logs, given["log_format"], live=follow)
        if given["merge"]:
            self._traces.merge(wholes.values())
        clock = given.get("clock")
        options.refuse(clock is not None and not follow, "--clock needs events that arrive: --follow")
        options.require_times(clock, wholes.values())
        if follow:
            self._traces.require_growing("--follow", "LOG")
        most = given["max_events"] or (LATEST if follow else PLACES)
        self.settings: list[MonitorSettings] = []
        self.reports: dict[str, LogReport] = {}
        for file, whole in wholes.items():
            name = click.format_filename(file)
            with about(file, many=many):
                plan = plan_of(valid_part(whole, branch, kind), whole, given)
                risk = _risk(file, plan, given)
                self.reports[name] = report = LogReport(whole, plan, most=most, grows=follow, risk=risk)
            self.settings.append(
                MonitorSettings(
                    plan,
                    whole,
                    name=name,
                    per=given["per"],
                    form="text",
                    several=self._traces.several,
                    detections=False,
                    drawn=False,
                    near=False,
                    drawing=None,
                    hooks=Hooks(),
                    checkpoints=None,
                    follow=follow,
                    clock=clock,
                    complete=given["complete"],
                    unchosen=given["semantics"] is None and whole.semantics is None,
                    others=(report,) if risk is None else (risk, report),
                    many=many,
                )
            )
        self.pages = dict(zip(self.reports, page_names(self.reports), strict=True))
        self._ending = "/" if served else ".html"
        self.home = "" if not many else "../" if served else f"{INDEX}.html"
        """The address of the page that lists the trees, from the page of one; "" for one tree."""

    def own_lines(self, name: str, lines: Sequence[str]) -> list[str]:
        """Return the lines that are not about another tree, as far as they say so."""
        others = tuple(f"rvaft: warning: {one}: " for one in self.reports if one != name)
        return [line for line in lines if not line.startswith(others)]

    def index(self, lines: Sequence[str], *, live: bool = False) -> bytes:
        """Return the page that lists the trees."""
        rows = [Row(one, f"{self.pages[one]}{self._ending}", *self.reports[one].detects) for one in self.reports]
        return index_page(rows, lines, live=live)

    def run(self, make: Callable[[MonitorSettings, Sink], Reporter]) -> int:
        """Read the logs and return the exit status."""
        status = run(self.settings, self._traces.sources, report=make)
        return FAILED if self._traces.missing.met else status


def _risk(file: str, plan: MonitoringPlan, given: Mapping[str, Any]) -> "RiskListener | None":
    """Return what follows the risk of a tree, if it is asked for."""
    if given["risk"] is None:
        return None
    from rvaft.cli.monitor_risk import risk_listener  # noqa: PLC0415 -- imported on use

    return risk_listener(file, plan, given["risk"], None, Hooks())


@click.command("report", cls=TreesCommand)
@page_options
@options.number("--max-events", default=PLACES, text=MOST)
@click.option("-o", "--output", metavar="FILE", help=_OUTPUT)
def report_command(
    *, tree: str, logs: tuple[str, ...], branch: int | None, kind: Kind | None, output: str | None, **given: Any
) -> int:
    """Write an HTML page about the events in each LOG: the tree, the events, detections and near
    misses.

    A LOG is given as for `monitor`. The page is one file and needs no network. Several trees, or all trees of a
    folder, have a page each, and a page that lists them. The exit status is 1 if a log detects a tree.
    """
    request = PageRequest(tree, logs, branch, kind, given=given)
    many = len(request.settings) > 1
    if many:
        options.refuse(output in (None, "", "-"), "several trees have a page each: name a folder for them by -o")
        folder = Path(output or "")
        wrong = not folder.is_dir() and (folder.exists() or not folder.parent.is_dir())
        options.refuse(wrong, f"-o {output}: name a folder, or a new one in a folder that exists")
        require_folder(folder if folder.exists() else folder.parent)
    else:
        options.require_writable([output or "-"])
    made: list[PageReporter] = []

    def make(settings: MonitorSettings, sink: Sink) -> Reporter:
        made.append(PageReporter(settings, sink, request))
        return made[-1]

    status = request.run(make)
    pages = {request.pages[one.settings.name]: one.page for one in made if one.page is not None}
    if not pages:
        warn(f"{output or 'the page'} is not written: no log was read to its end")
    elif many:
        pages[INDEX] = request.index(made[0].sink.kept or [])
        place(Path(output or ""), {f"{name}.html": page for name, page in pages.items()}, force=True)
    else:
        deliver(next(iter(pages.values())), output)
    return status
