"""From a tree to a pattern, gate by gate: AND, OR and FOLLOWEDBY demand distinct observations, as matches of a tree do.

Where the parts of a gate share events or variables (a node with several parents, a guard on what another node observes), its scenarios are written one
by one. Where the order of one is none of AND and FOLLOWEDBY, two events without order are tried in both.
"""

import re
from collections.abc import Iterable, Iterator
from decimal import Decimal
from itertools import chain, combinations, groupby
from math import comb
from typing import TYPE_CHECKING, Final, NamedTuple, NoReturn

from backends.stix.comparisons import Unsaid, comparisons, step
from backends.stix.objects import EVENT, StixHeader, Way, property_of
from rvaft.analysis.normal_form import NormalForm, Op, Part, divided, normal_form
from rvaft.errors import NotExpressible, TooLarge, TreeError
from rvaft.model.guards import Guard, conjuncts, holds, variables
from rvaft.model.patterns import Literal, ObjectPattern, rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

if TYPE_CHECKING:
    import networkx as nx

_SECOND: Final = 1_000_000_000
_LONGEST: Final = 1_000 * 366 * 86_400 * _SECOND
_EXACT: Final = 1_000_000_000 * _SECOND
"""The longest window with a fraction of a second that the matcher does not round."""
_TOKEN: Final = re.compile(r"'(?:[^'\\]|\\.)*'|[\w.:-]+|\S", re.DOTALL)
_SIGNS: Final = {Op.ALL: "AND", Op.SEQUENCE: "FOLLOWEDBY", Op.ONE: "OR"}


class JoinedObservations(NamedTuple):
    """Operands joined by AND, OR or FOLLOWEDBY, or a single one; `size` is how many observation expressions they have."""

    sign: str
    operands: tuple[str, ...]
    size: int

    @property
    def one(self) -> bool:
        """Whether it is one observation, which is no span of time."""
        return len(self.operands) == 1 and self.operands[0][-1] == "]"

    def text(self, *, alone: bool = True) -> str:
        """As a pattern, or as an operand of others; equal observations are counted."""
        several = [(one, len([*same])) for one, same in groupby(self.operands)]
        if self.sign == "AND":
            several = [(one, self.operands.count(one)) for one in dict.fromkeys(self.operands)]
        written: list[str] = []
        for one, count in several:
            counted = count > 1 and one[0] == "[" and one[-1] == "]"
            written += [f"{one} REPEATS {count} TIMES"] if counted else [one] * count
        return f" {self.sign} ".join(written) if alone or len(written) == 1 else f"({f' {self.sign} '.join(written)})"


NEVER: Final = JoinedObservations("OR", (), 0)
"""An alternative of nothing: what no events are."""


class StixPattern:
    """One translation of a tree; `plain` is the same without counted leaves, `pand` and windows. `limit` counts observation expressions."""

    def __init__(self, tree: RVAFT, plain: RVAFT, semantics: Semantics, header: StixHeader, limit: int) -> None:
        self._tree, self._semantics, self._header, self._limit = plain, semantics, header, limit
        self._form = normal_form(plain)
        asked = {tree.origins.get(n.name, n.name): n.within for n in tree.top_down() if n.within is not None}
        for name, within in asked.items():
            if within < 1 or within % 1_000 or within > _LONGEST or (within > _EXACT and within % _SECOND):
                self._refuse("WITHIN is of whole microseconds, one or more, and of whole seconds beyond 30 years", name)
        origins = ((name, number, plain.origins.get(name, name)) for name, number in self._form.whole.items())
        self._windows = sorted((number, asked[origin], name) for name, number, origin in origins if origin in asked)
        events = ((n.name, plain.pattern(n.name)) for n in plain.top_down() if n.has_event)
        self._binds = {name: {*rigid_variables(pattern)} for name, pattern in events if pattern is not None}
        self._made = 0

    def text(self) -> tuple[str, int]:
        """The pattern with its header, and how many symbols it has without."""
        root = self._whole() if self._form.feasible else None
        if root is None or root is NEVER:
            message = f"no scenario of {self._tree.root} is feasible"
            raise TreeError(message, rule="no-scenario", nodes=[self._tree.root])
        return f"{self._header}{root.text()}", len(_TOKEN.findall(root.text()))

    def _refuse(self, reason: str, *nodes: str) -> NoReturn:
        named = dict.fromkeys(self._tree.origins.get(name, name) for name in nodes)
        raise NotExpressible(reason, backend="stix", semantics=self._semantics, nodes=named)

    def _fits(self, size: int) -> None:
        if size > self._limit:
            raise TooLarge("observation expressions of the pattern", limit=self._limit)

    # -- gate by gate; a part that asks for nothing is None

    def _whole(self) -> JoinedObservations | None:
        parts, kept = self._form.parts, self._form.kept()
        knots = self._knots(kept)
        reached, todo = set[int](), [self._form.root]
        while todo:
            if (number := todo.pop()) not in reached:
                reached.add(number)
                todo += () if number in knots else parts[number].parts
        found: dict[int, JoinedObservations | None] = {}
        for number in (number for number in kept if number in reached):
            if number in knots:
                made = self._joined("OR", self._scenarios(number))
            else:
                made = self._gate(parts[number], [found[one] for one in parts[number].parts])
            for window, within, _ in self._windows:
                if window == number and made is not None and made is not NEVER and not made.one:
                    seconds = format((Decimal(within) / _SECOND).normalize(), "f")
                    made = JoinedObservations("", (f"({made.text()}) WITHIN {seconds} SECONDS",), made.size)
            found[number] = made
        return found[self._form.root]

    def _knots(self, kept: Iterable[int]) -> set[int]:
        """The parts whose scenarios may have an event or a variable in two of their parts."""
        held: dict[int, frozenset[object]] = {}
        knots = set[int]()
        for number in kept:
            part = self._form.parts[number]
            asked: set[object] = {name for guard in self._foreign(part) for name in variables(guard)}
            if part.op is Op.EVENT:
                asked |= {number, *self._binds[part.node]}
            held[number] = frozenset(asked).union(*(held[one] for one in part.parts))
            several = part.op in (Op.ALL, Op.SEQUENCE) or (part.op is Op.AT_LEAST and part.need > 1)
            if several and len(held[number]) < sum(len(held[one]) for one in part.parts):
                knots.add(number)
        return knots

    def _local(self, node: str) -> list[Guard]:
        """What the guard of a node asks of the node's own event."""
        parts = conjuncts(self._tree.nodes[node].when) if node in self._binds else ()
        return [one for one in parts if self._binds[node].issuperset(variables(one))]

    def _foreign(self, part: Part) -> list[Guard]:
        """What a condition asks of the events of other nodes."""
        return [one for one in conjuncts(part.guard) if one not in self._local(part.node)]

    def _gate(self, part: Part, below: list[JoinedObservations | None]) -> JoinedObservations | None:
        if part.op in (Op.EVENT, Op.CONDITION):
            return self._event(part.node, ()) if part.op is Op.EVENT else None
        if part.op in _SIGNS:
            return self._joined(_SIGNS[part.op], below)
        some = [one for one in below if one is not None and one is not NEVER]
        need = part.need - below.count(None)
        if need <= 0:
            return None
        self._fits(comb(len(some), need))
        return self._joined("OR", (self._joined("AND", way) for way in combinations(some, need)))

    def _event(self, node: str, further: Iterable[Guard]) -> JoinedObservations:
        pattern, on = self._tree.pattern(node), self._tree.nodes[node].on
        assert pattern is not None, "only nodes with events are observed"
        match pattern:
            case ObjectPattern((("event", Literal(name)),)) if on is None or on.event not in self._header.types:
                kind = str(name)
            case _:
                kind = on.event if on else node

        def path(way: Way) -> str:
            names = ".".join(step(property_of(name)) for name in way)
            return self._header.path(kind, way) if self._header.types else f"{EVENT}:{names}"

        try:
            test = comparisons(pattern, [*self._local(node), *further], path)
        except Unsaid as reason:
            self._refuse(str(reason), node)
        if isinstance(test, bool):  # any event, or none
            test = f"{EVENT}:type {'=' if test else '!='} '{EVENT}'"
        return JoinedObservations("", (f"[{test}]",), 1)

    def _joined(self, sign: str, parts: Iterable[JoinedObservations | None]) -> JoinedObservations | None:
        some, size = list[JoinedObservations](), 0
        for one in parts:
            if one is None and sign == "OR":
                return None  # an alternative that asks for nothing
            if one is NEVER and sign != "OR":
                return NEVER
            if one is not None and one is not NEVER and not (sign == "OR" and one in some):
                some.append(one)
                size += one.size
                self._fits(size)
        if len(some) < 2:
            return some[0] if some else NEVER if sign == "OR" else None
        operands = [one.operands if one.sign == sign else (one.text(alone=False),) for one in some]
        flat = chain(*operands)
        return JoinedObservations(sign, tuple(dict.fromkeys(flat) if sign == "OR" else flat), size)

    # -- one scenario after the other

    def _scenarios(self, number: int) -> Iterator[JoinedObservations | None]:
        """The scenarios of a part, each as its own pattern."""
        inside = [name for window, _, name in self._windows if window < number]
        reached = NormalForm(self._form.parts[: number + 1], self._form.whole)
        if names := [name for name in inside if self._form.whole[name] in reached.kept()]:
            self._refuse("a window is over one expression, and parts that share something become several", *names)

        def choice(form: NormalForm) -> int | tuple[int, ...]:
            kept = form.kept()
            return next((one for one in reversed(kept) if form.parts[one].chooses), tuple(kept))

        self._made = 0
        for tried, (form, kept) in enumerate(divided(reached, choice, at_least=False)):
            self._fits(tried // 20)
            yield from self._scenario(form, kept)

    def _scenario(self, form: NormalForm, kept: tuple[int, ...]) -> Iterator[JoinedObservations | None]:
        """A scenario, if its order has no cycle."""
        import networkx as nx  # noqa: PLC0415 -- slow to import, and seldom needed

        inside: dict[int, set[int]] = {}
        order = nx.DiGraph()
        for number in kept:
            part = form.parts[number]
            inside[number] = {number} if part.op is Op.EVENT else set[int]().union(*(inside[one] for one in part.parts))
            order.add_nodes_from(inside[number])
            self._fits(len(order))
            earlier = set[int]()
            for one in part.parts if part.op is Op.SEQUENCE else ():
                order.add_edges_from((first, last) for first in earlier for last in inside[one])
                earlier |= inside[one]
        if not nx.is_directed_acyclic_graph(order):
            return
        nodes = {form.parts[number].node: number for number in sorted(order)}
        binder: dict[str, str] = {}
        for node in nodes:
            for name in self._binds[node]:
                if binder.setdefault(name, node) != node:
                    self._refuse(f"no pattern compares what two observations have, as with {name}", binder[name], node)
        further: dict[str, list[Guard]] = {node: [] for node in nodes}
        for guard in (guard for number in kept for guard in self._foreign(form.parts[number])):
            asked = dict.fromkeys(binder[name] for name in variables(guard))
            if not asked and not holds(guard, {}):
                return
            if not asked:
                continue
            if len(asked) > 1:
                self._refuse("no pattern compares what two observations have, as a guard does", *asked)
            further[next(iter(asked))].append(guard)
        self._events = {number: self._event(node, further[node]) for node, number in nodes.items()}
        yield self._arranged([*self._events], nx.transitive_closure_dag(order)) if nodes else None

    def _arranged(self, events: list[int], order: "nx.DiGraph") -> JoinedObservations | None:
        """The events of a scenario, or some of them, in their order."""
        import networkx as nx  # noqa: PLC0415 -- slow to import, and seldom needed

        if len(events) == 1:
            self._made += 1
            self._fits(self._made)
            return self._events[events[0]]
        own = order.subgraph(events).to_undirected()
        for sign, graph in (("AND", own), ("FOLLOWEDBY", nx.complement(own))):
            groups = [sorted(group) for group in nx.connected_components(graph)]
            if len(groups) > 1:
                groups.sort(key=lambda group: (order.in_degree(group[0]) if sign == "FOLLOWEDBY" else 0, group[0]))
                return self._joined(sign, [self._arranged(group, order) for group in groups])
        pair = next((one, other) for one, other in combinations(events, 2) if not own.has_edge(one, other))
        ways = []
        for both in (pair, pair[::-1]):
            further = nx.DiGraph(order)
            further.add_edge(*both)
            ways.append(self._arranged(events, nx.transitive_closure_dag(further)))
        return self._joined("OR", ways)
