"""The `match-recognize` backend: row pattern recognition of SQL:2016, as stream processors and data warehouses run it.

The text explains itself: a leading comment defines the columns of the table `events`, whose first row of each log has position 0 and fits nothing. The unit of
`limit` is events of all orders in which those of a scenario may come.
"""

import time
from dataclasses import replace
from typing import ClassVar

from backends.match_recognize.translation import RowPatternQueries
from rvaft.backend import Backend, Specification
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict

__all__ = ["MatchRecognizeBackend"]


class MatchRecognizeBackend(Backend):
    """Queries with a row for each detection: every tree, but for calculations over several events that doubles do otherwise.

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
    untimed: ClassVar[str] = ""
    default_limit: ClassVar[int] = 2_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as queries; `NotExpressible` for late events, multiplication and what else only Python computes alike, `TooLarge`."""
        semantics, start = Semantics(semantics), time.perf_counter()
        plain = self.plain(tree, semantics)
        text, metrics = RowPatternQueries(plain, semantics, self.default_limit if limit is None else limit).text()
        return Specification(text, self.language, replace(metrics, seconds=time.perf_counter() - start))
