"""Events in groups of a kind: what can be said of all of them at once, for speed.

If no group of a batch can change the state of a run, only counts change; otherwise the run takes the
events one by one. The results do not depend on it.
"""

from collections import defaultdict, deque
from collections.abc import Collection, Hashable, Sequence
from operator import eq, itemgetter
from sys import float_info
from typing import Final, TypeAlias, TypeVar

from rvaft.core.guard_table import GuardTable
from rvaft.core.pattern_index import PatternIndex, key_at
from rvaft.model.event_time import EventTime
from rvaft.model.values import OWN_TYPES, Json, JsonObject, exact
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.monitor_set import MonitorSet
from rvaft.stream.statistics import EventKind, EventTypeIndex

FEW_VALUES: Final = 16
"""Maximum number of distinct values that are tested instead of all events."""
_NUMBERS: Final = frozenset({int, float})
"""Types whose values compare as themselves."""
_LARGEST: Final = float_info.max
H = TypeVar("H")
Groups: TypeAlias = Sequence[tuple[EventKind, "EventGroup"]]


class EventGroup:
    """Events with the same fields; columns of values are computed once."""

    __slots__ = ("_ends", "_times", "_types", "_values", "events")

    def __init__(self, events: Sequence[JsonObject]) -> None:
        self.events = events
        self._values: dict[str, list[Json]] = {}
        self._types: dict[str, set[type]] = {}
        self._ends: dict[str, Sequence[Json]] = {}
        self._times: Sequence[int | None] | None = None

    def values(self, field: str) -> list[Json]:
        """Return the values of a field."""
        found = self._values.get(field)
        if found is None:
            found = self._values[field] = [event[field] for event in self.events]
        return found

    def types(self, field: str) -> set[type]:
        """Return the types of the values."""
        found = self._types.get(field)
        if found is None:
            found = self._types[field] = set(map(type, self.values(field)))
        return found

    def times(self, time: EventTime) -> Sequence[int | None]:
        """Return the times of the events; `time` is that of the tree."""
        if self._times is None:
            self._times = time.of_all(time.written_in(self.events))
        return self._times

    def ends(self, field: str) -> Sequence[Json]:
        """Return the least and the greatest value if all are finite numbers, else ()."""
        found = self._ends.get(field)
        if found is None:
            values, types, found = self.values(field), self.types(field), ()
            if types == {int} or (types <= _NUMBERS and all(map(eq, values, values))):  # NaN is not equal to itself
                least, most = min(values), max(values)
                found = (least, most) if least >= -_LARGEST and most <= _LARGEST else ()
            self._ends[field] = found
        return found


def groups(types: EventTypeIndex, events: Sequence[JsonObject]) -> list[tuple[EventKind, EventGroup]] | None:
    """Group events by kind; None if they must be asked one by one."""
    found = by_shape(types.shapes, events)
    return None if found is None else [one for group in found for one in split(types.shapes.of(group.events[0]), group)]


def by_shape(index: PatternIndex[H], events: Sequence[JsonObject]) -> list[EventGroup] | None:
    """Group events by shape; None for unhashable values of literal fields."""
    try:
        found = _by_texts(index.texts, events)
        if index.others or not all(map(_have_the_same_fields, found)):
            shapes = defaultdict[Hashable, list[JsonObject]](list)
            for event in events:
                shapes[*event, *[key_at(event, field) for field in (*index.texts, *index.others)]].append(event)
            found = shapes.values()
    except TypeError:  # a list or an object in the field of a literal
        return None
    return list(map(EventGroup, found))


def _by_texts(fields: tuple[str, ...], events: Sequence[JsonObject]) -> Collection[Sequence[JsonObject]]:
    """Group events by number of fields and these values, without a call per event."""
    found = defaultdict[Hashable, list[JsonObject]](list)
    match fields:
        case (one,):
            for event in events:
                found[len(event), event.get(one)].append(event)
        case (one, two):
            for event in events:
                found[len(event), event.get(one), event.get(two)].append(event)
        case (one, two, three):
            for event in events:
                found[len(event), event.get(one), event.get(two), event.get(three)].append(event)
        case _:
            for event in events:
                found[len(event), *map(event.get, fields)].append(event)
    return found.values()


def _have_the_same_fields(events: Sequence[JsonObject]) -> bool:
    try:
        deque(map(itemgetter(*events[0]), events) if events[0] else (), maxlen=0)
    except KeyError:
        return False
    return True


def split(table: GuardTable[H], group: EventGroup) -> list[tuple[H, EventGroup]]:
    """Split events of one shape by the guards that hold."""
    if _has_one_entry(table, group):
        return [(table.of(group.events[0]), group)]
    found: dict[H, list[JsonObject]] = {}
    for event in group.events:
        found.setdefault(table.of(event), []).append(event)
    return [(entry, EventGroup(events)) for entry, events in found.items()]


def _has_one_entry(table: GuardTable[H], group: EventGroup) -> bool:
    """Whether a cheap test shows that the same guards hold."""
    if not table.guards:
        return True
    if table.field is None:
        return False
    few: Collection[Json] = ()
    if table.ordered:
        few = group.ends(table.field)
    if not few and group.types(table.field) in ({str}, {int}):
        few = set(group.values(table.field))
    return 0 < len(few) <= FEW_VALUES and len({table.held({table.field: value}) for value in few}) == 1


def needs_no_warning(warnings: DataWarnings, group: EventGroup, event_kind: EventKind, *, timed: bool = False) -> bool:
    """Whether events of one kind, which may all be `timed`, are known to cause no warning."""
    if event_kind.checks.looked_at == ():
        return True
    if event_kind.checks.good is None or event_kind.checks.good[:2] != (warnings, warnings.version):
        return False
    if not timed and warnings.time is not None and event_kind.entries and None in group.times(warnings.time):
        return False
    _, _, fields, known = event_kind.checks.good
    if not fields:
        return fields is not None and () in known
    if len(fields) == 1:
        return all((kind,) in known for kind in group.types(fields[0]))
    return known.issuperset(zip(*(map(type, group.values(field)) for field in fields), strict=True))


def changes_nothing(monitors: MonitorSet, group: EventGroup, event_kind: EventKind, *, keyed: bool) -> bool | None:
    """Return whether events of a kind that change nothing are relevant.

    Return None if an event may change something, or if the monitor of a key is unknown.
    """
    projects, event_class = monitors.skips_irrelevant, event_kind.classes[0]
    if not event_kind.relevant and (projects or not event_kind.serves):
        return False
    if keyed or monitors.rests:
        return None
    if projects:
        return None if monitors.live else True
    if monitors.live and monitors.live_columns != (0,):
        return None
    if not (event_class.serving or event_class.breaking):
        return False
    engine = monitors.engines[0]
    inert = engine.inert(event_class)
    if inert is None:
        return None
    for letter, fields in inert.letters:
        if fields is None:
            return None
        values = [
            group.values(field) if group.types(field) <= OWN_TYPES else [*map(exact, group.values(field))]
            for field in fields
        ]
        if not all(name in inert.known for name in zip([letter] * len(group.events), *values, strict=True)):
            return None
    return bool(engine.read(group.events[0], event_class).hits)
