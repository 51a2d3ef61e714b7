"""The `ltlf` backend: linear temporal logic on finite traces, in Spot's syntax.

A leading comment of the text defines atoms (event patterns and guards), relevant events and shared
subformulas. The `limit` counts subformulas. Only reading needs Spot.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

from backends.absences import refuse_timeless, without_vacuous
from backends.ltlf.monitor import LtlfMonitor, formal, observed
from backends.ltlf.translation import Translation
from rvaft.backend import Backend, Observed, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Capability, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, Within, WithoutEvent
from rvaft.core.time_order import GUARDED_EVENTS
from rvaft.model.guards import Operator
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor

__all__ = ["LtlfBackend"]


class LtlfBackend(Backend):
    """LTLf in Spot's syntax: every tree under every semantics, except late events.

    >>> from rvaft import loads
    >>> print(LtlfBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    /* rvaft
    atom break_in := { event: "break_in" }
    atom alarm := { event: "alarm" }
    */
    F(break_in & X[!] F alarm)
    """

    name: ClassVar[str] = "ltlf"
    language: ClassVar[str] = "ltlf"
    suffix: ClassVar[str] = ".ltlf"
    remark: ClassVar[str] = "/* {} */\n"
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = GUARDED_EVENTS
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = JSON_VALUES | {Value.SOME_ITEM, Value.SOME_VARIABLE}
    ties: ClassVar[Ties] = Ties.ANY
    extensions: ClassVar[Mapping[Capability, str]] = {
        **dict.fromkeys((Ties.ALL_EVENTS, Ties.ANY), "slices"),
        **dict.fromkeys((Feature.TIME_POINTS, Within), "time variables"),
    }
    most_nodes: ClassVar[int] = 200_000
    default_limit: ClassVar[int] = 200_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the formula."""
        prop = without_vacuous(prop, semantics)
        refuse_timeless(prop, semantics, {Semantics.SCATTERED, Semantics.CONSECUTIVE})
        return SpecificationText(*Translation(prop, semantics, limit).text())

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """Return a monitor for a formula in Spot's LTLf syntax, with or without a header."""
        return LtlfMonitor(text, atoms or {})

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:
        """Return the patterns of the atoms, or None if the formula has times."""
        return observed(text, atoms or {})

    def formal(self, text: str) -> dict[str, Any]:
        """Return the abstract syntax of a formula."""
        return formal(text)
