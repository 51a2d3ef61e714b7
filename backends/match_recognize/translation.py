"""Properties to MATCH_RECOGNIZE queries, one row pattern per order of a scenario's events.

A `without` is a condition on the rows that the pattern skips between the events of its part.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from itertools import chain, count
from typing import Final

from backends.event_columns import EventColumns, FittingEvent, ValueColumn, time_variables
from backends.match_recognize.conditions import ALWAYS, NEVER, written
from backends.orders import Orders
from rvaft.backend import Metrics
from rvaft.core.conditions import TruthCondition, TruthConditions, Unsayable
from rvaft.core.property import Property, WithoutEvent
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.guards import Guard, conjuncts, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Pattern, Variable, rigid_variables
from rvaft.model.patterns import variables as pattern_variables
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
        for clause in prop.absences:
            if semantics is not Semantics.SCATTERED:
                reason = "of absent events only those among the rows that a pattern skips: use --semantics scattered"
                raise NotExpressible(unwritten(reason), nodes=[clause.source.node])
            if clause.side is not Side.DURING:
                reason = "of absent events only those between the first and the last event of their part"
                raise NotExpressible(unwritten(reason), nodes=[clause.source.node])
        minimal = semantics is Semantics.SCATTERED and not prop.absences
        self._orders = Orders(prop, limit=limit, grouped=False, minimal=minimal)
        self._header = EventColumns(time=prop.time)
        self._times = time_variables(prop)
        self._columns: dict[FittingEvent, str] = {}
        self._taken = set(_RESERVED)

    def text(self) -> tuple[str, Metrics]:
        """Return the text and its metrics."""
        projects = self._semantics in (Semantics.PROJECTED, Semantics.CONSECUTIVE)
        table = f"(SELECT * FROM events WHERE {self._relevance()})" if projects else "events"  # noqa: S608
        queries: dict[str, None] = {}
        for scenario in self._orders.scenarios():
            for columns, conditions, skipped in self._words(scenario):
                self._size += len(columns)
                queries[self._query(table, len(columns), conditions, skipped)] = None
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

    def _words(self, scenario: Scenario) -> Iterator[tuple[Sequence[str], list[str], dict[int, str]]]:
        """Yield the columns of the events of each order, their conditions, and those of skipped rows."""
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
        absent = [(clause, frozenset(part)) for clause, part in scenario.absences]
        around = {name: frozenset(number for number, (_, part) in enumerate(absent) if name in part) for name in bound}
        fitting = {name: self._fitting(name.source.node, name.pattern, own[name]) for name in bound}
        clauses = tuple(clause for clause, _ in absent)
        letters = {name: (fitting[name], (*shared,), (clauses, around[name])) for name in bound}
        variables_of = {letters[name][0]: names for name, names in bound.items()}
        uses = Counter(chain(*bound.values()))
        for word in self._orders.words(scenario, letters):
            columns = [column for column, _, _ in word]
            per_event = self._conditions(columns, variables_of, shared, sorted(name for name in uses if uses[name] > 1))
            if per_event is None:
                continue
            skipped: dict[int, list[str]] = {}
            for number, clause in enumerate(clauses):
                inside = [at for at, (_, _, (_, those)) in enumerate(word, 1) if number in those]
                for gap in range(inside[0], inside[-1]):
                    broken = self._breaking(clause, gap, [(one, variables_of[one]) for one in columns[:gap]])
                    skipped.setdefault(gap, []).extend(broken)
            yield columns, per_event, {gap: " AND ".join(dict.fromkeys(some)) for gap, some in skipped.items() if some}

    def _breaking(self, clause: WithoutEvent, gap: int, events: Sequence[tuple[str, Set[str]]]) -> Iterator[str]:
        """Yield the condition that a skipped row does not break a clause, after these events."""
        node, names = clause.source.node, frozenset(pattern_variables(clause.pattern))
        guards = conjuncts(clause.guard)
        base = self._fitting(node, clause.pattern, [guard for guard in guards if names.issuperset(variables(guard))])
        row, found = f"g{gap}", [f"g{gap}.{base}"]

        def column(aspect: str, part: Guard) -> str | None:
            used = {*variables(part)}
            if used <= names:
                return self._cell(base, row, aspect, part)
            at = next((at for at, (_, known) in enumerate(events) if used <= known), None)
            return None if at is None else self._cell(events[at][0], f"e{at + 1}", aspect, part)

        def known(name: str) -> str:
            at = next(at for at, (_, bound) in enumerate(events) if name in bound)
            return self._cell(events[at][0], f"e{at + 1}", "text", Variable(name))

        ties = (name for name in rigid_variables(clause.pattern) if name not in clause.own)
        found += [f"{self._cell(base, row, 'text', Variable(name))} = {known(name)}" for name in ties]
        conditions = TruthConditions(
            self._times,
            lambda part: any({*variables(part)} <= one for one in (names, *(bound for _, bound in events))),
        )
        for guard in guards:
            if not names.issuperset(variables(guard)):
                with self._naming(node):
                    condition = written(conditions.of(guard), column)
                if condition == NEVER:
                    return
                found += [condition] if condition != ALWAYS else []
        yield f"({' AND '.join(f'({one})' if ' OR ' in one else one for one in found)}) IS NOT TRUE"

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
                cells = [self._cell(columns[at], f"e{at + 1}", "text", Variable(variable)) for at in (first, number)]
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
                return self._cell(columns[at], f"e{at + 1}", aspect, part)

            with self._naming(node):
                condition = written(test, column)
            if condition == NEVER:
                return None
            found[last] += [condition] if condition != ALWAYS else []
        return [" AND ".join(several) for several in found]

    def _cell(self, base: str, row: str, aspect: str, part: Guard) -> str:
        """Return a value of the event of a row, which fits the column `base`."""
        value = ValueColumn(aspect, part)
        known = self._header.values.setdefault(base, {})
        name = next((name for name, one in known.items() if one == value), None)
        if name is None:
            about = part.name if isinstance(part, Variable) else "value"
            name = self._fresh(f"{base.removeprefix('is_')}_{about}", f"_{aspect}")
            known[name] = value
        return f"{row}.{name}"

    def _fitting(self, node: str, pattern: Pattern, own: Sequence[Guard]) -> str:
        fitting = FittingEvent(pattern, tuple(dict.fromkeys(own)))
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

    def _query(self, table: str, length: int, conditions: Sequence[str], skipped: Mapping[int, str]) -> str:
        gaps = self._semantics is Semantics.SCATTERED
        named = [f"e{number}" for number in range(1, length + 1)]
        start = self._semantics is not Semantics.CONSECUTIVE
        pattern = [one for number, name in enumerate(named) for one in ([f"g{number}*?", name] if gaps else [name])]
        defined = [f"{name} AS {condition}" for name, condition in zip(named, conditions, strict=True)]
        defined[:0] = ["s AS s.pos = 0"] if start else []
        defined += [f"g{gap} AS {condition}" for gap, condition in sorted(skipped.items())]
        return (
            f"SELECT trace, found FROM {table} MATCH_RECOGNIZE (\n"  # noqa: S608 (literals are quoted)
            f"  PARTITION BY trace ORDER BY ts MEASURES e{length}.pos AS found\n"
            "  ONE ROW PER MATCH AFTER MATCH SKIP TO NEXT ROW PATTERN "
            f"({' '.join([*(['s'] if start else []), *pattern])})\n"
            f"  DEFINE {', '.join(defined)})"
        )
