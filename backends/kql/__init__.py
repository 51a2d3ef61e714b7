"""The `kql` backend: queries of the Kusto Query Language on tables with typed columns.

The `limit` counts joined events.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from backends.kql.reader import compiled
from backends.kql.translation import KqlQuery
from backends.tables import ROWID, Table, with_time
from rvaft.backend import Backend, Match, SpecificationText
from rvaft.capabilities import COMPARING, EVERY_OPERATOR, GATES, LOGICAL, Capability, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, WithoutEvent
from rvaft.core.time_order import GUARDED_EVENTS
from rvaft.errors import OptionError, Reason, unwritten
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Operator
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor

__all__ = ["KqlBackend"]
_O = Operator


class KqlBackend(Backend):
    """KQL for Microsoft Sentinel, Defender and Azure Data Explorer: inner joins, `scattered`.

    >>> from rvaft import loads
    >>> print(KqlBackend().translate(loads("r or a b;"), Semantics.SCATTERED).text.splitlines()[4])
    let a_1 = ['events']
    """

    name: ClassVar[str] = "kql"
    language: ClassVar[str] = "kql"
    suffix: ClassVar[str] = ".kql"
    remark: ClassVar[str] = "// {}\n"
    remark_line: ClassVar[int] = 1
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    json_alone: ClassVar[bool] = True
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = GUARDED_EVENTS
    operators: ClassVar[frozenset[Operator]] = (
        LOGICAL
        | COMPARING
        | {_O.ADD, _O.SUB, _O.NEGATE, _O.ABS, _O.MIN, _O.MAX}
        | {_O.STARTSWITH, _O.ENDSWITH, _O.CONTAINS, _O.LIKE}
    )
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = frozenset({Value.NUMBER, Value.BOOLEAN})
    ties: ClassVar[Ties] = Ties.ANY
    relies: ClassVar[frozenset[Assumption]] = frozenset({Assumption.TYPES, Assumption.PRESENT, Assumption.EXACT})
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Semantics: unwritten("a join skips the events between its own: use --semantics scattered"),
        Value.NULL: unwritten("a column does not distinguish null from an absent field"),
        Value.LIST: unwritten("a column holds no list"),
        **{one: unwritten(f"KQL has no exact `{one}`") for one in EVERY_OPERATOR},
        _O.MUL: unwritten("an integer product may exceed the 64 bits of KQL"),
        _O.DIV: unwritten("KQL divides integers without a fraction, and by zero without an error"),
    }
    default_limit: ClassVar[int] = 500

    def __init__(self, table: Table | None = None) -> None:
        self._table = table or Table()

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        """Return the query; raises `NotExpressible` for what KQL does not say exactly, and
        `TooLarge`.
        """
        return SpecificationText(*KqlQuery(prop, limit, self._table).text())

    def mapped(self, mapping: Mapping[str, Any]) -> "KqlBackend":
        """Return the backend for a `table` with typed `columns` by field, and the columns
        `position`, `partition` and `time`; raises `OptionError`.
        """
        if "dialect" in mapping:
            raise OptionError(f"kql has no dialects: omit --dialect {mapping['dialect']}")
        table = Table.of(mapping)
        if table.position == ROWID:
            raise OptionError("rows have no order in KQL: name the column that orders them (--position COLUMN)")
        return KqlBackend(table)

    def timed(self, text: str, time: EventTime) -> str:
        """Return the text with this declaration of times, unless it has one."""
        return with_time(text, time, "//")

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> DetectionMonitor:  # noqa: ARG002
        """Return a monitor for a query in the subset that `write` uses; raises `LanguageError`."""
        query = compiled(text)
        return DetectionMonitor(query.first_detections, query.left_open)

    def fields(self, text: str) -> tuple[tuple[str, ...], ...]:
        """Return the fields of the columns that the comments of a query define."""
        return compiled(text).fields

    def matches(self, text: str, traces: Sequence[Sequence[Any]]) -> Sequence[frozenset[Match]] | None:
        """Return all matches per trace, or None if the query has only the smallest ones."""
        query = compiled(text)
        return query.matches(traces) if query.every else None
