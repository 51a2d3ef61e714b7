"""Runs `rvaft monitor` over its traces, in one or several processes."""

import gc
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from functools import partial
from io import BytesIO, IOBase
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from threading import Timer
from typing import BinaryIO, Final, NamedTuple, TypeAlias, cast

import click

from rvaft.cli import FAILED, FOUND
from rvaft.cli.alerts import ALL_REPORTERS
from rvaft.cli.monitor_output import MonitorSettings, Reporter, Sink, SummaryRow
from rvaft.errors import OptionError, RvaftError, TooLarge, TraceError
from rvaft.export import PICTURES, fired_dot, fired_text, picture
from rvaft.model.values import Json
from rvaft.monitors import LIVE
from rvaft.readers.json_lines import LinesRead
from rvaft.readers.log import Live, Log, LogReader, LogSource, open_log, source_of, suffix
from rvaft.stream import bulk, whole_log
from rvaft.stream.checkpoint import CheckpointFile, open_at
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.detection import UNSTARTED, counted, detection
from rvaft.stream.follow import FollowedFile, stopping
from rvaft.stream.listeners import EventBuffer, Listener, VerdictChange
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import Source, StateBeside, TraceRun
from rvaft.stream.semantics_hint import SemanticsHint
from rvaft.stream.statistics import Statistics
from rvaft.stream.whole_log import Declined, LogAnswer
from rvaft.support.files import SUFFIXES as COMPRESSED
from rvaft.support.files import deliver
from rvaft.support.output import STOP
from rvaft.support.processes import Killed, in_processes
from rvaft.support.terminal import ProgressBar

SUFFIXES: Final = (".svg", ".dot", ".gv", ".pdf", ".png", ".txt")
_OFTEN: Final = 1_000
"""Minimum checkpoint interval, in events, for reading in blocks."""
_CHUNK: Final = 1 << 20
_ReportState: TypeAlias = tuple[int, tuple[int, str | None], bool]
"""The state of reporter and reaction, and whether kept events are whole."""
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

    def log(self, source: object, plan: MonitoringPlan, line: int, live: Live, sink: Sink | None) -> Log | None:
        """Return the log from that line on, or None for JSON Lines; warn of the first malformed
        event.
        """
        if self.reader is None:
            return None

        def warn_of(first: TraceError) -> None:
            if sink is not None:
                sink.warn(f"{first}; skipped, as are later ones like it")

        of_keys = (one for key in (plan.key, plan.distinct) if key is not None for one in key.fields)
        needed = tuple((one.text, one.path[0]) for one in of_keys)
        given, strict = cast("LogSource", source), plan.strict_json
        return Log(self.reader, given, self.name, plan.reads, strict, line, needed=needed, on_reject=warn_of, live=live)

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
            make, fired = fired_text if form == "txt" else fired_dot, (settings.tree, explanation, change.events)
            self._draw(lambda: picture(make(*fired), form) if form in PICTURES else make(*fired).encode())  # noqa: B023

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


class _Run(Listener):
    """Runs traces in turn and sums their statistics."""

    def __init__(
        self,
        settings: MonitorSettings,
        sink: Sink,
        progress: ProgressBar | None,
        reporter: Reporter | None = None,
        *,
        deliver: bool,
        jobs: int = 1,
    ) -> None:
        self.settings = settings
        self.sink = sink
        self.jobs = jobs
        self.progress = progress
        monitors, tried = settings.plan.monitors, settings.checkpoints is None
        self.reporter = reporter or ALL_REPORTERS[settings.form](settings, sink)
        sums = self.reporter.sums
        self.totals = Totals(
            Statistics(monitors.types) if sums or not tried else None,  # for this summary, or that of a resumed run
            DataWarnings(monitors.types, sink.warn),
            SemanticsHint(monitors.columns[0].part, tried=tried) if settings.unchosen and sums else None,
        )
        self.reporter.totals = self.totals
        self.reaction = _OnDetection(settings, sink, deliver=deliver)
        reacts = bool(settings.hooks) or settings.drawing is not None
        self.listeners: list[Listener] = [self, *settings.others, self.reporter, *([self.reaction] if reacts else [])]
        self._log: Log | None = None
        self._has_whole = True
        """Whether the events that are kept, for explanations and order, have all fields."""

    def change(self, change: VerdictChange) -> None:
        kept = self.settings.checkpoints
        if kept is not None and change.detected and change.number > kept.noted:
            kept.note(change.number)

    def watch(self, trace: TraceSource) -> TraceOutcome:
        """Run one trace; an error follows the events before it."""
        settings, reaction, path = self.settings, self.reaction, Path(trace.file or "")
        plan = settings.plan
        again = (
            trace.file is not None
            and (path.is_file() or path.is_dir())
            and plan.order_by is None
            and plan.distinct is None
            and not settings.follow
        )
        buffer = EventBuffer(path if again else None, reads=plan.reads, reader=trace.reader, late=not plan.plain)
        prefix = f"{trace.name}: " if settings.several else ""
        run = TraceRun(plan, trace.name, self.listeners, self.totals, buffer=buffer, prefix=prefix)
        before, failed, ended = reaction.count, False, False
        self._log = None
        try:
            if (answer := self._answer(run, trace)) is None:
                if self._arrives(trace) and plan.monitors.evaluate_prefixes:
                    self.sink.warn(
                        f"the backend evaluates all events of {trace.name} after each event, at most {LIVE:,}: "
                        "give a complete log as a file, or omit --backend"
                    )
                backends = not (plan.monitors.engines or self._arrives(trace))
                with _shown(f"the backend evaluates {trace.name} as a whole") if backends else nullcontext():
                    self._read(run, trace)
            else:
                with closing(answer):
                    run.begin()
                    for _ in whole_log.read(run, answer):
                        self.reporter.pause(run)
            run.end()
            ended = True
        except (RvaftError, OSError) as error:
            if isinstance(error, OSError) and error.filename is None:  # standard output failed
                raise
            failed = True
            run.stop()
            if isinstance(error, TooLarge):
                remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
                error.add_note(f"at event {run.number} of {trace.name}{remedy}")
            self.sink.report(error)
        if self._log is not None and (fault := self._log.fault) is not None:
            if self._log.is_malformed(run.number):
                failed = True
                self.sink.report(fault)
            else:
                self.sink.warn(str(fault))
        for warning in run.warnings:
            self.sink.warn(f"{prefix}{warning}")
        concerned = any(watch.monitors.concerned for watch in run.watches)
        if ended and run.number == 1 and not concerned and trace.reader is None and suffix(path) == ".json":
            self.sink.warn(
                f"{trace.name} was read as JSON Lines with one event; "
                "for a JSON document name its list of events with --records PATH"
            )
        rows = [SummaryRow.of(watch, failed=failed) for watch in run.watches] if settings.summed else []
        status = FAILED if failed else FOUND if run.found else 0
        key = settings.plan.key
        keyless = " and ".join(field.text for field in key.fields) if key and run.number and not run.watches else ""
        return TraceOutcome(status, rows, reaction.first, reaction.count - before, reaction.failed, keyless, ended)

    def _arrives(self, trace: TraceSource) -> bool:
        """Whether events of a trace arrive while it is monitored."""
        return self.settings.follow or trace.live or isinstance(trace.events, IOBase)

    def _readers(self, trace: TraceSource) -> int:
        """Return how many processes read a trace; flush, since forked processes inherit the
        buffer.
        """
        if not trace.is_plain or trace.size <= bulk.STRETCH:
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

    def _source(self, stack: ExitStack, run: TraceRun, trace: TraceSource) -> Iterable[Json] | LogSource:
        """Open a trace; a compiled monitor, if there is one, reads it first."""
        source: Iterable[Json] | LogSource = trace.events
        if trace.file is not None:
            source = stack.enter_context(source_of(trace.reader, trace.file) if trace.reader else open_log(trace.file))
        native = self.settings.native
        if native is None:
            return source
        same = Path(trace.file) if trace.file is not None and trace.is_plain else None
        return stack.enter_context(native.trace(trace.name, same, cast("BinaryIO", source), run.buffer))

    def _state(self, run: TraceRun) -> tuple[StateBeside, _ReportState]:
        """Return the state of a run besides that of its monitored traces."""
        return run.state_beside, (self.reporter.listed, self.reaction.state, self._has_whole)

    def _resume(self, run: TraceRun, kept: CheckpointFile) -> tuple[int, int]:
        """Restore the run from its checkpoint, or write a first one; return offset and line."""
        found = kept.load()
        if found is None:
            kept.save(partial(self._state, run), 0, LinesRead(BytesIO()), traces=run.watches)
            return 0, 0
        about, traces, state = found
        try:
            beside, report = cast("tuple[StateBeside, _ReportState]", state)
            self.reporter.listed, self.reaction.state, self._has_whole = report
            run.restore((traces, beside), about.events)
        except Exception as error:
            raise kept.unreadable(error) from error
        for listener in self.listeners:
            listener.reported_before = kept.noted
        if any(one.whole for one in self.listeners) and not self._has_whole:
            lacking = "the run that wrote it kept of each event only the fields that the tree reads"
            self.sink.warn(f"{kept.path}: {lacking}: events up to event {about.events} may lack others")
        return about.offset, about.line

    def _read(self, run: TraceRun, trace: TraceSource) -> None:
        """Read all events since the last checkpoint; save and flush after each batch."""
        follow, kept, sink = self.settings.follow, self.settings.checkpoints, self.sink
        stream: LinesRead | FollowedFile | None = None
        flushed = 0
        offset, line = (0, 0) if kept is None else self._resume(run, kept)

        def keep(*, ended: bool = False) -> None:
            """Write a checkpoint if one is due, after flushing the output that precedes it.

            Events held back by `--order-by` are not saved: a resumed run reads them again. So it does
            those whose commands were not started.
            """
            nonlocal flushed
            self.reporter.pause(run)
            if kept is None or stream is None:
                return
            if not run.ended and not self.reaction.unstarted and (ended or kept.is_due(run.number)):
                sink.flush()
                file = stream.file if isinstance(stream, FollowedFile) else None
                kept.save(partial(self._state, run), run.number, stream, file, traces=run.watches, bounded=not ended)
            elif run.detected > flushed:
                sink.flush()
            flushed = run.detected

        run.begin()
        with ExitStack() as stack:
            source: Iterable[Json] | LogSource = ()
            if trace.file is not None and follow and not trace.live:
                stop = stack.enter_context(stopping())
                stream = FollowedFile(trace.file, stop=stop, changed=sink.warn, idle=keep, offset=offset, line=line)
                stack.callback(stream.close)
            elif trace.file is not None and kept is not None:
                stream = stack.enter_context(open_at(Path(trace.file), offset=offset, line=line))
            else:
                source = self._source(stack, run, trace)
            at_once = self._arrives(trace)
            live = stack.enter_context(_listening(trace, sink, keep))
            self._log = trace.log(stream or source, self.settings.plan, line + 1, live, sink if follow else None)
            seldom = not follow and (kept is None or kept.every >= _OFTEN)
            by_blocks = seldom if self._log is None else not (at_once or stream)
            self._has_whole &= not by_blocks or any(one.whole for one in self.listeners)
            given, jobs = cast("Source", self._log or stream or source), self._readers(trace)
            log = None if trace.file is None else Path(trace.file)
            for going_on in bulk.read(
                run, given, trace.name, line=line + 1, by_blocks=by_blocks, live=at_once, jobs=jobs, log=log
            ):
                if at_once:
                    sink.flush()
                keep(ended=not going_on)
                if self.progress is not None:
                    self.progress.reach(source)
            if isinstance(stream, FollowedFile) and stream.unfinished:
                sink.warn(f"{trace.name}: the last line is incomplete and was not read ({stream.unfinished} bytes)")
            if isinstance(stream, FollowedFile) and stream.goes_on:
                sink.warn(f"{trace.name}: what follows line {stream.line} was not read: the monitor was stopped")
            if self.reaction.unstarted:
                sink.warn(f"{counted(self.reaction.unstarted, 'command')} not started: the monitor was stopped")
            if self.progress is not None:
                self.progress.finish(trace.size)


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
    settings: MonitorSettings,
    traces: Sequence[TraceSource],
    jobs: int = 1,
    report: Callable[[MonitorSettings, Sink], Reporter] | None = None,
) -> int:
    """Run all traces and return the exit status; `report` replaces the reporter."""
    STOP.reset()
    gc.freeze()  # decoding triggers garbage collection often
    try:
        sizes = sum(trace.size for trace in traces)
        watched = not settings.follow and all(trace.file is not None for trace in traces)
        progress = ProgressBar(sizes) if watched and sizes else None
        sink = Sink(progress=progress)
        reporter = None if report is None else report(settings, sink)
        alone = _Run(settings, sink, progress, reporter, deliver=True, jobs=jobs)
        if jobs > 1 and len(traces) > 1:
            outcomes = list(_in_processes(alone, traces, jobs))
        else:
            outcomes = [alone.watch(trace) for trace in traces]
        rows = [row for one in outcomes for row in one.rows]
        if any(outcome.ended for outcome in outcomes):
            alone.reporter.finish(rows, alone.totals)
        if (names := "".join({one.keyless for one in outcomes})) and not rows:
            sink.report(OptionError(f"no event has the key field ({names}), so nothing was monitored"))
            return FAILED
        reaction = alone.reaction
        if settings.drawing is not None and not reaction.failed:
            if reaction.first is None:
                why = "no explanation" if reaction.count else "nothing was detected"
                sink.warn(f"{settings.drawing} is not written: {why}")
            elif reaction.count > 1:
                sink.warn(f"{settings.drawing} shows the first of {reaction.count} detections")
        return max([FAILED if reaction.failed else 0, *(outcome.status for outcome in outcomes)])
    finally:
        gc.unfreeze()


def _in_processes(alone: _Run, traces: Sequence[TraceSource], jobs: int) -> Iterator[TraceOutcome]:
    """Run traces in several processes; yield and print in the order of traces."""
    sink = alone.sink
    with TemporaryDirectory(prefix="rvaft-") as folder:

        def work(number: int) -> tuple[TraceOutcome, Totals, list[str]]:
            with (Path(folder) / str(number)).open("w", encoding="utf-8", errors="backslashreplace") as file:
                own = _Run(alone.settings, Sink(file), None, deliver=False)
                outcome = own.watch(traces[number])
                return outcome, own.totals, own.sink.errors

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
                    yield TraceOutcome(FAILED)
                    continue
                outcome, totals, errors = result
                sink.errors += errors
                sink.pass_on()
                alone.totals.merge(totals)
                alone.reaction.take(outcome)
                yield outcome
