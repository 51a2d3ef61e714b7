"""Properties to MATCH_RECOGNIZE queries, one row pattern per order of a scenario's events."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from itertools import chain, count
from typing import Final

from backends.event_columns import FittingEvent, ValueColumn, time_variables
from backends.match_recognize.conditions import ALWAYS, NEVER, written
from backends.match_recognize.flink import RowHeader
from backends.orders import Orders
from rvaft.backend import Metrics
from rvaft.core.conditions import TruthCondition, TruthConditions, Unsayable
from rvaft.core.property import Event, Property
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import Variable, rigid_variables
from rvaft.model.verdict import Semantics

_ILLEGAL: Final = re.compile(r"[^a-z0-9]+")
_TOKEN: Final = re.compile(r"'(?:[^']|'')*'|\w+(?:\.\d+\w*)?|[<>]=|<>|[^\s\w]")
_NOTHING: Final = "SELECT trace, pos AS found FROM events WHERE FALSE"
_RESERVED: Final = {"trace", "pos", "ts", "is_relevant", "is_ignored"}


class RowPatternQueries:
    """One translation; raises `NotExpressible`, `TooLarge`, and `TreeError` without a feasible
    scenario.
    """

    def __init__(self, prop: Property, semantics: Semantics, limit: int) -> None:
        self._prop, self._semantics, self._size = prop, semantics, 0
        self._orders = Orders(prop, limit=limit, grouped=False, minimal=semantics is Semantics.SCATTERED)
        self._header = RowHeader(time=prop.time)
        self._times = time_variables(prop)
        self._columns: dict[FittingEvent, str] = {}
        self._taken = set(_RESERVED)

    def text(self) -> tuple[str, Metrics]:
        """Return the text and its metrics."""
        projects = self._semantics in (Semantics.PROJECTED, Semantics.CONSECUTIVE)
        table = f"(SELECT * FROM events WHERE {self._relevance()})" if projects else "events"  # noqa: S608
        queries: dict[str, None] = {}
        for scenario in self._orders.scenarios():
            for columns, conditions in self._words(scenario):
                self._size += len(columns)
                queries[self._query(table, len(columns), conditions)] = None
        for fitting, column in self._columns.items():
            self._header.fitting[column] = [fitting]
        written = "\nUNION ALL\n".join(queries) or _NOTHING
        return f"{self._header}{written}\n", Metrics(len(_TOKEN.findall(written)), subformulas=self._size)

    def _relevance(self) -> str:
        whole = ((entry.pattern, entry.when) for entry in self._prop.alphabet)
        ignored = ((one.pattern, one.when) for one in self._prop.ignored)
        for column, pairs in (("is_relevant", whole), ("is_ignored", ignored)):
            several = [FittingEvent(pattern, () if when is None else (when,)) for pattern, when in pairs]
            if several:
                self._header.fitting[column] = [*dict.fromkeys(several)]
        start = "pos = 0 OR " if self._semantics is Semantics.PROJECTED else ""
        return start + " AND NOT ".join(self._header.fitting)

    def _words(self, scenario: Scenario) -> Iterator[tuple[Sequence[str], list[str]]]:
        shared = dict[tuple[str, Guard], TruthCondition]()
        bound = {event: frozenset(rigid_variables(event.pattern)) for event in scenario.events}
        conditions = TruthConditions(
            self._times, lambda part: any(one.issuperset(variables(part)) for one in bound.values())
        )

        def several(node: str, guard: Guard) -> None:
            with self._naming(node):
                shared[node, guard] = conditions.of(guard)

        own = self._orders.assigned_guards(scenario, bound, several)
        if own is None:
            return
        letters = {name: (self._fitting(name, own[name]), (*shared,)) for name in bound}
        variables_of = {letters[name][0]: names for name, names in bound.items()}
        uses = Counter(chain(*bound.values()))
        for word in self._orders.words(scenario, letters):
            columns = [column for column, _ in word]
            per_event = self._conditions(columns, variables_of, shared, sorted(name for name in uses if uses[name] > 1))
            if per_event is not None:
                yield columns, per_event

    @contextmanager
    def _naming(self, node: str) -> Iterator[None]:
        try:
            yield
        except Unsayable as error:
            reason = f"a guard over several events: {error}"
            raise NotExpressible(unwritten(reason), nodes=[node]) from None

    def _conditions(
        self,
        columns: Sequence[str],
        variables_of: Mapping[str, Set[str]],
        shared: Mapping[tuple[str, Guard], TruthCondition],
        tied: Sequence[str],
    ) -> list[str] | None:
        found = [[f"e{number}.{name}"] for number, name in enumerate(columns, 1)]
        for variable in tied:
            first, *others = (number for number, name in enumerate(columns) if variable in variables_of[name])
            for number in others:
                cells = [self._cell(columns, at, "text", Variable(variable)) for at in (first, number)]
                found[number].append(f"{cells[1]} = {cells[0]}")
        for (node, _), test in shared.items():
            last = 0

            def column(aspect: str, part: Guard) -> str | None:
                nonlocal last
                names = {*variables(part)}
                at = next((number for number, name in enumerate(columns) if names <= variables_of[name]), None)
                if at is None:
                    return None
                last = max(last, at)
                return self._cell(columns, at, aspect, part)

            with self._naming(node):
                condition = written(test, column)
            if condition == NEVER:
                return None
            found[last] += [condition] if condition != ALWAYS else []
        return [" AND ".join(several) for several in found]

    def _cell(self, columns: Sequence[str], at: int, aspect: str, part: Guard) -> str:
        base, value = columns[at], ValueColumn(aspect, part)
        known = self._header.values.setdefault(base, {})
        name = next((name for name, one in known.items() if one == value), None)
        if name is None:
            about = part.name if isinstance(part, Variable) else "value"
            name = self._fresh(f"{base.removeprefix('is_')}_{about}", f"_{aspect}")
            known[name] = value
        return f"e{at + 1}.{name}"

    def _fitting(self, event: Event, own: Sequence[Guard]) -> str:
        node = event.source.node
        fitting = FittingEvent(event.pattern, tuple(dict.fromkeys(own)))
        if fitting not in self._columns:
            self._columns[fitting] = self._fresh(f"is_{node}" if _ILLEGAL.sub("", node.lower()) else "is_event")
        return self._columns[fitting]

    def _fresh(self, wanted: str, ending: str = "") -> str:
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
            "  ONE ROW PER MATCH AFTER MATCH SKIP TO NEXT ROW PATTERN "
            f"({' '.join([*(['s'] if start else []), *pattern])})\n"
            f"  DEFINE {', '.join(defined)})"
        )
