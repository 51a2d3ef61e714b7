"""Files that `rvaft monitor` may leave and go on with: one that grows, and one with checkpoints."""

from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO, cast

from rvaft.cli.sink import Sink
from rvaft.cli.watching import Manner
from rvaft.monitoring.checkpoint import Placed, reading
from rvaft.monitoring.keeping import Keeping
from rvaft.monitoring.run import Run, events
from rvaft.monitoring.sources import LogFile
from rvaft.monitoring.tailing import Followed, stopping


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
