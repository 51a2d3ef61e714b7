"""Detections and pending events as JSON."""

from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Final

from rvaft.core.fields_to_read import TreeReads
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, finite, is_finite
from rvaft.monitors import Explanation, Pending

PLACES: Final = ("time", "topic")
_FINITE: Final = frozenset({str, int, bool})
"""Types of which all values are finite."""
_UNEXPLAINED: Final[Mapping[str, Json]] = {"branch": None, "kinds": [], "matched": [], "variables": {}}


def matched_events(explanations: Collection[Explanation]) -> set[int]:
    """Return the numbers of the events in explanations."""
    return {one.event for explanation in explanations for one in explanation.matched}


def identifying_fields(tree: RVAFT) -> tuple[str, ...]:
    """Return time, topic, and discriminating fields, which identify an event in output.

    >>> import rvaft
    >>> identifying_fields(rvaft.loads('event e(x) = { kind: "k", x: x }; top and a; a on e(1);'))
    ('time', 'topic', 'kind')
    """
    return tuple(dict.fromkeys((*PLACES, *_time_field(tree), *TreeReads(tree).discriminators.fields)))


def _time_field(tree: RVAFT) -> tuple[str, ...]:
    return () if tree.time is None else tree.time.field[:1]


def places(event: Json, tree: RVAFT) -> dict[str, Json]:
    """Return the time of an event, as written in the time field of the tree, and its topic.

    >>> import rvaft
    >>> places({"t": 7, "topic": "/x"}, rvaft.loads("time t as s; top and a b;"))
    {'time': 7, 'topic': '/x'}
    """
    written = None if tree.time is None else tree.time.written(event)
    if written is None:
        return kept(event, PLACES)
    return {**kept({"time": written}, PLACES[:1]), **kept(event, PLACES[1:])}


def kept(event: Json, fields: Sequence[str]) -> dict[str, Json]:
    """Return the values of an event in these fields, without numbers that are not finite."""
    if type(event) is not dict and not isinstance(event, Mapping):
        return {}
    found = [(name, event[name]) for name in fields if name in event]
    return {name: value for name, value in found if type(value) in _FINITE or is_finite(value)}


def other_fields(node: str, event: Json, tree: RVAFT, fields: Sequence[str]) -> dict[str, Json]:
    """Return the identifying fields besides time and topic; none for a default event."""
    others = _others(tuple(fields), _time_field(tree))
    if not others or (node in tree.nodes and tree.nodes[node].on is None):
        return {}
    found = kept(event, others)
    return {name: value for name, value in found.items() if not isinstance(value, (Mapping, list))} if found else found


@lru_cache(maxsize=16)
def _others(fields: tuple[str, ...], of_time: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in fields if name not in (*PLACES, *of_time))


def explained(
    explanation: Explanation,
    tree: RVAFT,
    events: Mapping[int, Json],
    fields: Sequence[str],
    lines: Mapping[int, int | None] | None = None,
) -> dict[str, Json]:
    """Return an explanation as JSON; `events` and `lines` have the known events."""
    matched = []
    for node, occurrence, number in explanation.matched:
        event = events.get(number)
        others = other_fields(node, event, tree, fields)
        record = {"node": node, "occurrence": occurrence, "event": number}
        if lines is not None:
            record["line"] = lines.get(number)
        record.update(places(event, tree))
        if others:
            record["fields"] = others
        matched.append(record)
    return {
        "branch": explanation.branch,
        "kinds": sorted(kind.value for kind in explanation.kinds),
        "matched": matched,
        **({"absent": [one._asdict() for one in explanation.absences]} if explanation.absences else {}),
        "variables": finite(explanation.bound(tree)),
    }


def expected(pending: Sequence[Pending]) -> list[Json]:
    """Return the missing events, one record per branch and binding."""
    return [
        {
            "branch": record.branch,
            "awaited": [{"node": awaited.node, "event": awaited.event} for awaited in record.awaited],
            **({"absent": [{"node": a.node, "event": a.event} for a in record.absent]} if record.absent else {}),
            "variables": finite(dict(record.variables)),
        }
        for record in pending
    ]


def unlike(explanations: Mapping[int, Explanation]) -> Collection[tuple[list[int], Explanation]]:
    """Return distinct explanations, each with its columns."""
    known: dict[object, tuple[list[int], Explanation]] = {}
    for column, one in explanations.items():
        known.setdefault((one.branch, one.kinds, one.matched), ([], one))[0].append(column)
    return known.values()


def detection(
    about: Mapping[str, Json],
    explanation: Explanation | None,
    events: Mapping[int, Json],
    tree: RVAFT,
    lines: Mapping[int, int | None] | None = None,
) -> dict[str, Json]:
    """Return the JSON object for a command: `about`, the explanation, and the known events by
    number as text.

    Without an explanation, `branch`, `kinds`, `matched` and `variables` are null or empty.
    """
    found, numbers = _UNEXPLAINED, set[int]()
    if explanation is not None:
        found = explained(explanation, tree, events, identifying_fields(tree), lines)
        numbers = matched_events([explanation])
    known = {str(number): finite(events[number]) for number in sorted(numbers) if number in events}
    return {**about, **found, "events": known}
