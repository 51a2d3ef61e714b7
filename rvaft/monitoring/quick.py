"""A log file read many lines at a time: events that fit no pattern are counted, and meet no monitor.

What is told and counted is the same as by `rvaft.monitoring.run.events`; only events in between are not told of.
"""

from collections.abc import Iterator
from io import BufferedIOBase
from typing import Final

from rvaft.engine.monitor import Engine
from rvaft.errors import RvaftError
from rvaft.fast.batches import Batches
from rvaft.monitoring.run import TIME, Run
from rvaft.reads import TreeReads
from rvaft.statistics import Statistics
from rvaft.values import Json
from rvaft.verdict import Semantics

TOPIC: Final = "topic"
"""What is told of the events of a match, beside the time."""
_NO_EVENT: Final[dict[str, Json]] = {}
"""Stands for any event that fits no pattern: where there are such, no pattern is without a literal."""


def batches_for(run: Run) -> Batches | None:
    """What reads the file of a run quickly, or None where the run has to see every event as it stands."""
    reads = run.plan.reads
    engine = isinstance(run.watch.bank.monitors[0], Engine)
    if not (engine and run.plan.plain and isinstance(reads, TreeReads)) or run.every or run.statistics is None:
        return None
    return Batches.of(reads, (TIME, TOPIC))


def advance(run: Run, batches: Batches, stream: BufferedIOBase, name: str, statistics: Statistics) -> Iterator[None]:
    """Give a run all events of a stream, and pause after every batch; raises what `rvaft.traces.read` raises."""
    watch, bank, clock, prefix = run.watch, run.watch.bank, run.clock, run.prefix
    strict, projected = (bank.semantics is one for one in (Semantics.STRICT, Semantics.PROJECTED))
    for batch in batches.read(stream, name, statistics.wants):
        number = before = run.number
        try:
            for place, event in batch.events:
                number = before + place + 1
                if strict:
                    _fill(run, number)
                    run.number = number
                if not statistics.add(event, number, prefix) and projected:
                    continue
                # What `Run.watched` does, here for very many events.
                changed = bank.step(event, number)
                if clock is not None and bank.concerned:
                    clock.see(number, event)
                if bank.serves:
                    watch.recall.remember(number, event)
                if changed:
                    run.told(watch, number, event, changed)
        except RvaftError:
            run.number = number
            raise
        for values, count in batch.others:
            statistics.pass_over(values, count)
        if strict:
            _fill(run, before + batch.count + 1)
        run.number = watch.events = before + batch.count
        yield


def _fill(run: Run, number: int) -> None:
    """Under `strict` an event that fits nothing ends a match."""
    while run.watch.bank.live and run.number + 1 < number:
        run.watched(run.number + 1, _NO_EVENT)
