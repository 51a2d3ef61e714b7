"""How a verdict came about, as JSON: what programs are told, on standard output or by a hook."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import Explanation, Pending

_PLACES = ("time", "topic")
"""The fields of an event that say where it is from, in the logs of ROS."""


def counted(events: int) -> str:
    """So many events, in words."""
    return "1 event" if events == 1 else f"{events} events"


def matched_events(explanations: Collection[Explanation]) -> set[int]:
    """The numbers of the events that explanations name."""
    return {number for explanation in explanations for number in explanation.matched.values()}


def places(event: Json) -> dict[str, Json]:
    """When and where an event happened, where it says so. A number that is none in JSON, as infinity, says nothing."""
    found = {name: event[name] for name in _PLACES if name in event} if isinstance(event, Mapping) else {}
    return {name: value for name, value in found.items() if not isinstance(value, float) or math.isfinite(value)}


def explained(explanation: Explanation, tree: RVAFT, events: Mapping[int, Json]) -> dict[str, Json]:
    """Branch, kinds, which event was which node, and the variables; `events` are those that are known, by their numbers."""
    return {
        "branch": explanation.branch,
        "kinds": sorted(kind.value for kind in explanation.kinds),
        "matched": [
            {"node": node, "event": number, **places(events.get(number))}
            for node, number in explanation.matched.items()
        ],
        "variables": variables(explanation, tree),
    }


def variables(explanation: Explanation, tree: RVAFT) -> dict[str, Json]:
    """The variables of a match in the order of the tree."""
    return {name: explanation.variables[name] for name in tree.variables if name in explanation.variables}


def expected(pending: Sequence[Pending]) -> list[Json]:
    """What was waited for, a record for each branch and each way to bind its variables."""
    return [
        {
            "branch": record.branch,
            "awaited": [{"node": awaited.node, "event": awaited.event} for awaited in record.awaited],
            "variables": dict(record.variables),
        }
        for record in pending
    ]


def apart(explanations: Sequence[Explanation | None]) -> Iterator[tuple[list[int], Explanation]]:
    """The explanations that differ in branch or events, each with the places at which it stands."""
    known: dict[object, tuple[list[int], Explanation]] = {}
    for place, explanation in enumerate(explanations):
        if explanation is not None:
            name = explanation.branch, frozenset(explanation.kinds), tuple(explanation.matched.items())
            known.setdefault(name, ([], explanation))[0].append(place)
    return iter(known.values())
