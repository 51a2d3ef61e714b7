"""Several logs of one recording as one log, in the order of the times of their events."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from heapq import merge
from math import inf
from operator import itemgetter
from typing import ClassVar

from rvaft.model.event_time import EventTime
from rvaft.model.values import Json
from rvaft.readers.log import Log, LogReader, source_of


class MergedReader(LogReader):
    """The events of several files, each in its own format; an event without a time follows the one before it.

    >>> from rvaft.model.event_time import TimeFormat
    >>> from rvaft.readers.registry import reader
    >>> folder = "docs/first/break_in.traces/"
    >>> files = [(f"{folder}{name}.jsonl", reader("jsonl")) for name in ("monday", "monday")]
    >>> merged = MergedReader(files, EventTime(("time",), TimeFormat.SECONDS))
    >>> [event["event"] for _, event in merged.events(Log(merged, "", "two logs"))][:3]
    ['scan', 'scan', 'heartbeat']
    """

    name: ClassVar[str] = "merged"
    unit: ClassVar[str] = "event"
    needs_file: ClassVar[bool] = True

    def __init__(self, files: Sequence[tuple[str, LogReader]], time: EventTime) -> None:
        super().__init__()
        self._files, self._time = files, time

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json] | None]]:
        """Yield the events with their numbers in the whole."""
        with ExitStack() as opened:
            streams = [self._timed(file, reader, log, opened) for file, reader in self._files]
            for number, (_, event) in enumerate(merge(*streams, key=itemgetter(0)), 1):
                yield number, event

    def _timed(
        self, file: str, reader: LogReader, log: Log, opened: ExitStack
    ) -> Iterator[tuple[float, dict[str, Json] | None]]:
        source = opened.enter_context(source_of(reader, file))
        own = replace(log, reader=reader, source=source, name=file, rejected=0, first=None)
        last: float = -inf
        for event in own.events():
            time = None if event is None else self._time.read(event)
            last = last if time is None else time
            yield last, event
        log.rejected += own.rejected
        log.first = log.first or own.first
