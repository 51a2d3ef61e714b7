"""Event fields by path, keys, the monitors of each value of a key, and the ids of events that came."""

from collections import Counter, deque
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from math import inf
from operator import itemgetter
from typing import Final, Self, TypeAlias, cast

from rvaft.errors import OptionError, TooLarge
from rvaft.model.values import OWN_TYPES, Exact, Json, JsonObject, at, is_finite
from rvaft.model.values import key as value_key
from rvaft.readers.json_lines import NonFiniteEvent
from rvaft.stream.verdict_change import MonitoredTrace
from rvaft.support.wording import counted

MAX_KEYS: Final = 100_000
"""Default maximum number of values of a key."""
MAX_DISTINCT: Final = 100_000
"""Default number of ids that are remembered."""
_ABSENT: Final = object()
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

    If `forgets` allows it, values are forgotten instead of exceeding the maximum: those that have
    detected nothing and of which no event can matter any more, because the greatest time of all
    values is further ahead than windows and twice the lateness. `forgotten` counts them.
    """

    def __init__(
        self,
        key: Key,
        most: int,
        fork: Callable[[tuple[Json, ...]], MonitoredTrace],
        begin: Callable[[MonitoredTrace], object],
        forgets: Callable[[], bool] = lambda: False,
    ) -> None:
        self.key = key
        self.lacking = self.first_lacking = 0
        self.names = tuple(one.text for one in key.fields) if all(len(one.path) == 1 for one in key.fields) else ()
        self.known: dict[tuple[Json, ...], MonitoredTrace | None] = {}
        self._most = most
        self._fork = fork
        self._begin = begin
        self._forgets = forgets
        self.forgotten = self.early = self.first_early = 0
        self.follows_native = False
        """Whether a compiled monitor has the partial matches, and decides which values it forgets."""
        self._horizon: float = -inf
        """A time before which an event may need one of a forgotten value."""
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
            if not OWN_TYPES.issuperset(map(type, plain)):
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
                self._forget()
            if len(self._traces) >= self._most:
                what = " and ".join(field.text for field in self.key.fields)
                remedy = "raise it with --max-keys N, or name another field"
                raise TooLarge(f"different values of {what}", limit=self._most, remedy=remedy)
            trace = self._traces[name] = self._fork(found)
            self._note_early(trace, event, number)
            self._begin(trace)
        if plain:
            self.known[plain] = trace
        return trace

    def _forget(self) -> None:
        """Forget the values whose events cannot matter any more, if a tenth of them can be."""
        forgets = self._forgets()
        traces = [*self._traces.items()]
        times = [engine.latest for _, trace in traces for engine in trace.monitors.engines[:1]]
        time, known = traces[0][1].monitors.time, [one for one in times if one is not None]
        if not forgets or time is None or time.late is None or not known:
            return
        horizon = max(known) - time.late
        kept = {name: trace for name, trace in traces if trace.monitors.until >= horizon - time.late}
        if len(kept) > self._most * 9 // 10:
            return
        if (
            self.follows_native
        ):  # it has the partial matches: the values with the latest events are kept for their counts
            idle = [(one is not None, one or 0, name) for (name, _), one in zip(traces, times, strict=True)]
            idle = sorted((one for one in idle if one[2] not in kept), key=itemgetter(0, 1))
            kept |= {name: self._traces[name] for _, _, name in idle[len(idle) // 2 :]}
            kept = {name: trace for name, trace in traces if name in kept}
        self.forgotten += len(self._traces) - len(kept)
        self._horizon = max(self._horizon, horizon)
        self._traces = kept
        self.known.clear()

    def _note_early(self, trace: MonitoredTrace, event: JsonObject, number: int) -> None:
        """Count a new value whose first event may need one of a forgotten value."""
        if not self.forgotten or trace.monitors.time is None:
            return
        time = trace.monitors.time.read(event)
        if time is not None and time < self._horizon:
            self.early += 1
            self.first_early = self.first_early or number

    def note_forgotten(self, numbers: tuple[int, int, int]) -> None:
        """Replace the counts by those of a compiled monitor: keys forgotten, early ones, the first event of these."""
        self.forgotten, self.early, self.first_early = numbers
        self.follows_native = True

    @property
    def state(self) -> tuple[int, ...]:
        """What is known besides the traces, for `resume`."""
        horizon = 0 if self._horizon == -inf else int(self._horizon)
        return self.lacking, self.first_lacking, self.forgotten, self.early, self.first_early, horizon

    def resume(self, state: tuple[int, ...]) -> None:
        """Continue from a state."""
        self.lacking, self.first_lacking, self.forgotten, self.early, self.first_early, horizon = state
        self._horizon = horizon if self.forgotten else -inf

    @property
    def warnings(self) -> Iterator[str]:
        """The warnings about events without the key and about forgotten values, if any."""
        names = " and ".join(field.text for field in self.key.fields)
        if self.forgotten:
            what = "that detected nothing and whose windows had passed were forgotten"
            native = "a greater --max-keys, or a run without --native, may keep more"
            remedy = native if self.follows_native else "--max-keys N keeps more"
            yield f"{self.forgotten:,} values of {names} {what}; {remedy}"
        if self.early:
            why = "such an event may need one of a value that was forgotten"
            yield (
                f"{self.early:,} values of {names} begin with an event earlier than those of other values allow "
                f"(first: event {self.first_early}); {why}"
            )
        if self.lacking:
            lacking = f"{counted(self.lacking)} without the field {' or '.join(one.text for one in self.key.fields)}"
            yield f"{lacking}, not monitored (first: event {self.first_lacking})"


class KeyedBatch:
    """Events in order, of which many are counted for their keys at once.

    `keys` and `numbers` are those of each event. If times count, `times` are those of the events, and `latest` the
    maximum time of its key up to each. The traces of the events before the index `done` are known and counted.
    """

    def __init__(
        self,
        known: Mapping[tuple[Json, ...], MonitoredTrace | None],
        keys: Sequence[tuple[Json, ...]],
        numbers: Sequence[int],
    ) -> None:
        self.keys, self.numbers = keys, numbers
        self.times: Sequence[int | None] = ()
        self.latest: Sequence[int | None] = ()
        self.done = 0
        self._known = known
        self._traces = list(map(known.get, keys))

    def stops(self, late: Collection[int], start: int = 0) -> deque[int]:
        """Return the indices, in order, of the first events of keys that are not known, and of those at places that
        are late.
        """
        keys = self.keys
        if start:
            self._traces[start:] = map(self._known.get, keys[start:])
        stops = {at for at in late if at >= start}
        if None in self._traces[start:]:
            first = dict(zip(reversed(keys[start:]), range(len(keys) - 1, start - 1, -1), strict=True))
            stops.update(at for key, at in first.items() if key not in self._known)
        return deque(sorted(stops))

    def pass_to(self, end: int) -> Sequence[MonitoredTrace]:
        """Count the events before an index for their keys, all of which are known, and return their traces."""
        passed = self._traces[self.done : end]
        if None in passed:
            passed = [self._known[key] for key in self.keys[self.done : end]]
        self.done = end
        for trace, number in Counter(passed).items():
            assert trace is not None, "each event has a key"
            trace.events += number
        return cast("Sequence[MonitoredTrace]", passed)


DistinctState: TypeAlias = tuple[list[bytes], tuple[int, str], tuple[int, str], int, bool]
"""The remembered ids in order; how many events were skipped, and how many had no id, with the first; how many
came; and whether ids were forgotten.
"""


class DistinctEvents:
    """The ids of events, so that an event whose id came before is skipped; with a key, an id of that key.

    `most` ids are remembered, by digests. An id is a text or a finite number; an event without one is
    not skipped. `warn` is called when the first id is forgotten.

    >>> distinct = DistinctEvents(Key.parse(["id"]), None, 10)
    >>> [distinct.is_new({"id": name}) for name in (1, 2, 1.0, "1", None, None)]
    [True, True, False, True, True, True]
    """

    def __init__(self, fields: Key, key: Key | None, most: int, warn: Callable[[str], object] | None = None) -> None:
        self._fields, self._key, self._most, self._warn = fields, key, most, warn
        self._ids: dict[bytes, None] = {}
        self._order: deque[bytes] = deque()
        self._skipped, self._lacking = (0, ""), (0, "")
        self._came = 0
        self._forgets = False

    def is_new(self, event: Json, line: int | None = None) -> bool:
        """Whether no event with this id was remembered; remember it."""
        self._came += 1
        found = self._fields.of(event)
        texts = [None] if found is None else [_id_text(value) for value in found]
        if None in texts:
            self._lacking = self._counted(self._lacking, line)
            return True
        of_key = None if self._key is None else self._key.of(event)
        key = None if of_key is None else [*map(value_key, of_key)]
        name = blake2b(repr((key, texts)).encode(errors="surrogatepass"), digest_size=16).digest()
        if name in self._ids:
            self._skipped = self._counted(self._skipped, line)
            return False
        self._ids[name] = None
        self._order.append(name)
        if len(self._order) > self._most:
            del self._ids[self._order.popleft()]
            if not self._forgets and self._warn is not None:
                what = f"more than {self._most} ids in {self._name}, of which the oldest are forgotten"
                more = "an event that comes again later is monitored twice; --max-distinct allows more"
                self._warn(f"{what}: {more}")
            self._forgets = True
        return True

    def _counted(self, count: tuple[int, str], line: int | None) -> tuple[int, str]:
        number, first = count
        return number + 1, first or (f"event {self._came} as read" if line is None else f"line {line}")

    @property
    def _name(self) -> str:
        return " and ".join(field.text for field in self._fields.fields)

    @property
    def state(self) -> DistinctState:
        """The state for `restore`."""
        return [*self._order], self._skipped, self._lacking, self._came, self._forgets

    def restore(self, state: DistinctState) -> None:
        """Continue from a state."""
        order, self._skipped, self._lacking, self._came, self._forgets = state
        self._order, self._ids = deque(order), dict.fromkeys(order)

    @property
    def warnings(self) -> Iterator[str]:
        """The counts of skipped events and of events without an id, if any."""
        if self._skipped[0]:
            number, first = self._skipped
            yield f"{counted(number)} skipped, whose {self._name} came before (first: {first})"
        if self._lacking[0]:
            number, first = self._lacking
            yield f"{counted(number)} without a text or number in {self._name}, never skipped (first: {first})"


def _id_text(value: Json) -> str | None:
    """Return a text that equal texts or equal numbers have in common; None for other values."""
    if isinstance(value, str):
        return f"'{value}"
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value - value != 0:
        return None
    return repr(int(value)) if value == int(value) and not isinstance(value, Exact) else repr(value)
