"""Disturbed traces: edits that occur in logs or distinguish implementations."""

from collections.abc import Callable, Sequence
from enum import StrEnum
from random import Random
from typing import Final, NamedTuple, assert_never

from cross_check.generate.times import durations, grown, in_between, timed
from cross_check.generate.traces import WILD, Manner, detecting, is_relevant, noise, some_event
from cross_check.generate.values import COMMON, EventFields, LogValues, Path, around, interesting_values, places, put
from rvaft.engine import Engine
from rvaft.model.tree import RVAFT
from rvaft.model.values import EXACT_INTEGERS, Json, equal, is_number
from rvaft.model.verdict import Semantics, Verdict

_CARELESS: Final = 0.3
_WAYS: Final = 12


class Disturbance(StrEnum):
    """The kinds of edits."""

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
    TIME = "a time at or next to a bound"
    BACK = "a time that goes back"
    UNREADABLE = "a time that cannot be read"
    SPELLING = "a time written in another way"


OF_TIMES: Final = (Disturbance.TIME, Disturbance.BACK, Disturbance.UNREADABLE, Disturbance.SPELLING)
"""Edits that need a tree with times."""


def kinds_for(tree: RVAFT) -> list[Disturbance]:
    """Return the kinds of edits for traces of a tree."""
    return [kind for kind in Disturbance if tree.time is not None or kind not in OF_TIMES]


def disturbed(random: Random, trace: list[Json], tree: RVAFT, values: Sequence[Json] = ()) -> list[Json]:
    """Return the trace after one to three edits; the original is unchanged.

    `values` are candidates beside those of the tree.
    """
    for _ in range(random.choice((1, 1, 1, 2, 2, 3))):
        known = kinds_for(tree)
        kinds = random.sample(known, len(known))
        after = (disturbed_by(kind, random, trace, tree, values) for kind in kinds)
        trace = next((edited for edited in after if edited is not None), trace)
    return trace


def disturbed_by(
    kind: Disturbance, random: Random, trace: list[Json], tree: RVAFT, values: Sequence[Json] = ()
) -> list[Json] | None:
    """Return the trace after one edit, different from the original; None if that is impossible."""
    index = random.randrange(len(trace)) if trace else 0
    match kind:
        case Disturbance.EXTRA | Disturbance.NOISE:
            extra = kind is Disturbance.EXTRA
            event = some_event(random, tree, interesting_values(tree)) if extra else noise(random, tree, COMMON)
            at = random.randint(0, len(trace)) if event is not None else 0
            if event is None:
                return None
            there = in_between(random, tree, trace, at, event, plain=False)
            return [*trace[:at], event if not extra and is_relevant(tree, there) else there, *trace[at:]]
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
                random, trace, lambda _, old: [v for v in COMMON if _kind(v) is not _kind(old)] + _look_alikes(old)
            )
        case Disturbance.NUMBER:
            return _edited(random, trace, _other_number)
        case Disturbance.FIELD:
            fields = [path for path, _ in _inside(trace) if isinstance(path[-1], str)]
            if not fields:
                return None
            *above, field = random.choice(fields)
            owner: Json = trace
            for step in above:
                owner = owner[step]
            return put(trace, tuple(above), {name: value for name, value in owner.items() if name != field})
        case Disturbance.OTHER | Disturbance.THROUGHOUT:
            # one place breaks a join, all places break a condition
            if not (scalars := _scalars(trace)):
                return None
            path, old = random.choice(scalars)
            others = [*interesting_values(tree), *values, *(value for _, value in scalars), *_next_to(old)]
            return _exchanged(random, trace, path, old, others, everywhere=kind is Disturbance.THROUGHOUT)
        case Disturbance.TIME | Disturbance.BACK | Disturbance.UNREADABLE | Disturbance.SPELLING:
            times = [None if tree.time is None else tree.time.read(event) for event in trace]
            known = any(time is not None for time in times)
            ways = (_another_time(kind, random, trace, tree, times) for _ in range(_WAYS if known else 0))
            return next((edited for edited in ways if edited is not None), None)
        case _:
            assert_never(kind)


def _another_time(
    kind: Disturbance, random: Random, trace: list[Json], tree: RVAFT, times: Sequence[int | None]
) -> list[Json] | None:
    assert tree.time is not None
    index = random.choice([index for index, time in enumerate(times) if time is not None])
    own = times[index] or 0
    if kind in (Disturbance.UNREADABLE, Disturbance.SPELLING):
        new = None if kind is Disturbance.UNREADABLE else own
        found = timed(random, tree, trace[index], new, plain=False)
        same = repr(found) == repr(trace[index]) or tree.time.read(found) != new
        return None if same else [*trace[:index], found, *trace[index + 1 :]]
    earlier = [time for time in times[:index] if time is not None]
    if not earlier:
        return None
    from_time = max(earlier) if kind is Disturbance.BACK else random.choice(earlier)
    bound = random.choice(durations(tree))
    by = random.choice((0, 1, -1))
    new = from_time - bound - by if kind is Disturbance.BACK else from_time + bound + by
    moved = range(index, len(trace) if new > own and random.random() < 0.5 else index + 1)
    shifted = {place: time + new - own for place in moved if (time := times[place]) is not None}
    result = [
        timed(random, tree, event, shifted[place], plain=True) if place in shifted else event
        for place, event in enumerate(trace)
    ]
    return result if new != own and tree.time.read(result[index]) == new else None


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
    """Return the trace with a number near a bound: a constant, a number of the trace, or their sum."""
    fields = EventFields(tree)

    def near(path: Path, old: Json) -> list[Json]:
        if not is_number(old):
            return []
        constants, numbers = fields.bounds(path, trace)
        constant, other = random.choice(constants or [old]), random.choice(numbers)
        every = (old, other, constant, *((other + constant, other - constant) if constants else ()))
        bounds = [bound for bound in every if bound >= min(0, other, constant)]
        return [one for bound in bounds for one in around(bound) if not equal(one, old)]

    return _edited(random, trace, near)


def _edited(random: Random, trace: list[Json], instead: Callable[[Path, Json], Sequence[Json]]) -> list[Json] | None:
    edits = [(path, new) for path, old in _inside(trace) if (new := instead(path, old))]
    if not edits:
        return None
    path, new = random.choice(edits)
    return put(trace, path, random.choice(new))


def _look_alikes(value: Json) -> list[Json]:
    if isinstance(value, bool):
        return [int(value), str(value)]
    if is_number(value):
        return [str(value), *([bool(value)] if value in (0, 1) else [])]
    return []


def _other_number(_: Path, value: Json) -> list[Json]:
    if not is_number(value) or abs(value) >= EXACT_INTEGERS or value != int(value):
        return []
    return [float(value) if isinstance(value, int) else int(value)]


def with_constant(random: Random, trace: list[Json], constants: Sequence[Json]) -> list[Json] | None:
    """Return the trace with a guard's constant, or a value next to it, at one value of its kind; or
    None.

    The rest is unchanged, so that one condition is met or broken while others hold.
    """
    scalars = _scalars(trace)
    alike = [(path, twin) for path, value in scalars for twin in _look_alikes(value)]
    if alike and random.random() < _CARELESS:
        return put(trace, *random.choice(alike))
    kinds = {_kind(constant) for constant in constants}
    fitting = [(path, value) for path, value in scalars if _kind(value) in kinds]
    if not fitting:
        return None
    near = [value for constant in constants for value in (constant, *_next_to(constant))]
    return _exchanged(random, trace, *random.choice(fitting), near, everywhere=random.random() < 0.5)


def _exchanged(
    random: Random, trace: list[Json], path: Path, old: Json, values: Sequence[Json], *, everywhere: bool
) -> list[Json] | None:
    others = [value for value in values if _kind(value) is _kind(old) and not equal(value, old)]
    if not others:
        return None
    new = random.choice(others)
    for other in [other for other, value in _scalars(trace) if equal(value, old)] if everywhere else [path]:
        trace = put(trace, other, new)
    return trace


def _next_to(value: Json) -> list[Json]:
    if isinstance(value, str):
        return [value.swapcase(), f"{value}'"]
    return around(value) if is_number(value) else []


def _kind(value: Json) -> type:
    return float if is_number(value) else type(value)


def _inside(trace: list[Json]) -> list[tuple[Path, Json]]:
    return [(path, value) for path, value in places(trace) if len(path) > 1]


def _scalars(trace: list[Json]) -> list[tuple[Path, Json]]:
    return [(path, value) for path, value in _inside(trace) if not isinstance(value, (dict, list))]


# Traces one edit away from a detection.

_TRIES: Final = 3
_EVERYDAY: Final = (
    Disturbance.MISSING,
    Disturbance.SWAPPED,
    Disturbance.REPEATED,
    Disturbance.FIELD,
    Disturbance.BOUND,
    Disturbance.TIME,
    Disturbance.UNREADABLE,
)
"""Edits that occur in real logs."""


class UndetectedTrace(NamedTuple):
    """A trace without a detection, the detecting trace that it came from, and the edit."""

    trace: list[Json]
    detecting: list[Json]
    edit: Disturbance


def near_miss(
    random: Random, tree: RVAFT, semantics: Semantics = Semantics.PROJECTED, manner: Manner = WILD
) -> UndetectedTrace:
    """Return a near miss; raises `NoTraceFound`, and errors of the monitor (`TooLarge`)."""
    detected = detecting(random, tree, semantics, manner)
    kinds = [kind for kind in kinds_for(tree) if kind in _EVERYDAY or not manner.believable]
    for kind in random.sample(kinds, len(kinds)):
        for _ in range(_TRIES):
            edited = disturbed_by(kind, random, detected, tree)
            if edited is None:
                break
            if manner.longest is not None and len(edited) > manner.longest:
                continue
            if manner.believable:
                edited = grown(random, tree, LogValues(random, tree).in_time(edited))
            if Verdict.TRUE not in Engine(tree, semantics).run(edited):
                return UndetectedTrace(edited, detected, kind)
    # Without its last event, the detecting trace detects nothing.
    return UndetectedTrace(detected[:-1], detected, Disturbance.MISSING)
