"""How a verdict came about, as JSON: what programs are told, on standard output, by a hook or by a server."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final

from rvaft.analysis.pattern_index import TreeReads
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import Explanation, Pending

PLACES: Final = ("time", "topic")
"""The fields of an event that say where it is from, in the logs of ROS."""


def counted(events: int) -> str:
    """So many events, in words.

    >>> counted(2)
    '2 events'
    """
    return "1 event" if events == 1 else f"{events} events"


def matched_events(explanations: Collection[Explanation]) -> set[int]:
    """The numbers of the events that explanations name."""
    return {number for explanation in explanations for number in explanation.matched.values()}


def told_fields(tree: RVAFT) -> tuple[str, ...]:
    """The fields that tell an event of a tree from others: time and topic, and those where its event types have different texts.

    >>> import rvaft
    >>> told_fields(rvaft.loads('event e(x) = { kind: "k", x: x }; top and a; a on e(1);'))
    ('time', 'topic', 'kind')
    """
    return tuple(dict.fromkeys((*PLACES, *TreeReads(tree).discriminators.fields)))


def places(event: Json, fields: Sequence[str] = PLACES) -> dict[str, Json]:
    """What an event has in the fields that tell it from others. A number that is none in JSON, as infinity, says nothing."""
    found = {name: event[name] for name in fields if name in event} if isinstance(event, Mapping) else {}
    return {name: value for name, value in found.items() if not isinstance(value, float) or math.isfinite(value)}


def other_fields(node: str, event: Json, tree: RVAFT, fields: Sequence[str]) -> dict[str, Json]:
    """What tells the event of a node from others beside time and topic; a default event is named by its node alone."""
    if node in tree.nodes and tree.nodes[node].on is None:
        return {}
    found = places(event, [name for name in fields if name not in PLACES])
    return {name: value for name, value in found.items() if not isinstance(value, (Mapping, list))}


def explained(
    explanation: Explanation, tree: RVAFT, events: Mapping[int, Json], fields: Sequence[str] = PLACES
) -> dict[str, Json]:
    """Branch, kinds, which event was which node, and the variables; `events` are those that are known, by their numbers."""
    matched = []
    for node, number in explanation.matched.items():
        event = events.get(number)
        record: dict[str, Json] = {"node": node, "event": number, **places(event)}
        if others := other_fields(node, event, tree, fields):
            record["fields"] = others
        matched.append(record)
    return {
        "branch": explanation.branch,
        "kinds": sorted(kind.value for kind in explanation.kinds),
        "matched": matched,
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


def unlike(explanations: Mapping[int, Explanation | None]) -> Iterator[tuple[list[int], Explanation]]:
    """The explanations that differ in branch or events, each with the columns that have it."""
    known: dict[object, tuple[list[int], Explanation]] = {}
    for column, explanation in explanations.items():
        if explanation is not None:
            name = explanation.branch, frozenset(explanation.kinds), tuple(explanation.matched.items())
            known.setdefault(name, ([], explanation))[0].append(column)
    return iter(known.values())
