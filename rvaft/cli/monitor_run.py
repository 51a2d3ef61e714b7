"""Runs `rvaft monitor` over its traces, in one or several processes."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from datetime import UTC, datetime
from functools import partial
from io import BytesIO, IOBase
from math import inf
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from threading import Timer
from time import monotonic
from typing import BinaryIO, Final, NamedTuple, TypeAlias, cast

import click

from rvaft.cli import FAILED, FOUND
from rvaft.cli.alerts import ALL_REPORTERS
from rvaft.cli.monitor_output import WIDE, MonitorSettings, Reporter, Sink, SummaryRow, finish_together, read_afresh
from rvaft.errors import OptionError, RvaftError, TooLarge, TraceError
from rvaft.export import PICTURES, Format
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import LIVE, Explanation
from rvaft.readers.json_lines import LinesRead
from rvaft.readers.log import Live, Log, LogReader, LogSource, open_log, source_of, suffix
from rvaft.stream import pipeline, sources, whole_log
from rvaft.stream.checkpoint import CheckpointFile, open_at
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.detection import detection
from rvaft.stream.detection_commands import UNSTARTED
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.follow import FollowedFile, stopping
from rvaft.stream.listeners import Listener
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from rvaft.stream.semantics_hint import SemanticsHint
from rvaft.stream.sources import Source, reading_of
from rvaft.stream.statistics import Statistics
from rvaft.stream.trace_progress import StateBeside
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.stream.whole_log import Declined, LogAnswer
from rvaft.support.collector import rare_collections
from rvaft.support.files import SUFFIXES as COMPRESSED
from rvaft.support.files import deliver
from rvaft.support.output import STOP
from rvaft.support.processes import Killed, in_processes
from rvaft.support.terminal import ProgressBar
from rvaft.support.wording import counted

SUFFIXES: Final = (".svg", ".dot", ".gv", ".pdf", ".png", ".txt")
_OFTEN: Final = 1_000
"""Minimum checkpoint interval, in events, for reading in blocks."""
_CHUNK: Final = 1 << 20
_State: TypeAlias = tuple[list[StateBeside], list[tuple[int, tuple[int, str | None]]], bool]
"""The states of runs, those of reporters and reactions, and whether kept events are whole."""
_DAY: Final = 24 * 3600 * 10**9
_SILENCE: Final = 2.0
"""Seconds before a terminal shows what an engine does."""


class TraceSource(NamedTuple):
    """A file, or events from memory or a stream; `reader` is None for JSON Lines."""

    name: str
    file: str | None = None
    events: Iterable[Json] | BinaryIO = ()
    reader: LogReader | None = None

    @property
    def live(self) -> bool:
        """Whether the events come from a URL."""
        return self.reader is not None and bool(self.reader.schemes)

    def log(
        self, source: object, plans: tuple[MonitoringPlan, ...], line: int, live: Live, sink: Sink | None
    ) -> Log | None:
        """Return the log from that line on, or None for JSON Lines; warn of the first malformed
        event.
        """
        if self.reader is None:
            return None

        def warn_of(first: TraceError) -> None:
            if sink is not None:
                sink.warn(f"{first}; skipped, as are later ones like it")

        reads, plan = reading_of(plans).reads, plans[0]
        of_keys = (one for key in (plan.key, plan.distinct) if key is not None for one in key.fields)
        needed = tuple((one.text, one.path[0]) for one in of_keys)
        given, strict = cast("LogSource", source), plan.strict_json
        return Log(self.reader, given, self.name, reads, strict, line, needed=needed, on_reject=warn_of, live=live)

    @property
    def is_plain(self) -> bool:
        """Whether this is an uncompressed file of JSON Lines."""
        return self.reader is None and self.file is not None and Path(self.file).suffix.lower() not in COMPRESSED

    @property
    def size(self) -> int:
        """The size of a regular file in bytes, else 0."""
        return Path(self.file).stat().st_size if self.file is not None and Path(self.file).is_file() else 0


class TraceOutcome(NamedTuple):
    """The result of one trace.

    `keyless` names key fields that no event has; `ended`: the trace was read to its end.
    """

    status: int
    rows: Sequence[SummaryRow] = ()
    drawn: bytes | None = None
    detections: int = 0
    undrawn: bool = False
    keyless: str = ""
    ended: bool = False


class _OnDetection(Listener):
    """Runs commands for detections, draws the first one, and counts them."""

    each_key = False

    def __init__(self, settings: MonitorSettings, sink: Sink, *, deliver: bool) -> None:
        self.whole = bool(settings.hooks)
        self.count = 0
        self.unstarted = 0
        """The number of commands that were not started after a stop was requested."""
        self.first: bytes | None = None
        self.failed = False
        self._settings = settings
        self._sink = sink
        self._deliver = deliver

    @property
    def state(self) -> tuple[int, str | None]:
        """The number of detections, and the file to which one was drawn."""
        return self.count, None if self.first is None else self._settings.drawing

    @state.setter
    def state(self, state: tuple[int, str | None]) -> None:
        self.count, drawn = state
        if drawn is not None and drawn == self._settings.drawing and Path(drawn).exists():
            self.first = Path(drawn).read_bytes()

    def change(self, change: VerdictChange) -> None:
        settings, watch = self._settings, change.watch
        again = {"again": True} if change.number <= self.reported_before else {}
        about = {"tree": settings.name, "trace": watch.trace, **settings.key(watch), "event": change.number, **again}
        about["line"] = change.line
        for explanation, kinds, count in change.detections:
            self.count += 1
            if settings.hooks:
                with suppress(BrokenPipeError):  # also if standard output is closed
                    self._sink.flush()
                counted = {} if count is None else count.fields
                record = detection({**about, **counted}, explanation, change.events, settings.tree, change.lines)
                for failure in settings.hooks.run(record, kinds):
                    if failure == UNSTARTED:
                        self.unstarted += 1
                    else:
                        self._sink.warn(failure)
            if settings.drawing is None or explanation is None or self.first is not None or self.failed:
                continue
            form = PurePath(settings.drawing).suffix.lower().removeprefix(".")
            self._draw(lambda: _drawing(settings.tree, explanation, change.events, form))  # noqa: B023

    def _draw(self, make: Callable[[], bytes]) -> None:
        try:
            self.first = make()
            if self._deliver:
                deliver(self.first, self._settings.drawing)
        except (RvaftError, OSError) as error:
            self._sink.report(error)
            self.failed = True

    def take(self, outcome: TraceOutcome) -> None:
        """Add the detections of another process."""
        self.count += outcome.detections
        self.failed = self.failed or outcome.undrawn
        if self.first is None and (drawn := outcome.drawn) is not None:
            self._draw(lambda: drawn)


def _drawing(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json], form: str) -> bytes:
    """Return a detection as a file of this format."""
    from rvaft.export.drawing import fired_dot, fired_picture, fired_text  # noqa: PLC0415 -- imported on use

    if form in PICTURES:
        return fired_picture(tree, explanation, events, Format(form))
    return (fired_text if form == "txt" else fired_dot)(tree, explanation, events).encode()


class _WatchedTree:
    """The settings of one tree, its totals, and the listeners of its runs."""

    def __init__(
        self,
        settings: MonitorSettings,
        sink: Sink,
        reporter: Reporter,
        warn: Callable[[str], object],
        *,
        deliver: bool,
        first: Listener,
        few: bool,
    ) -> None:
        self.settings = settings
        monitors = settings.plan.monitors
        self.reporter = reporter
        sums = self.reporter.sums
        resumed = settings.checkpoints is not None
        tried = not resumed and few
        self.totals = Totals(
            Statistics(monitors.types) if sums or resumed else None,  # for this summary, or that of a resumed run
            DataWarnings(monitors.types, warn),
            SemanticsHint(monitors.columns[0].part, tried=tried) if settings.unchosen and sums else None,
        )
        self.reporter.totals = self.totals
        self.reaction = _OnDetection(settings, sink, deliver=deliver)
        reacts = bool(settings.hooks) or settings.drawing is not None
        risk = [] if settings.risk is None else [settings.risk]
        self.listeners = [first, *settings.others, *risk, self.reporter, *([self.reaction] if reacts else [])]

    def run(self, trace: TraceSource) -> TraceRun:
        """Return a new run over a trace."""
        settings, path = self.settings, Path(trace.file or "")
        plan = settings.plan
        again = (
            trace.file is not None
            and (path.is_file() or path.is_dir())
            and plan.order_by is None
            and plan.distinct is None
            and not settings.follow
        )
        buffer = EventBuffer(path if again else None, reads=plan.reads, reader=trace.reader, late=not plan.plain)
        return TraceRun(
            plan, trace.name, self.listeners, self.totals, buffer=buffer, prefix=settings.of_trace(trace.name)
        )


class _Run(Listener):
    """Runs traces in turn, each for all trees, and sums their statistics."""

    each_key = False

    def __init__(
        self,
        trees: Sequence[MonitorSettings],
        sink: Sink,
        progress: ProgressBar | None,
        report: Callable[[MonitorSettings, Sink], Reporter] | None = None,
        *,
        deliver: bool,
        jobs: int = 1,
    ) -> None:
        self.settings = trees[0]
        """The settings that all trees share."""
        self.sink = sink
        self.jobs = jobs
        self.progress = progress
        times = {one.tree.time for one in trees}
        self._said: set[str] | None = set() if len(trees) > 1 and len(times) == 1 else None
        """What was said about times, if all trees read them alike."""
        made = partial(_WatchedTree, deliver=deliver, first=self, few=len(trees) <= WIDE)
        make = report or (lambda one, sink: ALL_REPORTERS[one.form](one, sink))
        self.trees = [made(one, sink, make(one, sink), partial(self._warn_of, one)) for one in trees]
        self._log: Log | None = None
        self._has_whole = True
        """Whether the events that are kept, for explanations and order, have all fields."""
        self._runs: Sequence[TraceRun] = ()
        """The runs of the present trace, by tree."""
        self._told = monotonic()
        """When the monitors were told the time."""
        self._has_compared = False
        """Whether a difference between the clocks of machine and log was found."""
        self._failed = set[int]()
        """The runs whose monitors have failed, by their `id`."""

    @property
    def listeners(self) -> Iterator[Listener]:
        """The listeners of all trees."""
        return (one for tree in self.trees for one in tree.listeners)

    def _warn_of(self, settings: MonitorSettings, message: str) -> None:
        """Warn about the data of a tree, once if it holds for all trees."""
        if self._said is None:
            self.sink.warn(f"{settings.of_tree}{message}")
        elif message not in self._said:
            self._said.add(message)
            self.sink.warn(message)

    def change(self, change: VerdictChange) -> None:
        kept = self.settings.checkpoints
        if kept is not None and change.detected and change.number > kept.noted:
            kept.note(change.number)

    def watch(self, trace: TraceSource) -> list[TraceOutcome]:
        """Run one trace, and return its outcome for each tree; an error follows the events before it."""
        path = Path(trace.file or "")
        runs = self._runs = [tree.run(trace) for tree in self.trees]
        before, failed, ended = [tree.reaction.count for tree in self.trees], False, False
        self._log = None
        self._failed.clear()
        try:
            if (answer := self._answer(runs[0], trace)) is None:
                if self._arrives(trace) and any(run.plan.monitors.evaluate_prefixes for run in runs):
                    self.sink.warn(
                        f"the backend evaluates all events of {trace.name} after each event, at most {LIVE:,}: "
                        "give a complete log as a file, or omit --backend"
                    )
                backends = not (all(run.plan.monitors.engines for run in runs) or self._arrives(trace))
                with _shown(f"the backend evaluates {trace.name} as a whole") if backends else nullcontext():
                    self._read(runs, trace)
            else:
                with closing(answer):
                    runs[0].begin()
                    for _ in whole_log.read(runs[0], answer):
                        self.trees[0].reporter.pause(runs[0])
            for run in runs:
                if id(run) not in self._failed:
                    if self.settings.complete:
                        run.finish()
                    run.end()
            ended = True
        except (RvaftError, OSError) as error:
            if isinstance(error, OSError) and error.filename is None:  # standard output failed
                raise
            failed = True
            for run in runs:
                if id(run) not in self._failed:
                    run.stop()
            self._report(runs[0], error)
        if self._log is not None and (fault := self._log.fault) is not None:
            if self._log.is_malformed(runs[0].number):
                failed = True
                self.sink.report(fault)
            else:
                self.sink.warn(str(fault))
        self._warn(runs)
        concerned = any(watch.monitors.concerned for run in runs for watch in run.watches)
        if ended and runs[0].number == 1 and not concerned and trace.reader is None and suffix(path) == ".json":
            self.sink.warn(
                f"{trace.name} was read as JSON Lines with one event; "
                "for a JSON document name its list of events with --records PATH"
            )
        return [
            self._outcome(tree, run, count, failed=failed, ended=ended)
            for tree, run, count in zip(self.trees, runs, before, strict=True)
        ]

    def _outcome(self, tree: _WatchedTree, run: TraceRun, before: int, *, failed: bool, ended: bool) -> TraceOutcome:
        reaction, key, lost = tree.reaction, tree.settings.plan.key, id(run) in self._failed
        failed, ended = failed or lost, ended and not lost
        rows = [SummaryRow.of(watch, failed=failed) for watch in run.watches] if tree.settings.summed else []
        status = FAILED if failed else FOUND if run.found else 0
        keyless = " and ".join(field.text for field in key.fields) if key and run.number and not run.watches else ""
        return TraceOutcome(status, rows, reaction.first, reaction.count - before, reaction.failed, keyless, ended)

    def _report(self, run: TraceRun, error: BaseException) -> None:
        if isinstance(error, TooLarge):
            remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
            error.add_note(f"at event {run.number} of {run.trace}{remedy}")
        self.sink.report(error)

    def _fail(self, run: TraceRun, error: RvaftError) -> None:
        """Report that the monitors of a tree have failed; the others continue, unless they are kept for later."""
        number = next(place for place, one in enumerate(self._runs) if one is run)
        if not isinstance(error, TraceError):
            error.add_note(f"the tree is {self.trees[number].settings.name}")
        if self.settings.checkpoints is not None:
            raise error
        self._failed.add(id(run))
        run.stop()
        self._report(run, error)

    def _warn(self, runs: Sequence[TraceRun]) -> None:
        """Print the warnings of runs, once if they are those of all trees."""
        found: dict[str, list[_WatchedTree]] = {}
        for tree, run in zip(self.trees, runs, strict=True):
            for warning in run.warnings:
                found.setdefault(f"{run.prefix}{warning}", []).append(tree)
        for warning, trees in found.items():
            if len(trees) == len(self.trees):
                self.sink.warn(warning)
            else:
                for tree in trees:
                    self.sink.warn(f"{tree.settings.of_tree}{warning}")

    def _arrives(self, trace: TraceSource) -> bool:
        """Whether events of a trace arrive while it is monitored."""
        return self.settings.follow or trace.live or isinstance(trace.events, IOBase)

    def _readers(self, trace: TraceSource) -> int:
        """Return how many processes read a trace; flush, since forked processes inherit the
        buffer.
        """
        if not trace.is_plain or trace.size <= sources.STRETCH:
            return 1
        self.sink.flush()
        return self.jobs

    def _answer(self, run: TraceRun, trace: TraceSource) -> LogAnswer | None:
        """Return the answer of the engine for a trace; without one, warn and return None.

        There is no warning if the file cannot be opened, which the reader reports.
        """
        engine, answer = self.settings.engine, None
        if engine is None or trace.file is None:
            return None
        if not os.access(trace.file, os.R_OK) or Path(trace.file).is_dir():
            return None
        try:
            with _shown(f"{engine.name} is reading {trace.name}"):
                answer = engine.ask(Path(trace.file), trace.reader)
                whole_log.count(run, answer)
        except Declined as reason:
            if answer is not None:
                answer.close()
            if engine.says_so:
                self.sink.warn(f"{trace.name} is read without {engine.name}: {reason}")
            return None
        return answer

    def _source(self, stack: ExitStack, runs: Sequence[TraceRun], trace: TraceSource) -> Iterable[Json] | LogSource:
        """Open a trace; a compiled monitor, if there is one, reads it first."""
        source: Iterable[Json] | LogSource = trace.events
        if trace.file is not None:
            source = stack.enter_context(source_of(trace.reader, trace.file) if trace.reader else open_log(trace.file))
        native = self.settings.native
        if native is None:
            return source
        same = Path(trace.file) if trace.file is not None and trace.is_plain else None
        return stack.enter_context(native.trace(trace.name, same, cast("BinaryIO", source), runs[0]))

    @property
    def _unstarted(self) -> int:
        """The number of commands that were not started after a stop was requested."""
        return sum(tree.reaction.unstarted for tree in self.trees)

    def _state(self, runs: Sequence[TraceRun]) -> _State:
        """Return the state of runs besides that of their monitored traces."""
        reports = [(tree.reporter.listed, tree.reaction.state) for tree in self.trees]
        return [run.state_beside for run in runs], reports, self._has_whole

    def _resume(self, runs: Sequence[TraceRun], kept: CheckpointFile) -> tuple[int, int]:
        """Restore runs from their checkpoint, or write a first one; return offset and line."""
        found = kept.load()
        if found is None:
            kept.save(partial(self._state, runs), 0, LinesRead(BytesIO()), traces=_in_turns(runs))
            return 0, 0
        about, traces, state = found
        try:
            beside, reports, self._has_whole = cast("_State", state)
            for place, (tree, run) in enumerate(zip(self.trees, runs, strict=True)):
                tree.reporter.listed, tree.reaction.state = reports[place]
                run.restore((traces[place :: len(runs)], beside[place]), about.events)
        except Exception as error:
            raise kept.unreadable(error) from error
        for listener in self.listeners:
            listener.reported_before = kept.noted
        if any(one.whole for one in self.listeners) and not self._has_whole:
            lacking = "the run that wrote it kept of each event only the fields that the tree reads"
            self.sink.warn(f"{kept.path}: {lacking}: events up to event {about.events} may lack others")
        return about.offset, about.line

    def _tell_time(self, runs: Sequence[TraceRun]) -> None:
        """Tell monitors that wait for it the time, if the period of the clock has passed."""
        clock = self.settings.clock
        if clock is not None and monotonic() - self._told >= clock / 1e9:
            self._told = monotonic()
            for run in runs:
                if id(run) not in self._failed and run.plan.monitors.time is not None:
                    now = datetime.now(tz=UTC)
                    self._compare_clocks(run, now)
                    run.pass_time(now)
            self.sink.flush()

    def _compare_clocks(self, run: TraceRun, now: datetime) -> None:
        """Warn once of a deadline that was over long ago, as if the log had another clock."""
        time, first = run.plan.monitors.time, min((watch.monitors.deadline for watch in run.watches), default=inf)
        if time is None or self._has_compared or first == inf:
            return
        days = (time.now(now) - first) / _DAY
        if days > 1:
            self._has_compared = True
            what = f"a deadline of {run.trace} lies {days:,.0f} days before this machine's time"
            self.sink.warn(f"{what}: if {'.'.join(time.field)} is of another clock, --clock ends every wait at once")

    def _read(self, runs: Sequence[TraceRun], trace: TraceSource) -> None:
        """Read all events since the last checkpoint; save and flush after each batch."""
        follow, kept, sink = self.settings.follow, self.settings.checkpoints, self.sink
        stream: LinesRead | FollowedFile | None = None
        flushed = 0
        offset, line = (0, 0) if kept is None else self._resume(runs, kept)

        def keep(*, ended: bool = False) -> None:
            """Write a checkpoint if one is due, after flushing the output that precedes it.

            Events held back by `--order-by` are not saved: a resumed run reads them again. So it does
            those whose commands were not started.
            """
            nonlocal flushed
            for tree, run in zip(self.trees, runs, strict=True):
                tree.reporter.pause(run)
            if kept is None or stream is None:
                return
            number, detected = runs[0].number, max(run.detected for run in runs)
            if not (runs[0].ended or self._unstarted) and (ended or kept.is_due(number)):
                sink.flush()
                file = stream.file if isinstance(stream, FollowedFile) else None
                state, traces = partial(self._state, runs), _in_turns(runs)
                kept.save(state, number, stream, file, traces=traces, bounded=not ended)
            elif detected > flushed:
                sink.flush()
            flushed = detected

        def idle() -> None:
            self._tell_time(runs)
            keep()

        for run in runs:
            run.begin()
        with ExitStack() as stack:
            source: Iterable[Json] | LogSource = ()
            if trace.file is not None and follow and not trace.live:
                stop = stack.enter_context(stopping())
                stream = FollowedFile(trace.file, stop=stop, changed=sink.warn, idle=idle, offset=offset, line=line)
                stack.callback(stream.close)
            elif trace.file is not None and kept is not None:
                stream = stack.enter_context(open_at(Path(trace.file), offset=offset, line=line))
            else:
                source = self._source(stack, runs, trace)
            at_once, plans = self._arrives(trace), tuple(run.plan for run in runs)
            live = stack.enter_context(_listening(trace, sink, idle))
            self._log = trace.log(stream or source, plans, line + 1, live, sink if follow else None)
            seldom = not follow and (kept is None or kept.every >= _OFTEN)
            by_blocks = seldom if self._log is None else not (at_once or stream)
            self._has_whole &= not by_blocks or any(one.whole for one in self.listeners)
            given, jobs = cast("Source", self._log or stream or source), self._readers(trace)
            for going_on in pipeline.read(
                runs,
                given,
                trace.name,
                line=line + 1,
                by_blocks=by_blocks,
                live=at_once,
                jobs=jobs,
                log=None if trace.file is None else Path(trace.file),
                failed=self._fail if len(runs) > 1 else None,
            ):
                if at_once:
                    sink.flush()
                keep(ended=not going_on)
                if self.progress is not None:
                    self.progress.reach(source)
            for warning in _unread(trace.name, stream) if isinstance(stream, FollowedFile) else ():
                sink.warn(warning)
            if self._unstarted:
                sink.warn(f"{counted(self._unstarted, 'command')} not started: the monitor was stopped")
            if self.progress is not None:
                self.progress.finish(trace.size)


def _unread(name: str, stream: FollowedFile) -> Iterator[str]:
    """Yield what was not read of a followed file."""
    if stream.unfinished:
        yield f"{name}: the last line is incomplete and was not read ({stream.unfinished} bytes)"
    if stream.goes_on:
        yield f"{name}: what follows line {stream.line} was not read: the monitor was stopped"


def _in_turns(runs: Sequence[TraceRun]) -> list[MonitoredTrace]:
    """Return the monitored traces of each key for all trees, so that new keys come last, for a checkpoint."""
    for run in runs:
        run.settle()
    return [watch for of_key in zip(*(run.watches for run in runs), strict=True) for watch in of_key]


@contextmanager
def _shown(work: str) -> Iterator[None]:
    """Show on a terminal what is being done, if it takes longer than `_SILENCE`."""
    waiting = Timer(_SILENCE, click.echo, [f"rvaft: {work}"], {"err": True})
    if sys.stderr is not None and sys.stderr.isatty():
        waiting.start()
    try:
        yield
    finally:
        waiting.cancel()


@contextmanager
def _listening(trace: TraceSource, sink: Sink, idle: Callable[[], object]) -> Iterator[Live]:
    if not trace.live:
        yield Live()
        return
    listening = False

    def began() -> None:
        nonlocal listening
        listening = True
        click.echo(f"rvaft: listening to {trace.name} (Ctrl-C ends)", err=True)

    with stopping() as stop:

        def is_stopping() -> bool:
            if listening:
                idle()
            return stop()

        yield Live(is_stopping, began, sink.warn)


def run(
    trees: Sequence[MonitorSettings],
    traces: Sequence[TraceSource],
    jobs: int = 1,
    report: Callable[[MonitorSettings, Sink], Reporter] | None = None,
) -> int:
    """Run all traces for all trees and return the exit status; `report` makes other reporters."""
    STOP.reset()
    settings = trees[0]
    with rare_collections():
        sizes = sum(trace.size for trace in traces)
        watched = not settings.follow and all(trace.file is not None for trace in traces)
        progress = ProgressBar(sizes) if watched and sizes else None
        sink = Sink(progress=progress)
        alone = _Run(trees, sink, progress, report, deliver=True, jobs=jobs)
        if jobs > 1 and len(traces) > 1:
            outcomes = list(_in_processes(alone, traces, jobs))
        else:
            outcomes = [alone.watch(trace) for trace in traces]
        rows = [[row for one in of_trees for row in one.rows] for of_trees in zip(*outcomes, strict=True)]
        every = [one for of_trees in outcomes for one in of_trees]
        if any(outcome.ended for outcome in every):
            if len(trees) == 1 or not alone.trees[0].reporter.together:
                for line in read_afresh([row for own in rows for row in own]) if len(trees) > 1 else ():
                    sink.warn(line)
                for tree, own in zip(alone.trees, rows, strict=True):
                    tree.reporter.finish(own, tree.totals)
            else:
                finish_together([tree.reporter for tree in alone.trees], rows)
        if (names := "".join({one.keyless for one in every})) and not any(rows):
            sink.report(OptionError(f"no event has the key field ({names}), so nothing was monitored"))
            return FAILED
        reaction = alone.trees[0].reaction
        if settings.drawing is not None and not reaction.failed:
            if reaction.first is None:
                why = "no explanation" if reaction.count else "nothing was detected"
                sink.warn(f"{settings.drawing} is not written: {why}")
            elif reaction.count > 1:
                sink.warn(f"{settings.drawing} shows the first of {reaction.count} detections")
        return max([FAILED if reaction.failed else 0, *(outcome.status for outcome in every)])


def _in_processes(alone: _Run, traces: Sequence[TraceSource], jobs: int) -> Iterator[list[TraceOutcome]]:
    """Run traces in several processes; yield and print in the order of traces."""
    sink = alone.sink
    with TemporaryDirectory(prefix="rvaft-") as folder:

        def work(number: int) -> tuple[list[TraceOutcome], list[Totals], list[str]]:
            with (Path(folder) / str(number)).open("w", encoding="utf-8", errors="backslashreplace") as file:
                own = _Run([tree.settings for tree in alone.trees], Sink(file), None, deliver=False)
                outcomes = own.watch(traces[number])
                return outcomes, [tree.totals for tree in own.trees], own.sink.errors

        with closing(in_processes(work, range(len(traces)), jobs=min(jobs, len(traces)))) as running:
            for number, result in running:
                printed = Path(folder) / str(number)
                if printed.exists():
                    with printed.open(encoding="utf-8") as file:
                        while text := file.read(_CHUNK):
                            sink.write(text)
                    printed.unlink()
                if alone.progress is not None:
                    alone.progress.finish(traces[number].size)
                if isinstance(result, Killed):
                    killed = f"{traces[number].name}: the process that monitored it was killed"
                    sink.report(click.ClickException(killed))
                    yield [TraceOutcome(FAILED) for _ in alone.trees]
                    continue
                outcomes, totals, errors = result
                sink.errors += errors
                sink.pass_on()
                for tree, own, outcome in zip(alone.trees, totals, outcomes, strict=True):
                    tree.totals.merge(own)
                    tree.reaction.take(outcome)
                yield outcomes
