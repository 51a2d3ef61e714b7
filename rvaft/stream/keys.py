"""Event fields by path, keys, and the monitors of each value of a key."""

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
"""Default maximum number of values of a key."""
_ABSENT: Final = object()
_OWN_KEYS: Final = frozenset({str, int})
"""Types whose values serve as dictionary keys."""


@dataclass(frozen=True, slots=True)
class Field:
    """A field of an event by its dotted path; the whole text may also be the name of a field.

    >>> Field.parse("robot.id").of({"robot": {"id": 7}})
    (7,)
    """

    text: str
    path: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a dotted path; raises `OptionError`."""
        path = tuple(text.split("."))
        if not all(path):
            raise OptionError(f"{text!r} is not a field: write a name, or names with dots between")
        return cls(text, path)

    def of(self, event: Json) -> tuple[Json] | None:
        """Return the value in a 1-tuple (it may be null), or None if the event lacks the field."""
        if isinstance(event, Mapping) and self.text in event:
            return (event[self.text],)
        found = at(event, self.path, _ABSENT)
        return None if found is _ABSENT else (found,)


@dataclass(frozen=True, slots=True)
class Key:
    """The fields by which a log is split.

    >>> Key.parse(["user", "src"]).of({"user": "bob", "src": 1, "x": 2})
    ('bob', 1)
    """

    fields: tuple[Field, ...]

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Self:
        """Parse dotted paths; raises `OptionError`."""
        return cls(tuple(map(Field.parse, dict.fromkeys(texts))))

    def of(self, event: Json) -> tuple[Json, ...] | None:
        """Return the values, or None if the event lacks a field."""
        found = [field.of(event) for field in self.fields]
        return None if None in found else tuple(value[0] for value in found if value is not None)

    def as_json(self, values: tuple[Json, ...]) -> Json:
        """Return a single value, or an object for several fields."""
        if len(self.fields) == 1:
            return values[0]
        return {field.text: value for field, value in zip(self.fields, values, strict=True)}


class KeyedTraces:
    """The monitors of each value of a key.

    `fork` makes the monitored trace of a new value, and `begin` is called with it. `lacking` counts
    the events without a key field, which no monitor receives.
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
        self.known: dict[tuple[Json, ...], MonitoredTrace | None] = {}
        self._most = most
        self._fork = fork
        self._begin = begin
        self._traces: dict[Hashable, MonitoredTrace] = {}

    @property
    def traces(self) -> list[MonitoredTrace]:
        """The trace of each value, in order of first occurrence."""
        return list(self._traces.values())

    def restore(self, trace: MonitoredTrace, values: tuple[Json, ...]) -> None:
        """Restore the trace of these values from a checkpoint."""
        self._traces[tuple(map(value_key, values))] = trace

    def find(self, values: tuple[Json, ...]) -> MonitoredTrace | None:
        """Return the trace of these values, or None if no event had them."""
        return self._traces.get(tuple(map(value_key, values)))

    def of(self, event: JsonObject, number: int) -> MonitoredTrace | None:
        """Return the trace of an event, or None if it lacks a key field; raises `TooLarge`."""
        plain: tuple[Json, ...] = ()
        if type(event) is dict and self.names:
            plain = tuple([event.get(name) for name in self.names])
            if not _OWN_KEYS.issuperset(map(type, plain)):
                plain = ()
            elif (known := self.known.get(plain)) is not None:
                return known
        found = self.key.of(event)
        if found is None or (
            isinstance(event, NonFiniteEvent) and not is_finite(found)
        ):  # such a number equals no other
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
        """The warning about events without the key, if any."""
        if self.lacking:
            lacking = f"{counted(self.lacking)} without the field {' or '.join(one.text for one in self.key.fields)}"
            yield f"{lacking}, not monitored (first: event {self.first_lacking})"
