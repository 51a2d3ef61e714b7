"""What is done with a stream of events before they meet monitors: put in the order of a number in them, told apart by a key."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush, heappushpop
from math import inf
from typing import Final, Self

from rvaft.errors import OptionError, TraceError
from rvaft.model.values import Json, is_number, key

DEFAULT_WINDOW: Final = 1_000
"""How many events are held back unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Events that follow each other: how many, and those of them that may concern the tree, each with its place among all, from 0.

    The others fit no pattern of the tree. After the events comes the `error`, if there is one. A batch without events is the end of the trace.
    """

    count: int
    events: Sequence[tuple[int, dict[str, Json]]]
    error: TraceError | None = None


END: Final = Batch(0, ())


@dataclass(frozen=True, slots=True)
class Field:
    """A field of an event by its dotted path; one whose own name has dots is found under its whole name.

    >>> Field.parse("robot.id").of({"robot": {"id": 7}})
    (7,)
    """

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

    def number(self, event: Json) -> int | float | None:
        """The number that an event has there; a boolean or a string is none."""
        found = self.of(event)
        return found[0] if found is not None and is_number(found[0]) else None


@dataclass(frozen=True, slots=True)
class Key:
    """The fields that together say which of many an event is about.

    >>> Key.parse(["user", "src"]).of({"user": "bob", "src": 1, "x": 2})
    ('bob', 1)
    """

    fields: tuple[Field, ...]

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Self:
        """Raises `OptionError` for what is no path."""
        return cls(tuple(map(Field.parse, dict.fromkeys(texts))))

    def of(self, event: Json) -> tuple[Json, ...] | None:
        """The value of each field, or None where the event lacks one of them."""
        found = [field.of(event) for field in self.fields]
        return None if None in found else tuple(value[0] for value in found if value is not None)

    def told(self, values: tuple[Json, ...]) -> Json:
        """The key as JSON: the value of a single field, or an object with those of several."""
        if len(self.fields) == 1:
            return values[0]
        return {field.text: value for field, value in zip(self.fields, values, strict=True)}

    @staticmethod
    def name(values: tuple[Json, ...]) -> Hashable:
        """Equal for values that are equal: 1 and 1.0 are one value, `true` is another."""
        return key(values[0]) if len(values) == 1 else tuple(map(key, values))

    def __str__(self) -> str:
        return " or ".join(field.text for field in self.fields)


class Ordering:
    """Holds back up to `window` events and gives the one with the smallest number first, events with equal numbers as they came.

    The order is right wherever no event stands more than `window` places behind its own. An event that comes later than that
    is given at once, and counted as `late`. An event without a number keeps its place behind the one before it, and is counted in `without`.
    Can be pickled with the events that it holds. Raises `OptionError` for a negative window and for what is no field.

    >>> ordering = Ordering("time", window=1)
    >>> [ordering.add({"time": time}) for time in (2, 1, 3)]
    [None, {'time': 1}, {'time': 2}]
    """

    def __init__(self, field: str, *, window: int = DEFAULT_WINDOW) -> None:
        if window < 0:
            raise OptionError(f"a window of {window} events: it cannot be negative")
        self.field = Field.parse(field)
        self.window = window
        self.came = 0
        """How many events were read."""
        self.late = self.without = 0
        self.first_late = self.first_without = 0
        """The numbers of the first such events, as read."""
        self._held: list[
            tuple[int | float, int, dict[str, Json]]
        ] = []  # the number in the field, that in the trace, the event
        self._before: int | float = -inf
        self._given: int | float = -inf

    def add(self, event: dict[str, Json]) -> dict[str, Json] | None:
        """Take the next event of the trace; the event whose turn it is then, if the window is full."""
        self.came += 1
        place = self.field.number(event)
        if place is None:
            place = self._before
            self.without += 1
            self.first_without = self.first_without or self.came
        elif place < self._given:
            self.late += 1
            self.first_late = self.first_late or self.came
        self._before = place
        entry = (place, self.came, event)
        if len(self._held) < self.window:
            heappush(self._held, entry)
            return None
        # Once something was given the window stays full, so what is late is the smallest here and comes straight back.
        given = heappushpop(self._held, entry)
        self._given = max(self._given, given[0])
        return given[2]

    def rest(self) -> Iterator[dict[str, Json]]:
        """The events still held, in order: the trace has ended."""
        while self._held:
            yield heappop(self._held)[2]


class Backwards:
    """Counts how often a number is smaller than the one before, and at which event first; can be pickled."""

    def __init__(self, field: str) -> None:
        self.field = Field.parse(field)
        self.count = self.first = 0
        self._last: int | float = -inf

    def see(self, number: int, event: Json) -> None:
        """Look at the next event; one without a number in the field is passed over."""
        place = event.get(self.field.text) if type(event) is dict else None
        if type(place) is not float:  # what it mostly is
            place = self.field.number(event)
            if place is None:
                return
        if place < self._last:
            self.count += 1
            self.first = self.first or number
        self._last = place
