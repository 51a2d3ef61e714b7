"""A smaller trace: fewer events, events with less in them, values that the tree knows."""

from collections.abc import Iterator

from cross_check.reductions.pair import Pair
from cross_check.reductions.sizes import Path, places, simple_values, value_size, written
from rvaft.values import Json


def shorter_trace(pair: Pair) -> Iterator[Pair]:
    """Without a run of events: half of them, then shorter and shorter runs down to single events, the last first."""
    length = len(pair.trace)
    size = length
    while size:
        for end in range(length, 0, -size):
            yield pair.with_trace([*pair.trace[: max(end - size, 0)], *pair.trace[end:]])
        size //= 2


def smaller_events(pair: Pair) -> Iterator[Pair]:
    """An event with nothing in it, without one field, or without one item of a list in it."""
    for index, event in enumerate(pair.trace):
        yield pair.with_event_at(index, {})
        for path, _ in places(event):
            yield pair.with_event_at(index, without_value(event, path))


def simpler_values(pair: Pair) -> Iterator[Pair]:
    """A simpler value for a value in an event: 0, the empty string, a name or a literal of the tree."""
    simple = simple_values(pair.nodes, pair.events, pair.ignores)
    ranks = {written(value): rank for rank, value in enumerate(simple)}
    for index, event in enumerate(pair.trace):
        for path, value in places(event):
            for plain in simple[: value_size(value, ranks)]:
                yield pair.with_event_at(index, with_value(event, path, plain))


def with_value(event: Json, path: Path, value: Json) -> Json:
    """A copy of an event with another value at a place; what the path does not touch is shared."""
    around = _around(event, path)
    for step, whole in zip(reversed(path), reversed(around), strict=True):
        copy = whole.copy()
        copy[step] = value
        value = copy
    return value


def without_value(event: Json, path: Path) -> Json:
    """A copy of an event without the field or item at a place."""
    *above, last = path
    whole = _around(event, path)[-1].copy()
    del whole[last]
    return with_value(event, tuple(above), whole)


def _around(event: Json, path: Path) -> list[Json]:
    """The objects and lists that the path goes through, outermost first."""
    around: list[Json] = []
    for step in path:
        around.append(event)
        event = event[step]
    return around
