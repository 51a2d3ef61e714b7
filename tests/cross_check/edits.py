"""Whether one trace comes from another by one edit of a kind; told from the traces alone."""

import json

from cross_check.generate import Disturbance
from rvaft import RVAFT
from rvaft.model.values import Json, equal, is_number
from rvaft.semantics.reference import relevant


def written(trace: list[Json]) -> list[str]:
    return [json.dumps(event) for event in trace]


def inserted(before: list[Json], after: list[Json]) -> Json | None:
    """The one event that came in, where nothing else changed."""
    for index, event in enumerate(after):
        if written([*after[:index], *after[index + 1 :]]) == written(before):
            return event
    return None


def flat(value: Json, path: tuple[object, ...] = ()) -> dict[tuple[object, ...], Json]:
    """All places and what stands there, containers as their type."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    own = {path: type(value) if isinstance(value, (dict, list)) else value}
    return own | {place: part for name, below in inner for place, part in flat(below, (*path, name)).items()}


def moved(before: list[Json], after: list[Json]) -> tuple[set[tuple[object, ...]], list[tuple[Json, Json]]]:
    """The places that are there in one of them alone, without those further in, and the values that became others."""
    old, new = flat(before), flat(after)
    gone = old.keys() ^ new.keys()
    top = {place for place in gone if not any(place[:length] in gone for length in range(len(place)))}
    return top, [(old[p], new[p]) for p in old.keys() & new.keys() if repr(old[p]) != repr(new[p])]


def a_kind(value: Json) -> object:
    return "number" if is_number(value) else value if isinstance(value, type) else type(value)


def is_edit(kind: Disturbance, tree: RVAFT, before: list[Json], after: list[Json]) -> bool:
    """Whether one trace comes from another by one edit of a kind; told from the traces alone."""
    added, (top, changes) = inserted(before, after), moved(before, after)
    change = changes[0] if len(changes) == 1 and len(before) == len(after) else None
    scalar = None if top else change
    match kind:
        case Disturbance.EXTRA:
            return added is not None
        case Disturbance.REPEATED:
            return added is not None and json.dumps(added) in written(before)
        case Disturbance.NOISE:
            return added is not None and not relevant(tree, added)
        case Disturbance.MISSING:
            return inserted(after, before) is not None
        case Disturbance.SWAPPED:
            pairs = [(a, b) for a, b in zip(written(before), written(after), strict=False) if a != b]
            return len(before) == len(after) and len(pairs) == 2 and pairs[0] == pairs[1][::-1]
        case Disturbance.BOUND:
            return scalar is not None and is_number(scalar[0]) and is_number(scalar[1]) and not equal(*scalar)
        case Disturbance.TYPE:
            return change is not None and a_kind(change[0]) != a_kind(change[1])
        case Disturbance.NUMBER:
            return scalar is not None and equal(*scalar) and type(scalar[0]) is not type(scalar[1])
        case Disturbance.OTHER:
            return scalar is not None and a_kind(scalar[0]) == a_kind(scalar[1]) and not equal(*scalar)
        case Disturbance.THROUGHOUT:
            alike = all(equal(old, changes[0][0]) and repr(new) == repr(changes[0][1]) for old, new in changes)
            left = [one for one in flat(after).values() if not isinstance(one, type)]
            return bool(changes) and not top and alike and not any(equal(one, changes[0][0]) for one in left)
        case Disturbance.FIELD:
            return len(top) == 1 and not changes and top <= flat(before).keys()
