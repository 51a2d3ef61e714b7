"""Rules about absent events (`without`)."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple, assert_never

from rvaft.core.feasibility import ScenarioSpace
from rvaft.core.passes import expand_times
from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    Property,
    Sequence,
    Times,
    Within,
    WithoutEvent,
)
from rvaft.core.scenarios import Scenario, most_events, scenarios
from rvaft.core.time_order import order_ends
from rvaft.errors import TooLarge
from rvaft.language.draft import Draft
from rvaft.model.expressions import without_text
from rvaft.model.nodes import Node, Side, Without
from rvaft.model.patterns import rigid_variables
from rvaft.rules.rule import RuleReport, branch_of
from rvaft.support.bits import bits
from rvaft.support.budget import Undecided
from rvaft.support.wording import did_you_mean, listing

_Names = frozenset[str]
_NONE: _Names = frozenset()
_SCENARIOS = 5_000


def without(draft: Draft) -> Iterator[RuleReport]:
    """A `without` has a duration where it needs one."""
    for node in draft.nodes.values():
        for clause, place in node.withouts:
            if clause.duration is None and clause.side is Side.AFTER:
                yield RuleReport(place, f"`after` at {node.name} needs a duration, as in `for 5 s after`", (node.name,))
            elif clause.duration is not None and clause.side is Side.DURING:
                message = f"the `for` at {node.name} needs a side: `for 5 s after` or `for 5 s before`"
                yield RuleReport(place, message, (node.name,))


def void_absence(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A `without` between the events of a part is at a node whose part has two events."""
    tree, most = space.tree, most_events(space.prop.parts)
    for part in space.prop.absences:
        if part.side is Side.DURING and most[part] < 2:
            node = tree.nodes[part.source.node]
            clause = node.without[part.number - 1]
            message = "its part has one event, so that no event lies between; add `before` or `for D after`"
            yield RuleReport(clause.place, _said(node, clause, message), (node.name,))


def unbound_absence(space: ScenarioSpace) -> Iterator[RuleReport]:
    """The part of a `without` has an event, and binds the variables that the clause shares with the
    tree when they are needed.
    """
    tree = space.tree
    for node in tree.top_down():
        for clause in node.without:
            free = sorted(tree.own_variables(clause).difference(clause.on.variables))
            if free:
                guess = did_you_mean(free[0], (*tree.variables, *clause.on.variables))
                message = f"no event binds {listing(free)}{guess}"
                yield RuleReport(clause.place, _said(node, clause, message), (node.name,))
    unsure = [part for part in space.prop.absences if not _is_surely_bound(space.prop, part)]
    if not unsure:
        return
    sources = {(part.source, part.number) for part in unsure}
    reported = set[str]()
    try:
        for scenario in _scenarios(space.prop):
            for part in scenario.kept:
                if isinstance(part, WithoutEvent) and (part.source, part.number) in sources:
                    message = _lacking(tree.variables, scenario, part)
                    node = tree.nodes[part.source.node]
                    if message and node.name not in reported:
                        reported.add(node.name)
                        place = node.without[part.number - 1].place
                        yield RuleReport(place, _said(node, node.without[part.number - 1], message), (node.name,))
    except TooLarge:
        raise Undecided("absent events") from None


def _said(node: Node, clause: Without, message: str) -> str:
    return f"`{without_text(clause)}` at {node.name}: {message}"


def _scenarios(prop: Property) -> Iterator[Scenario]:
    for alternative in order_ends(expand_times(prop)).alternatives:
        yield from scenarios(alternative, limit=_SCENARIOS)


def _lacking(known: Iterable[str], scenario: Scenario, part: WithoutEvent) -> str:
    """Return what is wrong with a clause in a scenario, or an empty text."""
    inside = frozenset(scenario.events_below(part))
    own = [number for number, event in enumerate(scenario.events) if event in inside]
    if not own:
        return f"{part.source.node} has no event in {branch_of(scenario.kept)}"
    before, events = scenario.before, scenario.events
    if part.side is Side.AFTER:
        needed = [{one for number in own for one in (number, *bits(before[number]))}]
    else:
        firsts = [number for number in own if not any(before[number] >> other & 1 for other in own)]
        needed = [{number, *bits(before[number])} for number in firsts]
    for some in needed:
        bound = {name for number in some for name in rigid_variables(events[number].pattern)}
        for name in part.shared:
            if name not in bound:
                when = "when its events end" if part.side is Side.AFTER else "when its first event comes"
                there = "bind it there or before, or write a variable of the clause's own"
                guess = did_you_mean(name, (one for one in known if one != name))
                return f"variable {name} is not bound {when} in {branch_of(scenario.kept)}; {there}{guess}"
    return ""


# A condition that suffices, without scenarios.


class _Bound(NamedTuple):
    """Variables that a part binds in every scenario, and those that each possible first event binds.

    `silent` if the part may have no event.
    """

    surely: _Names
    first: _Names
    silent: bool


def _is_surely_bound(prop: Property, clause: WithoutEvent) -> bool:
    bound = _bound(prop)
    own = bound[clause]
    before = _bound_before(prop, bound)[clause]
    have = own.surely if clause.side is Side.AFTER else own.first
    return not own.silent and {*clause.shared} <= have | before


def _bound(prop: Property) -> Mapping[Part, _Bound]:
    found: dict[Part, _Bound] = {}
    for part in prop.parts:
        inner = [found[one] for one in part.parts]
        busy = [one for one in inner if one.first or not one.silent]
        firsts = [one.first for one in busy]
        any_first = frozenset.intersection(*firsts) if firsts else _NONE
        silent = all(one.silent for one in inner)
        union = frozenset[str]().union(*(one.surely for one in inner))
        match part:
            case Event(pattern=pattern) | Times(pattern=pattern):
                names = frozenset(rigid_variables(pattern))
                found[part] = _Bound(names, names, silent=False)
            case Condition():
                found[part] = _Bound(_NONE, _NONE, silent=True)
            case Sequence():
                leading = busy[:1] if busy and not busy[0].silent else busy
                first = frozenset.intersection(*(one.first for one in leading)) if leading else _NONE
                found[part] = _Bound(union, first, silent)
            case All() | EndInOrder() | Within() | WithoutEvent():
                found[part] = _Bound(union, any_first, silent)
            case One():
                surely = frozenset.intersection(*(one.surely for one in inner)) if inner else _NONE
                found[part] = _Bound(surely, any_first, any(one.silent for one in inner))
            case AtLeast(need=need):
                names = frozenset(name for one in inner for name in one.surely)
                least = len(inner) - need + 1
                surely = frozenset(name for name in names if sum(name in one.surely for one in inner) >= least)
                found[part] = _Bound(surely, any_first, sum(one.silent for one in inner) >= need)
            case _:
                assert_never(part)
    return found


def _bound_before(prop: Property, bound: Mapping[Part, _Bound]) -> Mapping[Part, _Names]:
    """Return the variables that events before all events of a part bind, whatever is above it."""
    found: dict[Part, _Names] = {prop.root: _NONE}
    for part in reversed(prop.parts):
        before = found[part]
        for inner in part.parts:
            found[inner] = found[inner] & before if inner in found else before
            if isinstance(part, Sequence):
                before |= bound[inner].surely
    return found
