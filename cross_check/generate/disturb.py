"""Traces with something wrong in them: what happens to logs, and what tells implementations apart."""

from collections.abc import Callable, Sequence
from enum import StrEnum
from random import Random
from typing import Final, NamedTuple, TypeAlias, assert_never

from cross_check.generate.detections import ATTEMPTS, WILD, Manner, detecting, noise, some_event
from cross_check.generate.log_values import LogValues
from cross_check.generate.traces import COMMON, interesting_values
from cross_check.generate.values import around
from rvaft.engine import engine
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, equal, is_number
from rvaft.model.verdict import Semantics, Verdict

TracePlace: TypeAlias = tuple[int, tuple[str | int, ...]]
"""The index of an event, and the fields and list indices that lead to a value in it."""

_EXACT: Final = 2**53
_CARELESS: Final = 0.3


class Disturbance(StrEnum):
    """The ways in which one edit disturbs a trace."""

    EXTRA = "an extra event"
    MISSING = "a missing event"
    SWAPPED = "two events swapped"
    REPEATED = "an event repeated"
    BOUND = "a value at or next to a bound"
    TYPE = "a value of a wrong type"
    NUMBER = "1 for 1.0 or 1.0 for 1"
    OTHER = "another value at one place"
    THROUGHOUT = "another value wherever it stands"
    FIELD = "a dropped field"
    NOISE = "an event of noise"


def disturbed(random: Random, trace: list[Json], tree: RVAFT, values: Sequence[Json] = ()) -> list[Json]:
    """The trace after one edit or a few; the trace itself stays as it is. `values` are worth trying beside those of the tree."""
    for _ in range(random.choice((1, 1, 1, 2, 2, 3))):
        kinds = random.sample(list(Disturbance), len(Disturbance))
        after = (disturbed_by(kind, random, trace, tree, values) for kind in kinds)
        trace = next((edited for edited in after if edited is not None), trace)
    return trace


def disturbed_by(
    kind: Disturbance, random: Random, trace: list[Json], tree: RVAFT, values: Sequence[Json] = ()
) -> list[Json] | None:
    """The trace after one edit of a kind, different from what it was, or None where there is nothing to edit in that way."""
    index = random.randrange(len(trace)) if trace else 0
    match kind:
        case Disturbance.EXTRA:
            return _inserted(random, trace, some_event(random, tree, interesting_values(tree)))
        case Disturbance.NOISE:
            event = noise(random, tree, COMMON)
            return None if event is None else _inserted(random, trace, event)
        case Disturbance.MISSING:
            return [*trace[:index], *trace[index + 1 :]] if trace else None
        case Disturbance.REPEATED:
            again = random.choice((index, random.randint(index, len(trace) - 1))) + 1 if trace else 0
            return [*trace[:again], trace[index], *trace[again:]] if trace else None
        case Disturbance.SWAPPED:
            return _swapped(random, trace)
        case Disturbance.BOUND:
            return _bound(random, trace, tree)
        case Disturbance.TYPE:
            return _edited(
                random, trace, lambda old: [v for v in COMMON if _kind(v) is not _kind(old)] + _look_alikes(old)
            )
        case Disturbance.NUMBER:
            return _edited(random, trace, _other_number)
        case Disturbance.FIELD:
            return _without_field(random, trace)
        case Disturbance.OTHER | Disturbance.THROUGHOUT:
            every = [*interesting_values(tree), *values]
            return _other(random, trace, every, everywhere=kind is Disturbance.THROUGHOUT)
        case _:
            assert_never(kind)


def _inserted(random: Random, trace: list[Json], event: Json) -> list[Json]:
    index = random.randint(0, len(trace))
    return [*trace[:index], event, *trace[index:]]


def _swapped(random: Random, trace: list[Json]) -> list[Json] | None:
    for _ in range(10 if len(trace) > 1 else 0):
        first = random.randrange(len(trace) - 1)
        second = random.choice((first + 1, random.randrange(first + 1, len(trace))))
        if not equal(trace[first], trace[second]):
            result = list(trace)
            result[first], result[second] = result[second], result[first]
            return result
    return None


def _bound(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:
    """Bounds are the constants of the tree, the numbers of the trace, and the sums of both (`T2 >= T1 + 10`)."""
    numbers = [value for _, value in _places(trace) if is_number(value)]
    constant = random.choice([constant for constant in interesting_values(tree) if is_number(constant)])
    other = random.choice(numbers) if numbers else 0

    def near(old: Json) -> list[Json]:
        bounds = (old, other, constant, other + constant, other - constant) if is_number(old) else ()
        return [one for bound in bounds for one in around(bound) if not equal(one, old)]

    return _edited(random, trace, near)


def _edited(random: Random, trace: list[Json], instead: Callable[[Json], Sequence[Json]]) -> list[Json] | None:
    """The trace with another value at one place, one of those that the value there may become."""
    places = [(place, new) for place, old in _places(trace) if (new := instead(old))]
    if not places:
        return None
    place, new = random.choice(places)
    return _put(trace, place, random.choice(new))


def _look_alikes(value: Json) -> list[Json]:
    """What a careless comparison takes for the same value."""
    if isinstance(value, bool):
        return [int(value), str(value)]
    if is_number(value):
        return [str(value), *([bool(value)] if value in (0, 1) else [])]
    return []


def _other_number(value: Json) -> list[Json]:
    """1.0 for 1, and 1 for 1.0."""
    if not is_number(value) or abs(value) >= _EXACT or value != int(value):
        return []
    return [float(value) if isinstance(value, int) else int(value)]


def _other(random: Random, trace: list[Json], values: Sequence[Json], *, everywhere: bool) -> list[Json] | None:
    """What ties events together breaks at one place; what a condition says of all of them is broken in all of them."""
    scalars = _scalars(trace)
    if not scalars:
        return None
    place, old = random.choice(scalars)
    others = [*values, *(value for _, value in scalars), *_next_to(old)]
    return _exchanged(random, trace, place, old, others, everywhere=everywhere)


def with_constant(random: Random, trace: list[Json], constants: Sequence[Json]) -> list[Json] | None:
    """The trace with a constant of some guard, or a value next to it, in place of a value of its kind, or None without any.

    The rest stays, so that one condition is met or broken while the others hold. Now and then a value becomes one that looks like it.
    """
    alike = [(place, twin) for place, value in _scalars(trace) for twin in _look_alikes(value)]
    if alike and random.random() < _CARELESS:
        return _put(trace, *random.choice(alike))
    kinds = {_kind(constant) for constant in constants}
    places = [(place, value) for place, value in _scalars(trace) if _kind(value) in kinds]
    if not places:
        return None
    near = [value for constant in constants for value in (constant, *_next_to(constant))]
    return _exchanged(random, trace, *random.choice(places), near, everywhere=random.random() < 0.5)


def _exchanged(
    random: Random, trace: list[Json], place: TracePlace, old: Json, values: Sequence[Json], *, everywhere: bool
) -> list[Json] | None:
    """The trace with one of the values of the same kind at a place, and wherever else the old one stands."""
    others = [value for value in values if _kind(value) is _kind(old) and not equal(value, old)]
    if not others:
        return None
    new = random.choice(others)
    for other in [other for other, value in _scalars(trace) if equal(value, old)] if everywhere else [place]:
        trace = _put(trace, other, new)
    return trace


def _next_to(value: Json) -> list[Json]:
    if isinstance(value, str):
        return [value.swapcase(), f"{value}'"]
    return list(around(value)) if is_number(value) else []


def _without_field(random: Random, trace: list[Json]) -> list[Json] | None:
    places = [place for place, _ in _places(trace) if isinstance(place[1][-1], str)]
    if not places:
        return None
    index, (*above, last) = random.choice(places)
    owner = dict(trace[index] if not above else _at(trace[index], above))
    del owner[last]
    return _put(trace, (index, tuple(above)), owner)


def _kind(value: Json) -> type:
    return float if is_number(value) else type(value)


def _scalars(trace: list[Json]) -> list[tuple[TracePlace, Json]]:
    return [(place, value) for place, value in _places(trace) if not isinstance(value, (dict, list))]


def _places(trace: list[Json]) -> list[tuple[TracePlace, Json]]:
    """All values inside the events with their places, in order; an event itself is none."""
    found: list[tuple[TracePlace, Json]] = []
    for index, event in enumerate(trace):
        todo: list[tuple[tuple[str | int, ...], Json]] = [((), event)]
        while todo:
            path, value = todo.pop()
            if path:
                found.append(((index, path), value))
            inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
            todo += [((*path, step), part) for step, part in reversed(list(inner))]
    return found


def _at(event: Json, path: Sequence[str | int]) -> Json:
    for step in path:
        event = event[step]
    return event


def _put(trace: list[Json], place: TracePlace, new: Json) -> list[Json]:
    """The trace with another value at a place; only what leads there is copied."""
    index, path = place
    for depth in range(len(path) - 1, -1, -1):
        owner = _at(trace[index], path[:depth]).copy()
        owner[path[depth]] = new
        new = owner
    return [*trace[:index], new, *trace[index + 1 :]]


# Random traces that are one edit away from a detection.

_TRIES = 3
_EVERYDAY = (Disturbance.MISSING, Disturbance.SWAPPED, Disturbance.REPEATED, Disturbance.FIELD, Disturbance.BOUND)
"""What happens to logs that people believe."""


class NearMiss(NamedTuple):
    """A trace in which the tree is not detected, the detecting one it came from, and the edit that lies between."""

    trace: list[Json]
    detecting: list[Json]
    edit: Disturbance


def near_miss(
    random: Random,
    tree: RVAFT,
    semantics: Semantics = Semantics.PROJECTED,
    *,
    manner: Manner = WILD,
    longest: int | None = None,
    attempts: int = ATTEMPTS,
) -> NearMiss:
    """A near miss; raises `NoTraceFound` where no detecting trace is found, and what the monitor raises (`TooLarge`)."""
    detected = detecting(random, tree, semantics, manner=manner, longest=longest, attempts=attempts)
    kinds = _EVERYDAY if manner.believable else tuple(Disturbance)
    for kind in random.sample(kinds, len(kinds)):
        for _ in range(_TRIES):
            edited = disturbed_by(kind, random, detected, tree)
            if edited is None:
                break
            if longest is not None and len(edited) > longest:
                continue
            if manner.believable:
                if kind is Disturbance.BOUND and _leaps(detected, edited):
                    continue
                edited = LogValues(random, tree).in_time(edited)
            if not _detected(tree, semantics, edited):
                return NearMiss(edited, detected, kind)
    # The tree is detected at the last event and not before.
    return NearMiss(detected[:-1], detected, Disturbance.MISSING)


def _detected(tree: RVAFT, semantics: Semantics, trace: list[Json]) -> bool:
    return Verdict.TRUE in engine(tree, semantics).run(trace)


def _leaps(before: Sequence[Json], after: Sequence[Json]) -> bool:
    """Whether a number became one of another order, as a time that takes the bound of a size."""
    changed = (
        (old[field], event[field])
        for old, event in zip(before, after, strict=True)
        for field in old
        if is_number(old[field]) and is_number(event.get(field))
    )
    return any(abs(new - old) > max(100, abs(old)) for old, new in changed)
