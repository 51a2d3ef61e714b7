"""Time order: a window puts events in order by a field, and counts late ones; a clock counts times that go back."""

from collections.abc import Iterable, Iterator, Sequence
from heapq import heappush, heappushpop
from itertools import chain, count, islice
from math import inf
from operator import gt, le, lt
from typing import Any, Final

from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.values import Json, is_number
from rvaft.readers.json_blocks import Batch
from rvaft.stream.keys import Field

DEFAULT_WINDOW: Final = 1_000
"""How many events are held back unless told otherwise."""
_NUMBERS: Final = frozenset({int, float})
_ISO: Final = EventTime((), TimeFormat.ISO8601)
"""Reads a value that is a time itself."""


class OrderedField:
    """A field by which events are in order: by the `time` of the tree, where that is there, else by numbers or times of ISO 8601.

    Which of the two it holds the first that comes says; the other is then no place. Raises `OptionError` for what is no field.
    """

    def __init__(self, field: str, time: EventTime | None = None) -> None:
        self.time = time if time is not None and ".".join(time.field) == field else None
        self.field = Field.parse(field) if self.time is None else Field(field, self.time.field)
        self._holds: bool | None = None
        """Whether times of ISO 8601 stand there."""

    def place(self, event: Json) -> int | float | None:
        """The number or time that an event has there; a boolean is none, nor is what is not finite."""
        if self.time is not None:
            return self.time.read(event)
        plain = type(event) is dict and self.field.text in event  # mostly; asked of every event
        value = event[self.field.text] if plain else (self.field.of(event) or (None,))[0]
        if type(value) is float and self._holds is False and value - value == 0:
            return value
        is_time = isinstance(value, str)
        place: int | float | None = _ISO.read(value) if is_time else value if is_number(value) else None
        if place is None or place - place != 0 or self._holds is (not is_time):
            return None
        self._holds = is_time
        return place


def _in_places(batch: Batch, others: Sequence[Any], own: Sequence[Any]) -> list[Any]:
    """What stands for each event of a batch: one of its `own`, or for those that concern nothing one of the others."""
    if len(own) < len(others):
        found = list(others)
        for (place, _), one in zip(batch.events, own, strict=True):
            found.insert(place, one)
        return found
    found = [None] * batch.total
    for place, one in zip(chain(batch.passed, (place for place, _ in batch.events)), chain(others, own), strict=True):
        found[place] = one
    return found


class Ordering(OrderedField):
    """Holds back up to `window` events and gives the one with the smallest place first, events with equal ones as they came.

    The order is right wherever no event stands more than `window` places behind its own. An event that comes later than that
    is given at once, and counted as `late`. An event without a place stays behind the one before it, and is counted in `without`.
    Can be pickled with the events that it holds.

    >>> ordering = Ordering("time", window=1)
    >>> [ordering.add({"time": time}) for time in (2, 1, 3)]
    [None, {'time': 1}, {'time': 2}]
    """

    def __init__(self, field: str, *, window: int = DEFAULT_WINDOW, time: EventTime | None = None) -> None:
        super().__init__(field, time)
        self.window = window
        self.late = self.without = 0
        self.first_late = self.first_without = 0
        """The numbers of the first such events, as read."""
        self._came = 0
        self._held: list[tuple[int | float, int, Any]] = []
        """Events with the number in the field and that in the trace."""
        self._as_they_came = False
        """Whether those that are held are in the order of their places and of their numbers alike."""
        self._before: int | float = -inf
        self._given: int | float = -inf

    def add(self, event: dict[str, Json]) -> dict[str, Json] | None:
        """Take the next event of the trace; the event whose turn it is then, if the window is full."""
        given: dict[str, Json] | None = self._add(self.place(event), event)
        return given

    def add_all(self, batch: Batch, values: Sequence[Any], others: Sequence[Any]) -> list[Any]:
        """Take the next events of the trace; those whose turn it is then.

        Those of the batch that concern nothing have these `values` in the field, and what stands for them among the events are the `others`.
        """
        came = _in_places(batch, others, [event for _, event in batch.events])
        places: list[int | float | None]
        if self.time is None and self._holds is False and _NUMBERS.issuperset(map(type, values)):
            places = _in_places(batch, values, [self.place(event) for _, event in batch.events])
        else:  # the first of all says what the field holds
            known, name = dict(zip(batch.passed, values, strict=True)), self.field.text
            told = ({name: known[place]} if place in known else event for place, event in enumerate(came))
            places = list(map(self.place, told))
        if None not in places and (given := self._add_sorted(places, came)) is not None:
            return given
        return [event for event in map(self._add, places, came) if event is not None]

    def _add_sorted(self, places: Sequence[Any], events: Sequence[Any]) -> list[Any] | None:
        """Take events all at once, and give those whose turn it is; None, and nothing is taken, where one of them is too late."""
        known = [*self._held, *zip(places, count(self._came + 1), events)]
        turns = max(0, len(known) - self.window)
        last = self._held[-1][0] if self._held else self._given
        if not (self._as_they_came and places and last <= places[0] and all(map(le, places, islice(places, 1, None)))):
            known.sort()  # by place and number, which differ
            numbers = [number for _, number, _ in known]
            self._as_they_came = all(map(lt, numbers, islice(numbers, 1, None)))
            # Each has to be there when its turn comes: with the first event that has no room in the window, the second, and so on.
            full = self._came + 1 + self.window - len(self._held)
            if turns and (known[0][0] < self._given or any(map(gt, numbers[:turns], count(full)))):
                self._as_they_came = False
                return None
        due = known[:turns]
        self._came += len(events)
        self._held = known[turns:]
        if places:
            self._before = places[-1]
        if due:
            self._given = due[-1][0]
        return [event for _, _, event in due]

    def _add(self, place: int | float | None, event: Any) -> Any:
        self._came += 1
        self._as_they_came = False
        if place is None:
            place = self._before
            self.without += 1
            self.first_without = self.first_without or self._came
        elif place < self._given:
            self.late += 1
            self.first_late = self.first_late or self._came
        self._before = place
        entry = (place, self._came, event)
        if len(self._held) < self.window:
            heappush(self._held, entry)
            return None
        # Once something was given the window stays full, so what is late is the smallest here and comes straight back.
        given = heappushpop(self._held, entry)
        self._given = max(self._given, given[0])
        return given[2]

    def rest(self) -> Iterator[dict[str, Json]]:
        """The events still held, in order: the trace has ended."""
        rest, self._held = sorted(self._held), []
        yield from (event for _, _, event in rest)


class Backwards(OrderedField):
    """Counts how often a place is before the last one, and at which event first; can be pickled."""

    count = first = 0
    _last: int | float = -inf

    def see_all(self, events: Sequence[Json], numbers: Iterable[int]) -> None:
        """Look at the next events; they have these numbers."""
        if self.time is None and self._holds is False and len(self.field.path) == 1:
            name = self.field.text
            places: list[Any] = [event.get(name) for event in events]
            rises = _NUMBERS.issuperset(map(type, places)) and all(map(le, chain((self._last,), places), places))
            if rises and places and places[-1] < inf:  # nor is any before it infinite, or not a number
                self._last = places[-1]
                return
        for number, event in zip(numbers, events, strict=True):
            self.see(number, event)

    def see(self, number: int, event: Json) -> None:
        """Look at the next event; one without a place is passed over."""
        place = self.place(event)
        if place is not None:
            if place < self._last:
                self.count += 1
                self.first = self.first or number
            self._last = place
