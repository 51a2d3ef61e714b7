"""The `rml` backend: trees as specifications in the Runtime Monitoring Language.

The text means the tree under the published RML compiler and monitor.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

from backends.rml.reader.deviations import touching
from backends.rml.reader.event_types import observed
from backends.rml.reader.monitor import read
from backends.rml.writer import translate
from backends.rml.writer.terms import FUNCTIONS, KEYWORDS, TYPES, VALUES
from rvaft.backend import Backend, Highlighting, Metrics, Observed, SpecificationText
from rvaft.capabilities import (
    CALCULATING,
    COMPARING,
    GATES,
    JSON_VALUES,
    LOGICAL,
    READING,
    TEXTUAL,
    Capability,
    Feature,
    Ties,
    Value,
)
from rvaft.core.passes import Pass, expand_times, order_ends
from rvaft.core.property import Condition, Part, Property, Within
from rvaft.model.guards import Operator
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor

HIGHLIGHTING: Final = Highlighting(
    "RML",
    rf"""
\lstdefinelanguage{{RML}}{{
  morekeywords={{{",".join(sorted(KEYWORDS | TYPES))}}},
  morekeywords=[2]{{{",".join(sorted(FUNCTIONS | VALUES))}}},
  keywordstyle=\bfseries,
  keywordstyle=[2]\itshape,
  sensitive=true,
  morecomment=[l]{{//}},
  commentstyle=\itshape,
  morestring=[b]',
}}
""",
)
"""RML for the package `listings` of LaTeX, in styles that survive print without colour."""


_UNTIMED: Final = "times are read from texts and decimals, and RML has only the numbers of an event as they stand"


class RmlCapabilities(Backend):
    """What RML can express, in whichever form its texts are written."""

    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends)
    operators: ClassVar[frozenset[Operator]] = LOGICAL | COMPARING | CALCULATING
    values: ClassVar[frozenset[Value]] = JSON_VALUES
    ties: ClassVar[Ties] = Ties.ANY
    reasons: ClassVar[Mapping[Capability, str]] = {
        Within: _UNTIMED,
        Feature.TIME_POINTS: _UNTIMED,
        **{one: f"RML has no {one.value}" for one in TEXTUAL | READING},
    }
    default_limit: ClassVar[int] = 20_000


class RmlBackend(RmlCapabilities):
    """Attack-fault trees in the Runtime Monitoring Language (RML).

    Trees without variables and conditions on time are expressed under every semantics, with one
    exception: RML cannot order strings, nor look into them, so `projected` and `consecutive` are
    refused where relevance depends on that, by a guard of `ignore` (or, in a part of a tree, by one
    of a node outside it). Under `strict` and `projected` also trees with variables are expressed,
    unless a guard asks such a thing. `limit` counts scenarios, and alternatives of the equations;
    for each, ten symbols of the text and fifty steps of looking for it are allowed.
    """

    name: ClassVar[str] = "rml"
    language: ClassVar[str] = "rml"
    suffix: ClassVar[str] = ".rml"
    highlighting: ClassVar[Highlighting] = HIGHLIGHTING
    json_alone: ClassVar[bool] = True  # `not matches` takes whatever is not matched

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """The text in RML; raises `NotExpressible` and `TooLarge`."""
        text, symbols, equations = translate(prop, semantics, limit=limit)
        return SpecificationText(text, Metrics(symbols=symbols, states=equations))

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs an RML text, whoever wrote it; its texts define their events, so
        `atoms` is not looked at.
        """
        return read(text)

    def observed(
        self,
        text: str,
        *,
        atoms: Mapping[str, Pattern] | None = None,  # noqa: ARG002
    ) -> tuple[Observed, ...] | None:
        """What the event types that an RML text uses ask of events; None where patterns with guards cannot say it."""
        return observed(text)

    def masked(self, text: str, trace: Sequence[Json]) -> tuple[str, ...]:
        """The titles of the rows in the table of deviations that the text touches on the trace."""
        return tuple(deviation.title for deviation in touching(text, trace))
