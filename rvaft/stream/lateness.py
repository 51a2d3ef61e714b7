"""The times of a batch in which no event is late, so that few of them must be parsed.

Values of one type and layout that never fall have times that never fall. Then an event is late only if
it is late for the events before the batch, and the parsed times are those of events that are stepped over.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import islice
from operator import le, lt, sub
from typing import Final, cast

from rvaft.model.event_time import JUMPS, NUMERIC, UNITS, EventTime, TimeFormat
from rvaft.model.values import Json

_ERROR: Final = 2.0**-48
"""More than the relative error of a difference of doubles that are rounded."""
_LAYOUT: Final = str.maketrans("123456789", "000000000")


class RisingTimes:
    """Times that never fall; `latest` is the maximum before them. Places count events, from 0."""

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
        rises = lt if exact is not None and types == {float} else le
        if values and not (comparable and all(map(rises, values, islice(values, 1, None)))):
            return None
        found = cls(time, places, values, latest, exact if types == {float} else None)
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

    def latest(self, place: int) -> int | None:
        """Return the maximum time up to the event at a place."""
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


def _have_one_layout(texts: Sequence[str]) -> bool:
    """Whether texts differ in digits only, and these are no offset from UTC."""
    first = texts[0].translate(_LAYOUT)
    if first.count("-") != 2 or "+" in first or "\n" in first or not first.isascii():
        return False
    return "\n".join(texts).translate(_LAYOUT) == "\n".join([first] * len(texts))
