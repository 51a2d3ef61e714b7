"""Event times for generated traces: formats, schedules that satisfy a scenario, and bounds.

Conditions on time are difference bounds (`time[a] - time[b] <= c`). Bellman-Ford relaxation finds
instants that satisfy all bounds; they are then moved within their slack. Open choices, such as the
last event of a part, are random.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from itertools import chain, combinations, pairwise, product
from math import inf, nan
from random import Random
from typing import Final, TypeAlias
from zoneinfo import ZoneInfo

from rvaft.core.precedence import node_of
from rvaft.core.property import Condition, Event, Kept, Part, Property, Source, Times, Within
from rvaft.core.times import point_bounds
from rvaft.model.event_time import UNITS, TextFormat, TimeFormat
from rvaft.model.guards import (
    OPERATORS,
    Guard,
    Operation,
    Operator,
    TimePoint,
    conjuncts,
    holds,
    substitute,
    time_points,
    variables,
    walk,
)
from rvaft.model.patterns import Anything, Binding, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json

SECOND: Final = UNITS["s"]
MICROSECOND: Final = UNITS["us"]
_FILETIME: Final = -11_644_473_600 * SECOND
"""The beginning of the format `filetime`."""
TODAY: Final = 1_760_000_000 * SECOND
_STEPS: Final = 9
_UNDEFINED: Final = 0.06
"""Probability of an unreadable time, if the time does not matter."""
_FIRST, _LAST = -20_000_000_000 * SECOND, 200_000_000_000 * SECOND  # years of four digits
_SHORT = 0, 3_000_000_000 * SECOND  # years of two digits
_PAIRS: Final = 30
"""Maximum number of window events that are compared in pairs; beyond it, times increase."""

Bound: TypeAlias = tuple[int, int, int]
"""Two events by number, and the maximum of their difference in nanoseconds."""


# The field of the time.


def with_time(event: Json, field: Sequence[str], value: Json) -> Json | None:
    """Return the event with this value in its field, or None if another value is in the way.

    >>> with_time({"event": "a"}, ("header", "stamp"), 3)
    {'event': 'a', 'header': {'stamp': 3}}
    """
    if not isinstance(event, dict):
        return None
    inner = value if len(field) == 1 else with_time(event.get(field[0], {}), field[1:], value)
    return None if inner is None and len(field) > 1 else {**event, field[0]: inner}


def without_time(event: Json, field: Sequence[str]) -> Json:
    """Return the event without the field."""
    if not isinstance(event, dict) or field[0] not in event:
        return event
    if len(field) == 1:
        return {name: value for name, value in event.items() if name != field[0]}
    return {**event, field[0]: without_time(event[field[0]], field[1:])}


def standing(pattern: Pattern, field: Sequence[str]) -> Pattern | None:
    """Return the part of a pattern at the time field, or None; a pattern that is no object stands
    itself.
    """
    if not field or not isinstance(pattern, ObjectPattern):
        return pattern
    inner = next((inner for name, inner in pattern.fields if name == field[0]), None)
    return None if inner is None else standing(inner, field[1:])


TEXT_FORMATS: Final = (
    TextFormat("%Y-%m-%d %H:%M:%S.%f"),
    TextFormat("%d/%b/%Y:%I:%M:%S %p %z"),
    TextFormat("%a %b %d %H:%M:%S", 2025, "Europe/Berlin"),
    TextFormat("%Y%m%d%H%M%S.%f", zone="-03:30"),
    TextFormat("%y/%m/%d %H:%M:%S.%f"),
)
FORMATS: Final = (*TimeFormat, *TEXT_FORMATS)
"""The formats of random trees."""


def written(random: Random, form: TimeFormat | TextFormat, instant: int, *, plain: bool) -> Json:
    """Return an instant in a format, in any spelling unless `plain`; None outside of the calendar.

    A text format drops what it does not write, such as decimals.

    >>> formats = TimeFormat.ISO8601, TimeFormat.SECONDS
    >>> tuple(written(Random(0), form, 1_500_000_000, plain=True) for form in formats)
    ('1970-01-01T00:00:01.5Z', 1.5)
    """
    first, last = _SHORT if isinstance(form, TextFormat) and "%y" in form.pattern else (_FIRST, _LAST)
    if (form is TimeFormat.ISO8601 or isinstance(form, TextFormat)) and not first < instant < last:
        return None
    ways = [*_texts(random, form, instant)] if isinstance(form, TextFormat) else [*_ways(random, form, instant)]
    return ways[0] if plain else random.choice(ways)


def _ways(random: Random, form: TimeFormat, instant: int) -> Iterator[Json]:
    match form:
        case TimeFormat.ISO8601:
            yield _iso(instant)
            far = f"{random.choice('+-')}{random.randrange(24):02}:{random.randrange(60):02}"
            for offset in (far, "+02", "-0330", ""):
                yield _iso(instant, offset, random.choice("Tt "), random.choice(".,"))
            if instant % 2 == 0:  # a further half nanosecond rounds to this even value
                yield f"{_iso(instant - instant % SECOND)[:-1]}.{instant % SECOND:09}5"
            if instant % (60 * SECOND) < SECOND:
                before = _iso(instant - SECOND)
                yield f"{before[:17]}60{before[19:]}"
        case TimeFormat.ROS:
            seconds, rest = divmod(instant, SECOND)
            for names in (("sec", "nanosec"), ("secs", "nsecs")):
                yield dict(zip(names, (seconds, rest), strict=True))
            yield {"sec": seconds - 1, "nanosec": rest + SECOND}
        case _:
            size, begin = (100, _FILETIME) if form is TimeFormat.FILETIME else (UNITS[form], 0)
            instant -= begin
            digits = len(str(size)) - 1
            whole, rest = divmod(abs(instant), size)
            long = f"{'-' if instant < 0 else ''}{whole}.{str(rest).zfill(digits)[:digits]}"
            text = long.rstrip("0").rstrip(".")
            exact = Decimal(text)
            if exact == int(exact):
                yield int(exact)
            if Decimal(repr(float(text))) == exact:
                yield float(text)
            yield text
            if instant % 2 == 0 and instant > 0:  # a further half nanosecond rounds to this even value
                yield f"{long}5"
            yield f"{text}e0" if random.random() < 0.5 else f"{exact:e}".replace("e", random.choice("eE"))


def _texts(random: Random, form: TextFormat, instant: int) -> Iterator[str]:
    """Yield the spellings of an instant in a text format."""
    seconds, rest = divmod(instant, SECOND)
    utc = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    offset = re.fullmatch(r"([+-])(\d\d):(\d\d)", form.zone or "+00:00")
    if offset is None:
        clock = utc.astimezone(ZoneInfo(str(form.zone)))
    else:
        ahead = timedelta(hours=int(offset[2]), minutes=int(offset[3]))
        clock = utc + (-ahead if offset[1] == "-" else ahead)
    first: str | None = None
    for short, (shift, zone) in product((False, True), ((0, "Z"), (2, "+0200"), (-5, "-05"), (0, "z"))):
        moment = clock + timedelta(hours=shift) if "%z" in form.pattern else clock
        month, day = _MONTHS[moment.month - 1], _DAYS[moment.weekday()]
        names = {"%b": month[:3], "%B": month, "%a": day[:3], "%A": day, "%z": zone, "%%": "%"}
        names |= {"%f": f"{rest:09}", "%p": "PM" if moment.hour > 11 else "AM"}
        names |= {"%Y": f"{moment.year:04}", "%y": f"{moment.year % 100:02}"}
        numbers = {"%m": moment.month, "%d": moment.day, "%H": moment.hour, "%M": moment.minute}
        numbers |= {"%S": moment.second, "%I": moment.hour % 12 or 12}
        names |= {name: str(number) if short else f"{number:02}" for name, number in numbers.items()}
        names["%f"] = names["%f"].rstrip("0") or "0" if short else names["%f"]
        text = re.sub("%.", lambda found, names=names: names[found[0]], form.pattern)  # type: ignore[misc]
        text = text.replace(" ", " " * random.randrange(1, 3)) if short else text
        if first is None or form.read(text) == form.read(first):  # digits in a row have no short form
            yield text
        first = first or text


_MONTHS: Final[list[str]] = re.findall(
    "[A-Z][a-z]+", "January February March April May June July August September October November December"
)
_DAYS: Final[list[str]] = re.findall("[A-Z][a-z]+", "Monday Tuesday Wednesday Thursday Friday Saturday Sunday")


def _iso(instant: int, offset: str = "Z", between: str = "T", point: str = ".") -> str:
    digits = offset.strip("+-Z").replace(":", "").ljust(4, "0")
    ahead = timedelta(hours=int(digits[:2]), minutes=int(digits[2:])) * (-1 if offset.startswith("-") else 1)
    seconds, rest = divmod(instant, SECOND)
    clock = datetime(1970, 1, 1) + timedelta(seconds=seconds) + ahead
    part = f"{point}{rest:09}".rstrip("0") if rest else ""
    return f"{clock:%Y-%m-%d}{between}{clock:%H:%M:%S}{part}{offset}"


_UNREADABLE_TEXTS: Final = (
    *("", "2025-02-29 00:00:00.5", "29/Feb/2025:10:00:00 AM Z", "1/Jan/2025:13:00:00 PM Z", "20250101240000.0"),
    *("Sun Mar 30 02:30:00", "Thu Oct  9 08:53:20 ", "Thu Okt 9 08:53:20", 1_760_000_000, True),
)
_UNREADABLE_TIMES: Final[Mapping[TimeFormat, Sequence[Json]]] = {
    **dict.fromkeys(
        TimeFormat, ("", " 1", "1 s", "0x1", "01", "+1", "NaN", "2024-05-17T09:00:00Z", True, [1], {"sec": 1})
    ),
    TimeFormat.ISO8601: (
        *("2024-05-17", "2024-02-30T00:00:00Z", "2024-05-17T24:00:00Z", "2024-05-17T09:00:61Z"),
        *("17.5.2024 09:00", 1_700_000_000),
    ),
    TimeFormat.ROS: (
        *({"sec": 1}, {"sec": 1, "nsecs": 2}, {"sec": 1.0, "nanosec": 0}, {"sec": True, "nanosec": 0}),
        *(1, "1"),
    ),
}


# Conditions of a scenario.


def durations(tree: RVAFT) -> list[int]:
    """Return the durations at which a verdict can change, in nanoseconds, 0 first."""
    nodes = [*tree.top_down()]
    guards = [node.when for node in nodes if time_points(node.when)]
    found = [part.value for guard in guards for part in walk(guard) if isinstance(part, Literal)]
    late = None if tree.time is None else tree.time.late
    absences = [clause.duration for node in nodes for clause in node.without]
    every = (0, *found, *(node.within for node in nodes), *absences, late)
    return list(dict.fromkeys(one for one in every if type(one) is int))


class Schedule:
    """The times of one scenario's events, and the variables bound to them.

    `order` holds the node of each event. A variable at the time field keeps its value if a guard
    uses it; other variables there follow the time.
    """

    def __init__(
        self, random: Random, prop: Property, kept: Kept, order: Sequence[str], binding: Binding, *, plain: bool
    ) -> None:
        tree = prop.requested or prop.tree
        assert tree.time is not None
        self.random, self.tree, self.prop, self.kept = random, tree, prop, kept
        self.order, self.binding, self.plain = order, binding, plain
        timed = [part for part in kept if isinstance(part, Condition) and time_points(part.guard)]
        self._guards = [guard for part in timed for guard in conjuncts(part.guard) if time_points(guard)]
        self._windows = [part for part in kept if isinstance(part, Within)]
        timed_parts: list[Part] = [*timed, *self._windows]
        self.constrained = [*map(node_of, timed_parts)] or [*order]
        guarded = {name for node in tree.top_down() for name in variables(node.when)}
        stands = [standing(tree.pattern(name) or Anything(), tree.time.field) for name in order]
        self.free = [part is None or isinstance(part, Anything) for part in stands]
        self._following: dict[str, list[int]] = {}
        """Variables that follow the time, with their events."""
        self._fixed: dict[int, int | None] = {}
        for number, part in enumerate(stands):
            if isinstance(part, Variable) and (part.name not in guarded or part.name not in binding):
                self._following.setdefault(part.name, []).append(number)
            elif not self.free[number]:
                value = binding[part.name] if isinstance(part, Variable) else getattr(part, "value", None)
                self._fixed[number] = tree.time.read(with_time({}, tree.time.field, value))

    def times(self) -> list[int | None] | None:
        """Return a time per event, or None if the conditions are not met; irrelevant ones may be
        undefined.
        """
        bounds = [*self._bounds()]
        for first, *others in self._following.values():
            bounds += [bound for other in others for bound in ((other, first, 0), (first, other, 0))]
        needed = {event for bound in bounds for event in bound[:2]}
        found = None if any(self._fixed.get(event, 0) is None for event in needed) else self._instants(bounds)
        if found is None:
            return None
        times: list[int | None] = [*found]
        for number, free in enumerate(self.free):
            lost = not self.plain and number not in needed and free and self.random.random() < _UNDEFINED
            if lost or self._fixed.get(number, 0) is None:
                times[number] = None
        points: dict[str, Guard] = {}  # a value that is not finite represents an undefined time
        for point in chain.from_iterable(map(time_points, self._guards)):
            every = [times[event] for event in self._events(point)]
            known = [time for time in every if time is not None]
            defined = known and len(known) == len(every)
            points[point.name] = Literal((min if point.point == "start" else max)(known) if defined else nan)
        return times if all(holds(substitute(guard, points), self.binding) for guard in self._guards) else None

    def bound(self, times: Sequence[int | None]) -> Binding:
        """Return the values of the variables, including those that follow the time."""
        assert self.tree.time is not None
        found = dict(self.binding)
        for name, (first, *_) in self._following.items():
            if (time := times[first]) is not None:
                found[name] = written(self.random, self.tree.time.format, time, plain=self.plain)
        return found

    def _bounds(self) -> Iterator[Bound]:
        for guard in self._guards:
            yield from self._demanded(guard, truth=True)
        for window in self._windows:
            events = self._below(window)
            if len(events) > _PAIRS:
                yield from ((a, b, 0) for a, b in pairwise(events))
                events = [events[0], events[-1]]
            yield from ((a, b, window.duration) for a in events for b in events)
        late = None if self.tree.time is None else self.tree.time.late
        if late is not None:
            every = range(len(self.order))
            pairs, most = (pairwise(every), 0) if len(every) > _PAIRS else (combinations(every, 2), late)
            yield from ((a, b, most) for a, b in pairs)

    def _events(self, point: TimePoint) -> list[int]:
        if point.point == "at":
            return [number for number, name in enumerate(self.order) if name == point.node]
        whole = self.prop.wholes.get(Source(point.node, point.number))
        return [] if whole is None else self._below(whole)

    def _below(self, whole: Part) -> list[int]:
        below = reachable(whole, lambda part: self.kept.get(part, ()))
        names = {node_of(part) for part in below if isinstance(part, Event | Times)}
        return [number for number, name in enumerate(self.order) if name in names]

    def _demanded(self, guard: Guard, *, truth: bool) -> Iterator[Bound]:
        match guard:
            case Operation(Operator.NOT, (inner,)):
                yield from self._demanded(inner, truth=not truth)
            case Operation(Operator.AND | Operator.OR as junction, operands):
                some = operands if (junction is Operator.AND) is truth else [self.random.choice(operands)]
                for operand in some:
                    yield from self._demanded(operand, truth=truth)
            case Operation(operator, operands) if negated := OPERATORS[operator].negated:
                comparison = operator if truth else negated
                if comparison is Operator.NE and time_points(guard):
                    comparison = self.random.choice((Operator.LT, Operator.GT))
                for bound in point_bounds(Operation(comparison, operands)):
                    yield from self._at_most(*bound)
            case _:
                pass

    def _at_most(self, one: TimePoint, other: TimePoint, most: int) -> Iterator[Bound]:
        first, second = self._events(one), self._events(other)
        some = [self._either(first, 0)] if one.point == "start" else first
        others = [self._either(second, -1)] if other.point == "end" else second
        yield from ((a, b, most) for a in some for b in others)

    def _either(self, events: Sequence[int], likely: int) -> int:
        return events[likely] if self.random.random() < 0.7 else self.random.choice(events)

    def _instants(self, bounds: Sequence[Bound]) -> list[int] | None:
        """Return instants that satisfy the bounds, or None.

        Plain instants increase by some seconds if possible; others are often at or next to a bound.
        """
        random, plain, count = self.random, self.plain, len(self.order)
        fixed = {number: time for number, time in self._fixed.items() if time is not None}
        step = min([_STEPS * SECOND, *(most // (2 * count) for _, _, most in bounds if most > 0)])
        steps = steps_of(self.tree)
        required = [*bounds]
        for event, instant in fixed.items():
            required += [(event, count, instant), (count, event, -instant)]
        growing = [*required, *((a, b, 0) for a, b in pairwise(range(count)))]
        for every in (growing, required) if plain else (required,):
            now = min(fixed.values(), default=TODAY if plain else random.choice((0, TODAY, -3 * SECOND)))
            times = []
            for _ in range(count):
                times.append(now)
                if not plain:
                    now += random.choice(steps) + random.choice((0, 0, 1, SECOND))
                else:
                    now += random.randint(1, step // SECOND) * SECOND if step >= SECOND else random.randint(0, step)
            found = _lowered([*times, 0], every)
            if found is not None:
                self._move(found, every)
                return found[:-1]
        return None

    def _move(self, times: list[int], bounds: Sequence[Bound]) -> None:
        for event in range(len(self.order)):
            if self._fixed.get(event) is not None or self.random.random() < 0.5:
                continue
            most = min((times[b] + by for a, b, by in bounds if a == event), default=inf)
            least = max((times[a] - by for a, b, by in bounds if b == event), default=-inf)
            near = (least, most) if self.plain else (most, most - 1, least)
            ends = [end for end in near if isinstance(end, int) and least <= end <= most]
            ends = [end for end in ends if not self.plain or self.random.random() < 0.2]
            if ends:
                times[event] = self.random.choice(ends)


def _lowered(times: list[int], bounds: Sequence[Bound]) -> list[int] | None:
    """Return the times lowered until they satisfy all bounds; the last one stands for 0."""
    for _ in times:
        changed = False
        for a, b, most in bounds:
            if times[a] > times[b] + most:
                times[a], changed = times[b] + most, True
        if not changed:
            return [time - times[-1] for time in times]
    return None


# Times of a whole trace.


def steps_of(tree: RVAFT) -> list[int]:
    """Return steps at which a verdict can change, and adjacent ones."""
    return [step for duration in durations(tree) for step in (duration, duration + 1, duration - 1)]


def timed(random: Random, tree: RVAFT, event: Json, instant: int | None, *, plain: bool) -> Json:
    """Return the event at an instant or with an unreadable time; unchanged if its field cannot hold
    one.
    """
    assert tree.time is not None
    value: Json = None
    if instant is not None:
        value = written(random, tree.time.format, instant, plain=plain)
    else:
        event = without_time(event, tree.time.field)
        if random.random() < 0.5:
            form = tree.time.format
            value = random.choice(_UNREADABLE_TEXTS if isinstance(form, TextFormat) else _UNREADABLE_TIMES[form])
    return event if value is None else with_time(event, tree.time.field, value) or event


def walked(random: Random, tree: RVAFT, trace: Iterable[Json], *, plain: bool = False) -> list[Json]:
    """Return the events with times at critical distances.

    Some times decrease and, unless `plain`, some are missing.
    """
    if tree.time is None:
        return [*trace]
    steps, now, found = steps_of(tree), random.choice((0, TODAY)), []
    for event in trace:
        now += random.choice(steps) * random.choice((1, 1, 1, 1, -1))
        instant = None if random.random() < _UNDEFINED and not plain else now
        found.append(timed(random, tree, event, instant, plain=random.random() < 0.5 or plain))
    return found


def in_order(tree: RVAFT, trace: Iterable[Json]) -> list[Json]:
    """Return the events with increasing times near the original ones, in whole microseconds.

    A nanosecond beside a bound becomes a microsecond beside it.
    """
    if tree.time is None:
        return [*trace]
    events = [*trace]
    times = [tree.time.read(event) for event in events]
    shift = -min((time for time in times if time is not None), default=0) // SECOND * SECOND + SECOND
    now, found = -MICROSECOND, []
    for event, time in zip(events, times, strict=True):
        if time is not None:
            near = round((time + shift) / MICROSECOND)
            off = (time + shift) - near * MICROSECOND
            now = max(now, (near - 1 + (off > 0) - (off < 0)) * MICROSECOND)
        now += MICROSECOND
        found.append(timed(Random(0), tree, event, now, plain=True))  # noqa: S311 -- no secret
    return found


def apart(tree: RVAFT, trace: Sequence[Json]) -> list[Json] | None:
    """Return the events with equal times separated by a microsecond.

    None if times decrease or are not whole microseconds.
    """
    if tree.time is None:
        return [*trace]
    found: list[Json] = []
    before = now = -MICROSECOND
    for event in trace:
        time = tree.time.read(event)
        if time is None or time % MICROSECOND or time < before:
            return None
        before, moved = time, max(time, now + MICROSECOND)
        found.append(event if moved == time else timed(Random(0), tree, event, moved, plain=True))  # noqa: S311
        now = moved
    return found


def in_between(random: Random, tree: RVAFT, trace: Sequence[Json], at: int, event: Json, *, plain: bool) -> Json:
    """Return an event with a time between its neighbours, so that no event becomes late."""
    if tree.time is None:
        return event
    before, after = (
        [time for one in part if (time := tree.time.read(one)) is not None] for part in (trace[:at], trace[at:])
    )
    around = [*before[-1:], *after[:1]]
    if not around or (not plain and random.random() < _UNDEFINED):
        return event if plain else timed(random, tree, event, None, plain=plain)
    first, last = around[0], max(around)
    between = random.randint(first, last)
    if plain and last > first + SECOND:
        between -= (between - first) % SECOND
    return timed(random, tree, event, between, plain=plain)


def grown(random: Random, tree: RVAFT, trace: Sequence[Json]) -> list[Json]:
    """Return the trace with decreasing times replaced by the latest time."""
    found: list[Json] = []
    latest: int | None = None
    for event in trace:
        time = None if tree.time is None else tree.time.read(event)
        early = time is not None and latest is not None and time < latest
        found.append(timed(random, tree, event, latest, plain=True) if early else event)
        latest = latest if early or time is None else time
    return found
