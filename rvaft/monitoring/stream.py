"""Events in the order of a number in them, such as a time: put right within a window, or only watched.

A field is named by its path, as in `fields`. Numbers are compared by mathematical value; a boolean or a string is no number.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from heapq import heappop, heappush, heappushpop
from math import inf
from typing import Final, Self, TypeAlias

from rvaft.errors import OptionError
from rvaft.model.values import Json, is_number

# A field of an event by its dotted path: `robot.id` is the field `id` of the object in the field `robot`.


@dataclass(frozen=True, slots=True)
class Field:
    """Where a value stands in an event. A field whose own name has dots is found under its whole name."""

    text: str
    path: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Raises `OptionError` for what is no path."""
        path = tuple(text.split("."))
        if not all(path):
            raise OptionError(f"{text!r} is no field: write a name, or names with dots between")
        return cls(text, path)

    def of(self, event: Json) -> tuple[Json] | None:
        """The value, in a tuple since it may be null, or None where the event has none."""
        if isinstance(event, Mapping) and self.text in event:
            return (event[self.text],)
        for name in self.path:
            if not isinstance(event, Mapping) or name not in event:
                return None
            event = event[name]
        return (event,)


DEFAULT_WINDOW: Final = 1_000
"""How many events are held back unless told otherwise."""

Numbered: TypeAlias = tuple[int, Json]
"""An event after its number in the trace, from 1."""


@dataclass(slots=True)
class Late:
    """What an ordering met: events that came too late for the window, and events without a number in the field.

    `first` and `first_without` are the numbers of the first such events, None where there are none.
    """

    count: int = 0
    first: int | None = None
    without: int = 0
    first_without: int | None = None


class Ordering:
    """Holds back up to `window` events and gives the smallest first, events with equal numbers as they came.

    The order is right wherever no event stands more than `window` places behind its own. An event that comes later than that
    is given at once, and counted in `late`. An event without a number keeps its place behind the one that came before it. Can
    be pickled with the events that it holds. Raises `OptionError` for a negative window and for what is
    no field.
    """

    def __init__(self, field: str, *, window: int = DEFAULT_WINDOW, late: Late | None = None) -> None:
        if window < 0:
            raise OptionError(f"a window of {window} events: it cannot be negative")
        self.field = Field.parse(field)
        self.window = window
        self.late = Late() if late is None else late
        # The number in the field, how many came before, the number in the trace, the event: no two are compared further.
        self._held: list[tuple[int | float, int, int, Json]] = []
        self._came = 0
        self._before: int | float = -inf
        self._given: int | float = -inf

    def add(self, number: int, event: Json) -> Numbered | None:
        """Take the next event of the trace; the event whose turn it is then, if the window is full."""
        place = _number(self.field, event)
        if place is None:
            place = self._before
            self.late.without += 1
            self.late.first_without = self.late.first_without or number
        elif place < self._given:
            self.late.count += 1
            self.late.first = self.late.first or number
        self._before = place
        self._came += 1
        entry = (place, self._came, number, event)
        if len(self._held) < self.window:
            heappush(self._held, entry)
            return None
        # Once something was given the window stays full, so what is late is the smallest here and comes straight back.
        given = heappushpop(self._held, entry)
        self._given = max(self._given, given[0])
        return given[2:]

    def rest(self) -> Iterator[Numbered]:
        """The events still held, in order: the trace has ended."""
        while self._held:
            yield heappop(self._held)[2:]


def ordered(
    events: Iterable[Numbered], field: str, *, window: int = DEFAULT_WINDOW, late: Late | None = None
) -> Iterator[Numbered]:
    """The events as an `Ordering` gives them, to the last one; it raises what that raises, at once."""
    ordering = Ordering(field, window=window, late=late)
    return _ordered(events, ordering)


def _ordered(events: Iterable[Numbered], ordering: Ordering) -> Iterator[Numbered]:
    for number, event in events:
        given = ordering.add(number, event)
        if given is not None:
            yield given
    yield from ordering.rest()


class Backwards:
    """Watches a field without reordering: how often its number is smaller than the one before, and at which event first.

    Events without a number in the field are passed over. Can be pickled.
    """

    def __init__(self, field: str) -> None:
        self.field = Field.parse(field)
        self.count = 0
        self.first: int | None = None
        self._last: int | float = -inf

    def see(self, number: int, event: Json) -> bool:
        """Look at the next event; whether its number goes back."""
        place = event.get(self.field.text) if type(event) is dict else None
        if type(place) is not float:  # what it mostly is
            place = _number(self.field, event)
            if place is None:
                return False
        back = place < self._last
        self._last = place
        if back:
            self.count += 1
            self.first = self.first or number
        return back


def _number(field: Field, event: Json) -> int | float | None:
    """The number that an event has in a field, or None where it has none."""
    found = field.of(event)
    return found[0] if found is not None and is_number(found[0]) else None
