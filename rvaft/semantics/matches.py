"""All matches of a trace, by enumeration (definition, section 3)."""

from collections.abc import Iterator, Sequence
from typing import Any

from rvaft.errors import TooLarge
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.semantics.events import Binding, time_of
from rvaft.semantics.reference import (
    Partial,
    TraceStep,
    chosen_scenarios,
    decided,
    guards_hold,
    observed,
    relevant,
    unbroken,
)
from rvaft.semantics.scenarios import ReferenceScenario

Match = frozenset[tuple[str, int]]
"""The events of a match as pairs of a node and a position (from 1)."""


def matches(
    tree: RVAFT,
    semantics: Semantics,
    trace: Sequence[Any],
    *,
    branch: int | None = None,
    kind: Kind | None = None,
    scenarios: Sequence[ReferenceScenario] | None = None,
    limit: int = 10_000,
) -> frozenset[Match]:
    """Return every match of a feasible scenario in a trace.

    `scenarios` are those of the branch or kind, if known. Raises `TooLarge` if more than `limit`
    events would be tried.

    >>> from rvaft import loads
    >>> found = matches(loads("top sand a b;"), Semantics.SCATTERED, [{"event": name} for name in "aab"])
    >>> sorted(sorted(match) for match in found)
    [[('a', 1), ('b', 3)], [('a', 2), ('b', 3)]]
    """
    found, left = set[Match](), limit
    late, numbered = _late(tree, trace), enumerate(trace, 1)
    past = [TraceStep(event, time_of(tree.time, event), position in late) for position, event in numbered]
    for scenario in chosen_scenarios(tree, branch, kind) if scenarios is None else scenarios:
        for positions in _windows(tree, semantics, trace, len(scenario.occurrences)):
            for match, tried in _served(scenario, trace, positions, past, left):
                left -= tried
                if match is not None:
                    found.add(match)
    return frozenset(found)


def _late(tree: RVAFT, trace: Sequence[Any]) -> set[int]:
    late = set[int]()
    greatest: int | None = None
    for position, event in enumerate(trace, 1):
        time = time_of(tree.time, event)
        if time is not None and tree.time is not None and tree.time.late is not None:
            if greatest is not None and greatest - time > tree.time.late:
                late.add(position)
            greatest = time if greatest is None else max(time, greatest)
    return late


def _windows(tree: RVAFT, semantics: Semantics, trace: Sequence[Any], size: int) -> Iterator[Sequence[int]]:
    """Clause: which positions a match may use; late events are never among them."""
    every, late = [*range(1, len(trace) + 1)], _late(tree, trace)
    in_time = [position for position in every if position not in late]
    counted = [position for position in in_time if semantics.projects and relevant(tree, trace[position - 1])]
    match semantics:
        case Semantics.STRICT:
            starts = [every[:size]] if late.isdisjoint(every[:size]) else []
        case Semantics.PROJECTED:
            starts = [counted[:size]]
        case Semantics.CONSECUTIVE:
            starts = [counted[first : first + size] for first in range(len(counted))]
        case Semantics.SCATTERED:
            starts = [in_time]
    yield from (window for window in starts if len(window) >= size)


def _served(
    scenario: ReferenceScenario, trace: Sequence[Any], positions: Sequence[int], past: Sequence[TraceStep], limit: int
) -> Iterator[tuple[Match | None, int]]:
    """Iterate over the matches, each with the number of events tried since the last match.

    Clauses: one position for each occurrence and no position twice; every event matches its
    occurrence under one assignment of the variables; precedence is kept; every guard holds.
    """
    names, tried = sorted(scenario.occurrences), 0
    agenda: list[tuple[tuple[int, ...], Binding]] = [((), {})]
    while agenda:
        taken, binding = agenda.pop()
        if len(taken) == len(names):
            place = dict(zip(names, taken, strict=True))
            in_order = any(all(place[a] < place[b] for b in names for a in order[b]) for order in scenario.orders)
            times = {name: time_of(scenario.tree.time, trace[position - 1]) for name, position in place.items()}
            indices = {name: position - 1 for name, position in place.items()}
            match = Partial(0, 0, scenario.occurrences, binding, times, indices)
            unhurt = in_order and guards_hold(scenario, match)
            if unhurt and unbroken(scenario, match, past) and decided(scenario, match, past):
                yield frozenset((scenario.observing[name].name, position) for name, position in place.items()), tried
                limit, tried = limit - tried, 0
            continue
        for position in positions:
            tried += 1
            if tried > limit:
                raise TooLarge("events tried for the occurrences of a match", limit=limit)
            event = trace[position - 1]
            found = [] if position in taken else observed(scenario, names[len(taken)], event, binding)
            agenda += [((*taken, position), bound) for bound in found]
    yield None, tried
