"""The `sql` backend: a query on a table of events, whose rows are detections.

A comment describes the table, the rows and the declared time. The `limit` counts joined events.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from backends.sql.dialects import DIALECTS, PORTABLE, TRANSPILED, transpiled
from backends.sql.reader import PROGRAMS, Query, dialect_of, query
from backends.sql.translation import SqlQuery
from backends.tables import Table, with_time
from rvaft.backend import Backend, Highlighting, Match, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, WithoutEvent
from rvaft.core.time_order import GUARDED_EVENTS
from rvaft.errors import NotExpressible, OptionError, unwritten
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Operator
from rvaft.model.nodes import Assumption, Side
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor, Monitor

__all__ = ["SqlBackend", "SqlDuckdbBackend", "SqlPostgresBackend", "SqlTableBackend", "SqlTableDuckdbBackend"]


class SqlBackend(Backend):
    """SQL for SQLite: every tree under every semantics, including late events; it reports
    detections only.

    >>> from rvaft import loads
    >>> specification = SqlBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED)
    >>> [verdict.symbol for verdict in specification.monitor().run([{"event": "break_in"}, {"event": "alarm"}])]
    ['?', '⊤']
    """

    name: ClassVar[str] = "sql"
    language: ClassVar[str] = "sql"
    suffix: ClassVar[str] = ".sql"
    remark: ClassVar[str] = "-- {}\n"
    remark_line: ClassVar[int] = 1
    dialect: ClassVar[str] = "sqlite"
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    json_alone: ClassVar[bool] = True
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = GUARDED_EVENTS
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.LATE, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = JSON_VALUES | {Value.SOME_ITEM}
    ties: ClassVar[Ties] = Ties.ANY
    highlighting: ClassVar[Highlighting | None] = Highlighting("SQL")
    default_limit: ClassVar[int] = 2_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the query; raises `NotExpressible` for constants that tables cannot hold, and
        `TooLarge`.
        """
        return SpecificationText(*SqlQuery(prop, semantics, DIALECTS[self.dialect], limit).text())

    def timed(self, text: str, time: EventTime) -> str:
        """Return the text with this declaration of times, unless it has one."""
        return with_time(text, time, "--")

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """Return a monitor for any query."""
        compiled = self._query(text)
        return DetectionMonitor(compiled.first_detections, compiled.left_open)

    def _query(self, text: str) -> Query:
        return query(text, self.dialect)

    def matches(self, text: str, traces: Sequence[Sequence[Json]]) -> Sequence[frozenset[Match]] | None:
        """Return all matches per trace, or None if the rows of the query are not all matches."""
        compiled = self._query(text)
        return compiled.matches(traces) if compiled.every else None

    def mapped(self, mapping: Mapping[str, Any]) -> "SqlTableBackend":
        """Return the backend for a `table` with typed `columns` by field, and the columns
        `position`, `partition` (one log for each value) and `time` (with its type, as in `ts:ms`),
        in a `dialect`; raises `OptionError`.
        """
        dialect = mapping.get("dialect", self.dialect)
        if dialect not in (*DIALECTS, *TRANSPILED):
            raise OptionError(f"unknown dialect {dialect}; known: {', '.join((*DIALECTS, *TRANSPILED))}")
        if "position" not in mapping and dialect not in PROGRAMS:
            raise OptionError(f"rows have no order in {dialect}: name the column that orders them (--position COLUMN)")
        return SqlTableBackend(Table.of(mapping), dialect)

    @classmethod
    def dialect_backend(cls, dialect: str) -> str:
        """Return the name of the backend for a dialect; raises `OptionError`."""
        if dialect not in DIALECTS:
            raise OptionError(f"unknown dialect {dialect or '(empty)'}; known: {', '.join(DIALECTS)}")
        if dialect != cls.dialect and cls.form_of is not None:
            raise OptionError(f"{cls.name} is the dialect {cls.dialect}: name {cls.form_of} for {dialect}")
        return cls.name if dialect == cls.dialect else f"{cls.name}-{dialect}"


class SqlDuckdbBackend(SqlBackend):
    """SQL for DuckDB."""

    name: ClassVar[str] = "sql-duckdb"
    dialect: ClassVar[str] = "duckdb"
    form_of: ClassVar[str | None] = "sql"
    extra: ClassVar[str] = "duckdb"
    modules: ClassVar[tuple[str, ...]] = ("duckdb",)


class SqlPostgresBackend(SqlBackend):
    """SQL for PostgreSQL, without a reader."""

    name: ClassVar[str] = "sql-postgres"
    dialect: ClassVar[str] = "postgres"
    form_of: ClassVar[str | None] = "sql"
    readable: ClassVar[bool] = False
    values: ClassVar[frozenset[Value]] = JSON_VALUES

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """Raise `OptionError`: there is no reader for PostgreSQL."""
        return Backend.read(self, text, atoms=atoms)


class SqlTableBackend(SqlBackend):
    r"""SQL for SQLite over typed columns: of a table `events` with the columns `pos`, `trace` and
    `time` besides those of the fields, or of any table (`mapped`).

    >>> from rvaft import loads
    >>> text = "event login(u: text) = { login: true, user: u }; assume types, present; top on login(U);"
    >>> auth = SqlTableBackend().mapped({"table": "auth", "columns": {"user": "user_name"}, "dialect": "duckdb"})
    >>> print(auth.translate(loads(text), Semantics.SCATTERED).text.partition("WITH")[2], end="")
    <BLANKLINE>
      n1 AS (
        SELECT rowid AS pos, user_name AS "U" FROM auth WHERE (login = true)
      )
    SELECT e1.pos AS detected, 1 AS branch,
      '{"top": ' || CAST(e1.pos AS TEXT) || '}' AS nodes, e1."U" AS "U"
    FROM n1 AS e1
    """

    name: ClassVar[str] = "sql-table"
    form_of: ClassVar[str | None] = "sql"
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = frozenset({Value.NUMBER, Value.BOOLEAN})
    relies: ClassVar[frozenset[Assumption]] = frozenset({Assumption.TYPES, Assumption.PRESENT, Assumption.EXACT})

    def __init__(self, table: Table | None = None, dialect: str = "") -> None:
        self._table, self._dialect = table or Table(), dialect or self.dialect

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the query; raises `NotExpressible` for fields that columns cannot hold, `TooLarge`
        and `ToolMissing`.
        """
        waiting = [clause.source.node for clause in prop.absences if clause.side is Side.AFTER]
        if waiting and self._dialect in TRANSPILED:
            reason = (
                f"a `without … after` is a subquery that compares times, which rvaft does not write for {self._dialect}"
            )
            raise NotExpressible(unwritten(reason), nodes=waiting)
        dialect = PORTABLE if self._dialect in TRANSPILED else DIALECTS[self._dialect]
        text, metrics = SqlQuery(prop, semantics, dialect, limit, self._table).text()
        if self._dialect in TRANSPILED:
            text = transpiled(text, self._dialect)
        return SpecificationText(text, metrics)

    def _query(self, text: str) -> Query:
        dialect = dialect_of(text) or self._dialect
        if dialect not in PROGRAMS:
            raise OptionError(f"{self.name} is only emitted for {dialect}: rvaft runs texts for SQLite and DuckDB")
        return query(text, dialect)


class SqlTableDuckdbBackend(SqlTableBackend):
    """SQL for DuckDB over typed columns."""

    name: ClassVar[str] = "sql-table-duckdb"
    dialect: ClassVar[str] = "duckdb"
    extra: ClassVar[str] = "duckdb"
    modules: ClassVar[tuple[str, ...]] = ("duckdb",)
