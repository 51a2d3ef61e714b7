"""A run of `rvaft monitor` over its traces: who listens, one trace after the other or several at once, and what is told in the end."""

import gc
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, BinaryIO, Final, cast

import click

from rvaft.cli.failure import FAILED, FOUND
from rvaft.cli.monitor_output import OutputShape, Reporter, Sink, SummaryRow
from rvaft.errors import RvaftError, TooLarge, ToolMissing
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitoring.checkpoint import CheckpointFile, LinesRead, open_at
from rvaft.monitoring.follow import FollowedFile, stopping
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.reader import open_log
from rvaft.monitoring.run import EventBuffer, Listener, MonitoringPlan, TraceRun, VerdictChange
from rvaft.support.files import deliver
from rvaft.support.terminal import ProgressBar

if TYPE_CHECKING:
    from rvaft.monitoring.hooks import Hooks

TERMINAL: Final = "-"
"""In place of a file: draw among the text."""
PICTURES: Final = ("svg", "pdf", "png")
SUFFIXES: Final = (".svg", ".dot", ".gv", ".pdf", ".png", ".txt")
"""Of the files that the path that fired is drawn to."""
_CHUNK: Final = 1 << 20
"""Characters that are passed on at once."""


class HookRunner(Listener):
    """Runs commands on detection; `name` is that of the tree."""

    whole = True

    def __init__(self, hooks: "Hooks", shape: OutputShape, name: str, sink: Sink) -> None:
        self._hooks = hooks
        self._shape = shape
        self._name = name
        self._sink = sink

    def change(self, change: VerdictChange) -> None:
        """Run them for what this event detected; what was printed before is seen before they start."""
        from rvaft.monitoring.hooks import detection  # noqa: PLC0415 -- imported on use

        watch, key = change.watch, self._shape.key
        for found in change.detections:
            with suppress(BrokenPipeError):  # that nobody reads what is printed is no reason not to run the command
                self._sink.flush()
            told = detection(
                found,
                self._shape.tree,
                name=self._name,
                trace=watch.trace,
                event=change.number,
                key=None if key is None or watch.key is None else (key.told(watch.key),),
                again=change.number <= self.told_before,
            )
            for failure in self._hooks.run(told, found.kinds):
                self._sink.warn(str(failure))


class Drawing(Listener):
    """Draws the first detection, and counts them; with `deliver` at once, otherwise it is left to be collected.

    A failure is reported and stops nothing.
    """

    def __init__(self, tree: RVAFT, file: str, sink: Sink, deliver: Callable[[bytes, str], None] | None) -> None:
        self.count = 0
        self.first: bytes | None = None
        self.failed = False
        self._tree = tree
        self._file = file
        self._sink = sink
        self._deliver = deliver

    def change(self, change: VerdictChange) -> None:
        """Draw what this event detected, in the format of the file's suffix."""
        from rvaft.export import fired_dot, fired_text, picture  # noqa: PLC0415 -- imported on use

        form = PurePath(self._file).suffix.lower().removeprefix(".")
        for found in change.detections:
            self.count += 1
            if self.first is not None or found.explanation is None or self.failed:
                continue
            fired = self._tree, found.explanation, found.events
            try:
                if form == "txt":
                    self.first = fired_text(*fired).encode()
                else:
                    dot = fired_dot(*fired)
                    self.first = picture(dot, form) if form in PICTURES else dot.encode()
                if self._deliver is not None:
                    self._deliver(self.first, self._file)
            except (RvaftError, OSError) as error:
                self._sink.report(error)
                self.failed = True


def require_drawable(file: str) -> None:
    """Raise `ToolMissing` now rather than at a detection, hours from here."""
    if PurePath(file).suffix.lower().removeprefix(".") in PICTURES and shutil.which("dot") is None:
        raise ToolMissing("dot", remedy="install Graphviz (apt-get install graphviz), or name a file .dot or .txt")


@dataclass(frozen=True, slots=True)
class TraceSource:
    """One trace: a file, or else events that are there already or come by a stream."""

    name: str
    file: str | None = None
    events: Iterable[Json] | BinaryIO = ()

    @property
    def size(self) -> int:
        """The bytes of a regular file on the disk, else 0."""
        return Path(self.file).stat().st_size if self.file is not None and Path(self.file).is_file() else 0


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """How every trace is run: the plan, what is printed and by whom, what is done on detection."""

    plan: MonitoringPlan
    shape: OutputShape
    reporter: Callable[[OutputShape, Sink], Reporter]
    tree: str
    counted: bool = True
    hooks: "Hooks | None" = None
    drawing: str | None = None
    checkpoints: CheckpointFile | None = None
    follow: bool = False


@dataclass(slots=True)
class TraceOutcome:
    """What a trace has come to: whether it was read to its end, and the first detection in it, where it is to be drawn."""

    status: int
    read: bool = False
    rows: list[SummaryRow] = field(default_factory=list)
    drawn: bytes | None = None
    detections: int = 0
    undrawn: bool = False
    """Whether drawing it failed, which has been reported."""


class Monitoring:
    """Runs traces one after the other and adds up their statistics."""

    def __init__(
        self, settings: MonitorSettings, sink: Sink, progress: ProgressBar | None = None, *, drawing: bool = True
    ) -> None:
        self.settings = settings
        self.sink = sink
        self.progress = progress
        shape = settings.shape
        self.statistics = Statistics(settings.plan.monitors.types)
        self.reporter = settings.reporter(shape, sink)
        self.listeners: list[Listener] = [self.reporter]
        self.drawing = None
        if settings.hooks is not None:
            self.listeners.append(HookRunner(settings.hooks, shape, settings.tree, sink))
        if settings.drawing is not None:
            self.drawing = Drawing(shape.tree, settings.drawing, sink, deliver if drawing else None)
            self.listeners.append(self.drawing)

    def watch(self, trace: TraceSource) -> TraceOutcome:
        """Run one trace; a malformed one is reported up to the fault."""
        settings, drawing = self.settings, self.drawing
        again = trace.file is not None and Path(trace.file).is_file() and settings.plan.plain and not settings.follow
        buffer = EventBuffer(Path(trace.file or "") if again else None, reads=settings.plan.reads)
        prefix = f"{trace.name}: " if settings.shape.several else ""
        counts = self.statistics if settings.counted else None
        run = TraceRun(settings.plan, trace.name, self.listeners, buffer=buffer, statistics=counts, prefix=prefix)
        before = 0 if drawing is None else drawing.count
        failed = False
        try:
            self._read(run, trace)
            run.end()
        except (RvaftError, OSError) as error:
            if isinstance(error, OSError) and error.filename is None:  # not the trace but standard output
                raise
            failed = True
            run.stop()
            if isinstance(error, TooLarge):
                remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
                error.add_note(f"at event {run.number} of {trace.name}{remedy}")
            self.sink.report(error)
        for said in run.warnings:
            self.sink.warn(f"{prefix}{said}")
        self.statistics = run.statistics or self.statistics
        rows = [SummaryRow.of(watch, failed=failed) for watch in run.watches] if settings.shape.summed else []
        outcome = TraceOutcome(FAILED if failed else FOUND if run.found else 0, not failed, rows)
        if drawing is not None:
            outcome.drawn, outcome.detections = drawing.first, drawing.count - before
            outcome.undrawn = drawing.failed
            outcome.status = FAILED if drawing.failed else outcome.status
        return outcome

    def _read(self, run: TraceRun, trace: TraceSource) -> None:
        """Give a run all events of its trace, from the last checkpoint on; after each batch of them somebody may wait for something."""
        settings, sink = self.settings, self.sink
        kept = settings.checkpoints
        offset = line = 0
        if kept is not None and (found := kept.load()) is not None:
            offset, line = found.offset, found.line
            try:
                run.restore(found.state, found.events)
            except Exception as error:  # whatever somebody may have put into it
                raise kept.unreadable(error) from error
            for listener in self.listeners:
                listener.told_before = kept.noted
        elif kept is not None:
            kept.save(run.state, 0, LinesRead(BytesIO()))
        run.begin()
        with ExitStack() as stack:
            source: Iterable[Json] | BinaryIO = trace.events
            stream: LinesRead | FollowedFile | None = None
            if trace.file is not None and settings.follow:
                changed = lambda change: sink.warn(str(change))  # noqa: E731
                stop = stack.enter_context(stopping())
                idle = lambda: None if kept is None else self._keep(run, kept, stream, idle=True)  # noqa: E731
                stream = FollowedFile(trace.file, stop=stop, changed=changed, idle=idle, offset=offset, line=line)
                stack.callback(stream.close)
            elif trace.file is not None and kept is not None:
                stream = stack.enter_context(open_at(Path(trace.file), offset=offset, line=line))
            elif trace.file is not None:
                source = stack.enter_context(open_log(trace.file))
            at_once = trace.file is None or settings.follow  # what is said is seen while events come
            by_blocks = trace.file is not None and stream is None
            read = cast("BinaryIO", stream) or source
            for going_on in run.read(read, trace.name, line=line + 1, by_blocks=by_blocks):
                if at_once:
                    sink.flush()
                if kept is not None:
                    self._keep(run, kept, stream, ended=not going_on)
                if self.progress is not None:
                    self.progress.reach(source)
            if isinstance(stream, FollowedFile) and stream.unfinished:
                sink.warn(f"{trace.name}: the last line has no end yet and is not read ({stream.unfinished} bytes)")
        if self.progress is not None:
            self.progress.finish(trace.size)

    def _keep(
        self,
        run: TraceRun,
        kept: CheckpointFile,
        stream: LinesRead | FollowedFile | None,
        *,
        ended: bool = False,
        idle: bool = False,
    ) -> None:
        """Write a checkpoint where one is due; what was printed before it would not be printed again, so it leaves us first.

        Events that were held back until the end have none: they come again when the trace goes on.
        """
        assert stream is not None
        if not run.ended and (ended or kept.is_due(run.number, idle=idle)):
            self.sink.flush()
            kept.save(run.state, run.number, stream, stream.file if isinstance(stream, FollowedFile) else None)
            kept.noted = run.detected
        elif run.detected > kept.noted:
            self.sink.flush()
            kept.note(run.detected)


def run(settings: MonitorSettings, traces: Sequence[TraceSource], jobs: int, *, failed: bool) -> int:
    """Run all traces and return the exit status; `failed` says that some of those that were asked for are not there."""
    gc.freeze()  # spare the collector, which the decoding of events sets going, what is there already
    try:
        sizes = sum(trace.size for trace in traces)
        watched = not settings.follow and all(trace.file is not None for trace in traces)
        progress = ProgressBar(sizes) if watched and sizes else None
        sink = Sink(progress=progress)
        monitoring = Monitoring(settings, sink, progress)
        if jobs > 1 and len(traces) > 1:
            outcomes = list(_in_processes(monitoring, traces, jobs))
        else:
            outcomes = [monitoring.watch(trace) for trace in traces]
        if any(outcome.read for outcome in outcomes):
            monitoring.reporter.finish([row for one in outcomes for row in one.rows], monitoring.statistics)
        if settings.drawing is not None and not any(outcome.undrawn for outcome in outcomes):
            count = sum(outcome.detections for outcome in outcomes)
            if not any(outcome.drawn for outcome in outcomes):
                sink.warn(f"{settings.drawing} is not written: {'no explanation' if count else 'nothing was detected'}")
            elif count > 1:
                sink.warn(f"{settings.drawing} shows the first of {count} detections")
        return max([FAILED if failed else 0, *(outcome.status for outcome in outcomes)])
    finally:
        gc.unfreeze()


def _in_processes(monitoring: Monitoring, traces: Sequence[TraceSource], jobs: int) -> Iterator[TraceOutcome]:
    """Run traces in several processes; what each prints is passed on, complete, in the order of the traces."""
    from tempfile import TemporaryDirectory  # noqa: PLC0415 -- imported on use

    from rvaft.support.processes import Killed, in_processes  # noqa: PLC0415 -- imported on use

    settings, sink = monitoring.settings, monitoring.sink
    to_draw = settings.drawing is not None
    with TemporaryDirectory(prefix="rvaft-") as folder:

        def work(number: int) -> tuple[TraceOutcome, Statistics, list[str]]:
            with (Path(folder) / str(number)).open("w", encoding="utf-8", errors="backslashreplace") as file:
                own = Monitoring(settings, Sink(file), drawing=False)
                return own.watch(traces[number]), own.statistics, own.sink.errors

        with closing(in_processes(work, range(len(traces)), jobs=min(jobs, len(traces)))) as running:
            for number, result in running:
                printed = Path(folder) / str(number)
                if printed.exists():
                    with printed.open(encoding="utf-8") as file:
                        while text := file.read(_CHUNK):
                            sink.write(text)
                    printed.unlink()
                if monitoring.progress is not None:
                    monitoring.progress.finish(traces[number].size)
                if isinstance(result, Killed):
                    sink.report(
                        click.ClickException(f"{traces[number].name}: the process that monitored it was killed")
                    )
                    yield TraceOutcome(FAILED)
                    continue
                outcome, statistics, errors = result
                sink.flush()
                for line in errors:
                    click.echo(line, err=True)
                monitoring.statistics.merge(statistics)
                if to_draw and outcome.drawn is not None and settings.drawing is not None:
                    to_draw = False
                    try:
                        deliver(outcome.drawn, settings.drawing)
                    except OSError as error:
                        sink.report(error)
                        outcome.status, outcome.undrawn = FAILED, True
                yield outcome
