"""The events of a tree as a nest of parts: one event, all parts, one of them, some of them, or parts in sequence; for languages that say these.

It is made gate by gate. Where the parts of a node share events or variables (a node with several parents, a guard on what another node observes), its
scenarios are said one by one; where the order of one is no nest, two events without order are tried in both. Matches are of distinct events.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb
from typing import Final, NoReturn, TypeAlias

import networkx as nx

from backends.orders import Orders
from rvaft.analysis.normal_form import Op, body, is_impossible
from rvaft.analysis.scenarios import Kept, Resolutions, event, precedence
from rvaft.errors import TooLarge, TreeError
from rvaft.model.guards import Guard, conjuncts, variables
from rvaft.model.nodes import Causality
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.model.tree import RVAFT, reachable

Refusal: TypeAlias = Callable[[str, Iterable[str]], NoReturn]
"""Raises why nodes cannot be said: a `TIE` of events, or a `WINDOW` over parts that become several."""
TIE: Final = "tie"
WINDOW: Final = "window"


@dataclass(frozen=True, slots=True)
class Nest:
    """An event of a node that fulfils guards, or parts, of which `need` are asked for, within a time; `size` is how many events are written."""

    op: Op
    parts: tuple["Nest", ...] = ()
    need: int = 0
    node: str = ""
    guards: tuple[Guard, ...] = ()
    within: int | None = None
    size: int = 0

    def inside(self) -> Iterator["Nest"]:
        """The nest and all in it."""
        yield self
        for part in self.parts:
            yield from part.inside()

    def nodes(self) -> list[str]:
        """The nodes whose events it has, each as often as it is written."""
        return [one.node for one in self.inside() if one.op is Op.EVENT]

    def during(self, within: int | None) -> "Nest":
        """The nest within a time, the shorter one if it has another; a single event takes none.

        >>> both = joined(Op.ALL, [Nest(Op.EVENT, node="a"), Nest(Op.EVENT, node="b")])
        >>> both.during(5).during(9).within, both.parts[0].during(5).within
        (5, None)
        """
        asked = [one for one in (self.within, within) if one is not None]
        return replace(self, within=min(asked)) if asked and self.parts else self

    def ways(self) -> "Nest":
        """One of all that it asks for, where it asks for some."""
        several = (joined(Op.ALL, some) for some in combinations(self.parts, self.need))
        return replace(joined(Op.ONE, several), within=self.within) if self.op is Op.AT_LEAST else self


NOTHING: Final = Nest(Op.ALL)
"""What is there at once."""
NEVER: Final = Nest(Op.ONE)
"""What no events are."""


def joined(op: Op, parts: Iterable[Nest], need: int = 0) -> Nest:
    """Parts under one operator, nothing that means nothing among them.

    >>> joined(Op.ALL, [NOTHING, a := Nest(Op.EVENT, node="a", size=1)]) == a, joined(Op.SEQUENCE, [a, NEVER]) == NEVER
    (True, True)
    """
    found = list[Nest]()
    for one in parts:
        found += one.parts if one.op is op and one.within is None and op is not Op.AT_LEAST else [one]
    if op is Op.ONE and NOTHING in found:
        return NOTHING
    if op in (Op.ALL, Op.SEQUENCE) and NEVER in found:
        return NEVER
    need = max(0, need - found.count(NOTHING))
    found = [one for one in found if one not in (NOTHING, NEVER)]
    if op is Op.AT_LEAST and need in (0, 1, len(found)):
        return joined(Op.ONE if need == 1 else Op.ALL, found if need else ())
    if op is Op.AT_LEAST and need > len(found):
        return NEVER
    size = sum(one.size for one in found) * (comb(len(found) - 1, need - 1) if op is Op.AT_LEAST else 1)
    return (
        found[0]
        if len(found) == 1
        else NOTHING
        if not found and op is not Op.ONE
        else Nest(op, tuple(found), need, size=size)
    )


def in_every_order(tree: RVAFT, *, limit: int) -> Nest:
    """A plain tree without guards as one of all orders in which its events can come, those with the same pattern being one; raises `TooLarge`.

    >>> from rvaft import loads
    >>> [part.nodes() for part in in_every_order(loads("top and a b;"), limit=9).parts]
    [['a', 'b'], ['b', 'a']]
    """
    orders = Orders(tree, limit=limit, apart=tree.nodes)
    first: dict[Pattern | None, Nest] = {}
    words = dict[tuple[Nest, ...], None]()
    for kept in orders.scenarios():
        events = [Nest(Op.EVENT, node=name, size=1) for name in kept if tree.nodes[name].has_event]
        words |= dict.fromkeys(
            orders.words(kept, {one.node: first.setdefault(tree.pattern(one.node), one) for one in events})
        )
    return joined(Op.ONE, [joined(Op.SEQUENCE, word) for word in words])


class Nesting:
    """The nest of a plain tree, whose nodes have `windows`. Variables that are `free` tie nothing. Raises `TooLarge` beyond `limit` of what the `unit` says.

    >>> from rvaft import loads
    >>> def refused(*_): raise ValueError
    >>> made = Nesting(loads("top sand a g; g and b c;"), {}, refused, limit=9, unit="events").nest()
    >>> made.op.name, made.parts[1].op.name, made.size
    ('SEQUENCE', 'ALL', 3)
    """

    def __init__(
        self,
        tree: RVAFT,
        windows: Mapping[str, int],
        refusal: Refusal,
        *,
        limit: int,
        unit: str,
        free: Container[str] = (),
    ) -> None:
        self._tree, self._windows, self._refuse, self._limit, self._unit = tree, windows, refusal, limit, unit
        patterns = ((n.name, tree.pattern(n.name)) for n in tree.top_down() if n.has_event)
        self._binds = {
            name: {one for one in rigid_variables(pattern) if one not in free} for name, pattern in patterns if pattern
        }
        assert not free or not any(variables(node.when) for node in tree.nodes.values()), "a guard ties what is free"
        self._shapes = {name: body(node) for name, node in tree.nodes.items()}

    def nest(self) -> Nest:
        """The whole tree, NEVER if no feasible scenario can be detected.

        Raises what the refusal raises, and `TreeError` where no scenario is feasible.
        """
        impossible = {node.name for node in self._tree.top_down() if is_impossible(node)}
        kept: Kept = Resolutions(self._tree, impossible).union
        knots, reached = self._knots(kept), {self._tree.root}
        for name, below in kept.items():
            reached.update(below if name in reached and name not in knots else ())
        found: dict[str, Nest] = {}
        for name in (name for name in reversed([*kept]) if name in reached):
            if name in knots:
                made = joined(Op.ONE, self._scenarios(name, kept))
            else:
                made = self._gate(name, [found[one] for one in self._shapes[name].children if one in kept[name]])
            self._fits(made.size)
            found[name] = made.during(self._windows.get(name))
        whole = found.get(self._tree.root, NEVER)
        if whole == NOTHING:
            message = f"a scenario of {self._tree.root} has no event"
            raise TreeError(message, rule="silent-scenario", nodes=[self._tree.root])
        if whole == NEVER:  # in a feasible scenario guards with variables may never hold
            next(Orders(self._tree, limit=self._limit, apart=self._tree.nodes).scenarios())
        return whole

    def _fits(self, size: int) -> None:
        if size > self._limit:
            raise TooLarge(self._unit, limit=self._limit)

    def _knots(self, kept: Kept) -> set[str]:
        """The nodes whose scenarios may have an event or a variable in two of their parts."""
        held: dict[str, set[object]] = {}
        knots = set[str]()
        for name in reversed([*kept]):
            below = [held[child] for child in kept[name]]
            own: set[object] = {event(name), *self._binds[name]} if name in self._binds else set()
            asked = conjuncts(self._tree.nodes[name].when)
            foreign: set[object] = {one for guard in asked if guard not in self._own(name) for one in variables(guard)}
            parts = [own, foreign, *([set[object]().union(*below)] if self._shapes[name].need == 1 else below)]
            held[name] = set[object]().union(*parts)
            if len(held[name]) < sum(map(len, parts)):
                knots.add(name)
        return knots

    def _own(self, name: str) -> list[Guard]:
        """What the guard of a node asks of the node's own event."""
        asked = conjuncts(self._tree.nodes[name].when) if name in self._binds else ()
        return [one for one in asked if self._binds[name].issuperset(variables(one))]

    def _gate(self, name: str, below: list[Nest]) -> Nest:
        shape = self._shapes[name]
        found = joined(shape.op, below, shape.need)
        own = Nest(Op.EVENT, node=name, guards=tuple(self._own(name)), size=1) if name in self._binds else NOTHING
        return joined(Op.SEQUENCE, (own, found) if self._tree.causality is Causality.TOP_DOWN else (found, own))

    # -- one scenario after the other

    def _scenarios(self, root: str, alive: Kept) -> Iterator[Nest]:
        """The scenarios of a node and what is below it, each as a nest."""
        if inside := [name for name in reachable(root, alive.__getitem__) if name in self._windows and name != root]:
            self._refuse(WINDOW, inside)
        names = reachable(root, lambda name: self._tree.nodes[name].children)
        part = self._tree.changed(root=root, nodes=[self._tree.nodes[name] for name in names])
        orders = Orders(part, limit=self._limit, apart=part.nodes)
        self._made = 0
        with suppress(TreeError):  # none is feasible
            for kept in orders.scenarios():
                binds = {name: self._binds[name] for name in kept if name in self._binds}
                self._fits(len(binds))
                for (one, have), (other, has) in combinations(binds.items(), 2):
                    if have & has:
                        self._refuse(min(have & has), (one, other))
                if asked := orders.asked(kept, binds, lambda node, _: self._refuse(TIE, [node])):
                    said = {name: Nest(Op.EVENT, node=name, guards=tuple(asked[name]), size=1) for name in binds}
                    before = nx.transitive_closure_dag(precedence(part, kept)).subgraph(map(event, binds))
                    yield self._arranged(said, nx.relabel_nodes(before, {event(name): name for name in binds}))
                elif asked is not None:
                    yield NOTHING

    def _arranged(self, said: Mapping[str, Nest], order: nx.DiGraph) -> Nest:
        """Some events of a scenario in their order."""
        if len(said) == 1:
            self._made += 1
            self._fits(self._made)
            return next(iter(said.values()))
        own = order.subgraph(said).to_undirected()
        for op, graph in ((Op.ALL, own), (Op.SEQUENCE, nx.complement(own))):
            found = [[name for name in said if name in group] for group in nx.connected_components(graph)]
            if len(found) > 1:
                place = [*said].index
                found.sort(key=lambda names: (order.in_degree(names[0]) if op is Op.SEQUENCE else 0, place(names[0])))
                return joined(op, [self._arranged({name: said[name] for name in names}, order) for names in found])
        pair = next(pair for pair in combinations(said, 2) if not own.has_edge(*pair))
        ways = [nx.transitive_closure_dag(nx.DiGraph([*order.edges, both])) for both in (pair, pair[::-1])]
        return joined(Op.ONE, [self._arranged(said, way) for way in ways])
