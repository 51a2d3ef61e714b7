"""The `match-recognize` backend: row pattern recognition of SQL:2016, as stream processors and data warehouses run it.

The text explains itself: a leading comment defines the columns of the table `events`, whose first
row of each log has position 0 and fits nothing. The unit of `limit` is events of all orders in
which those of a scenario may come.
"""

from typing import ClassVar

from backends.match_recognize.translation import RowPatternQueries
from rvaft.backend import Backend, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value
from rvaft.core.passes import Pass, bind_times, expand_times, order_ends, windows_to_guards
from rvaft.core.property import Condition, Part, Property
from rvaft.model.guards import Operator
from rvaft.model.verdict import Semantics, Verdict

__all__ = ["MatchRecognizeBackend"]


class MatchRecognizeBackend(Backend):
    """Queries with a row for each detection.

    Every tree, but for calculations over several events that doubles do otherwise.

    Nothing here runs it in a comparison; `backends.match_recognize.flink` asks Apache Flink.

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
    readable: ClassVar[bool] = False
    json_alone: ClassVar[bool] = True
    extra: ClassVar[str] = "flink"
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends, windows_to_guards, bind_times)
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS})
    values: ClassVar[frozenset[Value]] = JSON_VALUES
    ties: ClassVar[Ties] = Ties.ANY
    default_limit: ClassVar[int] = 2_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """The queries; raises `NotExpressible` for what only Python computes alike, `TooLarge`."""
        return SpecificationText(*RowPatternQueries(prop, semantics, limit).text())
