"""The `match-recognize` backend: row pattern recognition of SQL:2016.

A leading comment defines the columns of the table `events`. The first row of each log has position
0 and matches nothing. The `limit` counts the events of all orders of all scenarios.
"""

from typing import ClassVar

from backends.match_recognize.translation import RowPatternQueries
from rvaft.backend import Backend, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, WithoutEvent
from rvaft.core.time_order import GUARDED_EVENTS
from rvaft.model.guards import Operator
from rvaft.model.verdict import Semantics, Verdict

__all__ = ["MatchRecognizeBackend"]


class MatchRecognizeBackend(Backend):
    """Queries with a row per detection: every tree, except calculations over events that doubles
    distort.

    No cross-check runs these queries; `cross_check.published.flink` runs them in Apache Flink.

    >>> from rvaft import loads
    >>> print(MatchRecognizeBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    /* rvaft
    is_break_in := { event: "break_in" }
    is_alarm := { event: "alarm" }
    */
    SELECT trace, found FROM events MATCH_RECOGNIZE (
      PARTITION BY trace ORDER BY ts MEASURES e2.pos AS found
      ONE ROW PER MATCH AFTER MATCH SKIP TO NEXT ROW PATTERN (s g0*? e1 g1*? e2)
      DEFINE s AS s.pos = 0, e1 AS e1.is_break_in, e2 AS e2.is_alarm)
    """

    name: ClassVar[str] = "match-recognize"
    language: ClassVar[str] = "match-recognize"
    suffix: ClassVar[str] = ".match.sql"
    remark: ClassVar[str] = "/* {} */\n"
    readable: ClassVar[bool] = False
    json_alone: ClassVar[bool] = True
    extra: ClassVar[str] = "flink"
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = GUARDED_EVENTS
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = JSON_VALUES | {Value.SOME_ITEM}
    ties: ClassVar[Ties] = Ties.ANY
    default_limit: ClassVar[int] = 2_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the queries; raises `NotExpressible` for calculations that doubles distort, and for
        absent events other than those between the rows of a match that skips rows.
        """
        return SpecificationText(*RowPatternQueries(prop, semantics, limit).text())
