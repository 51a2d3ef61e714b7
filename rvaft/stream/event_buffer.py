"""The recent events of a trace, for explanations."""

from bisect import bisect_left, bisect_right
from collections import OrderedDict
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from itertools import chain, islice
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

from rvaft.core.fields_to_read import Scope
from rvaft.errors import RvaftError
from rvaft.model.values import Json
from rvaft.readers.json_lines import BLANK, decode
from rvaft.readers.log import BOM, Log, LogReader, failures_of, source_of
from rvaft.support.files import opened

BOUND: Final = 10_000


class _EventRow(NamedTuple):
    """Events in order, each after its number; `first` is that of the first, and `start` how many came in other rows.

    `lines` are those of the events after `before`, or ().
    """

    first: int
    start: int
    events: Sequence[tuple[Any, ...]]
    before: int
    lines: Sequence[int | None]

    def line(self, place: int) -> int | None:
        """Return the line of an event."""
        return self.lines[self.events[place][0] - self.before - 1] if self.lines else None


class EventBuffer:
    """The recent events of one trace by number, for explanations.

    Older events are read again from the regular file `path`, by `reader` unless it is JSON Lines;
    with `late`, only after the run. `reads` are the parts read.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        reads: Scope | None = None,
        reader: LogReader | None = None,
        late: bool = False,
    ) -> None:
        self.path = path
        self.late = late
        self.reads = reads
        self.reader = reader
        self._known: OrderedDict[int, Json] = OrderedDict()  # a dict finds its first key slowly after removals
        self._lines: dict[int, int | None] = {}
        self._rows: list[_EventRow] = []
        """Later events, in rows as they came, since few of them are ever asked for."""
        self._end = 0
        """The number of events of all rows so far."""

    def remember(self, number: int, event: Json, line: int | None = None) -> None:
        """Keep an event that may become part of a match."""
        self.known[number], self._lines[number] = event, line
        self._shorten()

    def remember_all(
        self, events: Sequence[tuple[Any, ...]], before: int = 0, lines: Sequence[int | None] = ()
    ) -> None:
        """Keep events, each after its number; the numbers follow those so far.

        `lines` are those of the events after `before`. Further values of the tuples are not read.
        """
        self._rows.append(_EventRow(events[0][0], self._end, events, before, lines))
        self._end += len(events)
        while self._rows[0].start + len(self._rows[0].events) <= self._end - BOUND:
            del self._rows[0]
        self._shorten()

    def _shorten(self) -> None:
        in_rows = self._end - self._rows[0].start if self._rows else 0
        for _ in range(min(len(self._known), len(self._known) + in_rows - BOUND)):
            self._lines.pop(self._known.popitem(last=False)[0], None)

    @property
    def known(self) -> OrderedDict[int, Json]:
        """The events that are kept, by number."""
        self._empty_rows()
        return self._known

    @property
    def lines(self) -> dict[int, int | None]:
        """The lines of the events that are kept."""
        self._empty_rows()
        return self._lines

    def _empty_rows(self) -> None:
        for row in self._rows:
            for place, (number, event, *_) in enumerate(row.events):
                self._known[number], self._lines[number] = event, row.line(place)
        self._rows.clear()
        self._shorten()

    def _find(self, number: int) -> tuple[Json, int | None] | None:
        """Return a kept event with its line."""
        if number in self._known:
            return self._known[number], self._lines.get(number)
        row = bisect_right(self._rows, number, key=attrgetter("first")) - 1
        if row < 0:
            return None
        events, start = self._rows[row].events, self._rows[row].start
        place = bisect_left(events, number, key=itemgetter(0))
        if place == len(events) or events[place][0] != number or start + place < self._end - BOUND:
            return None
        return events[place][1], self._rows[row].line(place)

    def line_of(self, number: int) -> int | None:
        """Return the line of a kept event, or of one that was read again; None if it has no line."""
        found = self._find(number)
        return self._lines.get(number) if found is None else found[1]

    def events(self, numbers: Collection[int], *, ended: bool = False) -> Mapping[int, Json]:
        """Return the available events with these numbers; `ended` after the run."""
        known = {number: found[0] for number in numbers if (found := self._find(number)) is not None}
        missing = set(numbers) - set(known) if ended or not self.late else set()
        if missing and self.path is not None and self.reader is not None:
            with suppress(RvaftError, OSError), source_of(self.reader, str(self.path)) as source:
                log = Log(self.reader, source, str(self.path), self.reads)
                for number, event in islice(enumerate(log.events(), 1), max(missing)):
                    if number in missing:
                        known[number], self._lines[number] = event, log.line_read
        elif missing and self.path is not None:
            with suppress(RvaftError, ValueError, *failures_of(str(self.path))), opened(self.path) as stream:
                first = stream.readline().removeprefix(BOM)
                lines = ((at, line) for at, line in enumerate(chain([first], stream), 1) if line.strip(BLANK))
                for number, (at, line) in enumerate(lines, 1):
                    if number in missing:
                        self._lines[number] = at
                        known[number] = decode(line.removesuffix(b"\n"), reads=self.reads)
                        if len(known) == len(numbers):
                            break
        return known
