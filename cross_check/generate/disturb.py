"""Traces with something wrong in them: what happens to logs, and what tells implementations apart."""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from random import Random
from typing import Final, NamedTuple, TypeAlias

from cross_check.generate.believable import Look
from cross_check.generate.detections import ATTEMPTS, WILD, Manner, detecting, noise, some_event
from cross_check.generate.traces import COMMON, interesting_values
from cross_check.generate.values import around
from rvaft.engine import engine
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, equal, is_number
from rvaft.model.verdict import Semantics, Verdict

Place: TypeAlias = tuple[int, tuple[str | int, ...]]
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
    if kind in (Disturbance.OTHER, Disturbance.THROUGHOUT):
        return _other(random, trace, [*interesting_values(tree), *values], everywhere=kind is Disturbance.THROUGHOUT)
    return _EDITS[kind](random, trace, tree)


# -- whole events -------------------------------------------------------------------------------------------------


def _extra(random: Random, trace: list[Json], tree: RVAFT) -> list[Json]:
    return _with(random, trace, some_event(random, tree, interesting_values(tree)))


def _noise(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:
    event = noise(random, tree, COMMON)
    return None if event is None else _with(random, trace, event)


def _with(random: Random, trace: list[Json], event: Json) -> list[Json]:
    index = random.randint(0, len(trace))
    return [*trace[:index], event, *trace[index:]]


def _missing(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:  # noqa: ARG001
    if not trace:
        return None
    index = random.randrange(len(trace))
    return [*trace[:index], *trace[index + 1 :]]


def _swapped(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:  # noqa: ARG001
    for _ in range(10):
        if len(trace) > 1:
            first = random.randrange(len(trace) - 1)
            second = random.choice((first + 1, random.randrange(first + 1, len(trace))))
            if not equal(trace[first], trace[second]):
                result = list(trace)
                result[first], result[second] = result[second], result[first]
                return result
    return None


def _repeated(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:  # noqa: ARG001
    if not trace:
        return None
    index = random.randrange(len(trace))
    again = random.choice((index, random.randint(index, len(trace) - 1))) + 1
    return [*trace[:again], trace[index], *trace[again:]]


# -- values in events ---------------------------------------------------------------------------------------------


def _bound(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:
    """Bounds are the constants of the tree, the numbers of the trace, and the sums of both (`T2 >= T1 + 10`)."""
    numbers = [place for place in _places(trace) if is_number(_at(trace, place))]
    if not numbers:
        return None
    place = random.choice(numbers)
    old = _at(trace, place)
    constants = [constant for constant in interesting_values(tree) if is_number(constant)]
    other, constant = _at(trace, random.choice(numbers)), random.choice(constants)
    bounds = (old, other, constant, other + constant, other - constant)
    new = [near for bound in bounds for near in around(bound) if not equal(near, old)]
    return _put(trace, place, random.choice(new)) if new else None


def _type(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:  # noqa: ARG001
    places = _places(trace)
    if not places:
        return None
    place = random.choice(places)
    old = _at(trace, place)
    others: list[Json] = [value for value in COMMON if _kind(value) is not _kind(old)]
    return _put(trace, place, random.choice([*others, *_look_alikes(old)]))


def _look_alikes(value: Json) -> list[Json]:
    """What a careless comparison takes for the same value."""
    if isinstance(value, bool):
        return [int(value), str(value)]
    if is_number(value):
        return [str(value), *([bool(value)] if value in (0, 1) else [])]
    return []


def _other(random: Random, trace: list[Json], values: Sequence[Json], *, everywhere: bool) -> list[Json] | None:
    """What ties events together breaks at one place; what a condition says of all of them is broken in all of them."""
    places = _scalars(trace)
    if not places:
        return None
    old = _at(trace, place := random.choice(places))
    others = [*values, *(_at(trace, other) for other in places), *_next_to(old)]
    return _exchanged(random, trace, place, others, everywhere=everywhere)


def with_constant(random: Random, trace: list[Json], constants: Sequence[Json]) -> list[Json] | None:
    """The trace with a constant of some guard, or a value next to it, in place of a value of its kind, or None without any.

    The rest stays, so that one condition is met or broken while the others hold. Now and then a value becomes one that looks like it.
    """
    alike = [(place, twin) for place in _scalars(trace) for twin in _look_alikes(_at(trace, place))]
    if alike and random.random() < _CARELESS:
        return _put(trace, *random.choice(alike))
    kinds = {_kind(constant) for constant in constants}
    places = [place for place in _scalars(trace) if _kind(_at(trace, place)) in kinds]
    if not places:
        return None
    near = [value for constant in constants for value in (constant, *_next_to(constant))]
    return _exchanged(random, trace, random.choice(places), near, everywhere=random.random() < 0.5)


def _exchanged(
    random: Random, trace: list[Json], place: Place, values: Sequence[Json], *, everywhere: bool
) -> list[Json] | None:
    """The trace with one of the values of the same kind at a place, and wherever else the old one stands."""
    old = _at(trace, place)
    others = [value for value in values if _kind(value) is _kind(old) and not equal(value, old)]
    if not others:
        return None
    new = random.choice(others)
    for other in _scalars(trace) if everywhere else [place]:
        if equal(_at(trace, other), old):
            trace = _put(trace, other, new)
    return trace


def _scalars(trace: list[Json]) -> list[Place]:
    return [place for place in _places(trace) if not isinstance(_at(trace, place), (dict, list))]


def _next_to(value: Json) -> list[Json]:
    if isinstance(value, str):
        return [value.swapcase(), f"{value}'"]
    return list(around(value)) if is_number(value) else []


def _number(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:  # noqa: ARG001
    places = []
    for place in _places(trace):
        value = _at(trace, place)
        if is_number(value) and abs(value) < _EXACT and value == int(value):
            places.append(place)
    if not places:
        return None
    place = random.choice(places)
    value = _at(trace, place)
    return _put(trace, place, float(value) if isinstance(value, int) else int(value))


def _field(random: Random, trace: list[Json], tree: RVAFT) -> list[Json] | None:  # noqa: ARG001
    places = [place for place in _places(trace) if isinstance(place[1][-1], str)]
    if not places:
        return None
    index, path = random.choice(places)
    owner: Place = (index, path[:-1])
    return _put(trace, owner, {name: value for name, value in _at(trace, owner).items() if name != path[-1]})


def _kind(value: Json) -> type:
    return float if is_number(value) else type(value)


def _places(trace: list[Json]) -> list[Place]:
    """All values inside the events, in order; an event itself is none."""
    found: list[Place] = []
    for index, event in enumerate(trace):
        todo: list[tuple[tuple[str | int, ...], Json]] = [((), event)]
        while todo:
            path, value = todo.pop()
            if path:
                found.append((index, path))
            if isinstance(value, Mapping):
                todo += [((*path, name), inner) for name, inner in reversed(list(value.items()))]
            elif isinstance(value, list):
                todo += [((*path, number), inner) for number, inner in reversed(list(enumerate(value)))]
    return found


def _at(trace: list[Json], place: Place) -> Json:
    index, path = place
    value = trace[index]
    for step in path:
        value = value[step]
    return value


def _put(trace: list[Json], place: Place, new: Json) -> list[Json]:
    """The trace with another value at a place; only what leads there is copied."""
    index, path = place
    for depth in range(len(path) - 1, -1, -1):
        owner = _at(trace, (index, path[:depth]))
        copied: Json = dict(owner) if isinstance(owner, Mapping) else list(owner)
        copied[path[depth]] = new
        new = copied
    return [*trace[:index], new, *trace[index + 1 :]]


_EDITS: Final[Mapping[Disturbance, Callable[[Random, list[Json], RVAFT], list[Json] | None]]] = {
    Disturbance.EXTRA: _extra,
    Disturbance.MISSING: _missing,
    Disturbance.SWAPPED: _swapped,
    Disturbance.REPEATED: _repeated,
    Disturbance.BOUND: _bound,
    Disturbance.TYPE: _type,
    Disturbance.NUMBER: _number,
    Disturbance.FIELD: _field,
    Disturbance.NOISE: _noise,
}

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
                edited = Look(random, tree).in_time(edited)
            if not _detected(tree, semantics, edited):
                return NearMiss(edited, detected, kind)
    # The tree is detected at the last event and not before.
    return NearMiss(detected[:-1], detected, Disturbance.MISSING)


def _detected(tree: RVAFT, semantics: Semantics, trace: list[Json]) -> bool:
    return Verdict.TRUE in engine(tree, semantics).run(trace)
