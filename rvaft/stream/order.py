"""Time order: `Ordering` sorts events within a window, `Backwards` counts times that go back."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from heapq import heappush, heappushpop
from itertools import chain, count, islice
from math import inf
from operator import gt, itemgetter, le, lt
from typing import Final, Generic, TypeAlias, TypeVar

from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.values import Json, JsonObject, is_number
from rvaft.stream.keys import Field
from rvaft.support.wording import counted

E = TypeVar("E")
Place: TypeAlias = int | float
DEFAULT_WINDOW: Final = 1_000
_FEW: Final = 16
"""The maximum number of events that are added one by one."""
NUMBERS: Final = frozenset({int, float})
_ISO: Final = EventTime((), TimeFormat.ISO8601)


class OrderedField:
    """A field with an order: the tree's time field, else numbers or ISO 8601 times.

    The first value decides between numbers and times; values of the other type count as missing.
    Raises `OptionError` for an invalid field.
    """

    def __init__(self, field: str, time: EventTime | None = None) -> None:
        self.time = time if time is not None and ".".join(time.field) == field else None
        self.field = Field.parse(field) if self.time is None else Field(field, self.time.field)
        self.holds_times: bool | None = None
        """None before the first value."""

    def place(self, event: Json) -> Place | None:
        """Return the number or time of an event; None for Booleans and values that are not
        finite.
        """
        if self.time is not None:
            return self.time.read(event)
        plain = type(event) is dict and self.field.text in event
        value = event[self.field.text] if plain else (self.field.of(event) or (None,))[0]
        if type(value) is float and self.holds_times is False and value - value == 0:
            return value
        is_time = isinstance(value, str)
        place: Place | None = _ISO.read(value) if is_time else value if is_number(value) else None
        if place is None or place - place != 0 or self.holds_times is (not is_time):
            return None
        self.holds_times = is_time
        return place


class Ordering(OrderedField, Generic[E]):
    """A buffer that returns the event with the smallest place once it holds `window` events.

    Events with equal places keep their order. Where the window holds a whole trace in which each event
    has a place and places never rise, the last event occurred first: equal places take the reverse
    order. Sorting is
    exact if no event is more than `window` places behind its own. A later event is returned at once
    and counted as `late`. An event without a place follows the event before it, and is counted in
    `without`. Can be pickled.

    >>> ordering = Ordering("time", window=1)
    >>> [ordering.add({"time": time}) for time in (2, 1, 3)]
    [None, {'time': 1}, {'time': 2}]
    """

    def __init__(self, field: str, *, window: int = DEFAULT_WINDOW, time: EventTime | None = None) -> None:
        super().__init__(field, time)
        self.window = window
        self.late = self.without = 0
        self.first_late = self.first_without = 0
        """The first late event and the first without a place, as read."""
        self.came = 0
        self.held: list[tuple[Place, int, E]] = []
        """A heap of place, number and event."""
        self.before: Place = -inf
        self.latest: Place = -inf
        """The greatest place of an event returned."""
        self.rises = self.falls = 0
        """Steps up and down in the first window."""
        self.equal = 0
        """The number of events with equal places, of a trace that the window holds."""
        self._as_they_came = False
        """Whether held events are sorted both by place and by number."""

    def add(self, event: E) -> E | None:
        """Add the next event; return the event that is due, or None while the window is not
        full.
        """
        return self.put(self.place(event), event)

    def put(self, place: Place | None, event: E) -> E | None:
        """Add an event whose place is known."""
        if self.came <= self.window and place is not None:
            self.count_steps((place,))
        self.came += 1
        if place is None:
            place = self.before
            self.without += 1
            self.first_without = self.first_without or self.came
        elif place < self.latest:
            self.late += 1
            self.first_late = self.first_late or self.came
        self.before = place
        entry = (place, self.came, event)
        if len(self.held) < self.window:
            heappush(self.held, entry)
            return None
        # the window stays full, so a late event is returned at once
        first = heappushpop(self.held, entry)
        self.latest = max(self.latest, first[0])
        return first[2]

    def put_all(self, places: Sequence[Place | None], events: Sequence[E]) -> list[E]:
        """Add events whose places are known, and return those that are due."""
        known = [place for place in places if place is not None]
        if _FEW < len(known) == len(places) and (found := self._put_sorted(known, events)) is not None:
            return found
        self._as_they_came = False
        return [event for event in map(self.put, places, events) if event is not None]

    def _put_sorted(self, places: Sequence[Place], events: Sequence[E]) -> list[E] | None:
        """Add events in one step; return None, without an effect, if one is late."""
        held = self.held
        known = [*held, *zip(places, count(self.came + 1), events)]
        turns = max(0, len(known) - self.window)
        last = held[-1][0] if held else self.latest
        if not (self._as_they_came and places and last <= places[0] and all(map(le, places, islice(places, 1, None)))):
            known.sort(key=itemgetter(0, 1))
            numbers = [number for _, number, _ in known]
            self._as_they_came = all(map(lt, numbers, islice(numbers, 1, None)))
            # each event has to be present when it is due
            full = self.came + 1 + self.window - len(held)
            if turns and (known[0][0] < self.latest or any(map(gt, numbers[:turns], count(full)))):
                return None
        due = known[:turns]
        if self.came <= self.window:
            self.count_steps(places[: self.window + 1 - self.came])
        self.came += len(events)
        self.held = known[turns:]
        if places:
            self.before = places[-1]
        if due:
            self.latest = due[-1][0]
        return [event for _, _, event in due]

    def count_steps(self, places: Iterable[Place]) -> None:
        """Count the rises and falls of the next places."""
        before = self.before
        for place in places:
            self.rises += -inf < before < place
            self.falls += place < before
            before = place

    def rest(self) -> Iterator[E]:
        """Return the held events in order, at the end of the trace."""
        rest, self.held = sorted(self.held, key=itemgetter(0, 1)), []
        if self.came <= self.window:
            self.equal = sum(size for size in Counter(place for place, _, _ in rest).values() if size > 1)
            if self._newest_first:
                rest.sort(key=lambda one: (one[0], -one[1]))
        yield from (event for _, _, event in rest)

    @property
    def _newest_first(self) -> bool:
        return self.falls > 0 and not self.rises and not self.without and self.came <= self.window

    @property
    def warnings(self) -> Iterator[str]:
        """The warnings about late events and events without a place."""
        name = self.field.text
        cure = "the log seems to be newest first: reverse it, as with tac LOG"
        seems = self.falls > 2 * (self.rises + 1)
        if self.late:
            more = f"too late for a window of {self.window}: not reordered"
            first = f"(first: event {self.first_late} as read){f'; {cure}' if seems else ''}"
            yield f"{counted(self.late)} by the field {name} {more} {first}"
        equal = f"{counted(self.equal)} with equal values of {name}"
        if self.equal and self._newest_first:
            yield f"the log is newest first: {equal} read from last to first"
        elif self.equal and seems:
            yield f"{equal} read in the order of the log, but {cure}"
        if self.without:
            what = "a number or a time of ISO 8601"
            remedy = f"; declare other formats in the tree with `time {name} as FORMAT;`"
            if self.time is not None:
                what, remedy = f"a time as {self.time.format}", ""
            lacking = f"{counted(self.without)} without {what} in the field {name}"
            keep = f"keep{'s its' if self.without == 1 else ' their'} place after the preceding event"
            yield f"{lacking} {keep} (first: event {self.first_without} as read){remedy}"


class Backwards(OrderedField):
    """A count of the places that are smaller than the last one; can be pickled."""

    count = first = 0
    last: Place = -inf

    def see(self, number: int, event: JsonObject) -> None:
        """Read the next event; skip an event without a place."""
        place = self.place(event)
        if place is not None:
            if place < self.last:
                self.count += 1
                self.first = self.first or number
            self.last = place

    def see_all(self, events: Sequence[tuple[int, JsonObject]]) -> None:
        """Read the next events, with their numbers."""
        if self.time is None and self.holds_times is False and len(self.field.path) == 1:
            places: list[Json] = [event.get(self.field.text) for _, event in events]
            rises = NUMBERS.issuperset(map(type, places)) and all(map(le, chain((self.last,), places), places))
            if rises and places and places[-1] < inf:  # no earlier place is infinite or NaN
                self.last = places[-1]
                return
        for number, event in events:
            self.see(number, event)

    @property
    def warnings(self) -> Iterator[str]:
        """The warning about times that go back, if any."""
        if self.count:
            name = self.field.text
            goes = f"the field {name} goes back at {counted(self.count)} (first: event {self.first})"
            yield f"{goes}; put them in order with --order-by {name}"
