"""Properties to SQL queries.

A scenario is a join, an occurrence an alias, precedence `<`, distinctness `<>`, and a guard a
condition. Under `strict` and `projected`, relevant events are numbered, and a match has the first
numbers. Under `consecutive`, each event is joined with all possible starts of its match.

Under `scattered` the query returns every match, unless only order relates the events or a leaf has
many counted events. It then finds the least position of each event after its predecessors, per
value of shared variables and start of a window. Only events that a guard compares or that match
each other's node are tried individually.

A counted leaf is one row (`backends.joins`): that of its last event, with the position and the time of
the first one by `lag`. Different values are counted by window functions in the dialects that have
them; elsewhere, and where the first event is needed, by a join with the latest event of each value.

An absent event is a NOT EXISTS over all events. A scenario with `without … after` is detected at the
first later event whose time decides the last of these clauses.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Final, assert_never

from backends.counted_leaves import LONGEST_WINDOW, single_rows
from backends.joins import COUNTED, JoinedScenario, joined_scenarios, variable_paths
from backends.sql.dialects import Dialect, Path
from backends.sql.guards import FACETS, Guards, SqlTerm
from backends.sql.rows import OWN, JsonRows, Rows, TableRows, renamed
from backends.sql.windows import CountedLeaf, NamedTables, NearestAbsence
from backends.tables import Table, time_line
from rvaft.backend import Metrics
from rvaft.core.overlaps import compatible
from rvaft.core.property import Event, Property, WithoutEvent
from rvaft.core.times import untimed
from rvaft.errors import TooLarge, TreeError
from rvaft.model.event_time import TIME
from rvaft.model.guards import Guard, conjuncts, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    rigid_variables,
)
from rvaft.model.verdict import Semantics

_TOKEN: Final = re.compile(r"'(?:[^']|'')*'|[\w.]+|->>|[<>]=?|<>|\|\||\S")
_NUMBERED: Final = re.compile(r"(first|last)_(pos|time)_\d+|(decided|key)_[\d_]+")
"""Names of columns of the query, by clause."""
_LENGTH: Final = 400
"""Characters of text per joined event of the limit."""
_PAIRED: Final = 4
"""Maximum number of events of a window that is written as bounds of pairs."""
TABLES: Final = 60
"""Maximum number of events of a scenario: SQLite joins 64 tables."""


@dataclass(frozen=True)
class QueriedScenario(JoinedScenario):
    """A scenario with its windows, and with the events that the query joins one by one."""

    @cached_property
    def tried(self) -> frozenset[Event]:
        """The occurrences that are tried individually: those compared by guards, and those in
        `apart`.
        """
        guards = (guard for guard, home in self.homes if home is None and guard not in self.windows)
        compared = (name for guard in guards for one in variables(guard) for name in self.binders.get(one, ()))
        return frozenset([*compared, *(name for pair in self.apart for name in pair)])

    @cached_property
    def starts(self) -> dict[str, tuple[frozenset[Event], int]]:
        """The windows with events that are not tried individually, by the column of their start."""
        windows = (window for window in dict.fromkeys(self.windows.values()) if window[0] - self.tried)
        return {f"s{number}": window for number, window in enumerate(windows, 1)}

    @property
    def loose(self) -> bool:
        """Whether only order relates the events."""
        return not self.tried and not self.windows and all(len(names) == 1 for names in self.binders.values())

    @property
    def counts(self) -> bool:
        """Whether three or more events have one pattern: all matches are then too many."""
        patterns = (untimed(event.pattern)[0] for event in self.before if event not in self.tried)
        return any(number > 2 for number in Counter(patterns).values())


@dataclass(frozen=True)
class QueriedRow:
    """The table of an occurrence, and the columns that it shares, by shared name."""

    table: str
    shared: Mapping[str, str]


class SqlQuery:
    """One translation; raises `TooLarge`, and `TreeError` without a feasible scenario."""

    def __init__(
        self,
        prop: Property,
        semantics: Semantics,
        dialect: Dialect,
        limit: int,
        table: Table | None = None,
        *,
        ordered: bool = False,
    ) -> None:
        """Translate; `ordered`: without `late`, the query runs on times that do not go back only."""
        self.prop, self.semantics, self.dialect, self.limit = prop, semantics, dialect, limit
        self.guards = Guards(dialect)
        self.rows: Rows = JsonRows(dialect) if table is None else TableRows.of(table, prop, dialect)
        self.typed = table is not None
        self.untraced = not self.rows.trace
        """Whether the table is one log."""
        self.tables: dict[str, str] = {}
        """Table names by query."""
        self._queries = NamedTables(self._table, dialect, () if self.untraced else ("trace",))
        self._columns_of: dict[str, list[str]] = {}
        """The columns of the tables of events."""
        self._known_tables = Counter[str]()
        """The number of tables by the letters of their names."""
        self.late = None if prop.time is None else prop.time.late
        self.timed = any(untimed(event.pattern)[1] is not None for event in prop.events)
        self.timed |= prop.times_absences
        time = prop.tree.time
        self.lateness = None if time is None else 0 if ordered and time.late is None else time.late
        """The D of `late`, or of the assumption that no event is late."""
        minimal = semantics is Semantics.SCATTERED and not prop.absences
        self.scenarios = joined_scenarios(QueriedScenario, prop, limit, most=COUNTED, minimal=minimal)
        several = any(len(one.before) > 1 for one in self.scenarios)
        loose = all(one.loose and len(one.before) <= TABLES for one in self.scenarios)
        many = any(one.counts for one in self.scenarios)
        counted = self.scenarios
        if semantics is Semantics.SCATTERED and not loose:
            counted = tuple(single_rows(one, self.lateness) for one in self.scenarios)
        self.counted = any(one.counts_of for one in counted) and not any(one.counts for one in counted)
        """Whether counted leaves are single rows."""
        self.first = minimal and not self.counted and ((several and loose) or many)
        """Whether the query finds first matches only."""
        if self.counted:
            self.scenarios = counted
        elif minimal and not self.first:
            self.scenarios = joined_scenarios(QueriedScenario, prop, limit, most=COUNTED, minimal=False)
        if any(len(one.before) > TABLES for one in self.scenarios):
            raise TooLarge("events joined in a scenario", limit=TABLES)
        if not self.scenarios:
            root = prop.tree.root
            raise TreeError(f"no scenario of {root} is feasible", rule="no-scenario", nodes=[root])
        self.most = max(len(one.before) for one in self.scenarios)
        self.variables = [
            *dict.fromkeys(name for one in self.scenarios for name in one.binders if name not in one.times)
        ]
        own = {name for clause in prop.absences for name in clause.own if not name.startswith("_")}
        own |= {name for one in self.scenarios for count in one.counts_of.values() for name in count.distinct}
        self._bound = [*dict.fromkeys((*self.variables, *sorted(own)))]
        """The variables, and those that only absent or counted events have."""
        self._columns = {name: f"v{number}" for number, name in enumerate(self._bound, 1)}

    def text(self) -> tuple[str, Metrics]:
        """Return the text and its metrics."""
        places = self._places()
        selects = [self._select(one, places) for one in self.scenarios]
        kept = "" if self.typed else "MATERIALIZED "
        tables = ",\n".join(f"  {name} AS {kept}(\n    {query}\n  )" for query, name in self.tables.items())
        text = "\nUNION ALL\n".join(selects)
        text = f"WITH\n{tables}\n{text}\n"
        if self.typed:
            text = self._named(text)
        if len(text) > self.limit * _LENGTH:
            raise TooLarge("characters of the query", limit=self.limit)
        return f"{self._header(text)}{text}", Metrics(symbols=len(_TOKEN.findall(text)))

    @cached_property
    def _names(self) -> list[str]:
        """The names of the columns of variables in a query on typed columns."""
        shown = [name.strip("_") if name.startswith("_") else name for name in self._bound]
        small = Counter([*map(str.lower, shown), *OWN])
        return [
            name if small[name.lower()] == 1 and not _NUMBERED.fullmatch(name.lower()) else f"v{number}"
            for number, name in enumerate(shown, 1)
        ]

    def _named(self, text: str) -> str:
        """Return the text with the names of variables for their columns."""
        literal_or_column = re.compile(r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|\bv(\d+)_(?:key|json)\b""")
        return literal_or_column.sub(
            lambda found: f'"{self._names[int(found[1]) - 1]}"' if found[1] else found[0], text
        )

    def _header(self, text: str) -> str:
        time = self.prop.time
        rows = "the first match of each scenario" if self.first else "every match"
        if self.counted:
            whole = any(count.first is not None for one in self.scenarios for count in one.counts_of.values())
            rows += f", with {'the first and ' * whole}the last event of counted leaves"
        rows += (
            ""
            if all(one.loose for one in self.scenarios) or not self.first
            else ", for all that ties its events together"
        )
        shown = zip(self._bound, self._names, strict=True) if self.typed else ()
        columns = [f"{column} {name}" for name, column in shown if name != column]
        if "_key" in text or "_json" in text:
            columns = [f"{self._column(name)} {name}" for name in self._bound]
        lines = [
            f"rvaft sql {self.dialect.name}",
            f"The attack-fault tree {json.dumps(self.prop.tree.root)} under {self.semantics}: {rows}.",
            *columns,
            *self.rows.header(),
        ]
        if time is not None:
            lines.append(time_line(time))
        return "".join(f"-- {line}\n" for line in lines)

    # Tables.

    def _table(self, query: str, letter: str) -> str:
        if query not in self.tables:
            source = self.rows.table.table.lower() if isinstance(self.rows, TableRows) else "events"
            letter += "_" * (source.rstrip("0123456789") == letter)  # not the name of the table of events
            self._known_tables[letter] += 1
            self.tables[query] = f"{letter}{self._known_tables[letter]}"
        return self.tables[query]

    def _places(self) -> str:
        """Return the table of relevant events, numbered per trace unless `scattered`."""
        source, late = self.rows.source, ""
        if self.late is not None:
            before = "PARTITION BY trace ORDER BY pos ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING"
            late = f"coalesce(max(time) OVER ({before}) - time > {self.dialect.number(self.late)}, false) AS late"
            source, late = self._table(f"SELECT trace, pos, event, time, {late} FROM events", "late_"), ", late"
        self.log = source, self.rows
        if self.semantics is Semantics.SCATTERED:
            return source
        wanted = ["NOT late"] if late and self.semantics is not Semantics.STRICT else []
        if self.semantics.projects:
            relevant = [self.condition(one.pattern, [one.when] if one.when else []) for one in self.prop.alphabet]
            ignored = [self.condition(one.pattern, [one.when] if one.when else []) for one in self.prop.ignored]
            wanted.append(f"({' OR '.join(dict.fromkeys(f'({one})' for one in relevant))})")
            wanted += [f"({one}) IS NOT TRUE" for one in dict.fromkeys(ignored)]
        where = f" WHERE {' AND '.join(wanted)}" if wanted else ""
        trace = f"PARTITION BY {self.rows.trace} " if self.rows.trace else ""
        place = f"row_number() OVER ({trace}ORDER BY {self.rows.position}) AS place"
        columns, self.rows = self.rows.numbered()
        return self._table(f"SELECT {columns}{late}, {place} FROM {source}{where}", "place_")

    def _leaf(self, one: QueriedScenario, name: Event, places: str, wanted: Set[str]) -> str:
        pattern = name.pattern
        count = next((count for last, count in one.counts_of.items() if name in (last, count.first)), None)
        guards, distinct = (count.guards, count.distinct) if count is not None else ((), ())
        where = [self.condition(pattern, [*(guard for guard, home in one.homes if home == name), *guards])]
        columns = [renamed(self.rows.trace, "trace"), renamed(self.rows.position, "pos")]
        paths = variable_paths(pattern)
        shown = (*(name for name in rigid_variables(pattern) if name not in one.times), *distinct)
        for variable, path in ((name, paths[name]) for name in shown):
            facets = self.rows.facets(path)
            named = {f"{self._column(variable)}_{kind}": expression for kind, expression in facets.items()}
            names = [column for column in named if column in wanted]
            columns += [f"{named[column]} AS {column}" for column in (names[:1] if self.typed else names)]
        if self.timed:
            columns.append(renamed(self.rows.time, "time"))
        if self.late is not None:
            where.insert(0, "NOT late")
        if self.semantics is Semantics.CONSECUTIVE:
            shifts = (f"SELECT {number} AS shift" for number in range(self.most))
            columns += ["place - shift AS start", "shift AS place"]
            places += f", {self._table(' UNION ALL '.join(shifts), 'shift_')}"
        elif self.semantics is not Semantics.SCATTERED:
            columns.append("place")
            where.insert(0, f"place <= {self.most}")
        if distinct and count is not None and count.timed:
            where.append(f"{self.rows.time} IS NOT NULL")
        columns = [*filter(None, columns)]
        found = self._table(f"SELECT {', '.join(columns)} FROM {places} WHERE {' AND '.join(where)}", "n")
        self._columns_of[found] = [column.rpartition(" AS ")[2] for column in columns]
        return found

    def _wanted(self, one: QueriedScenario, alias: Mapping[Event, str], text: str) -> dict[str, frozenset[str]]:
        """Return the columns of each row that a text names."""
        references = re.findall(r"(e\d+)\.(v\d+_[a-z]+)", text)
        wanted = {row: frozenset(column for other, column in references if other == row) for row in alias.values()}
        for last, count in one.counts_of.items():  # one table
            both = wanted[alias[last]] | (wanted[alias[count.first]] if count.first is not None else frozenset())
            names = (*(name for name in rigid_variables(last.pattern) if name not in one.times), *count.distinct)
            own = both.union(f"{self._column(name)}_key" for name in names)
            wanted |= {alias[event]: own for event in (count.first, last) if event is not None}
        return wanted

    def _counted(self, one: QueriedScenario, last: Event, table: str) -> str:
        """Return the table of the last events of a counted leaf, from that of its events."""
        count, names = one.counts_of[last], rigid_variables(untimed(last.pattern)[0])
        keys = [f"{self._column(name)}_key" for name in names]
        values = [f"{self._column(name)}_key" for name in count.distinct]
        return CountedLeaf(self._queries, count, table, self._columns_of[table], keys, values).table()

    def _column(self, variable: str) -> str:
        return self._columns[variable]

    def condition(self, pattern: Pattern, guards: Iterable[Guard], rows: Rows | None = None) -> str:
        """Return the condition that an event matches a pattern with guards on it alone."""
        places: dict[str, tuple[Rows, Path]] = {}
        conditions = self._tests([(rows or self.rows, (), pattern)], places, 1)
        for guard in guards:
            conditions.append(
                self.guards.condition(guard, {name: self._term(*places[name]) for name in variables(guard)})
            )
        return " AND ".join(dict.fromkeys(conditions)) or "true"

    def _tests(
        self, todo: list[tuple[Rows, Path, Pattern]], places: dict[str, tuple[Rows, Path]], depth: int
    ) -> list[str]:
        """Return conditions that values at places (rows and path) match patterns.

        The tests of a list with some matching item are nested, so that they can share variables.
        """
        conditions, lists = list[str](), list[tuple[Rows, Path, SomeItem]]()
        while todo:
            rows, path, part = todo.pop()
            match part:
                case Variable(name) if path == (TIME,):
                    places[name] = rows, path
                case Literal() | ListPattern() | SomeItem() if rows.is_event(path):  # an event is an object
                    conditions.append("false")
                case Literal(str() as value):
                    conditions.append(rows.is_text(value, path))
                case Literal(value):
                    conditions.append(self.guards.equal(self._term(rows, path), self.guards.literal(value)))
                case Variable() | Anything():
                    conditions += rows.there(path)
                    if isinstance(part, Variable):
                        known, first = places.setdefault(part.name, (rows, path))
                        if (known, first) != (rows, path):
                            conditions.append(f"{known.facets(first)['key']} = {rows.facets(path)['key']}")
                case ObjectPattern(fields):
                    conditions += rows.is_object(path)
                    todo += reversed([(rows, (*path, name), inner) for name, inner in fields])
                case ListPattern(items):
                    conditions.append(rows.is_list(path, len(items)))
                    todo += reversed([(rows, (*path, place), item) for place, item in enumerate(items)])
                case SomeItem():
                    conditions.append(rows.is_list(path))
                    lists.append((rows, path, part))
        if lists:
            (rows, path, some), *others = lists
            table, item = rows.items(path, f"item_{depth}")
            inside = self._tests([*others, (item, (), some.item)], places, depth + 1)
            conditions.append(f"EXISTS (SELECT 1 FROM {table} WHERE {' AND '.join(inside) or 'true'})")
        return conditions

    def _term(self, rows: Rows, path: Path) -> SqlTerm:
        return SqlTerm(whole=self.rows.time) if path == (TIME,) else rows.term(path)

    # The query of a scenario.

    def _select(self, one: QueriedScenario, places: str) -> str:
        alias = {name: f"e{number}" for number, name in enumerate(one.before, 1)}
        terms, first_of, where = self._joined_values(one, alias)
        windows = one.windows if self.first else {}
        for guard, home in one.homes:
            if home is None and not (guard in windows and windows[guard][0] - one.tried):
                where += self._near(one, guard, alias) or [self.guards.condition(guard, terms)]
        near = [number for number, (clause, part) in enumerate(one.absences, 1) if self._is_near(one, clause, part)]
        where += self._absences(one, alias, terms, first_of, near)
        values = self._values(first_of)
        extremes = [column for number in near for column in self._extremes(one, number, alias, first_of)]
        wanted = self._wanted(one, alias, " ".join([*where, *extremes, values]))
        tables = {
            name: self._leaf(one, name, places, wanted[alias[name]])
            for name in alias
            if name not in one.counts_of or one.counts_of[name].first is None
        }
        tables |= {last: self._counted(one, last, tables[count.first or last]) for last, count in one.counts_of.items()}
        rows = {name: QueriedRow(table, {}) for name, table in tables.items()}
        rows = self._firsts(one, tables, alias, wanted) if self.first else rows
        last_of = {
            alias[count.first]: alias[event] for event, count in one.counts_of.items() if count.first is not None
        }
        sources = [f"{rows[name].table} AS {row}" for name, row in alias.items() if row not in last_of]
        first, *others = alias.values()
        joins = [] if self.untraced else [f"{row}.trace = {first}.trace" for row in others]
        if self.first:  # join the events at the least positions for the values of variables
            with_values = {name: row for name, row in alias.items() if name not in one.tried and f"{row}.v" in values}
            sources += [f"{tables[name]} AS x{row[1:]}" for name, row in with_values.items()]
            joins += [
                f"x{row[1:]}.{column} = {row}.{column}"
                for row in with_values.values()
                for column in ("trace", "pos")[self.untraced :]
            ]
            for row in with_values.values():
                values = values.replace(f" {row}.v", f" x{row[1:]}.v")
        joins += self._shared(one, alias, rows)
        joins += self._order(one, alias)
        if len(sources) > TABLES + 4:
            raise TooLarge("tables joined in a scenario", limit=TABLES)
        lasts = [f"{alias[name]}.pos" for name in one.before if not any(name in some for some in one.before.values())]
        last = lasts[0] if len(lasts) == 1 else f"{self.dialect.greatest}({', '.join(lasts)})"
        decisions = {number: value for number, value in self._decisions(one, alias) if number not in near}
        trace = "" if self.untraced else f"{first}.trace, "
        what = f"{trace}{last} AS detected, {one.branch} AS branch,\n  {self._nodes(alias)} AS nodes{values}"
        what += "".join(f",\n  {decision} AS decided_{number}" for number, decision in decisions.items())
        what += f",\n  {', '.join(extremes)}" if extremes else ""
        condition = "\n  AND ".join(
            some for some in dict.fromkeys([*joins, *where]) if not _is_of_one_row(some, last_of)
        )
        distinct = "DISTINCT " if self.first and not one.loose else ""
        query = f"SELECT {distinct}{what}\nFROM {', '.join(sources)}" + (f"\nWHERE {condition}" if condition else "")
        query = _of_last(query, last_of)
        return self._decided(one, query, [*decisions], near, values) if decisions or near else query

    def _joined_values(
        self, one: QueriedScenario, alias: Mapping[Event, str]
    ) -> tuple[dict[str, SqlTerm], dict[str, str], list[str]]:
        """Return the terms and the first columns of variables, and the conditions that their values are equal."""
        terms: dict[str, SqlTerm] = {}
        first_of: dict[str, str] = {}
        where: list[str] = []
        for variable, names in one.binders.items():
            if variable in one.times:
                terms[variable] = SqlTerm(whole=f"{alias[names[0]]}.time")
                continue
            columns = [f"{alias[name]}.{self._column(variable)}" for name in names]
            where += [f"{column}_key = {columns[0]}_key" for column in columns[1:]]
            facets = {kind: f"{columns[0]}_{kind}" for kind in FACETS}
            if not self.typed and any(
                names[0] not in one.before[name] for name in names[1:]
            ):  # use the value of the earliest event: 1 or 1.0
                earliest = f"{alias[names[0]]}.pos"
                for name, column in zip(names[1:], columns[1:], strict=True):
                    sooner = f"CASE WHEN {alias[name]}.pos < {earliest} THEN"
                    facets |= {kind: f"{sooner} {column}_{kind} ELSE {facets[kind]} END" for kind in FACETS[:2]}
                    earliest = f"{sooner} {alias[name]}.pos ELSE {earliest} END"
            terms[variable] = self.rows.variable(facets, variable_paths(names[0].pattern)[variable])
            first_of[variable] = columns[0]
        return terms, first_of, where

    def _decided(
        self, one: QueriedScenario, query: str, decisions: Sequence[int], near: Sequence[int], values: str
    ) -> str:
        """Return the matches of a query that no event breaks, detected where the last clause `after` is decided.

        `decisions`: clauses whose decision is a column of the query; `near`: those that are not looked at yet.
        """
        source = f"(\n{query}\n) AS match_"
        if near:
            source = self._table(query, "match_")
            for number in near:
                source = self._unbroken(one, number, source)
        after = [number for number, (clause, _) in enumerate(one.absences, 1) if clause.side is Side.AFTER]
        last = f"{self.dialect.greatest}({', '.join(['detected', *(f'decided_{number}' for number in after)])}) AS "
        shown = ["nodes", *re.findall(r" AS (v\d+_json|variables)\b", values)]
        trace = "" if self.untraced else "trace, "
        decided = " AND ".join(f"decided_{number} IS NOT NULL" for number in decisions)
        what = f"{trace}{last if after else ''}detected, branch, {', '.join(shown)}"
        return f"SELECT {what}\nFROM {source}" + (f"\nWHERE {decided}" if decided else "")

    # Absent events.

    def _absences(
        self,
        one: QueriedScenario,
        alias: Mapping[Event, str],
        terms: Mapping[str, SqlTerm],
        first_of: Mapping[str, str],
        near: Sequence[int],
    ) -> Iterator[str]:
        """Yield the conditions that no event breaks a `without`; those `near` are for `_unbroken`."""
        for number, (clause, part) in enumerate(one.absences, 1):
            row, where = f"q{number}", list[str]()
            begin, end = self._extreme("pos", part, alias, one)
            if clause.duration is not None:
                yield from (f"{alias[event]}.time IS NOT NULL" for event in part)
            if number in near or (clause.side is Side.DURING and len(part) == 1):
                continue
            match clause.side:
                case Side.DURING:
                    where += [f"{begin} < {row}.pos", f"{row}.pos < {end}"]
                case Side.BEFORE:
                    where.append(f"{row}.pos < {begin}")
                    if clause.duration is not None:
                        start, _ = self._extreme("time", part, alias, one)
                        where.append(self._apart(start, "<=", f"{row}.time", clause.duration))
                case Side.AFTER:
                    where += [f"{end} < {row}.pos", *self._undecided(clause, part, row, alias, one)]
                case _:
                    assert_never(clause.side)
            used = [other for event, other in alias.items() if compatible(clause.pattern, event.pattern)]
            where += [f"{row}.pos <> {other}.pos" for other in used]
            paths = variable_paths(clause.pattern)
            names = rigid_variables(clause.pattern)
            columns = {name: f"{row}.{self._column(name)}" for name in names}
            where += [f"{columns[name]}_key = {first_of[name]}_key" for name in names if name not in clause.own]
            guards = conjuncts(clause.guard)
            alone = [guard for guard in guards if paths.keys() >= {*variables(guard)}]
            binding = dict(terms)
            for name in clause.own.intersection(names):
                facets = {kind: f"{columns[name]}_{kind}" for kind in FACETS}
                binding[name] = self.rows.variable(facets, paths[name])
            where += [self.guards.condition(guard, binding) for guard in guards if guard not in alone]
            wanted = {*re.findall(rf"\b{row}\.(v\d+_[a-z]+)", " ".join(where))}
            table = self._absent(clause, alone, wanted)
            trace = [] if self.untraced else [f"{row}.trace = {next(iter(alias.values()))}.trace"]
            yield f"NOT EXISTS (SELECT 1 FROM {table} AS {row} WHERE {' AND '.join([*trace, *where])})"

    def _absent(self, clause: WithoutEvent, guards: Iterable[Guard], wanted: Set[str], *, timed: bool = False) -> str:
        """Return the table of the events that a clause excludes; `timed`: of those with a time."""
        source, rows = self.log
        paths = variable_paths(clause.pattern)
        columns = [renamed(rows.trace, "trace"), renamed(rows.position, "pos")]
        for name in rigid_variables(clause.pattern):
            facets = rows.facets(paths[name])
            named = {f"{self._column(name)}_{kind}": expression for kind, expression in facets.items()}
            names = [column for column in named if column in wanted]
            columns += [f"{named[column]} AS {column}" for column in (names[:1] if self.typed else names)]
        if clause.duration is not None:
            columns.append(renamed(rows.time, "time"))
        where = ["NOT late"] if self.late is not None else []
        where += [self.condition(clause.pattern, guards, rows), *[f"{rows.time} IS NOT NULL"][:timed]]
        return self._table(f"SELECT {', '.join(filter(None, columns))} FROM {source} WHERE {' AND '.join(where)}", "w")

    def _undecided(
        self, clause: WithoutEvent, part: Sequence[Event], row: str, alias: Mapping[Event, str], one: QueriedScenario
    ) -> Iterator[str]:
        """Yield the conditions that a later event is in time, and that no event before it decides.

        With `late`, an event in time after the deciding one is late.
        """
        _, end = self._extreme("time", part, alias, one)
        yield self._apart(f"{row}.time", "<=", end, clause.duration or 0)
        if self.lateness is None:
            yield f"NOT EXISTS (SELECT 1 FROM {self._deciding(clause, part, alias, one)} AND d.pos < {row}.pos)"

    def _decisions(self, one: QueriedScenario, alias: Mapping[Event, str]) -> Iterator[tuple[int, str]]:
        """Yield the numbers of the clauses `after`, each with the position that decides it."""
        for number, (clause, part) in enumerate(one.absences, 1):
            if clause.side is Side.AFTER:
                yield number, f"(SELECT min(d.pos) FROM {self._deciding(clause, part, alias, one)})"

    def _deciding(
        self, clause: WithoutEvent, part: Sequence[Event], alias: Mapping[Event, str], one: QueriedScenario
    ) -> str:
        """Return the table `d` of times and the condition that an event decides a clause."""
        _, last = self._extreme("pos", part, alias, one)
        _, end = self._extreme("time", part, alias, one)
        trace = [] if self.untraced else [f"d.trace = {alias[part[0]]}.trace"]
        where = [*trace, f"{last} < d.pos", self._apart("d.time", ">", end, self._patience(clause))]
        return f"{self._times()} AS d WHERE {' AND '.join(where)}"

    def _times(self) -> str:
        """Return the table of the events with a time."""
        source, rows = self.log
        columns = [renamed(rows.trace, "trace"), renamed(rows.position, "pos"), renamed(rows.time, "time")]
        query = f"SELECT {', '.join(filter(None, columns))} FROM {source} WHERE {rows.time} IS NOT NULL"
        return self._table(query, "time_")

    def _patience(self, clause: WithoutEvent) -> int:
        """Return the time after which a clause is decided."""
        return (clause.duration or 0) + (self.lateness or 0)

    # Absent events of which the nearest one tells whether there is one: `n log n` by joins with the nearest row.

    def _is_near(self, one: QueriedScenario, clause: WithoutEvent, part: Sequence[Event]) -> bool:
        """Whether the nearest event with equal values tells whether an event breaks a clause.

        Then the guard is on the event alone, and events of the match cannot stand where others break it.
        """
        alone = all(variable_paths(clause.pattern).keys() >= {*variables(one)} for one in conjuncts(clause.guard))
        inside = clause.side is Side.DURING
        used = [event for event in one.before if inside or event not in part]
        apart = not any(compatible(clause.pattern, event.pattern) for event in used)
        short = self._patience(clause) < LONGEST_WINDOW
        return bool(self.dialect.nearest) and alone and apart and short and not (inside and len(part) == 1)

    def _extremes(
        self, one: QueriedScenario, number: int, alias: Mapping[Event, str], first_of: Mapping[str, str]
    ) -> Iterator[str]:
        """Yield the columns of a match that a clause compares: positions, times and values."""
        clause, part = one.absences[number - 1]
        for column in ("pos", *["time"][: clause.duration is not None]):
            first, last = self._extreme(column, part, alias, one)
            yield from [f"{first} AS first_{column}_{number}"] * (clause.side is not Side.AFTER)
            yield from [f"{last} AS last_{column}_{number}"] * (clause.side is not Side.BEFORE)
        for name in rigid_variables(clause.pattern):
            if name not in clause.own:
                yield f"{first_of[name]}_key AS key_{number}_{self._bound.index(name)}"

    def _unbroken(self, one: QueriedScenario, number: int, matches: str) -> str:
        """Return the table of the matches in a table that no event breaks; for `after` with the deciding position."""
        clause, _ = one.absences[number - 1]
        names = [name for name in rigid_variables(clause.pattern) if name not in clause.own]
        keys = {f"{self._column(name)}_key": f"key_{number}_{self._bound.index(name)}" for name in names}
        absent = self._absent(clause, conjuncts(clause.guard), {*keys}, timed=clause.duration is not None)
        times = self._times() if clause.side is Side.AFTER else ""
        return NearestAbsence(self._queries, clause, number, absent, keys, times, self.lateness).unbroken(matches)

    def _apart(self, later: str, sign: str, earlier: str, length: int) -> str:
        """Return the comparison of the difference of two times with a duration."""
        if length < LONGEST_WINDOW:
            return f"{later} {sign} {earlier} + {self.guards.literal(length).whole}"
        return f"{later} - {earlier} {sign} {self.guards.literal(min(length, 2**63 - 1)).whole}"

    def _extreme(
        self, column: str, part: Sequence[Event], alias: Mapping[Event, str], one: QueriedScenario
    ) -> tuple[str, str]:
        """Return the least and the greatest value of a column in the events of a part."""
        first, last = [*part], [*part]
        if column == "pos":
            first = [event for event in part if one.before[event].isdisjoint(part)]
            last = [event for event in part if not any(event in one.before[other] for other in part)]
        words = ((self.dialect.least_of, first), (self.dialect.greatest, last))
        least, most = (
            f"{alias[events[0]]}.{column}"
            if len(events) == 1
            else f"{word}({', '.join(f'{alias[event]}.{column}' for event in events)})"
            for word, events in words
        )
        return least, most

    def _near(self, one: QueriedScenario, guard: Guard, alias: Mapping[Event, str]) -> list[str]:
        """Return a window of few events as bounds of each pair, which a join can use."""
        members, length = one.windows.get(guard, (frozenset[Event](), 0))
        if len(members) > _PAIRED or length >= LONGEST_WINDOW:
            return []
        bound, rows = self.guards.literal(length).whole, [alias[event] for event in alias if event in members]
        return [f"{b}.time <= {a}.time + {bound} AND {a}.time <= {b}.time + {bound}" for a, b in combinations(rows, 2)]

    def _values(self, columns: Mapping[str, str]) -> str:
        """Return the columns of the values of variables."""
        rows = self.rows
        if not isinstance(rows, TableRows):
            return f", {self._object((name, f'{column}_json') for name, column in columns.items())} AS variables"
        found = ((f"{columns[name]}_json" if name in columns else rows.absent(name), name) for name in self.variables)
        return "".join(f", {column} AS {self._column(name)}_json" for column, name in found)

    def _nodes(self, alias: Mapping[Event, str]) -> str:
        """Return the positions of the events of each node as JSON."""
        rows: dict[str, list[str]] = {}
        for event, row in sorted(alias.items(), key=lambda item: item[0].source.number):
            number = self.dialect.cast(f"{row}.pos", "TEXT") if self.typed else f"{row}.pos"
            rows.setdefault(event.source.node, []).append(number)
        order = dict.fromkeys(event.source.node for event in alias)
        return self._object((node, self._numbers(rows[node])) for node in order)

    def _numbers(self, numbers: Sequence[str]) -> str:
        if len(numbers) == 1:
            return numbers[0]
        comma = f" || {self.dialect.text(', ')} || "
        return f"{self.dialect.text('[')} || {comma.join(numbers)} || {self.dialect.text(']')}"

    def _order(self, one: QueriedScenario, alias: Mapping[Event, str]) -> Iterator[str]:
        first, *others = alias.values()
        position, size = "pos", len(alias)
        if self.semantics is Semantics.CONSECUTIVE:
            yield from (f"{row}.start = {first}.start" for row in others)
        least, most = dict.fromkeys(alias, 0), dict.fromkeys(alias, 0)
        if self.semantics is not Semantics.SCATTERED:  # bounds from the numbers of predecessors and successors
            position, origin = "place", int(self.semantics is not Semantics.CONSECUTIVE)
            for name, row in alias.items():
                least[name] = origin + len(one.before[name])
                most[name] = origin + size - 1 - sum(name in some for some in one.before.values())
                same = least[name] == most[name]
                yield f"{row}.place " + (f"= {least[name]}" if same else f"BETWEEN {least[name]} AND {most[name]}")
        for name, row in alias.items():
            if not self.first or name in one.tried:
                near = (other for other in one.near(name) if most[other] >= least[name])
                yield from (f"{alias[other]}.{position} < {row}.{position}" for other in near)
        yield from (f"{alias[a]}.{position} <> {alias[b]}.{position}" for a, b in one.apart)

    # First events per value of shared variables.

    def _firsts(
        self,
        one: QueriedScenario,
        tables: Mapping[Event, str],
        alias: Mapping[Event, str],
        wanted: Mapping[str, Set[str]],
    ) -> dict[Event, QueriedRow]:
        """Return the rows of each occurrence: all if tried individually, else those at the least
        positions.
        """
        keys = {name: [key for key in sorted(wanted[row]) if key.endswith("_key")] for name, row in alias.items()}
        found: dict[Event, QueriedRow] = {}
        for name, row in alias.items():
            if name in one.tried:
                found[name] = QueriedRow(tables[name], {**{key: key for key in keys[name]}, f"p{row[1:]}": "pos"})
                continue
            sources, where = [f"{tables[name]} AS n"], list[str]()
            shared = {key: f"n.{key}" for key in keys[name]}
            for other in one.near(name):
                table, before = found[other].table, alias[other] if other in one.tried else found[other].table
                sources.append(table if table == before else f"{table} AS {before}")
                where += [f"{before}.trace = n.trace", f"{before}.pos < n.pos"][self.untraced :]
                where += self._same(shared, before, found[other])
            for column, (members, length) in one.starts.items():
                if name in members and column not in shared:
                    start = self._start(column, [other for other in alias if other in members], tables, keys)
                    sources.append(start.table)
                    where += [f"{start.table}.trace = n.trace", *self._same(shared, start.table, start)][
                        self.untraced :
                    ]
                if name in members:
                    where.append(f"n.time - {shared[column]} BETWEEN 0 AND {self.guards.literal(length).whole}")
            columns = "".join(f"{expression} AS {column}, " for column, expression in shared.items())
            trace, *groups = ["n.trace", *shared.values()]
            groups, trace = (groups, "") if self.untraced else ([trace, *groups], f"{trace}, ")
            condition = f" WHERE {' AND '.join(dict.fromkeys(where))}" if where else ""
            grouped = f"GROUP BY {', '.join(groups)}" if groups else "HAVING count(*) > 0"
            query = (
                f"SELECT {trace}{columns}min(n.pos) AS pos FROM "
                f"{', '.join(dict.fromkeys(sources))}{condition} {grouped}"
            )
            found[name] = QueriedRow(self._table(query, "f"), {column: column for column in shared})
        return found

    def _start(
        self, column: str, members: Sequence[Event], tables: Mapping[Event, str], keys: Mapping[Event, Sequence[str]]
    ) -> QueriedRow:
        every = [key for key in keys[members[0]] if all(key in keys[name] for name in members)]
        columns = ", ".join(["trace", *every, "time AS start"][self.untraced :])
        selects = dict.fromkeys(f"SELECT {columns} FROM {tables[name]}" for name in members)
        return QueriedRow(
            self._table(" UNION ".join(selects), "start_"), {**{key: key for key in every}, column: "start"}
        )

    @staticmethod
    def _same(known: dict[str, str], row: str, has: QueriedRow) -> list[str]:
        columns = {column: f"{row}.{own}" for column, own in has.shared.items()}
        return [f"{one} = {known[column]}" for column, one in columns.items() if known.setdefault(column, one) != one]

    def _shared(
        self, one: QueriedScenario, alias: Mapping[Event, str], rows: Mapping[Event, QueriedRow]
    ) -> Iterator[str]:
        known: dict[str, str] = {}
        for name, row in alias.items():
            yield from self._same(known, row, rows[name])
        for column, (members, length) in one.starts.items() if known else ():
            for name in (name for name in alias if name in one.tried & members):
                yield f"{alias[name]}.time - {known[column]} BETWEEN 0 AND {self.guards.literal(length).whole}"

    def _object(self, items: Iterable[tuple[str, str]]) -> str:
        fields = [
            f"{self.dialect.text(('{' if not number else ', ') + json.dumps(name) + ': ')} || {value}"
            for number, (name, value) in enumerate(items)
        ]
        return f"{' || '.join(fields)} || '}}'" if fields else "'{}'"


def _of_last(query: str, last: Mapping[str, str]) -> str:
    """Return a query with the columns of first events as those in the rows of the last ones."""
    literal_or_column = re.compile(r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|\b(e\d+)\.(\w+)""")

    def named(found: re.Match[str]) -> str:
        row, column = found[1], found[2]
        if row not in last:
            return found[0]
        return f"{last[row]}.{f'first_{column}' if column in ('pos', 'time') else column}"

    return literal_or_column.sub(named, query)


def _is_of_one_row(condition: str, last: Mapping[str, str]) -> bool:
    """Whether a condition says that values of the first and of the last event of a row are equal."""
    found = re.fullmatch(r"(e\d+)\.(v\d+_key) = (e\d+)\.(v\d+_key)", condition)
    return found is not None and found[2] == found[4] and last.get(found[3]) == found[1]
