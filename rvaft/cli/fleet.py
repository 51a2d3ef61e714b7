"""The traces of one run of `rvaft monitor`: all of them, in this process or in several, and what is said at the end."""

import gc
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

import click

from rvaft.cli.failure import FAILED
from rvaft.cli.output import deliver
from rvaft.cli.progress import Progress
from rvaft.cli.sink import Kept, Sink, Streams
from rvaft.cli.watching import Manner, Outcome, Trace, Watching
from rvaft.monitoring.totals import Totals

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

    from rvaft.parallel import Killed, in_processes  # noqa: PLC0415 -- imported on use

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
