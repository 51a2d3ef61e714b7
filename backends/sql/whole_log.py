"""Whole logs in DuckDB, for `rvaft monitor --engine duckdb`.

DuckDB reads the file into typed columns, runs the query of the tree, and counts equal events. It
reads more leniently than rvaft: rows that rvaft might read in another way are read again by rvaft,
or the log is declined.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

from backends.sql import SqlTableBackend
from backends.sql.connections import DuckDbConnection, NamedFile, failures
from backends.sql.dialects import DIALECTS, literal
from backends.sql.files import FORMATS, LogFile, instant, nanoseconds
from backends.sql.translation import SqlQuery
from backends.tables import Path as Place
from backends.tables import Table, column_types
from rvaft.backend import SpecificationText
from rvaft.core.fields_to_read import Scope
from rvaft.core.pattern_index import literals_of
from rvaft.core.property import Property
from rvaft.errors import NotExpressible, RvaftError, ToolFailed, unwritten
from rvaft.model.assumptions import AssumptionCheck, places, used_events
from rvaft.model.event_time import UNITS, EventTime, TimeFormat
from rvaft.model.guards import Guard, Operation, Operator, walk
from rvaft.model.nodes import Assumption, Side, ValueType
from rvaft.model.patterns import Literal, Pattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import EXACT_INTEGERS
from rvaft.model.verdict import Semantics
from rvaft.readers.log import LogReader
from rvaft.stream.plan import MonitoringPlan
from rvaft.stream.whole_log import FIRST, Declined, EventCount, LogAnswer, QueryEngine
from rvaft.stream.whole_log import Place as EventPlace
from rvaft.support.files import damage

MATCHES: Final = 20_000
"""Maximum number of matches of a query; a log with more is replayed in full."""
PATIENCE: Final = 60.0
"""Seconds for the matches; then the log is replayed in full."""
DOUBTS: Final = 10_000
"""Maximum number of lines that rvaft reads again."""
CLASSES: Final = 10_000
SPELLINGS: Final = 60
_BY_VALUE: Final = frozenset({Operator.DIV, Operator.MUL, Operator.NUMBER})
"""Operators that may be undefined for values of the right types."""
_FOLDED: Final = "ſKßẞﬀﬁﬂﬃﬄﬅﬆ"
"""Letters other than ASCII that are ASCII in folded case."""


class _LogBackend(SqlTableBackend):
    """The query of a tree, and conditions of its patterns."""

    name: ClassVar[str] = "the engine duckdb"
    query: SqlQuery

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the query."""
        assert self._table is not None, "the table is made for the tree"
        self.query = SqlQuery(prop, semantics, DIALECTS["duckdb"], limit, self._table, ordered=True)
        return SpecificationText(*self.query.text())


@dataclass(frozen=True)
class LogColumn:
    """A column of the table of events."""

    name: str
    place: Place
    kind: ValueType


class DuckDbEngine(QueryEngine):
    """DuckDB, for trees whose query on typed columns rvaft can write, under `scattered` and `consecutive`."""

    name: ClassVar[str] = "DuckDB"
    formats: ClassVar[frozenset[str]] = frozenset(FORMATS)

    def __init__(self, plan: MonitoringPlan) -> None:
        failures()
        self.plan, self.types = plan, plan.monitors.types
        absences = self.types.tree.absences
        self.waits = any(clause.side is Side.AFTER for _, clause, _ in absences)
        """Whether a later time decides a match."""
        self.clocked = any(clause.duration is not None for _, clause, _ in absences)
        """Whether the time of any event counts."""
        try:
            self._translate(plan.monitors.columns[0].part, plan.monitors.semantics)
        except NotExpressible as refusal:
            name, semantics = _LogBackend.name, plan.monitors.semantics
            raise NotExpressible(refusal.why, backend=name, semantics=semantics, nodes=refusal.nodes) from None
        self.name_of = {one.place: one.name for one in self.columns}
        literals = [literals_of(letter.pattern) for _, _, letter in self.types.letters]
        fields = self.types.discriminators.fields
        self.discriminating = all(any(isinstance(one.get(field), str) for field in fields) for one in literals)
        """Whether each pattern has a text in a discriminating field."""
        entries = [self._condition(letter.pattern) for what, _, letter in self.types.letters if what == "entry"]
        self.entry = f"({' OR '.join(f'({one})' for one in dict.fromkeys(entries))}) IS TRUE"
        absent = [*entries, *(self._condition(pattern) for _, _, pattern in absences)]
        self.concerns = f"({' OR '.join(f'({one})' for one in dict.fromkeys(absent))}) IS TRUE"
        """The condition that a node or a `without` matches an event."""

    def _translate(self, part: RVAFT, semantics: Semantics) -> None:
        tree = self.types.tree
        if semantics not in (Semantics.SCATTERED, Semantics.CONSECUTIVE):
            raise NotExpressible(unwritten("a query does not tell when a verdict becomes false"))
        if tree.time is not None and tree.time.format not in (*UNITS, TimeFormat.ISO8601):
            raise NotExpressible(unwritten(f"DuckDB does not read times as {tree.time.format}"))
        if self.plan.key is not None and self.waits:
            raise NotExpressible(unwritten("with --key, times of other keys decide a `without … after`"))
        guards = [*(node.when for node in tree.top_down()), *(one.when for one in tree.ignores)]
        guards += [clause.when for _, clause, _ in tree.absences]
        by_value = (one for guard in guards for one in walk(guard))
        if any(isinstance(one, Operation) and one.operator in _BY_VALUE for one in by_value):
            raise NotExpressible(unwritten("guards with *, / and number() may be undefined in some events only"))
        plain = _LogBackend(None, "duckdb")
        kinds = column_types(plain.prepared(tree, semantics))
        self.columns = [LogColumn(f"c{number}", place, kind) for number, (place, kind) in enumerate(kinds.items(), 1)]
        used = column_types(plain.prepared(part, semantics))
        named = {".".join(map(str, one.place)): one.name for one in self.columns if one.place in used}
        trace = "" if self.plan.key is None else "key"
        self.backend = _LogBackend(Table("log", named, "pos", trace, "time" if tree.time else "", "ns"), "duckdb")
        self.query = self.backend.translate(part, semantics).text
        self.every = bool(re.search(r"^-- .*: every match\.$", self.query, re.MULTILINE))
        """Whether the query returns every match, not the first one of each scenario."""

    def _condition(self, pattern: Pattern, when: Guard | None = None) -> str:
        return self.backend.query.condition(pattern, [] if when is None else [when])

    def _literal(self, value: object) -> str:
        term = self.backend.query.guards.literal(value)
        return term.whole or term.real or term.text or term.truth or "NULL"

    def broken(self) -> str:
        """Return the condition that an event breaks the assumptions `types` or `present`."""
        tree, found = self.types.tree, list[str]()
        for name in used_events(tree):
            parts = [(place, part) for place, part, _ in places(tree.events[name].pattern)]
            fits = [
                f"{self.name_of[place]} = {self._literal(part.value)}"
                for place, part in parts
                if isinstance(part, Literal)
            ]
            lacks = [f"{self.name_of[place]} IS NULL" for place, part in parts if isinstance(part, Variable)]
            if lacks:
                found.append(f"({' AND '.join([*fits, ''])}({' OR '.join(lacks)}))")
        if Assumption.EXACT in tree.assumes:
            numbers = [one.name for one in self.columns if one.kind in (ValueType.INTEGER, ValueType.NUMBER)]
            found += [f"abs({name}) >= {EXACT_INTEGERS}" for name in numbers]
        return " OR ".join(found) or "false"

    def keys(self) -> Iterator[str]:
        """Yield expressions with equal values for events that match the same patterns and guards."""
        literals: dict[Place, dict[str, None]] = {}
        for _, _, letter in self.types.letters:
            for place, part, _ in places(letter.pattern):
                if isinstance(part, Literal):
                    literals.setdefault(place, {})[self._literal(part.value)] = None
            if letter.when is not None:
                yield f"({self._condition(letter.pattern, letter.when)}) IS TRUE"
        for place, values in literals.items():
            name = self.name_of[place]
            tests = [f"{name} IN ({', '.join(values)})"]
            if len(place) == 1 and place[0] in self.types.discriminators.fields:
                texts = [*self.texts(place)]
                if not self.discriminating:
                    yield name
                    continue
                spelled = dict.fromkeys(literal(text.strip("/ ").casefold()) for text in texts)
                tests.append(f"lower(trim({name}, '/ ')) IN ({', '.join(spelled)})")
                others = "[^ -~]" if not all(map(str.isascii, texts)) else f"[{_FOLDED}]"
                tests.append(f"regexp_matches({name}, {literal(others)})")
            yield f"CASE WHEN {' OR '.join(tests)} THEN {name} END"

    def texts(self, place: Place) -> Iterator[str]:
        """Yield the texts that patterns have at a place."""
        for _, _, letter in self.types.letters:
            for other, part, _ in places(letter.pattern):
                if other == place and isinstance(part, Literal) and isinstance(part.value, str):
                    yield part.value

    def ask(self, path: Path, reader: LogReader | None) -> "DuckDbAnswer":
        """Return what is in a log; raises `Declined`."""
        time = self.types.tree.time
        field: Place = ("time",) if time is None else time.field
        name = "jsonl" if reader is None else reader.name
        fields = () if self.plan.key is None else self.plan.key.fields
        keys = [place for one in fields for place in dict.fromkeys([(one.text,), one.path])]
        unreadable: tuple[type[Exception], ...] = (RvaftError, OSError, *damage())
        try:
            with ExitStack() as opened:
                file = NamedFile(path)
                opened.callback(file.close)
                try:
                    source = FORMATS[name](path, [*(one.place for one in self.columns), *keys], field)
                    connection = opened.enter_context(DuckDbConnection([file.name], spills=True))
                    answer = DuckDbAnswer(self, source, connection, file.name)
                except failures() as error:
                    raise Declined(f"DuckDB: {file.by_path(_first_line(error))}") from error
                opened.pop_all()
                file.close()  # the rows are in a table
                return answer
        except Declined:
            raise
        except unreadable as error:
            raise Declined(_first_line(error)) from error


def _first_line(error: BaseException) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__


class DuckDbAnswer(LogAnswer):
    """A table in DuckDB, and what was asked of it."""

    def __init__(self, engine: DuckDbEngine, source: LogFile, connection: DuckDbConnection, file: str) -> None:
        self.engine, self.source, self.connection = engine, source, connection
        self._load(file)
        self._check()
        keys = ", ".join(engine.keys()) or "1"
        groups = self._ask(f"SELECT count(*), min(pos, {FIRST}) FROM log GROUP BY {keys} LIMIT {CLASSES + 1}")
        if len(groups) > CLASSES:
            raise Declined(f"more than {CLASSES} kinds of events")
        self.groups = [EventCount(number, first) for number, first in groups]
        self.noted = [*self._noted()]
        most = engine.plan.max_keys + 2  # with the events without a key, and one key too many
        counts = self._ask(f"SELECT key, count(*), min(pos) FROM log GROUP BY key ORDER BY 3 LIMIT {most}")
        self.keys = [EventCount(number, [first]) for key, number, first in counts if key]
        self.keyless = next((EventCount(number, [first]) for key, number, first in counts if key is None), None)
        self.selected = self._selected()

    def _ask(self, query: str, *, seconds: float | None = None) -> list[tuple[Any, ...]]:
        return self.connection.ask(query, seconds=seconds)[1]

    def _load(self, file: str) -> None:
        engine, source, tree = self.engine, self.source, self.engine.types.tree
        rows = source.rows(self.connection, file)
        cells = [f"{source.cell(one.place, one.kind)} AS {one.name}" for one in engine.columns]
        match tree.time:
            case None:
                time = "TRY_CAST(time_number AS DOUBLE)"
            case EventTime(format=TimeFormat.ISO8601):
                time = f"coalesce({instant('time_text')}, instant)"
            case declared:
                time = nanoseconds("time_number", UNITS[str(declared.format)])
        keys = () if engine.plan.key is None else [source.key(field) for field in engine.plan.key.fields]
        odd = " OR ".join(
            ["other", *(source.odd(one.place, one.kind) for one in engine.columns), *(odd for _, odd in keys)]
        )
        names = [f"k{number}" for number in range(len(keys))]
        cells += [f"{text} AS {name}" for name, (text, _) in zip(names, keys, strict=True)]
        present = " AND ".join(f"{name} IS NOT NULL" for name in names)
        key = f"CASE WHEN {present} THEN min(pos) OVER (PARTITION BY {', '.join(names)}) END" if keys else "0"
        self._ask(
            f"CREATE TABLE log AS SELECT pos, {''.join(f'{one.name}, ' for one in engine.columns)}"
            f"{time} AS time, time_number IS NULL AND time_text IS NOT NULL AS words, "
            "coalesce(time_number, time_text) IS NOT NULL OR instant IS NOT NULL AS timed, odd, doubtful, "
            f"{key} AS key FROM "
            f"(SELECT row_number() OVER () AS pos, {''.join(f'{one}, ' for one in cells)}"
            f"CAST({source.time_number} AS VARCHAR) AS time_number, CAST({source.time_text} AS VARCHAR) AS time_text, "
            f"{source.instant} AS instant, "
            f"coalesce({odd}, false) AS odd, coalesce({source.doubtful}, true) AS doubtful FROM {rows})"
        )

    def _check(self) -> None:
        """Raise `Declined` for a log with a warning, or with values that columns do not hold."""
        engine, tree = self.engine, self.engine.types.tree
        entry, late = engine.entry, None if tree.time is None else tree.time.late
        unread = f"{entry} AND {'words' if tree.time is None else 'time IS NULL'}"
        if late is not None or engine.clocked:  # the time of any event counts, not only of those that the tree matches
            unread = f"{unread} OR key IS NOT NULL AND time IS NULL AND timed"
        causes = {
            "has a value that a column cannot hold exactly": "odd",
            "breaks an assumption of the tree": engine.broken(),
            "has a time that cannot be read": unread,
        }
        counts = ", ".join(f"min(pos) FILTER (WHERE {cause})" for cause in causes.values())
        [(self.total, *found)] = self._ask(f"SELECT count(*), {counts} FROM log")
        doubtful = [number for (number,) in self._ask(f"SELECT pos FROM log WHERE doubtful LIMIT {DOUBTS + 1}")]
        if len(doubtful) > DOUBTS:
            raise Declined(f"more than {DOUBTS} lines that DuckDB may read in another way")
        self.source.check(self.total, sorted(doubtful), engine.plan.reads)
        for cause, number in zip(causes, found, strict=True):
            if number is not None:
                raise Declined(f"event {number} {cause}")
        back, rows = "lag(time) OVER (ORDER BY pos) > time", f"{entry} AND time IS NOT NULL"
        if late is not None:
            back = f"max(time) OVER (PARTITION BY key ORDER BY pos ROWS UNBOUNDED PRECEDING) - time > {late}"
            rows = "key IS NOT NULL"
        elif engine.clocked:
            rows = "key IS NOT NULL AND time IS NOT NULL"
        back = f"SELECT pos FROM (SELECT pos, {back} AS back FROM log WHERE {rows}) WHERE back LIMIT 1"
        for (number,) in self._ask(back):
            raise Declined(f"the time goes back at event {number}")
        if Assumption.CASE in tree.assumes:
            self._check_case()

    def _check_case(self) -> None:
        check = AssumptionCheck(self.engine.types.tree, [Assumption.CASE])
        for one in self.engine.columns:
            if one.kind is not ValueType.TEXT:
                continue
            for (text,) in self.connection.rows(f"SELECT DISTINCT {one.name} FROM log WHERE {one.name} IS NOT NULL"):
                event: Any = text
                for name in reversed(one.place):
                    event = {name: event}
                if check.broken(event):
                    raise Declined(f"{json.dumps(text)} breaks the assumption case")

    def _noted(self) -> Iterator[int]:
        engine = self.engine
        for field in engine.types.discriminators.fields:
            name = engine.name_of[field,]
            known = ", ".join(map(literal, engine.texts((field,))))
            query = f"SELECT min(pos) FROM log WHERE NOT {engine.entry} AND {name} NOT IN ({known}) GROUP BY {name}"
            yield from (number for (number,) in self._ask(f"{query} ORDER BY 1 LIMIT {SPELLINGS}"))

    def _matches(self) -> list[tuple[int, int, list[int]]] | None:
        """Return each match in order: key, number of the last event, and those of all; None for too many."""
        key, where = ("0", "") if self.engine.plan.key is None else ("trace", " WHERE trace IS NOT NULL")
        query = f"SELECT {key}, detected, nodes FROM (\n{self.engine.query}\n) AS found{where}"
        try:
            found = self._ask(f"{query} LIMIT {MATCHES + 1}", seconds=PATIENCE)
        except TimeoutError:
            return None
        if len(found) > MATCHES:
            return None
        return sorted((key, last, sorted(_positions(nodes))) for key, last, nodes in found)

    def _selected(self) -> Iterable[int]:
        monitors, every = self.engine.plan.monitors, self.engine.every
        whole, matches = len(monitors.columns) == 1, self._matches()
        if matches == []:
            return []
        if self.engine.types.tree.absences:
            return self._numbers_with_absences(matches, bounded=whole and not monitors.repeat)
        if matches is None or (monitors.repeat and not every):
            return self._numbers(None)
        first: dict[int, int] = {}
        for key, last, _ in matches:
            first.setdefault(key, last)
        if not every:
            return self._numbers({key: [(0, last)] for key, last in first.items()})
        if monitors.semantics is Semantics.SCATTERED:
            alone = whole and not monitors.repeat
            return sorted({one for key, _, numbers in matches for one in numbers if not alone or one <= first[key]})
        if not whole:
            return self._numbers(None)
        ranges: dict[int, list[tuple[int, int]]] = {}
        for key, last, numbers in matches:
            known = ranges.setdefault(key, [])
            if not known or (monitors.repeat and numbers[0] > known[-1][1]):
                known.append((numbers[0], last))
        return self._numbers(ranges)

    def _numbers_with_absences(
        self, matches: list[tuple[int, int, list[int]]] | None, *, bounded: bool
    ) -> Iterator[int]:
        """Yield the numbers of events that a match may have, that may break it, or at which it is detected.

        Without late events, the latter are enough to decide it: times do not go back.
        """
        time = self.engine.types.tree.time
        if matches is None or (self.engine.waits and time is not None and time.late):
            return self._numbers(None, "true")
        first: dict[int, int] = {}
        for key, last, _ in matches:
            first.setdefault(key, last)
        detected = ", ".join(map(str, sorted({last for _, last, _ in matches})))
        bounds = {key: [(0, last)] for key, last in first.items()} if bounded else None
        return self._numbers(bounds, f"{self.engine.concerns} OR pos IN ({detected})")

    def _numbers(
        self, ranges: Mapping[int, Sequence[tuple[int, int]]] | None, condition: str | None = None
    ) -> Iterator[int]:
        """Yield the numbers of events that a match may have, within increasing ranges of their keys."""
        left = {key: list(reversed(some)) for key, some in (ranges or {}).items()}
        for number, key in self._places(f"({condition or self.engine.entry}) AND key IS NOT NULL"):
            some = left.get(key, [])
            while some and some[-1][1] < number:
                some.pop()
            if ranges is None or (some and some[-1][0] <= number):
                yield number

    def _places(self, condition: str) -> Iterator[tuple[int, int]]:
        try:
            yield from self.connection.rows(f"SELECT pos, key FROM log WHERE {condition} ORDER BY pos")
        except failures() as error:
            raise ToolFailed("DuckDB", reason=_first_line(error)) from error

    def of_keys(self) -> Iterator[tuple[int, int]]:
        """Yield each event with a key, and the first event of that key."""
        return self._places("key IS NOT NULL")

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[EventPlace]:
        """Yield the events with these numbers."""
        return self.source.events(numbers, reads)

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()


def _positions(nodes: str) -> Iterator[int]:
    for found in json.loads(nodes).values():
        yield from found if isinstance(found, list) else [found]
