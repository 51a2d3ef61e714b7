"""From a tree to a query: a scenario is a join, an occurrence an alias, precedence `<`, another event `<>`, a guard a condition.

Under `strict` and `projected` the events that count have places, and a match has the first of them; under `consecutive` each event stands with all the
places at which a match with it may start. Where under `scattered` nothing but order ties events together, the query looks for the least position of
each, one after the other, and says the first match of each scenario, not all.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import replace
from itertools import combinations
from typing import Final, NamedTuple

import networkx as nx

from backends.sql.dialects import Duckdb, Path
from backends.sql.guards import FACETS, Guards, SqlTerm
from rvaft.analysis.branches import number_of
from rvaft.analysis.normal_form import Op, body
from rvaft.analysis.plain_trees import LIMIT, asks_for_time, plain_trees
from rvaft.analysis.scenarios import Kept, event, precedence, resolutions
from rvaft.analysis.unification import compatible
from rvaft.backend import Metrics
from rvaft.errors import NotExpressible, TooLarge, TreeError
from rvaft.model.event_time import TIME
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, rigid_variables
from rvaft.model.tree import RVAFT, Whole, find_cycle
from rvaft.model.verdict import Semantics

_TOKEN: Final = re.compile(r"'(?:[^']|'')*'|[\w.]+|->>|[<>]=?|<>|\|\||\S")
_LENGTH: Final = 400
"""So many characters may a text have for each event that is joined."""
TABLES: Final = 60
"""The most events of a scenario: SQLite joins 64 tables."""


class QueriedScenario(NamedTuple):
    """The occurrences of a scenario, each after those before it, with all that are `before` it, and the guards."""

    tree: RVAFT
    branch: int
    occurrences: tuple[str, ...]
    before: Mapping[str, frozenset[str]]
    guards: tuple[Guard, ...]


class SqlQuery:
    """One translation. Raises `TooLarge` beyond `limit` events that are joined, `TreeError` without a feasible scenario."""

    def __init__(self, tree: RVAFT, semantics: Semantics, dialect: Duckdb, limit: int) -> None:
        self.tree, self.semantics, self.dialect, self.limit = tree, semantics, dialect, limit
        self.guards = Guards(dialect)
        self.tables: dict[str, str] = {}
        """Of each query the name of the table that it makes."""
        self.late = late = None if tree.time is None else tree.time.late
        self.timed = any(map(asks_for_time, tree.top_down()))
        if self.timed and any(TIME in _fields(pattern) for pattern in _all_patterns(tree)):
            reason = f"the time of an event is called {TIME} there, and this tree reads a field of that name"
            raise NotExpressible(reason, backend="sql", semantics=semantics)
        plain = plain_trees(
            tree.changed(time=replace(tree.time, late=None)) if tree.time and late is not None else tree,
            limit=min(limit, LIMIT),
        )
        self.scenarios = [*self._scenarios(plain, minimal=True)] if semantics is Semantics.SCATTERED else []
        self.first = bool(self.scenarios) and all(map(self._loose, self.scenarios))
        """Whether the first match of each scenario is looked for, and not all."""
        if not self.first:
            self.scenarios = [*self._scenarios(plain, minimal=False)]
        if not self.scenarios:
            raise TreeError(f"no scenario of {tree.root} is feasible", rule="no-scenario", nodes=[tree.root])
        self.most = max(len(one.occurrences) for one in self.scenarios)
        uses = [
            name for one in self.scenarios for o in one.occurrences for name in rigid_variables(self._pattern(one, o))
        ]
        self.variables = [*dict.fromkeys(uses)]

    def text(self) -> tuple[str, Metrics]:
        """The text and its sizes."""
        places = self._places()
        selects = [self._select(one, places) for one in self.scenarios]
        tables = ",\n".join(f"  {name} AS MATERIALIZED (\n    {query}\n  )" for query, name in self.tables.items())
        text = "\nUNION ALL\n".join(selects)
        text = f"WITH\n{tables}\n{text}\n"
        if len(text) > self.limit * _LENGTH:
            raise TooLarge("characters of the query", limit=self.limit)
        return f"{self._header(text)}{text}", Metrics(symbols=len(_TOKEN.findall(text)))

    def _header(self, text: str) -> str:
        time, late = self.tree.time, self.late
        rows = "the first match of each scenario" if self.first else "every match"
        lines = [
            f"rvaft sql {self.dialect.name}",
            f"The attack-fault tree {json.dumps(self.tree.root)} under {self.semantics}: {rows}.",
        ]
        lines += (
            [f"{self._column(name)} {name}" for name in self.variables] if "_key" in text or "_json" in text else []
        )
        lines.append(
            "events(trace, pos, event, time): the log, its number from 1, the event as JSON, nanoseconds or NULL."
        )
        if time is not None:
            lines.append(f"time {json.dumps(time.field)} as {time.format}{'' if late is None else f' late {late} ns'}")
        return "".join(f"-- {line}\n" for line in lines)

    # scenarios

    def _scenarios(self, trees: Iterable[RVAFT], *, minimal: bool) -> Iterator[QueriedScenario]:
        joined = 0
        for tree in trees:
            for kept in resolutions(tree, minimal=minimal, limit=self.limit):
                graph = precedence(tree, kept)
                if find_cycle(graph):
                    continue
                some = [name for name in kept if tree.nodes[name].has_event]
                joined += max(len(some), 1)
                if joined > self.limit or len(some) > TABLES:
                    what = "events joined in the scenarios" if joined > self.limit else "events joined in a scenario"
                    raise TooLarge(what, limit=self.limit if joined > self.limit else TABLES)
                before = {
                    name: frozenset(one for kind, one, _ in nx.ancestors(graph, event(name)) if kind == "event")
                    for name in some
                }
                order = tuple(sorted(some, key=lambda name: len(before[name])))
                guards = tuple(w for name in kept if (w := tree.nodes[name].when) is not None and variables(w))
                yield QueriedScenario(tree, self._branch(tree, kept), order, before, guards)

    def _branch(self, tree: RVAFT, kept: Kept) -> int:
        part = tree.part_of or Whole(tree)
        if part.branch is not None:
            return part.branch
        choosing = {name: children[0] for name, children in kept.items() if body(tree.nodes[name]).op is Op.ONE}
        origins, whole = tree.origins, part.tree
        choices = {origins.get(name, name): origins.get(child, child) for name, child in choosing.items()}
        return (
            number_of(whole, {name: child for name, child in choices.items() if name in whole.nodes}, kind=part.kind)
            or 0
        )

    def _loose(self, one: QueriedScenario) -> bool:
        """Whether nothing but order ties the events of a scenario together."""
        patterns = {name: self._pattern(one, name) for name in one.occurrences}
        names = [name for pattern in patterns.values() for name in rigid_variables(pattern)]
        local = all(self._home(one, guard) for guard in one.guards)
        return (
            len(names) == len(set(names))
            and local
            and not any(compatible(patterns[a], patterns[b]) for a, b in self._apart(one))
        )

    @staticmethod
    def _apart(one: QueriedScenario) -> Iterator[tuple[str, str]]:
        """The occurrences that have no order."""
        for a, b in combinations(one.occurrences, 2):
            if a not in one.before[b] and b not in one.before[a]:
                yield a, b

    def _home(self, one: QueriedScenario, guard: Guard) -> str | None:
        """The occurrence whose event has all that a guard asks for, if there is one; of equal values the earliest counts, 1 or 1.0."""
        asked = set(variables(guard))
        binding = {name: asked & {*rigid_variables(self._pattern(one, name))} for name in one.occurrences}
        for name, own in binding.items():
            others = [other for other, some in binding.items() if other != name and some]
            if own == asked and all(name in one.before[other] for other in others):
                return name
        return None

    @staticmethod
    def _pattern(one: QueriedScenario, name: str) -> Pattern:
        pattern = one.tree.pattern(name)
        assert pattern is not None, "an occurrence has an event"
        return pattern

    # tables

    def _table(self, query: str, letter: str) -> str:
        if query not in self.tables:
            self.tables[query] = f"{letter}{sum(name[0] == letter for name in self.tables.values()) + 1}"
        return self.tables[query]

    def _places(self) -> str:
        """The table of the events that count, with their places in each trace where the semantics asks for these."""
        source, tree = "events", self.tree
        if self.late is not None:
            greatest = (
                "max(time) OVER (PARTITION BY trace ORDER BY pos ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING)"
            )
            late = f"coalesce({greatest} - time > {self.dialect.number(self.late)}, false)"
            source = self._table(f"SELECT trace, pos, event, time, {late} AS late FROM events", "late_")
        if self.semantics is Semantics.SCATTERED:
            return source
        wanted = [] if self.late is None or self.semantics is Semantics.STRICT else ["NOT late"]
        if self.semantics.projects:
            entries = [self._condition(entry.pattern, [entry.when] if entry.when else []) for entry in tree.alphabet]
            wanted.append(f"({' OR '.join(dict.fromkeys(f'({one})' for one in entries))})")
            ignored = [
                self._condition(tree.instantiate(one.on), [one.when] if one.when else []) for one in tree.ignores
            ]
            wanted += [f"({one}) IS NOT TRUE" for one in dict.fromkeys(ignored)]
        kept = "trace, pos, event, time" + (", late" if self.late is not None else "")
        where = f" WHERE {' AND '.join(wanted)}" if wanted else ""
        query = f"SELECT {kept}, row_number() OVER (PARTITION BY trace ORDER BY pos) AS place FROM {source}{where}"
        return self._table(query, "place_")

    def _leaf(self, one: QueriedScenario, name: str, places: str, wanted: Set[str]) -> str:
        """The table of the events of an occurrence, with these columns of its variables."""
        pattern = self._pattern(one, name)
        where = [self._condition(pattern, [guard for guard in one.guards if self._home(one, guard) == name])]
        columns = ["trace", "pos"]
        for variable, path in self._places_of(pattern):
            facets = {**self.guards.facets("event", path), "json": self.dialect.json("event", path)}
            named = ((f"{self._column(variable)}_{kind}", said) for kind, said in facets.items())
            columns += [f"{said} AS {column}" for column, said in named if column in wanted]
        if self.timed:
            columns.append("time")
        if self.late is not None:
            where.insert(0, "NOT late")
        if self.semantics is Semantics.CONSECUTIVE:
            shifts = self._table(
                " UNION ALL ".join(f"SELECT {number} AS shift" for number in range(self.most)), "shift_"
            )
            columns, places = [*columns, "place - shift AS start", "shift AS place"], f"{places}, {shifts}"
        elif self.semantics is not Semantics.SCATTERED:
            columns.append("place")
            where.insert(0, f"place <= {self.most}")
        return self._table(f"SELECT {', '.join(columns)} FROM {places} WHERE {' AND '.join(where)}", "n")

    def _column(self, variable: str) -> str:
        return f"v{self.variables.index(variable) + 1}"

    def _places_of(self, pattern: Pattern) -> list[tuple[str, Path]]:
        found: dict[str, Path] = {}
        for path, name in _variables(pattern):
            if not name.startswith("_") and not (self.timed and path == (TIME,)):
                found.setdefault(name, path)
        return [*found.items()]

    def _condition(self, pattern: Pattern, guards: Iterable[Guard]) -> str:
        """What is true of the events that match a pattern under guards."""
        dialect, asked = self.dialect, list[str]()
        todo: list[tuple[Path, Pattern]] = [((), pattern)]
        places: dict[str, Path] = {}
        while todo:
            path, part = todo.pop()
            match part:
                case _ if path == (TIME,) and self.timed and isinstance(part, Variable):
                    places[part.name] = path
                case Literal(str() as value) if path:
                    asked.append(dialect.is_text(value, "event", path))
                case Literal(value):
                    same = (
                        self.guards.equal(self.guards.variable("event", path), self.guards.literal(value))
                        if path
                        else "false"
                    )
                    asked.append(same)
                case Variable(name) if name in places and places[name] != (TIME,):
                    asked += [f"{dialect.kind('event', path)} IS NOT NULL"]
                    asked.append(f"{dialect.key('event', places[name])} = {dialect.key('event', path)}")
                case Variable() | Anything():
                    if isinstance(part, Variable):
                        places[part.name] = path
                    if path:
                        asked.append(f"{dialect.kind('event', path)} IS NOT NULL")
                case ObjectPattern(fields):
                    if path:
                        asked.append(dialect.is_a("object", "event", path))
                    todo += reversed([((*path, name), inner) for name, inner in fields])
                case ListPattern(items):
                    asked.append(
                        f"{dialect.is_a('list', 'event', path)} AND {dialect.length('event', path)} = {len(items)}"
                        if path
                        else "false"
                    )
                    todo += reversed([((*path, place), item) for place, item in enumerate(items)])
        for guard in guards:
            binding = {name: self._term(places[name]) for name in variables(guard)}
            asked.append(self.guards.condition(guard, binding))
        return " AND ".join(dict.fromkeys(asked)) or "true"

    def _term(self, path: Path) -> SqlTerm:
        return SqlTerm(whole="time") if self.timed and path == (TIME,) else self.guards.variable("event", path)

    # the query of a scenario

    def _select(self, one: QueriedScenario, places: str) -> str:
        alias = {name: f"e{number}" for number, name in enumerate(one.occurrences, 1)}
        terms: dict[str, SqlTerm] = {}
        first_of: dict[str, str] = {}
        rows_of: dict[str, list[str]] = {}
        where: list[str] = []
        for name, row in alias.items():
            pattern = self._pattern(one, name)
            for path, variable in _variables(pattern) if self.timed else ():
                if path == (TIME,):
                    terms[variable] = SqlTerm(whole=f"{row}.time")
            for variable, _ in self._places_of(pattern):
                rows_of.setdefault(variable, []).append(name)
        for variable, names in rows_of.items():
            columns = [f"{alias[name]}.{self._column(variable)}" for name in names]
            where += [f"{column}_key = {columns[0]}_key" for column in columns[1:]]
            facets = {kind: f"{columns[0]}_{kind}" for kind in FACETS}
            if any(names[0] not in one.before[name] for name in names[1:]):  # that of the earliest event: 1, or 1.0
                earliest = f"{alias[names[0]]}.pos"
                for name, column in zip(names[1:], columns[1:], strict=True):
                    sooner = f"CASE WHEN {alias[name]}.pos < {earliest} THEN"
                    facets |= {kind: f"{sooner} {column}_{kind} ELSE {facets[kind]} END" for kind in FACETS[:2]}
                    earliest = f"{sooner} {alias[name]}.pos ELSE {earliest} END"
            terms[variable] = SqlTerm.of(facets)
            first_of[variable] = columns[0]
        where += [self.guards.condition(guard, terms) for guard in one.guards if self._home(one, guard) is None]
        values = self._object((name, f"{column}_json") for name, column in first_of.items())
        asked = re.findall(r"(e\d+)\.(v\d+_[a-z]+)", " ".join([*where, values]))
        wanted = {row: frozenset(column for other, column in asked if other == row) for row in alias.values()}
        tables = {name: self._leaf(one, name, places, wanted[row]) for name, row in alias.items()}
        rows = self._firsts(one, tables) if self.first else tables
        sources = [f"{rows[name]} AS {row}" for name, row in alias.items()]
        first, *others = alias.values()
        joins = [f"{row}.trace = {first}.trace" for row in others]
        if self.first:  # of the events with the least positions what variables are
            with_values = [(name, row) for name, row in alias.items() if wanted[row]]
            sources += [f"{tables[name]} AS x{row[1:]}" for name, row in with_values]
            joins += [f"x{row[1:]}.{column} = {row}.{column}" for _, row in with_values for column in ("trace", "pos")]
            values = re.sub(r"\be(\d+)\.v", r"x\1.v", values)
        else:
            joins += self._order(one, alias)
        lasts = [
            f"{alias[name]}.pos" for name in one.occurrences if not any(name in some for some in one.before.values())
        ]
        least = lasts[0] if len(lasts) == 1 else f"{self.dialect.greatest}({', '.join(lasts)})"
        nodes = self._object((self._called(one.tree, name), f"{row}.pos") for name, row in alias.items())
        what = f"{first}.trace, {least} AS detected, {one.branch} AS branch,\n  {nodes} AS nodes, {values} AS variables"
        condition = "\n  AND ".join([*joins, *where])
        return f"SELECT {what}\nFROM {', '.join(sources)}" + (f"\nWHERE {condition}" if condition else "")

    @staticmethod
    def _called(tree: RVAFT, name: str) -> str:
        """What an occurrence is called in the tree as it was written."""
        name = tree.origins.get(name, name)
        own = name.rstrip("'").removesuffix("[event]")  # so a gate's event is called where the end of a `pand` is one
        return (
            own
            if tree.part_of is not None and name not in tree.part_of.tree.nodes and own in tree.part_of.tree.nodes
            else name
        )

    def _order(self, one: QueriedScenario, alias: Mapping[str, str]) -> Iterator[str]:
        """Which positions the occurrences may have."""
        first, *others = alias.values()
        position = "pos" if self.semantics is Semantics.SCATTERED else "place"
        if self.semantics is Semantics.CONSECUTIVE:
            yield from (f"{row}.start = {first}.start" for row in others)
        size = len(one.occurrences)
        if self.semantics is not Semantics.SCATTERED and size < self.most:
            sign = "<" if self.semantics is Semantics.CONSECUTIVE else "<="
            yield from (f"{row}.place {sign} {size}" for row in alias.values())
        for name, row in alias.items():
            before = one.before[name]
            near = [
                other
                for other in one.occurrences
                if other in before and not any(other in one.before[c] for c in before)
            ]
            yield from (f"{alias[other]}.{position} < {row}.{position}" for other in near)
        for a, b in self._apart(one):
            if compatible(self._pattern(one, a), self._pattern(one, b)):
                yield f"{alias[a]}.{position} <> {alias[b]}.{position}"

    def _firsts(self, one: QueriedScenario, tables: Mapping[str, str]) -> dict[str, str]:
        """For each occurrence the table of its least position in each trace after those before it."""
        found: dict[str, str] = {}
        for name in one.occurrences:
            before = one.before[name]
            near = sorted({found[a] for a in before if not any(a in one.before[b] for b in before)})
            after = "".join(f", {table}" for table in near)
            where = " AND ".join(f"{table}.trace = n.trace AND {table}.pos < n.pos" for table in near)
            query = f"SELECT n.trace, min(n.pos) AS pos FROM {tables[name]} AS n{after}{f' WHERE {where}' if where else ''} GROUP BY n.trace"
            found[name] = self._table(query, "f")
        return found

    def _object(self, items: Iterable[tuple[str, str]]) -> str:
        """A JSON object of what expressions give."""
        said = [
            f"{self.dialect.text(('{' if not number else ', ') + json.dumps(name) + ': ')} || {value}"
            for number, (name, value) in enumerate(items)
        ]
        return f"{' || '.join(said)} || '}}'" if said else "'{}'"


def _all_patterns(tree: RVAFT) -> Iterator[Pattern]:
    """All that a tree asks of events."""
    yield from (pattern for node in tree.top_down() if (pattern := tree.pattern(node.name)) is not None)
    yield from (tree.instantiate(ignore.on) for ignore in tree.ignores)


def _fields(pattern: Pattern) -> tuple[str, ...]:
    return tuple(name for name, _ in pattern.fields) if isinstance(pattern, ObjectPattern) else ()


def _variables(pattern: Pattern, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """The variables of a pattern, each with the places where it stands."""
    match pattern:
        case Variable(name):
            yield path, name
        case ObjectPattern(fields):
            for name, inner in fields:
                yield from _variables(inner, (*path, name))
        case ListPattern(items):
            for place, item in enumerate(items):
                yield from _variables(item, (*path, place))
