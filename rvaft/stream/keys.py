"""Fields of events by their paths; keys, whose values say which of many an event is about; and the
monitors of each key.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Self

from rvaft.errors import OptionError, TooLarge
from rvaft.model.values import Json, JsonObject, at, is_finite
from rvaft.model.values import key as value_key
from rvaft.readers.json_lines import NonFiniteEvent
from rvaft.stream.detection import counted
from rvaft.stream.listeners import MonitoredTrace

MAX_KEYS: Final = 100_000
"""How many values of a key have monitors unless told otherwise."""
_ABSENT: Final = object()
_OWN_KEYS: Final = frozenset({str, int})
"""Types of values that are their own keys, and that equal no value of another type but a double."""


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
        found = at(event, self.path, _ABSENT)
        return None if found is _ABSENT else (found,)


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

    def as_json(self, values: tuple[Json, ...]) -> Json:
        """The key as JSON: the value of a single field, or an object with those of several."""
        if len(self.fields) == 1:
            return values[0]
        return {field.text: value for field, value in zip(self.fields, values, strict=True)}


class KeyedTraces:
    """The monitors of each value of a key.

    `fork` makes the monitored trace of a new value and `begin` is called with it. An event that
    lacks a field of the key has no monitors: `lacking` counts such events, and `first_lacking` is
    the number of the first.
    """

    def __init__(
        self,
        key: Key,
        most: int,
        fork: Callable[[tuple[Json, ...]], MonitoredTrace],
        begin: Callable[[MonitoredTrace], object],
    ) -> None:
        self.key = key
        self.lacking = self.first_lacking = 0
        self.names = tuple(one.text for one in key.fields) if all(len(one.path) == 1 for one in key.fields) else ()
        """The fields of the key, if none is nested."""
        self.known: dict[tuple[Json, ...], MonitoredTrace | None] = {}
        """The traces by the values that events have in the fields of the key, if these values are their own keys."""
        self._most = most
        self._fork = fork
        self._begin = begin
        self._traces: dict[Hashable, MonitoredTrace] = {}

    @property
    def traces(self) -> list[MonitoredTrace]:
        """The trace of each value, in the order in which the values came."""
        return list(self._traces.values())

    def restore(self, trace: MonitoredTrace, values: tuple[Json, ...]) -> None:
        """Take over the trace of these values from a checkpoint."""
        self._traces[tuple(map(value_key, values))] = trace

    def find(self, values: tuple[Json, ...]) -> MonitoredTrace | None:
        """The trace of these values, or None if no event had them yet."""
        return self._traces.get(tuple(map(value_key, values)))

    def of(self, event: JsonObject, number: int) -> MonitoredTrace | None:
        """The trace that an event belongs to, or None if it lacks a field of the key.

        Raises `TooLarge` for too many values.
        """
        plain: tuple[Json, ...] = ()
        if type(event) is dict and self.names:  # mostly; asked of every event
            plain = tuple([event.get(name) for name in self.names])
            if not _OWN_KEYS.issuperset(map(type, plain)):
                plain = ()
            elif (known := self.known.get(plain)) is not None:
                return known
        found = self.key.of(event)
        if found is None or (isinstance(event, NonFiniteEvent) and not is_finite(found)):  # that equals no other value
            self.lacking += 1
            self.first_lacking = self.first_lacking or number
            return None
        name = tuple(map(value_key, found))  # 1 and 1.0 are one value, `true` is another
        trace = self._traces.get(name)
        if trace is None:
            if len(self._traces) >= self._most:
                what = " and ".join(field.text for field in self.key.fields)
                remedy = "raise it with --max-keys N, or name another field"
                raise TooLarge(f"different values of {what}", limit=self._most, remedy=remedy)
            trace = self._traces[name] = self._fork(found)
            self._begin(trace)
        if plain:
            self.known[plain] = trace
        return trace

    @property
    def warnings(self) -> Iterator[str]:
        """The warning about events without the key, if there are any."""
        if self.lacking:
            lacking = f"{counted(self.lacking)} without the field {' or '.join(one.text for one in self.key.fields)}"
            yield f"{lacking}, given to no monitor (first: event {self.first_lacking})"
