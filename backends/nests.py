"""Properties as series-parallel expressions: event, all, one, at least k, or sequence.

Scenarios are written one by one if parts share events or variables (shared nodes, guards over
several nodes). If the order of a scenario is not series-parallel, two unordered events are tried in
both orders. Matches use distinct events.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb
from typing import TYPE_CHECKING, Final, NoReturn, TypeAlias, assert_never

from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    PartKind,
    Property,
    Sequence,
    Times,
    Within,
    WithoutEvent,
    parts_below,
)
from rvaft.errors import TooLarge, TreeError
from rvaft.model.guards import Guard, conjuncts, variables
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.support.bits import bits

if TYPE_CHECKING:
    import networkx as nx

Refusal: TypeAlias = Callable[[str, Iterable[str]], NoReturn]
"""Raises a refusal for nodes: a `TIE` of events, or a `WINDOW` over a duplicated part."""
TIE: Final = "tie"
WINDOW: Final = "window"


@dataclass(frozen=True, slots=True)
class Nest:
    """An event under guards, or an operator over parts, of which it requires `need`, within a
    duration.

    `size` counts the written events.
    """

    op: PartKind
    parts: tuple["Nest", ...] = ()
    need: int = 0
    event: Event | None = None
    guards: tuple[Guard, ...] = ()
    within: int | None = None
    size: int = 0

    def inside(self) -> Iterator["Nest"]:
        """Yield the nest and all nests in it."""
        yield self
        for part in self.parts:
            yield from part.inside()

    def events(self) -> list[Event]:
        """Return its events with repetitions."""
        return [one.event for one in self.inside() if one.event is not None]

    def nodes(self) -> list[str]:
        """Return the nodes of its events with repetitions."""
        return [event.source.node for event in self.events()]

    def during(self, within: int | None) -> "Nest":
        """Return the nest with the shorter of both windows; a single event has no window.

        >>> both = joined(PartKind.ALL, [Nest(PartKind.EVENT, size=1), Nest(PartKind.EVENT, size=2)])
        >>> both.during(5).during(9).within, both.parts[0].during(5).within
        (5, None)
        """
        windows = [one for one in (self.within, within) if one is not None]
        return replace(self, within=min(windows)) if windows and self.parts else self

    def ways(self) -> "Nest":
        """Return an at-least-k nest as a choice of conjunctions."""
        several = (joined(PartKind.ALL, some) for some in combinations(self.parts, self.need))
        return replace(joined(PartKind.ONE, several), within=self.within) if self.op is PartKind.AT_LEAST else self


NOTHING: Final = Nest(PartKind.ALL)
"""A nest that is satisfied at once."""
NEVER: Final = Nest(PartKind.ONE)
"""A nest that no events satisfy."""


def joined(op: PartKind, parts: Iterable[Nest], need: int = 0) -> Nest:
    """Return parts under one operator, simplified.

    >>> a = Nest(PartKind.EVENT, size=1)
    >>> joined(PartKind.ALL, [NOTHING, a]) == a, joined(PartKind.SEQUENCE, [a, NEVER]) == NEVER
    (True, True)
    """
    found = list[Nest]()
    for one in parts:
        found += one.parts if one.op is op and one.within is None and op is not PartKind.AT_LEAST else [one]
    if op is PartKind.ONE and NOTHING in found:
        return NOTHING
    if op in (PartKind.ALL, PartKind.SEQUENCE) and NEVER in found:
        return NEVER
    need = max(0, need - found.count(NOTHING))
    found = [one for one in found if one not in (NOTHING, NEVER)]
    if op is PartKind.AT_LEAST and need in (0, 1, len(found)):
        return joined(PartKind.ONE if need == 1 else PartKind.ALL, found if need else ())
    if op is PartKind.AT_LEAST and need > len(found):
        return NEVER
    size = sum(one.size for one in found) * (comb(len(found) - 1, need - 1) if op is PartKind.AT_LEAST else 1)
    return (
        found[0]
        if len(found) == 1
        else NOTHING
        if not found and op is not PartKind.ONE
        else Nest(op, tuple(found), need, size=size)
    )


def in_every_order(prop: Property, refusal: Refusal, *, limit: int) -> Nest:
    """Return a property as the choice of all its event orders.

    Events with equal patterns and guards are equal. Raises `TooLarge`, and the error of `refusal`
    for guards over several events.

    >>> from rvaft import loads
    >>> from rvaft.core.restriction import property_of
    >>> def refused(*_): raise ValueError
    >>> [part.nodes() for part in in_every_order(property_of(loads("top and a b;")), refused, limit=9).parts]
    [['a', 'b'], ['b', 'a']]
    """
    from backends.orders import Orders  # noqa: PLC0415 -- imported on use

    orders = Orders(prop, limit=limit, grouped=False)
    first: dict[tuple[Pattern, tuple[Guard, ...]], Nest] = {}
    words = dict[tuple[Nest, ...], None]()
    for scenario in orders.scenarios():
        known = {event: frozenset(rigid_variables(event.pattern)) for event in scenario.events}
        guards = orders.assigned_guards(scenario, known, lambda node, _: refusal(TIE, [node]))
        if guards is None:
            continue
        letters = {
            one: first.setdefault((one.pattern, tuple(own)), Nest(PartKind.EVENT, event=one, guards=tuple(own), size=1))
            for one, own in guards.items()
        }
        words |= dict.fromkeys(orders.words(scenario, letters))
    return joined(PartKind.ONE, [joined(PartKind.SEQUENCE, word) for word in words])


class Nesting:
    """The nest of a property without counted events and ends in order; `free` variables bind
    nothing.

    Raises `TooLarge` beyond `limit` of the `unit`.

    >>> from rvaft import loads
    >>> from rvaft.core.restriction import property_of
    >>> def refused(*_): raise ValueError
    >>> made = Nesting(property_of(loads("top sand a g; g and b c;")), refused, limit=9, unit="events").nest()
    >>> made.op.name, made.parts[1].op.name, made.size
    ('SEQUENCE', 'ALL', 3)
    """

    def __init__(self, prop: Property, refusal: Refusal, *, limit: int, unit: str, free: Container[str] = ()) -> None:
        self._prop, self._refuse, self._limit, self._unit = prop, refusal, limit, unit
        self._own_variables = {event: frozenset(rigid_variables(event.pattern)) for event in prop.events}
        asked = (guard for part in prop.parts if isinstance(part, All) for guard in self._foreign(part))
        tied = {name for guard in asked for name in variables(guard)}  # by a guard that is not of one event
        self._binds = {
            event: frozenset(one for one in names if one in tied or one not in free)
            for event, names in self._own_variables.items()
        }
        self._made_nests: dict[tuple[Part, tuple[Guard, ...]], Nest] = {}
        self._knots = self._found_knots()

    def nest(self) -> Nest:
        """Return the whole property, or NEVER if no feasible scenario can be detected.

        Raises the errors of `refusal`, and `TreeError` without a feasible scenario.
        """
        found, root = self._nest(self._prop.root, ()), self._prop.tree.root
        if found == NOTHING:
            raise TreeError(f"a scenario of {root} has no event", rule="silent-scenario", nodes=[root])
        if found == NEVER:  # guards with variables may never hold in a feasible scenario
            from backends.orders import Orders  # noqa: PLC0415 -- imported on use

            next(Orders(self._prop, limit=self._limit, grouped=False).scenarios())
        return found

    def _fits(self, size: int) -> None:
        if size > self._limit:
            raise TooLarge(self._unit, limit=self._limit)

    def _found_knots(self) -> set[Part]:
        """Return the parts with scenarios that have an event or variable in two children."""
        held: dict[Part, set[object]] = {}
        knots = set[Part]()
        for part in self._prop.parts:
            inner = [held[one] for one in part.parts if not isinstance(one, Condition) or not isinstance(part, All)]
            match part:
                case Event():
                    held[part] = {part, *self._binds[part]}
                    continue
                case Condition(guard=guard):
                    held[part] = set(variables(guard))
                    continue
                case One():
                    inner = [set[object]().union(*inner)]
                case All():
                    inner.append({name for guard in self._foreign(part) for name in variables(guard)})
                case AtLeast() | Sequence() | Within() | WithoutEvent():
                    pass
                case Times() | EndInOrder():
                    raise AssertionError("passes remove these before")
                case _:
                    assert_never(part)
            held[part] = set[object]().union(*inner)
            if len(held[part]) < sum(map(len, inner)):
                knots.add(part)
        return knots

    def _own_event(self, part: All) -> Event | None:
        node = part.source.node if part.source is not None else None
        agenda: list[Part] = [one for one in part.parts if not isinstance(one, Condition)]
        while agenda:
            one = agenda.pop()
            if one.source is not None and one.source.node == node:
                if isinstance(one, Event):
                    return one
                agenda += one.parts
        return None

    def _asked(self, part: All) -> list[Guard]:
        return [guard for one in part.parts if isinstance(one, Condition) for guard in conjuncts(one.guard)]

    def _own(self, part: All) -> tuple[Guard, ...]:
        event = self._own_event(part)
        known = frozenset[str]() if event is None else self._own_variables[event]
        return tuple(guard for guard in self._asked(part) if known.issuperset(variables(guard)))

    def _foreign(self, part: All) -> list[Guard]:
        own = self._own(part)
        return [guard for guard in self._asked(part) if guard not in own]

    def _nest(self, part: Part, guards: tuple[Guard, ...]) -> Nest:
        if (part, guards) not in self._made_nests:
            found = joined(PartKind.ONE, self._scenarios(part)) if part in self._knots else self._gate(part, guards)
            self._fits(found.size)
            self._made_nests[part, guards] = found
        return self._made_nests[part, guards]

    def _gate(self, part: Part, guards: tuple[Guard, ...]) -> Nest:
        def below() -> list[Nest]:
            inner = (one for one in part.parts if not isinstance(one, Condition))
            return [self._nest(one, guards if self._same_node(part, one) else ()) for one in inner]

        match part:
            case Event():
                return Nest(PartKind.EVENT, event=part, guards=guards, size=1)
            case Condition():
                return NOTHING
            case All():
                guards = (*guards, *self._own(part))
                return joined(PartKind.ALL, below())
            case Sequence():
                return joined(PartKind.SEQUENCE, below())
            case One():
                return joined(PartKind.ONE, [self._nest(one, ()) for one in part.parts])
            case AtLeast(need=need):
                return joined(PartKind.AT_LEAST, [self._nest(one, ()) for one in part.parts], need)
            case Within(parts=(whole,), duration=duration):
                return self._nest(whole, guards).during(duration)
            case Within() | Times() | EndInOrder() | WithoutEvent():
                raise AssertionError("passes remove these before")
            case _:
                assert_never(part)

    @staticmethod
    def _same_node(part: Part, inner: Part) -> bool:
        return part.source is not None and inner.source is not None and part.source.node == inner.source.node

    # One scenario after the other.

    def _scenarios(self, root: Part) -> Iterator[Nest]:
        import networkx as nx  # noqa: PLC0415 -- imported on use

        if inside := [one.source.node for one in parts_below(root) if isinstance(one, Within)]:
            self._refuse(WINDOW, inside)
        from backends.orders import Orders  # noqa: PLC0415 -- imported on use

        orders = Orders(self._prop.with_root(root), limit=self._limit, grouped=False)
        self._made = 0
        with suppress(TreeError):  # no feasible scenario
            for scenario in orders.scenarios():
                binds = {event: self._binds[event] for event in scenario.events}
                self._fits(len(binds))
                for (one, have), (other, has) in combinations(binds.items(), 2):
                    if have & has:
                        self._refuse(min(have & has), (one.source.node, other.source.node))
                known = {event: self._own_variables[event] for event in scenario.events}
                guards = orders.assigned_guards(scenario, known, lambda node, _: self._refuse(TIE, [node]))
                if guards:
                    leaves = {
                        event: Nest(PartKind.EVENT, event=event, guards=tuple(guards[event]), size=1) for event in binds
                    }
                    order = nx.DiGraph()
                    order.add_nodes_from(leaves)
                    for event, before in zip(scenario.events, scenario.before, strict=True):
                        order.add_edges_from((scenario.events[earlier], event) for earlier in bits(before))
                    yield self._arranged(leaves, order)
                elif guards is not None:
                    yield NOTHING

    def _arranged(self, leaves: Mapping[Event, Nest], order: "nx.DiGraph") -> Nest:
        import networkx as nx  # noqa: PLC0415 -- imported on use

        if len(leaves) == 1:
            self._made += 1
            self._fits(self._made)
            return next(iter(leaves.values()))
        own = order.subgraph(leaves).to_undirected()
        for op, graph in ((PartKind.ALL, own), (PartKind.SEQUENCE, nx.complement(own))):
            found = [[one for one in leaves if one in group] for group in nx.connected_components(graph)]
            if len(found) > 1:
                place = [*leaves].index
                found.sort(
                    key=lambda some: (order.in_degree(some[0]) if op is PartKind.SEQUENCE else 0, place(some[0]))
                )
                return joined(op, [self._arranged({one: leaves[one] for one in some}, order) for some in found])
        pair = next(pair for pair in combinations(leaves, 2) if not own.has_edge(*pair))
        ways = [nx.transitive_closure_dag(nx.DiGraph([*order.edges, both])) for both in (pair, pair[::-1])]
        return joined(PartKind.ONE, [self._arranged(leaves, way) for way in ways])
