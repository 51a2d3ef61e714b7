"""Enumeration of the scenarios of a property (semantics, section 2)."""

from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import prod
from typing import Final, NamedTuple, assert_never

from rvaft.core.precedence import Edge, event_order
from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    Kept,
    One,
    Part,
    Property,
    Sequence,
    Times,
    Within,
    WithoutEvent,
    chooses,
    fewest,
    kept_ways,
    parts_below,
)
from rvaft.errors import TooLarge
from rvaft.model.guards import holds, variables
from rvaft.support.bits import bits

LIMIT: Final = 5_000
"""The default maximum number of scenarios."""


def is_constant(guard_of: Condition) -> bool:
    """Whether a condition has neither variables nor time points."""
    return not variables(guard_of.guard)


def observable(parts: Iterable[Part]) -> set[Part]:
    """Return the parts (inner parts first) that no false constant condition makes impossible."""
    found: set[Part] = set()
    for part in parts:
        match part:
            case Event() | Times():
                possible = True
            case Condition():
                possible = not is_constant(part) or holds(part.guard, {})
            case One() | AtLeast():
                possible = sum(inner in found for inner in part.parts) >= fewest(part)
            case All() | Sequence() | EndInOrder() | Within() | WithoutEvent():
                possible = all(inner in found for inner in part.parts)
            case _:
                assert_never(part)
        if possible:
            found.add(part)
    return found


def most_events(parts: Iterable[Part]) -> dict[Part, int]:
    """Return each part's maximum number of events, capped at 2 (inner parts first)."""
    most: dict[Part, int] = {}
    for part in parts:
        inner = [most[subpart] for subpart in part.parts]
        match part:
            case Event():
                most[part] = 1
            case Times(count=count):
                most[part] = min(2, count)
            case One():
                most[part] = max(inner, default=0)
            case Condition() | All() | Sequence() | AtLeast() | EndInOrder() | Within() | WithoutEvent():
                most[part] = min(2, sum(inner))
            case _:
                assert_never(part)
    return most


def most_scenarios(prop: Property) -> int:
    """Return an upper bound on the number of scenarios.

    It is exact if all are feasible and no part is shared.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> most_scenarios(build(rvaft.loads("top 2of3 a b c;")))
    4
    """
    ways: dict[Part, int] = {}
    for part in prop.parts:
        inside = [ways[inner] for inner in part.parts]
        match part:
            case One():
                ways[part] = sum(inside)
            case AtLeast(need=need):
                keeping = [1, *([0] * len(inside))]  # the number of ways to keep exactly k parts
                for of_part in inside:
                    keeping = [keeping[0], *(more + of_part * fewer for fewer, more in pairwise(keeping))]
                ways[part] = sum(keeping[need:])
            case Event() | Times() | Condition() | All() | Sequence() | EndInOrder() | Within() | WithoutEvent():
                ways[part] = prod(inside)
            case _:
                assert_never(part)
    return ways[prop.root]


class Fewest(NamedTuple):
    """The minimum number of events, and the direct subparts kept for it."""

    events: int
    kept: tuple[Part, ...]


def fewest_events(
    parts: Iterable[Part], *, without: Container[Part] = frozenset(), without_edges: Container[Edge] = frozenset()
) -> dict[Part, Fewest]:
    """Return the minimum number of events of each possible part; a shared part counts each time.

    `parts` lists inner parts first.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> prop = build(rvaft.loads("top 2of3 a b c;"))
    >>> fewest_events(prop.parts)[prop.root].events
    2
    """
    found: dict[Part, Fewest] = {}
    for part in parts:
        able = [inner for inner in part.parts if inner in found and (part, inner) not in without_edges]
        if part in without or len(able) < fewest(part):
            continue
        chosen = set(sorted(able, key=lambda inner: found[inner].events)[: fewest(part)])
        kept = tuple(inner for inner in part.parts if inner in chosen)
        own = part.count if isinstance(part, Times) else 1 if isinstance(part, Event) else 0
        found[part] = Fewest(own + sum(found[inner].events for inner in kept), kept)
    return found


def resolutions(prop: Property, *, minimal: bool = False, limit: int = LIMIT) -> Iterator[Kept]:
    """Iterate over the ways to make the choices, without impossible parts, in a stable order.

    `minimal` keeps exactly `need` parts of an `AtLeast`. Event order is ignored. Raises `TooLarge`.
    """
    order = prop.parts[::-1]
    place = {part: number for number, part in enumerate(order)}
    possible = observable(prop.parts)
    surely: dict[Part, int] = {}
    """For each part, the parts below it up to the next choices."""
    for part in prop.parts:
        below = 0
        for inner in () if isinstance(part, One | AtLeast) else part.parts:
            below |= surely[inner]
        surely[part] = 1 << place[part] | below
    gates = [part for part in order if isinstance(part, One | AtLeast)]

    def further(reached: int, chosen: Kept, gate: Part) -> Iterator[tuple[int, Kept]]:
        options = [part for part in gate.parts if part in possible]
        least = fewest(gate)
        most = least if minimal or isinstance(gate, One) else len(options)
        for kept in kept_ways(options, least, most):
            now = reached
            for part in kept:
                now |= surely[part]
            yield now, {**chosen, gate: kept}

    # One level per choice; an item has the reached parts and all choices so far.
    levels: list[Iterator[tuple[int, Kept]]] = [iter([(surely[prop.root], {})] if prop.root in possible else [])]
    count = 0
    while levels:
        reached, chosen = next(levels[-1], (0, {}))
        if not reached:
            levels.pop()
        elif len(levels) > len(gates):
            count += 1
            if count > limit:
                raise TooLarge("scenarios of the tree", limit=limit)
            yield {order[i]: chosen.get(order[i], order[i].parts) for i in bits(reached)}
        elif reached >> place[gate := gates[len(levels) - 1]] & 1:
            levels.append(further(reached, chosen, gate))
        else:
            levels.append(iter([(reached, chosen)]))


@dataclass(frozen=True, eq=False)
class Scenario:
    """A partial order of events, with conditions.

    `before[i]` has the events that precede `events[i]`, as bits.
    """

    events: tuple[Event, ...]
    before: tuple[int, ...]
    conditions: tuple[Condition, ...]
    kept: Kept

    def events_below(self, part: Part) -> tuple[Event, ...]:
        """Return the events at and below a kept part, in the order of `events`."""
        below = frozenset[Part](parts_below(part, lambda inner: self.kept[inner]))
        return tuple(event for event in self.events if event in below)

    @property
    def absences(self) -> tuple[tuple[WithoutEvent, tuple[Event, ...]], ...]:
        """The kept clauses of absent events, each with the events of its part."""
        return tuple((part, self.events_below(part)) for part in self.kept if isinstance(part, WithoutEvent))


def scenarios(prop: Property, *, minimal: bool = False, limit: int = LIMIT) -> Iterator[Scenario]:
    """Iterate over the feasible scenarios, in a stable order; raises `TooLarge`.

    The property has no `Times` and `EndInOrder`.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> found, = scenarios(build(rvaft.loads("top sand a b;")))
    >>> [event.source.node for event in found.events], found.before
    (['a', 'b'], (0, 1))
    """
    for kept in resolutions(prop, minimal=minimal, limit=limit):
        found = event_order(kept)
        if found is not None:
            conditions = tuple(part for part in kept if isinstance(part, Condition) and not is_constant(part))
            yield Scenario(*found, conditions, kept)


def is_empty(prop: Property, *, limit: int = LIMIT) -> bool:
    """Whether no scenario is feasible."""
    return next(scenarios(prop, limit=limit), None) is None


def unchosen(root: Part) -> bool:
    """Whether a choice at or below a part is still open."""
    return any(map(chooses, parts_below(root)))
