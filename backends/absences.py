"""Absent events (`without`) in one order of a match: which events are absent in which gap."""

from collections.abc import Iterable, Mapping, Sequence
from typing import assert_never

from rvaft.core.property import Event, Property, Without
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, Reason
from rvaft.model.nodes import Side
from rvaft.model.verdict import Semantics


def clauses_of(scenario: Scenario) -> dict[Event, tuple[Without, ...]]:
    """Return, for each event of a scenario, the clauses whose part has it, in a stable order.

    >>> from rvaft import loads
    >>> from rvaft.core.passes import property_of
    >>> from rvaft.core.scenarios import scenarios
    >>> text = 'event e(n) = { event: n }; r sand a x; x and b c without e("d");'
    >>> scenario, = scenarios(property_of(loads(text)))
    >>> [(event.source.node, len(some)) for event, some in clauses_of(scenario).items()]
    [('a', 0), ('b', 1), ('c', 1)]
    """
    found: dict[Event, tuple[Without, ...]] = dict.fromkeys(scenario.events, ())
    for clause in (part for part in scenario.kept if isinstance(part, Without)):
        agenda, seen = [*scenario.kept[clause]], set[object]()
        while agenda:
            part = agenda.pop()
            if part not in seen:
                seen.add(part)
                agenda += scenario.kept[part]
                if isinstance(part, Event):
                    found[part] += (clause,)
    return found


def gaps(clauses: Sequence[Iterable[Without]]) -> list[list[Without]]:
    """Return, for each event of an order, the clauses that no event between the previous one and it
    breaks; for the first one, those that no earlier event does.

    `clauses` has those whose part has the event. Clauses with durations are not considered.
    """
    found: list[list[Without]] = [[] for _ in clauses]
    places: dict[Without, list[int]] = {}
    for place, some in enumerate(clauses):
        for clause in some:
            places.setdefault(clause, []).append(place)
    for clause, (first, *rest) in places.items():
        match clause.side:
            case Side.DURING:
                between = range(first + 1, rest[-1] + 1 if rest else 0)
            case Side.BEFORE:
                between = range(first + 1)
            case Side.AFTER:
                between = range(0)
            case _:
                assert_never(clause.side)
        for place in between if clause.duration is None else ():
            found[place].append(clause)
    return found


def refuse(prop: Property, reasons: Mapping[str, Reason]) -> None:
    """Raise `NotExpressible` for the first absence with a `duration`, or with variables that are
    `shared` with the tree, if there is a reason.
    """
    for clause in prop.absences:
        for name, held in (("duration", clause.duration is not None), ("shared", bool(clause.shared))):
            if held and name in reasons:
                raise NotExpressible(reasons[name], nodes=[clause.source.node])


def is_vacuous(clause: Without, semantics: Semantics) -> bool:
    """Whether every match holds the clause: under `strict` a match uses all positions up to its end."""
    return semantics is Semantics.STRICT and clause.duration is None
