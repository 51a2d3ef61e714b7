"""A run of `rvaft monitor` over its traces: one after the other, or several at once and told in order."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from io import BufferedIOBase
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final, cast

from rvaft.cli.detections import Commands, Drawing
from rvaft.cli.failure import FAILED, FOUND
from rvaft.cli.output import deliver
from rvaft.cli.progress import Progress
from rvaft.cli.sink import Sink
from rvaft.cli.verdicts import Reporter, Row, Shape
from rvaft.errors import RvaftError, TooLarge
from rvaft.monitoring.quick import advance, batches_for
from rvaft.monitoring.recall import Recall
from rvaft.monitoring.run import Plan, Run, events
from rvaft.monitoring.sources import LogFile, place
from rvaft.monitoring.totals import Totals
from rvaft.monitoring.watch import Listener
from rvaft.statistics import Statistics
from rvaft.values import Json

if TYPE_CHECKING:
    from rvaft.monitoring.hooks import Hooks
    from rvaft.monitoring.keeping import Keeping

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
            from rvaft.cli.lasting import last  # noqa: PLC0415 -- imported on use

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
