"""The `eql` backend: sequences of the Event Query Language, as in Elasticsearch and the package
`eql`.

A text has one query per order of the tree's events; a match of any query is a detection. The
`limit` counts the events of these queries. Only reading needs the package.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, ClassVar

from backends.eql.reader import compiled, with_time
from backends.eql.translation import NO_NULL, EqlText
from rvaft.backend import Backend, Metrics, SpecificationText, stamped
from rvaft.capabilities import COMPARING, EVERY_OPERATOR, GATES, LOGICAL, Capability, Feature, Ties, Value
from rvaft.core.passes import Pass, expand_times
from rvaft.core.property import Condition, Part, Property, Within, WithoutEvent
from rvaft.core.time_order import order_ends
from rvaft.errors import OptionError, Reason, unwritten
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Operator
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor
from rvaft.support.terminal import readable_json

__all__ = ["EqlBackend"]


class EqlBackend(Backend):
    """EQL sequences: `scattered`, variables that all events share, and windows over whole
    sequences.

    >>> from rvaft import loads
    >>> events = "event login(u) = { user: u, ok: true };"
    >>> tree = loads(f'{events} theft sand break_in in; break_in times 2; in on login("root");')
    >>> print(EqlBackend().translate(tree, Semantics.SCATTERED).text, end="")
    // rvaft: any of these queries is a detection
    sequence
      [any where event == "break_in"] with runs=2
      [any where user == "root" and ok == true]
    """

    name: ClassVar[str] = "eql"
    language: ClassVar[str] = "eql"
    suffix: ClassVar[str] = ".eql"
    remark: ClassVar[str] = "// {}\n"
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    json_alone: ClassVar[bool] = True
    extra: ClassVar[str] = "eql"
    modules: ClassVar[tuple[str, ...]] = ("eql",)
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, Within, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends)
    operators: ClassVar[frozenset[Operator]] = (
        LOGICAL | COMPARING | {Operator.STARTSWITH, Operator.ENDSWITH, Operator.CONTAINS, Operator.LIKE}
    )
    values: ClassVar[frozenset[Value]] = frozenset({Value.NUMBER, Value.BOOLEAN, Value.LIST})
    ties: ClassVar[Ties] = Ties.ALL_EVENTS
    relies: ClassVar[frozenset[Assumption]] = frozenset({Assumption.TYPES, Assumption.PRESENT})
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Semantics: unwritten("sequences are written for `scattered`: they forbid no events between their own"),
        Feature.TIME_POINTS: unwritten(
            "`maxspan`, over a whole sequence, is the only condition on time that is written"
        ),
        Value.NULL: NO_NULL,
        **{
            one: unwritten(f"a condition is written as a field and a constant, without `{one}`")
            for one in EVERY_OPERATOR
        },
    }
    default_limit: ClassVar[int] = 1_000

    _missing: bool = False

    def mapped(self, mapping: Mapping[str, Any]) -> "EqlBackend":
        """Return the backend that writes missing events, `![…]`, for `{"missing_events": True}`.

        They are for Elasticsearch: the package `eql` does not have them.
        """
        if {*mapping} != {"missing_events"} or not isinstance(mapping["missing_events"], bool):
            raise OptionError(
                "eql takes no mapping of fields, and no other mapping than of `missing_events` to a truth value"
            )
        twin = copy(self)
        vars(twin)["_missing"] = mapping["missing_events"]
        return twin

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        """Return the queries."""
        text, symbols = EqlText(prop, limit, missing=self._missing).text()
        return SpecificationText(text, Metrics(symbols))

    def log(self, tree: RVAFT, trace: Sequence[Json]) -> str:
        """Return JSON Lines whose events have their time in `@timestamp`."""
        return "".join(f"{readable_json(event)}\n" for event in stamped(tree, trace, "@timestamp"))

    def timed(self, text: str, time: EventTime) -> str:
        """Return the text with this declaration of times, unless it has one."""
        return with_time(text, time)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> DetectionMonitor:  # noqa: ARG002
        """Return a monitor that runs queries in Elasticsearch syntax, separated by `;`, in the
        package `eql`.

        Queries whose meaning differs between `eql` and Elasticsearch raise `LanguageError`.
        """
        self.require()
        queries = compiled(text)
        return DetectionMonitor(queries.first_detections, queries.left_open)

    def fields(self, text: str) -> tuple[tuple[str, ...], ...]:
        """Return the fields of conditions and keys, and that of the time if a query needs it."""
        return compiled(text).fields
