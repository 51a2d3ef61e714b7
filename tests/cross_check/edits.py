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


def changed(before: list[Json], after: list[Json]) -> tuple[Json, Json] | None:
    """The one value that is another now, and what it is, where nothing else changed."""
    if len(before) != len(after):
        return None
    old, new = flat(before), flat(after)
    if old.keys() - new.keys():  # a container became something else, or a field went
        gone = {place for place in old if place not in new}
        top = [
            place
            for place in new
            if any(p[: len(place)] == place for p in gone) and repr(new[place]) != repr(old[place])
        ]
        rest = [p for p in new if p not in top and repr(new[p]) != repr(old.get(p))]
        return (old[top[0]], new[top[0]]) if len(top) == 1 and not rest else None
    places = [place for place in old if repr(old[place]) != repr(new[place])]
    return (old[places[0]], new[places[0]]) if len(places) == 1 else None


def a_kind(value: Json) -> object:
    return "number" if is_number(value) else value if isinstance(value, type) else type(value)


def replaced_throughout(before: list[Json], after: list[Json]) -> bool:
    """Whether one value became one other wherever it stood."""
    old, new = flat(before), flat(after)
    if old.keys() != new.keys():
        return False
    places = [place for place in old if repr(old[place]) != repr(new[place])]
    if not places:
        return False
    gone, came = old[places[0]], new[places[0]]
    went = all(equal(old[place], gone) and repr(new[place]) == repr(came) for place in places)
    return went and not any(equal(value, gone) for value in new.values() if not isinstance(value, type))


def is_edit(kind: Disturbance, tree: RVAFT, before: list[Json], after: list[Json]) -> bool:
    """Whether one trace comes from another by one edit of a kind; told from the traces alone."""
    added, change = inserted(before, after), changed(before, after)
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
            return change is not None and is_number(change[0]) and is_number(change[1]) and not equal(*change)
        case Disturbance.TYPE:
            return change is not None and a_kind(change[0]) != a_kind(change[1])
        case Disturbance.NUMBER:
            return change is not None and equal(*change) and type(change[0]) is not type(change[1])
        case Disturbance.OTHER:
            return change is not None and a_kind(change[0]) == a_kind(change[1]) and not equal(*change)
        case Disturbance.THROUGHOUT:
            return replaced_throughout(before, after)
        case Disturbance.FIELD:
            old, new = flat(before), flat(after)
            gone = old.keys() - new.keys()
            top = min(gone, key=len, default=())
            return (
                bool(gone)
                and all(p[: len(top)] == top for p in gone)
                and all(repr(new[p]) == repr(old.get(p, new)) for p in new)
            )
