"""The `sigma` backend: rules for single events and one correlation, a detection format of SIEM
systems.

The `limit` counts rules. Reading needs pySigma and its SQLite backend, whose queries run in
Python's sqlite3; translating needs PyYAML.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

from backends.sigma.translation import SigmaRules, expand_tied
from rvaft.backend import Backend, Metrics, SpecificationText, stamped
from rvaft.capabilities import COMPARING, GATES, LOGICAL, Capability, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, Times, Within
from rvaft.core.time_order import order_ends
from rvaft.errors import Reason, unwritten
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Operator
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.support.terminal import readable_json

__all__ = ["SigmaBackend"]


_UNTYPED: Final = "Sigma has no types and no null, and confuses the constant with other values"
_OPERATORS: Final = LOGICAL | COMPARING | {Operator.STARTSWITH, Operator.ENDSWITH, Operator.CONTAINS, Operator.LIKE}


class SigmaBackend(Backend):
    """Sigma correlations under `scattered`: sequences of events, or unordered gates.

    With windows inside the tree, one event must not match two unordered nodes.

    >>> from rvaft import loads
    >>> made = SigmaBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED)
    >>> print(made.text[made.text.index("correlation:"):], end="")
    correlation:
      type: temporal_ordered
      rules:
      - break_in
      - alarm
      timespan: 200y
    """

    name: ClassVar[str] = "sigma"
    language: ClassVar[str] = "sigma"
    suffix: ClassVar[str] = ".yml"
    remark: ClassVar[str] = "# {}\n"
    also: ClassVar[tuple[str, ...]] = (".yaml",)
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    json_alone: ClassVar[bool] = True
    extra: ClassVar[str] = "sigma"
    modules: ClassVar[tuple[str, ...]] = ("sigma", "sigma.backends.sqlite", "yaml")
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    says: ClassVar[frozenset[type[Part]]] = GATES | {Within, Times}
    passes: ClassVar[tuple[Pass, ...]] = (expand_tied, order_ends)
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = frozenset({Value.NUMBER})
    ties: ClassVar[Ties] = Ties.ALL_EVENTS
    needs: ClassVar[Mapping[Capability, frozenset[Assumption]]] = {
        Condition: frozenset({Assumption.TYPES}),
        Value.BOOLEAN: frozenset({Assumption.TYPES}),
        **{one: frozenset({Assumption.TYPES}) for one in _OPERATORS},
    }
    relies: ClassVar[frozenset[Assumption]] = frozenset({Assumption.TYPES, Assumption.PRESENT, Assumption.CASE})
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Semantics: unwritten("correlations are written for `scattered`: they forbid no events between their own"),
        Feature.TIME_POINTS: unwritten("the timespan is the only condition on time that is written"),
        Value.NULL: unwritten(_UNTYPED),
        Value.LIST: unwritten("rules are not written for the length of a list, or for whether a value is an object"),
        Value.SOME_ITEM: unwritten("a rule does not say which fields belong to one item of a list"),
    }
    default_limit: ClassVar[int] = 100

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        """Return the correlation with its rules; raises `ToolMissing` without PyYAML."""
        text, symbols = SigmaRules(prop, limit).text()
        return SpecificationText(text, Metrics(symbols))

    def log(self, tree: RVAFT, trace: Sequence[Json]) -> str:
        """Return JSON Lines whose events have their time in `timestamp`."""
        return "".join(f"{readable_json(event)}\n" for event in stamped(tree, trace, "timestamp"))

    def timed(self, text: str, time: EventTime) -> str:
        """Return the text with this declaration of times, unless it has one."""
        from backends.sigma.reader import with_time  # noqa: PLC0415 -- imported on use

        return with_time(text, time)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """Return a monitor for any rules, compiled by pySigma."""
        from backends.sigma.reader import SigmaMonitor  # noqa: PLC0415 -- imported on use

        self.require()
        return SigmaMonitor(text)

    def fields(self, text: str) -> tuple[tuple[str, ...], ...]:
        """Return the fields of conditions and groups, and that of the declared time."""
        from backends.sigma.reader import fields  # noqa: PLC0415 -- imported on use

        self.require()
        return fields(text)
