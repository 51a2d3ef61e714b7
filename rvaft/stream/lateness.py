"""The times of a batch, and which of its events are late.

Values of one type and layout that never fall have times that never fall. Then an event is late only if
it is late for the events before the batch, and few times must be parsed.
"""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain, islice
from math import inf
from operator import eq, le, sub
from typing import Final, NamedTuple, TypeAlias, cast

from rvaft.model.event_time import JUMPS, NUMERIC, UNITS, EventTime, Jump, TimeFormat
from rvaft.model.values import Json
from rvaft.stream.verdict_change import MonitoredTrace

WAITING: Final = 128
"""Maximum number of batches whose times the engines are not told yet."""
MOST_WAITING: Final = 1 << 18
"""Maximum number of events of keys whose times the engines are not told yet."""
_ERROR: Final = 2.0**-48
"""More than the relative error of a difference of doubles that are rounded."""
_LAYOUT: Final = str.maketrans("123456789", "000000000")


Lines: TypeAlias = tuple[int, Sequence[int | None]]
"""The lines of the events after a number, or ()."""


class LateEvent(NamedTuple):
    """The maximum time before a late event, and its last jumps in the batch: places, and before and after each."""

    latest: int
    jumps: Sequence["PlacedJump"]


PlacedJump: TypeAlias = tuple[int, int | None, int]


class RisingTimes:
    """Times that never fall; `latest` is the maximum before them. Places count events, from 0."""

    late: Final[Mapping[int, LateEvent]] = {}

    def __init__(
        self,
        time: EventTime,
        places: Sequence[int],
        values: Sequence[Json],
        latest: int | None,
        exact: Callable[[int], Json] | None,
    ) -> None:
        self._time, self._places, self._values, self._before, self._exact = time, places, values, latest, exact
        self._known: dict[int, int | None] = {}

    @classmethod
    def of(
        cls,
        time: EventTime,
        values: Sequence[Json],
        latest: int | None,
        exact: Callable[[int], Json] | None = None,
    ) -> "RisingTimes | None":
        """Return the times of events with these values, or None if one may be late; None has no time.

        Numbers may have lost digits if `exact` returns the value of an event by its place.
        """
        places: Sequence[int] = range(len(values))
        if None in values:
            places = [place for place, value in enumerate(values) if value is not None]
            values = [values[place] for place in places]
        types = set(map(type, values))
        comparable = types in ({int}, {float}) and time.format in NUMERIC
        if types == {str} and time.format is TimeFormat.ISO8601:
            comparable = _have_one_layout(cast("Sequence[str]", values))
        if values and not (comparable and all(map(le, values, islice(values, 1, None)))):
            return None
        found = cls(time, places, values, latest, exact if types == {float} else None)
        # equal doubles may be different times
        if found._exact is not None and True in map(eq, values, islice(values, 1, None)):
            pairs = enumerate(map(eq, values, islice(values, 1, None)))
            if any((found._read(number) or 0) > (found._read(number + 1) or 0) for number, same in pairs if same):
                return None
        first = found._next(0, len(values))
        allowed = latest is None or first is None or latest - first[1] <= (time.late or 0)
        return found if allowed else None

    def _read(self, number: int) -> int | None:
        if number not in self._known:
            value = self._values[number] if self._exact is None else self._exact(self._places[number])
            self._known[number] = self._time.of(value)
        return self._known[number]

    def _next(self, start: int, end: int) -> tuple[int, int] | None:
        """Return the first readable time from `start`, with its number."""
        times = ((number, self._read(number)) for number in range(start, end))
        return next(((number, time) for number, time in times if time is not None), None)

    def latest(self, place: int, time: int | None = None) -> int | None:
        """Return the maximum time up to the event at a place, whose time is known or not."""
        if time is not None:
            return time if self._before is None or time > self._before else self._before
        last = place if type(self._places) is range else bisect_right(self._places, place) - 1
        for number in range(last, -1, -1):
            found = self._read(number)
            if found is not None:
                return found if self._before is None else max(found, self._before)
        return self._before

    @cached_property
    def jumps(self) -> list[tuple[int, int | None, int]]:
        """The last jumps of the maximum: their places, and the maximum before and after each."""
        first = self._next(0, len(self._values))
        if first is None:
            return []
        gaps = self._gaps if type(self._values[0]) is str else self._steps
        found = list(islice(gaps(*first, len(self._values) - 1), JUMPS))
        start, before = first[1], self._before
        if len(found) < JUMPS and (before is None or start - before > (self._time.late or 0)):
            found.append((self._places[first[0]], before, start))
        return found[::-1]

    def _steps(self, low: int, start: int, high: int) -> Iterator[tuple[int, int | None, int]]:
        """Yield the jumps of numbers after the number `low`, from the last; only large steps are parsed."""
        values = cast("Sequence[float]", self._values)
        size = 100 if self._time.format is TimeFormat.FILETIME else UNITS[str(self._time.format)]
        large = (self._time.late or 0) - max(abs(values[low]), abs(values[high])) * size * _ERROR - 1
        if max(map(sub, islice(values, 1, None), values), default=0) * size <= large:
            return
        for number in range(high, low, -1):
            if (values[number] - values[number - 1]) * size > large:
                earlier = self._read(number - 1)
                yield from self._gaps(number - 1, start if earlier is None else earlier, number)

    def _gaps(self, low: int, start: int, high: int) -> Iterator[tuple[int, int | None, int]]:
        """Yield the jumps after the number `low`, whose time is `start`, from the last."""
        while high > low and self._read(high) is None:
            high -= 1
        last = self._read(high)
        agenda = [(low, start, high, last)] if high > low and last is not None else []
        while agenda:
            low, start, high, end = agenda.pop()
            before = start if self._before is None else max(start, self._before)
            if end - before <= (self._time.late or 0):
                continue
            middle = self._next((low + high + 1) // 2, high) or self._next(low + 1, (low + high + 1) // 2)
            if middle is None:
                yield self._places[high], before, end
            else:
                agenda += [(low, start, *middle), (*middle, high, end)]


class MixedTimes:
    """Times in any order; the interface is that of `RisingTimes`."""

    def __init__(self, time: EventTime, values: Sequence[Json], latest: int | None) -> None:
        allowed = time.late or 0
        jumps, latest_at = list[PlacedJump](), list[int | None]()
        self.late: dict[int, LateEvent] = {}
        for place, found in enumerate(time.of_all(values)):
            if found is not None:
                if latest is None or found - latest > allowed:
                    jumps.append((place, latest, found))
                elif latest - found > allowed:
                    self.late[place] = LateEvent(latest, jumps[-JUMPS:])
                latest = found if latest is None or found > latest else latest
            latest_at.append(latest)
        self._latest = latest_at
        self.jumps = jumps[-JUMPS:]

    def latest(self, place: int, time: int | None = None) -> int | None:  # noqa: ARG002 (all are known)
        """Return the maximum time up to the event at a place."""
        return self._latest[place]


BatchLateness: TypeAlias = RisingTimes | MixedTimes


class KeyedTimes:
    """The maximum times of keys up to events, which the engines of the keys are not told yet.

    `settle` tells an engine many of them at once.
    """

    def __init__(self) -> None:
        self.greatest: float = -inf
        """The maximum time over all keys."""
        self._waiting: list[tuple[Sequence[MonitoredTrace], Sequence[int], Sequence[int | None], Lines]] = []
        """Batches of events: their traces, numbers and maximum times, and the lines after a number."""
        self._count = 0
        self._same_lines = True
        """Whether all lines are the numbers of the events."""
        self._grouped = 0
        """The number of batches whose events are in the following columns."""
        self._numbers: list[int] = []
        self._latest: list[int | None] = []
        self._places: defaultdict[MonitoredTrace, list[int]] = defaultdict(list)
        """The places of the events of each trace in the columns."""

    def rises(self, times: Sequence[int | None]) -> bool:
        """Whether these times never fall, over all keys: then no event is late."""
        if not times or None in times:
            return False
        known = cast("Sequence[int]", times)
        return all(map(le, chain((self.greatest,), known), known))

    def add(
        self, traces: Sequence[MonitoredTrace], numbers: Sequence[int], latest: Sequence[int | None], lines: Lines
    ) -> None:
        """Add events of these traces, with the maximum time of its key up to each."""
        self._waiting.append((traces, numbers, latest, lines))
        before, known = lines
        self._same_lines &= not known or known == range(before + 1, before + 1 + len(known))
        self._count += len(traces)
        if self._count > MOST_WAITING:
            self.settle()

    def latest(self, trace: MonitoredTrace) -> int | None:
        """Return the maximum time of the events of a key."""
        self._group()
        return self._latest[self._places[trace][-1]] if trace in self._places else trace.monitors.engines[0].latest

    def _group(self) -> None:
        for traces, numbers, latest, _ in self._waiting[self._grouped :]:
            for place, trace in enumerate(traces, len(self._latest)):
                self._places[trace].append(place)
            self._numbers += numbers
            self._latest += latest
        self._grouped = len(self._waiting)

    def settle(self, only: MonitoredTrace | None = None) -> None:
        """Tell the engines of all keys, or that of one, the times of their events."""
        self._group()
        line = _same_line if self._same_lines else self._line
        if only is not None:
            if only in self._places:
                only.monitors.engines[0].pass_events(self._latest, self._numbers, self._places.pop(only), line)
            return
        for trace, places in self._places.items():
            trace.monitors.engines[0].pass_events(self._latest, self._numbers, places, line)
        for some in (self._waiting, self._numbers, self._latest, self._places):
            some.clear()
        self._count = self._grouped = 0
        self._same_lines = True

    def _line(self, number: int) -> int | None:
        """Return the line of an event, or None if it is its number."""
        at = bisect_right(self._waiting, number, key=lambda batch: batch[1][0])
        before, lines = self._waiting[at - 1][3]
        found = lines[number - before - 1] if lines else None
        return None if found == number else found


def _same_line(number: int) -> None:  # noqa: ARG001 (lines are the numbers of events)
    return None


def lateness(
    time: EventTime, values: Sequence[Json], latest: int | None, exact: Callable[[int], Json] | None = None
) -> BatchLateness:
    """Return the times of events with these values; None has no time.

    Numbers may have lost digits if `exact` returns the value of an event by its place.
    """
    found = RisingTimes.of(time, values, latest, exact)
    if found is not None:
        return found
    if exact is not None:
        values = [exact(place) if type(value) is float else value for place, value in enumerate(values)]
    return MixedTimes(time, values, latest)


def numbered_jumps(jumps: Iterable[PlacedJump], before: int, lines: Sequence[int | None]) -> list[Jump]:
    """Return jumps of a batch with the numbers of their events, and the lines that differ from these."""
    found = [Jump(before + place + 1, old, new, lines[place] if lines else None) for place, old, new in jumps]
    return [one._replace(line=None) if one.line == one.number else one for one in found]


def _have_one_layout(texts: Sequence[str]) -> bool:
    """Whether texts differ in digits only, and these are no offset from UTC."""
    first = texts[0].translate(_LAYOUT)
    if first.count("-") != 2 or "+" in first or "\n" in first or not first.isascii():
        return False
    return "\n".join(texts).translate(_LAYOUT) == "\n".join([first] * len(texts))
