"""The `stix` backend: STIX 2.1 patterns for threat intelligence.

An event is an object `x-rvaft` in an observation, with fields as properties; a user mapping can
select other objects. The `limit` counts observation expressions. Only reading needs stix2-matcher.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, ClassVar
from uuid import UUID

from backends.stix.comparisons import NO_NULL, ONE_OBSERVATION
from backends.stix.observations import StixHeader
from backends.stix.reader import StixMonitor
from backends.stix.translation import StixPattern
from rvaft.backend import Backend, Metrics, SpecificationText
from rvaft.capabilities import (
    CALCULATING,
    COMPARING,
    GATES,
    LOGICAL,
    READING,
    TEXTUAL,
    Capability,
    Feature,
    Ties,
    Value,
)
from rvaft.core.passes import Pass, expand_times
from rvaft.core.property import Condition, Part, Property, Within, WithoutEvent
from rvaft.core.time_order import order_ends
from rvaft.errors import Reason, cannot, unwritten
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Operator
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.support.terminal import readable_json

__all__ = ["StixBackend"]


class StixBackend(Backend):
    """STIX patterns: trees under `scattered` without variables over several events.

    >>> from rvaft import loads
    >>> print(StixBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text)
    [x-rvaft:event = 'break_in'] FOLLOWEDBY [x-rvaft:event = 'alarm']
    """

    name: ClassVar[str] = "stix"
    language: ClassVar[str] = "stix"
    suffix: ClassVar[str] = ".stix"
    remark: ClassVar[str] = "/* {} */ "
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    json_alone: ClassVar[bool] = True
    extra: ClassVar[str] = "stix"
    modules: ClassVar[tuple[str, ...]] = ("stix2matcher", "stix2patterns")
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, Within}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends)
    operators: ClassVar[frozenset[Operator]] = LOGICAL | COMPARING | TEXTUAL - {Operator.LOWER}
    values: ClassVar[frozenset[Value]] = frozenset({Value.NUMBER, Value.BOOLEAN})
    ties: ClassVar[Ties] = Ties.NONE
    relies: ClassVar[frozenset[Assumption]] = frozenset({Assumption.PRESENT})
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Semantics: unwritten("patterns are written for `scattered`, as they forbid no observations between their own"),
        Feature.TIME_POINTS: unwritten("WITHIN is the only condition on time that patterns are written with"),
        Value.NULL: NO_NULL,
        Value.LIST: unwritten(
            "comparisons are not written for the length of a list, or for whether a value is an object"
        ),
        Value.SOME_ITEM: unwritten("comparisons with `[*]` do not say which properties belong to one item"),
        WithoutEvent: cannot("a pattern that some observations match is matched by more observations, too"),
        Ties.ALL_EVENTS: ONE_OBSERVATION,
        Ties.ANY: ONE_OBSERVATION,
        **dict.fromkeys(
            CALCULATING | READING | {Operator.LOWER},
            unwritten("a comparison has one property and a constant, and no arithmetic"),
        ),
    }
    default_limit: ClassVar[int] = 250

    def __init__(self, header: StixHeader | None = None) -> None:
        self._header = header or StixHeader()

    def mapped(self, mapping: Mapping[str, Any]) -> "StixBackend":
        """Return the backend for a mapping from event types and fields to object paths.

        >>> from rvaft import loads
        >>> stix = StixBackend().mapped({"a": {"event": "user-account:account_login"}})
        >>> print(stix.translate(loads("top or a;"), Semantics.SCATTERED).text)
        /* rvaft {"objects":{"user-account:account_login":["event"]}} */ [user-account:account_login = 'a']
        """
        return MappedStixBackend(StixHeader.mapped(mapping))

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        """Return the pattern; raises `OptionError` if the mapping lacks a type or a field."""
        windows = any(isinstance(part, Within) for part in prop.parts)
        header = replace(self._header, time=prop.time if windows else None)
        text, symbols = StixPattern(prop, header, limit).text()
        return SpecificationText(text, Metrics(symbols))

    def log(self, tree: RVAFT, trace: Sequence[Json]) -> str:
        """Return a bundle of observed data.

        Raises as `translate` does, and `TraceError` if times do not increase.
        """
        header = StixHeader.of(self.translate(tree, Semantics.SCATTERED).text)
        objects = [*chain.from_iterable(header.observations(trace))]
        bundle = {"type": "bundle", "id": f"bundle--{UUID(int=0)}", "objects": objects}
        return f"{readable_json(bundle, indent=1)}\n"

    def timed(self, text: str, time: EventTime) -> str:
        """Return the text with this declaration of times, unless it has one."""
        return StixHeader.timed(text, time)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """Return a monitor for any pattern.

        Events are 1 s apart, unless the header of the pattern defines their times, which must
        increase.
        """
        self.require()
        return StixMonitor(text)


class MappedStixBackend(StixBackend):
    """STIX patterns over mapped objects, whose properties select the objects too."""

    relies: ClassVar[frozenset[Assumption]] = frozenset()
