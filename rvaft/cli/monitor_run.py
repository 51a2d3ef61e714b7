"""A run of `rvaft monitor` over its traces: one after the other, or several at once and told in order."""

import gc
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from io import BufferedIOBase
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, BinaryIO, Final, cast

import click

from rvaft.cli.failure import FAILED, FOUND
from rvaft.cli.monitor_output import Kept, Reporter, Row, Shape, Sink, Streams
from rvaft.errors import RvaftError, TooLarge, ToolMissing
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitoring.checkpoint import Keeping, Placed, reading
from rvaft.monitoring.event_buffer import Recall
from rvaft.monitoring.explanation_json import apart, matched_events
from rvaft.monitoring.follow import Followed, stopping
from rvaft.monitoring.monitor_set import Listener, Totals, Watch
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.reader import LogFile, place
from rvaft.monitoring.run import Plan, Run, advance, batches_for, events
from rvaft.monitors import Explanation
from rvaft.support.files import deliver
from rvaft.support.terminal import Progress

if TYPE_CHECKING:
    from rvaft.monitoring.hooks import Hooks


# What is done on detection beside saying so: commands are run, and the tree is drawn with the path that fired.

TERMINAL: Final = "-"
"""In place of a file: draw among the text."""
PICTURES: Final = ("svg", "pdf", "png")
SUFFIXES: Final = (".svg", ".dot", ".gv", ".pdf", ".png", ".txt")
"""Of the files that the path that fired is drawn to."""


@dataclass(frozen=True, slots=True)
class Detection:
    """One match that was found, the events in it that are known, and the kinds whose monitors it detected."""

    explanation: Explanation | None
    events: Mapping[int, Json]
    kinds: frozenset[Kind] = frozenset()


def detections(watch: Watch, number: int, event: Json, changed: Sequence[int]) -> Iterator[Detection]:
    """What an event detected, each match once: those of branches or kinds where these are monitored, else that of the tree."""
    fired = [column for column in changed if watch.bank.verdicts[column] is Verdict.TRUE]
    parts = [column for column in fired if column] or fired
    explanations = [watch.bank.explanation(column) for column in parts]
    if parts and not any(explanations):
        yield Detection(None, {})  # a backend does not explain
    for which, explanation in apart(explanations):
        known = watch.recall.events(matched_events([explanation]) - {number})
        wholes = [watch.bank.columns[parts[place]].part.part_of for place in which]
        kinds = frozenset(whole.kind for whole in wholes if whole is not None and whole.kind is not None)
        yield Detection(explanation, {**known, number: event}, kinds)


class Commands(Listener):
    """Runs commands on detection; `name` is that of the tree."""

    def __init__(self, hooks: "Hooks", tree: RVAFT, name: str, sink: Sink) -> None:
        self._hooks = hooks
        self._tree = tree
        self._name = name
        self._sink = sink

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Run them for what this event detected; what was printed before is seen before they start."""
        from rvaft.monitoring.hooks import detection  # noqa: PLC0415 -- imported on use

        for found in detections(watch, number, event, changed):
            with suppress(BrokenPipeError):  # that nobody reads what is printed is no reason not to run the command
                self._sink.flush()
            told = detection(
                found.explanation,
                self._tree,
                name=self._name,
                trace=watch.trace,
                event=number,
                key=watch.key,
                events=found.events,
            )
            for failure in self._hooks.run(told, found.kinds):
                self._sink.warn(str(failure))


class Drawing(Listener):
    """Draws the first detection for a file, and counts them; a failure is reported and stops nothing."""

    def __init__(self, tree: RVAFT, file: str, sink: Sink, deliver: Callable[[bytes, str], None] | None) -> None:
        self.count = 0
        self.first: bytes | None = None
        self.failed = False
        self._tree = tree
        self._file = file
        self._sink = sink
        self._deliver = deliver

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Draw what this event detected."""
        for found in detections(watch, number, event, changed):
            self.count += 1
            if self.first is None and found.explanation is not None and not self.failed:
                try:
                    self.first = drawn(self._tree, found.explanation, found.events, PurePath(self._file).suffix.lower())
                    if self._deliver is not None:
                        self._deliver(self.first, self._file)
                except (RvaftError, OSError) as error:
                    self._sink.report(error)
                    self.failed = True


def drawn(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json], suffix: str) -> bytes:
    """The tree with the path that fired, in the format of a suffix; raises `ToolMissing` and `ToolFailed`."""
    from rvaft.export import fired_dot, fired_text  # noqa: PLC0415 -- imported on use

    if suffix == ".txt":
        return fired_text(tree, explanation, events).encode()
    dot = fired_dot(tree, explanation, events)
    if suffix.removeprefix(".") not in PICTURES:
        return dot.encode()
    from rvaft.export.dot import picture  # noqa: PLC0415 -- imported on use

    return picture(dot, suffix.removeprefix("."))


def require_drawable(file: str) -> None:
    """Raise `ToolMissing` now rather than at a detection, hours from here."""
    if PurePath(file).suffix.lower().removeprefix(".") in PICTURES and shutil.which("dot") is None:
        raise ToolMissing("dot", remedy="install Graphviz (apt-get install graphviz), or name a file .dot or .txt")


_OFTEN: Final = 1 << 12
"""Events between two looks at how far a file is read."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One trace: a file, or else events that are there already or come by a stream."""

    name: str
    file: LogFile | None = None
    events: Iterable[Json] = ()
    stream: BinaryIO | None = None


@dataclass(frozen=True, slots=True)
class Manner:
    """How every trace is run: the plan, what is printed and by whom, what is done on detection."""

    plan: Plan
    shape: Shape
    reporter: Callable[[Shape, Sink], Reporter]
    tree: str
    counted: bool = True
    hooks: "Hooks | None" = None
    drawing: str | None = None
    keeping: "Keeping | None" = None
    follow: bool = False


@dataclass(slots=True)
class Outcome:
    """What a trace has come to: whether it was read to its end, and the first detection in it, where it is to be drawn."""

    status: int
    read: bool = False
    rows: list[Row] = field(default_factory=list)
    drawn: bytes | None = None
    detections: int = 0
    undrawn: bool = False
    """Whether drawing it failed, which has been reported."""


class Watching:
    """Runs traces one after the other; without `drawing` what is drawn is left to be collected."""

    def __init__(self, manner: Manner, sink: Sink, progress: Progress | None = None, *, drawing: bool = True) -> None:
        self.manner = manner
        self.sink = sink
        self.progress = progress
        self.reporter = manner.reporter(manner.shape, sink)
        self.statistics = Statistics(manner.shape.tree) if manner.counted else None
        self.drawing = None
        listeners: list[Listener] = [self.reporter]
        if manner.hooks is not None:
            listeners.append(Commands(manner.hooks, manner.shape.tree, manner.tree, sink))
        if manner.drawing is not None:
            where = deliver if drawing else None
            self.drawing = Drawing(manner.shape.tree, manner.drawing, sink, where)
            listeners.append(self.drawing)
        self.listeners = listeners

    @property
    def totals(self) -> Totals:
        """What the traces so far held."""
        return Totals() if self.statistics is None else Totals.of(self.statistics)

    def watch(self, trace: Trace) -> Outcome:
        """Run one trace; a malformed one is reported up to the fault."""
        path = None if trace.file is None else Path(trace.file.name)
        again = trace.file is not None and trace.file.regular and self.manner.plan.plain and not self.manner.follow
        recall = Recall(path if again else None, reads=self.manner.plan.reads)
        prefix = f"{trace.name}: " if self.manner.shape.several else ""
        run = Run(
            self.manner.plan, trace.name, self.listeners, recall=recall, statistics=self.statistics, prefix=prefix
        )
        before = 0 if self.drawing is None else self.drawing.count
        failed = False
        try:
            self._read(run, trace)
            run.end()
        except RvaftError as error:
            failed = True
            run.stop()
            if isinstance(error, TooLarge):
                remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
                error.add_note(f"at event {run.number} of {trace.name}{remedy}")
            self.sink.report(error)
        except OSError as error:
            if error.filename is None:  # not the trace but standard output
                raise
            failed = True
            run.stop()
            self.sink.report(error)
        for said in run.warnings:
            self.sink.warn(said if not prefix else f"{prefix}{said}")
        self.statistics = run.statistics
        rows = [Row.of(watch, failed=failed) for watch in run.watches] if self._summed else []
        outcome = Outcome(FAILED if failed else FOUND if run.found else 0, not failed, rows)
        if self.drawing is not None:
            outcome.drawn, outcome.detections = self.drawing.first, self.drawing.count - before
            outcome.undrawn = self.drawing.failed
            outcome.status = FAILED if self.drawing.failed else outcome.status
        return outcome

    @property
    def _summed(self) -> bool:
        return self.manner.shape.several or self.manner.shape.key is not None

    def _read(self, run: Run, trace: Trace) -> None:
        """Give a run all events of its trace."""
        if trace.stream is not None:
            run.begin()
            self._live(run, events(run, trace.stream, trace.name))
        elif trace.file is None:
            run.begin()
            self._live(run, events(run, trace.events, trace.name))
        elif self.manner.follow or self.manner.keeping is not None:
            last(run, self.manner, self.sink, trace.name, trace.file)
        else:
            run.begin()
            self._file(run, trace.name, trace.file)

    def _live(self, run: Run, found: Iterable[tuple[int, Json]]) -> None:
        """What comes while we watch: all that is said is seen at once."""
        for number, event in found:
            run.step(number, event)
            self.sink.flush()

    def _file(self, run: Run, name: str, file: LogFile) -> None:
        """A file, read once from its start to its end; quickly where nobody wants to see its events whole."""
        batches = None if self.manner.hooks is not None else batches_for(run)
        with file.open() as stream:
            if batches is not None and run.statistics is not None:
                steps = advance(run, batches, cast("BufferedIOBase", stream), name, run.statistics)
                often = 1
            else:
                steps = run.steps(events(run, stream, name))
                often = _OFTEN
            for count, _ in enumerate(steps, 1):
                if self.progress is not None and not count % often:
                    self.progress.reach(place(stream))
        if self.progress is not None:
            self.progress.finish(file.size)


# Files that `rvaft monitor` may leave and go on with: one that grows, and one with checkpoints.


def last(run: Run, manner: Manner, sink: Sink, name: str, file: LogFile) -> None:
    """Give a run all events of a file, from the last checkpoint on, as long as the file grows if it is followed."""
    keeping = manner.keeping
    number, offset, line = (0, 0, 0) if keeping is None else keeping.resume(run)
    run.begin()
    with ExitStack() as stack:
        stream: Placed | Followed
        if manner.follow:
            stop = stack.enter_context(stopping())
            changed = lambda change: sink.warn(str(change))  # noqa: E731
            stream = Followed(file.name, stop=stop, changed=changed, offset=offset, line=line)
            stack.callback(stream.close)
        else:
            stream = stack.enter_context(reading(Path(file.name), offset=offset, line=line))
        for number, event in events(run, cast("BinaryIO", stream), name, after=number, line=line + 1):  # noqa: B020 (it goes on from there)
            run.step(number, event)
            if manner.follow:
                sink.flush()
            if keeping is not None and not number % keeping.every:
                _keep(keeping, run, sink, number, stream)
        if keeping is not None:
            _keep(keeping, run, sink, number, stream)
        if isinstance(stream, Followed) and stream.unfinished:
            sink.warn(f"{name}: the last line has no end yet and is not read ({stream.unfinished} bytes)")


def _keep(keeping: Keeping, run: Run, sink: Sink, number: int, stream: Placed | Followed) -> None:
    """Write a checkpoint; what was printed before it would not be printed again, so it leaves us first."""
    sink.flush()
    keeping.save(run, number, stream, stream.file if isinstance(stream, Followed) else None)


# The traces of one run of `rvaft monitor`: all of them, in this process or in several, and what is said at the end.

_CHUNK: Final = 1 << 20
"""Characters that are passed on at once."""


@contextmanager
def _frozen() -> Iterator[None]:
    """Spare the garbage collector, which the decoding of events sets going, what is there already."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@_frozen()
def run(manner: Manner, traces: Sequence[Trace], jobs: int, *, failed: bool) -> int:
    """Run all traces and return the exit status; `failed` says that some of those that were asked for are not there."""
    sizes = sum(trace.file.size for trace in traces if trace.file is not None)
    watched = not manner.follow and all(trace.file is not None for trace in traces)
    progress = Progress(sizes) if watched and sizes else None
    sink = Streams(progress)
    outcomes: list[Outcome] = []
    totals = Totals()
    if jobs > 1 and len(traces) > 1:
        for outcome, held in _apart(manner, traces, jobs, sink, progress):
            if manner.drawing is not None and outcome.drawn is not None and not any(one.drawn for one in outcomes):
                try:
                    deliver(outcome.drawn, manner.drawing)
                except OSError as error:
                    sink.report(error)
                    outcome.status, outcome.undrawn = FAILED, True
            outcomes.append(outcome)
            totals.add(held)
        reporter = manner.reporter(manner.shape, sink)
    else:
        watching = Watching(manner, sink, progress)
        outcomes.extend(watching.watch(trace) for trace in traces)
        totals, reporter = watching.totals, watching.reporter
    if any(outcome.read for outcome in outcomes):
        reporter.finish([row for outcome in outcomes for row in outcome.rows], totals)
    if manner.drawing is not None and not any(outcome.undrawn for outcome in outcomes):
        count = sum(outcome.detections for outcome in outcomes)
        if not any(outcome.drawn for outcome in outcomes):
            sink.warn(f"{manner.drawing} is not written: {'no explanation' if count else 'nothing was detected'}")
        elif count > 1:
            sink.warn(f"{manner.drawing} shows the first of {count} detections")
    return max([FAILED if failed else 0, *(outcome.status for outcome in outcomes)])


def _apart(
    manner: Manner, traces: Sequence[Trace], jobs: int, sink: Sink, progress: Progress | None
) -> Iterator[tuple[Outcome, Totals]]:
    """Run traces in several processes; what each prints is passed on, complete, in the order of the traces."""
    from tempfile import TemporaryDirectory  # noqa: PLC0415 -- imported on use

    from rvaft.support.processes import Killed, in_processes  # noqa: PLC0415 -- imported on use

    with TemporaryDirectory(prefix="rvaft-") as folder:

        def work(number: int) -> tuple[Outcome, Totals, list[str]]:
            with (Path(folder) / str(number)).open("w", encoding="utf-8", errors="backslashreplace") as file:
                kept = Kept(file)
                watching = Watching(manner, kept, drawing=False)
                return watching.watch(traces[number]), watching.totals, kept.errors

        with closing(in_processes(work, range(len(traces)), jobs=min(jobs, len(traces)))) as running:
            for number, result in running:
                trace = traces[number]
                printed = Path(folder) / str(number)
                if printed.exists():
                    _pass_on(printed, sink)
                if progress is not None and trace.file is not None:
                    progress.finish(trace.file.size)
                if isinstance(result, Killed):
                    sink.report(click.ClickException(f"{trace.name}: the process that monitored it was killed"))
                    yield Outcome(FAILED), Totals()
                else:
                    outcome, totals, errors = result
                    sink.flush()
                    for line in errors:
                        click.echo(line, err=True)
                    yield outcome, totals


def _pass_on(printed: Path, sink: Sink) -> None:
    with printed.open(encoding="utf-8") as file:
        while text := file.read(_CHUNK):
            sink.write(text)
    printed.unlink()
