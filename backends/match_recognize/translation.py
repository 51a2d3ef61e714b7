"""From a tree to queries: one for each order in which the events of a scenario may come, each a row pattern with a condition for each event."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations, count
from typing import Final

import networkx as nx

from backends.match_recognize.conditions import ALWAYS, NEVER, NoCondition, RowConditions
from backends.match_recognize.rows import FittingEvent, RowHeader, ValueColumn
from rvaft.analysis.scenarios import Kept, event, precedence, resolutions
from rvaft.backend import Metrics
from rvaft.errors import NotExpressible, TooLarge, TreeError
from rvaft.model.event_time import TIME
from rvaft.model.guards import Guard, conjuncts, holds, variables
from rvaft.model.patterns import ObjectPattern, Variable, rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

_SCENARIOS: Final = 2_000
_LENGTH: Final = 20_000
"""The most characters of the conditions of one order."""
_ILLEGAL: Final = re.compile(r"[^a-z0-9]+")
_TOKEN: Final = re.compile(r"'(?:[^']|'')*'|\w+(?:\.\d+\w*)?|[<>]=|<>|[^\s\w]")
_NOTHING: Final = "SELECT trace, pos AS found FROM events WHERE FALSE"
_RESERVED: Final = {"trace", "pos", "ts", "is_relevant", "is_ignored"}


class RowPatternQueries:
    """One translation. Raises `NotExpressible`, `TooLarge` beyond `limit` row variables of all orders, `TreeError` without a feasible scenario."""

    def __init__(self, tree: RVAFT, semantics: Semantics, limit: int) -> None:
        self._tree, self._semantics, self._limit = tree, semantics, limit
        self._size = 0
        self._header = RowHeader(time=tree.time)
        self._patterns = {name: pattern for name in tree.occurrences if (pattern := tree.pattern(name)) is not None}
        fields = (
            one.fields for one in self._patterns.values() if tree.time is not None and isinstance(one, ObjectPattern)
        )
        self._times = frozenset(p.name for pairs in fields for f, p in pairs if f == TIME and isinstance(p, Variable))
        self._columns: dict[FittingEvent, str] = {}
        self._taken = set(_RESERVED)

    def text(self) -> tuple[str, Metrics]:
        """The text and its sizes."""
        projects = self._semantics in (Semantics.PROJECTED, Semantics.CONSECUTIVE)
        table = f"(SELECT * FROM events WHERE {self._relevance()})" if projects else "events"  # noqa: S608 (names of columns)
        queries: dict[str, None] = {}
        feasible = False
        for kept in resolutions(self._tree, minimal=self._semantics is Semantics.SCATTERED, limit=_SCENARIOS):
            points = precedence(self._tree, kept)
            if not nx.is_directed_acyclic_graph(points):
                continue
            feasible = True
            for order, conditions in self._orders(kept, points):
                queries[self._query(table, len(order), conditions)] = None
        if not feasible:
            message = f"no scenario of {self._tree.root} is feasible"
            raise TreeError(message, rule="no-scenario", nodes=[self._tree.root])
        for fitting, column in self._columns.items():
            self._header.fitting[column] = [fitting]
        written = "\nUNION ALL\n".join(queries) or _NOTHING
        return f"{self._header}{written}\n", Metrics(len(_TOKEN.findall(written)), subformulas=self._size)

    def _relevance(self) -> str:
        """Which rows are looked at."""
        whole = ((entry.pattern, entry.when) for entry in self._tree.alphabet)
        ignored = ((self._tree.instantiate(ignore.on), ignore.when) for ignore in self._tree.ignores)
        for column, pairs in (("is_relevant", whole), ("is_ignored", ignored)):
            several = [FittingEvent(pattern, () if when is None else (when,)) for pattern, when in pairs]
            if several:
                self._header.fitting[column] = [*dict.fromkeys(several)]
        start = "pos = 0 OR " if self._semantics is Semantics.PROJECTED else ""
        return start + " AND NOT ".join(self._header.fitting)

    def _orders(self, kept: Kept, points: nx.DiGraph) -> Iterator[tuple[tuple[str, ...], list[str]]]:
        """The orders of the events of a scenario, with the condition of each event."""
        events = [name for name in kept if self._tree.nodes[name].has_event]
        own: dict[str, list[Guard]] = {name: [] for name in events}
        shared: list[tuple[str, Guard]] = []
        bound = {name: {*rigid_variables(self._patterns[name])} for name in events}
        for node, guard in ((name, one) for name in kept for one in conjuncts(self._tree.nodes[name].when)):
            asked = {*variables(guard)}
            having = [name for name in events if asked <= bound[name]]
            if not asked and holds(guard, {}):
                continue
            if having:
                own[having[0]].append(guard)
            else:
                shared.append((node, guard))
        letters = {name: self._fitting(name, own[name]) for name in events}
        uses = Counter(chain(*bound.values()))
        before: nx.DiGraph = nx.DiGraph()
        before.add_nodes_from(events)
        after = {
            name: frozenset(o for o in events if o != name and event(o) in nx.descendants(points, event(name)))
            for name in events
        }
        before.add_edges_from((name, other) for name in events for other in after[name])
        earlier = {name: frozenset(before.predecessors(name)) for name in events}
        for one, other in combinations(events, 2):  # what is alike comes in one order
            if letters[one] == letters[other] and after[one] == after[other] and earlier[one] == earlier[other]:
                before.add_edge(one, other)
        for order in nx.all_topological_sorts(before):
            self._size += len(order)
            if self._size > self._limit:
                raise TooLarge("row variables of all orders", limit=self._limit)
            conditions = self._conditions(order, letters, bound, shared, {n for n in uses if uses[n] > 1})
            if conditions is not None:
                yield tuple(order), conditions

    def _conditions(
        self,
        order: Sequence[str],
        letters: Mapping[str, str],
        bound: Mapping[str, set[str]],
        shared: Sequence[tuple[str, Guard]],
        tied: set[str],
    ) -> list[str] | None:
        """The condition of each event of an order, None where they cannot hold together."""
        found = [[f"e{number}.{letters[name]}"] for number, name in enumerate(order, 1)]
        for variable in sorted(tied):
            first, *others = (number for number, name in enumerate(order) if variable in bound[name])
            for number in others:
                cells = [self._cell(order, letters, at, "text", Variable(variable)) for at in (first, number)]
                found[number].append(f"{cells[1]} = {cells[0]}")
        for node, guard in shared:
            last = 0

            def column(aspect: str, part: Guard) -> str | None:
                nonlocal last
                asked = {*variables(part)}
                at = next((number for number, name in enumerate(order) if asked <= bound[name]), None)
                if at is None:
                    return None
                last = max(last, at)
                return self._cell(order, letters, at, aspect, part)

            try:
                condition = RowConditions(self._times, column).when(guard)
            except NoCondition as error:
                reason = f"a guard over several events: {error}"
                raise NotExpressible(
                    reason, backend="match-recognize", semantics=self._semantics, nodes=[node]
                ) from None
            if condition == NEVER:
                return None
            if len(condition) > _LENGTH:
                raise TooLarge("characters of a condition", limit=_LENGTH)
            found[last] += [condition] if condition != ALWAYS else []
        return [" AND ".join(several) for several in found]

    def _cell(self, order: Sequence[str], letters: Mapping[str, str], at: int, aspect: str, part: Guard) -> str:
        """The column of an aspect of what one event of an order has."""
        base, value = letters[order[at]], ValueColumn(aspect, part)
        known = self._header.values.setdefault(base, {})
        name = next((name for name, one in known.items() if one == value), None)
        if name is None:
            about = part.name if isinstance(part, Variable) else "value"
            name = self._fresh(f"{base.removeprefix('is_')}_{about}", f"_{aspect}")
            known[name] = value
        return f"e{at + 1}.{name}"

    def _fitting(self, node: str, own: Sequence[Guard]) -> str:
        """The column that says of an event whether it is one of a node."""
        fitting = FittingEvent(self._patterns[node], tuple(dict.fromkeys(own)))
        if fitting not in self._columns:
            self._columns[fitting] = self._fresh(f"is_{node}" if _ILLEGAL.sub("", node.lower()) else "is_event")
        return self._columns[fitting]

    def _fresh(self, wanted: str, ending: str = "") -> str:
        """A name of a column that no other has, like that of a node."""
        name = _ILLEGAL.sub("_", wanted.lower()).strip("_")[:40]
        name = f"n{name}" if name[0].isdigit() else name
        tries = chain([name], (f"{name}_{number}" for number in count(2)))
        found = next(one + ending for one in tries if one + ending not in self._taken)
        self._taken.add(found)
        return found

    def _query(self, table: str, length: int, conditions: Sequence[str]) -> str:
        gaps = self._semantics is Semantics.SCATTERED
        named = [f"e{number}" for number in range(1, length + 1)]
        start = self._semantics is not Semantics.CONSECUTIVE
        pattern = [one for number, name in enumerate(named) for one in ([f"g{number}*?", name] if gaps else [name])]
        defined = [f"{name} AS {condition}" for name, condition in zip(named, conditions, strict=True)]
        defined[:0] = ["s AS s.pos = 0"] if start else []
        return (
            f"SELECT trace, found FROM {table} MATCH_RECOGNIZE (\n"  # noqa: S608 (literals are quoted)
            f"  PARTITION BY trace ORDER BY ts MEASURES e{length}.pos AS found\n"
            f"  ONE ROW PER MATCH AFTER MATCH SKIP TO NEXT ROW PATTERN ({' '.join([*(['s'] if start else []), *pattern])})\n"
            f"  DEFINE {', '.join(defined)})"
        )
