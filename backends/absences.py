"""Absent events (`without`) in one order of a match: which events are absent in which gap."""

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import NamedTuple, Self, assert_never

from rvaft.backend import Observed
from rvaft.core.property import Event, Part, Property, WithoutEvent, with_parts
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, Reason, unwritten
from rvaft.model.guards import variables
from rvaft.model.nodes import Side
from rvaft.model.verdict import Semantics


def clauses_of(scenario: Scenario) -> dict[Event, tuple[WithoutEvent, ...]]:
    """Return, for each event of a scenario, the clauses whose part has it, in a stable order.

    >>> from rvaft import loads
    >>> from rvaft.core.restriction import property_of
    >>> from rvaft.core.scenarios import scenarios
    >>> text = 'event e(n) = { event: n }; r sand a x; x and b c without e("d");'
    >>> scenario, = scenarios(property_of(loads(text)))
    >>> [(event.source.node, len(some)) for event, some in clauses_of(scenario).items()]
    [('a', 0), ('b', 1), ('c', 1)]
    """
    found: dict[Event, tuple[WithoutEvent, ...]] = dict.fromkeys(scenario.events, ())
    for clause, part in scenario.absences:
        for event in part:
            found[event] += (clause,)
    return found


def gaps(clauses: Sequence[Iterable[WithoutEvent]]) -> list[list[WithoutEvent]]:
    """Return, for each event of an order, the clauses that no event between the previous one and it
    breaks; for the first one, those that no earlier event does.

    `clauses` has those whose part has the event. Clauses with durations are not considered.
    """
    found: list[list[WithoutEvent]] = [[] for _ in clauses]
    places: dict[WithoutEvent, list[int]] = {}
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


def without_absences(prop: Property, dropped: Callable[[WithoutEvent], bool]) -> Property:
    """Return the property without these clauses."""

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        return parts[0] if isinstance(part, WithoutEvent) and dropped(part) else with_parts(part, parts)

    return prop.rewritten(change) if any(map(dropped, prop.absences)) else prop


def without_vacuous(prop: Property, semantics: Semantics) -> Property:
    """Return the property without the clauses that every match holds: under `strict`, where a match uses
    all positions up to its end, those without a duration.
    """
    return without_absences(prop, lambda one: semantics is Semantics.STRICT and one.duration is None)


def breaking_event(clause: WithoutEvent) -> Observed:
    """Return what breaks a clause, with its own variables as those of one event."""
    return Observed(clause.pattern, clause.guard).untied(sorted(clause.own))


class OpenClauses(NamedTuple):
    """The events of the clauses of one scenario, as bits of `scenario.events`."""

    parts: tuple[tuple[WithoutEvent, int], ...]

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Return the clauses of a scenario, in a stable order."""
        masks: dict[WithoutEvent, int] = {}
        clauses = clauses_of(scenario)
        for place, event in enumerate(scenario.events):
            for clause in clauses[event]:
                masks[clause] = masks.get(clause, 0) | 1 << place
        return cls(tuple(masks.items()))

    def after(self, done: int) -> list[WithoutEvent]:
        """Return the clauses without a duration that an event can break when these events of a match are there."""
        return [clause for clause, mask in self.parts if _is_open(clause, mask, done)]


def _is_open(clause: WithoutEvent, mask: int, done: int) -> bool:
    """Return whether an event can break a clause of these events."""
    match clause.side:
        case Side.DURING:
            return bool(mask & done and mask & ~done)
        case Side.BEFORE:
            return not mask & done
        case Side.AFTER:
            return False
        case _:
            assert_never(clause.side)


def refuse_timeless(prop: Property, semantics: Semantics, lasting: Container[Semantics]) -> None:
    """Raise `NotExpressible` for clauses that texts over slices do not say.

    Events that are absent `before` are written under the `lasting` semantics, which are never false, where no event
    ends all scenarios.
    """
    refuse(prop, {"duration": unwritten("absent events are written without durations")})
    for clause in prop.absences:
        nodes = [clause.source.node]
        if clause.side is Side.BEFORE and semantics not in lasting:
            raise NotExpressible(unwritten(f"events absent `before` are not written under {semantics}"), nodes=nodes)
        if clause.side is Side.BEFORE and clause.shared:
            why = "an event absent `before` comes before its variables of the tree are bound"
            raise NotExpressible(unwritten(why), nodes=nodes)
        if clause.shared and clause.own.intersection(variables(clause.guard)):
            why = "guards of absent events are written over variables of the tree alone, or of their own alone"
            raise NotExpressible(unwritten(why), nodes=nodes)


def require_unbroken(scenarios: Iterable[Scenario]) -> None:
    """Raise `NotExpressible` if each scenario has an event that is absent `before`.

    After such events the text would be false, as nothing is accepted any more, and the tree is not.
    """
    found = dict[str, None]()
    for scenario in scenarios:
        broken = [one.source.node for one, _ in scenario.absences if one.side is Side.BEFORE]
        if not broken:
            return
        found.update(dict.fromkeys(broken))
    if found:
        why = "after events that are absent `before`, the text would be false at once, and the tree is not"
        raise NotExpressible(unwritten(why), nodes=found)
