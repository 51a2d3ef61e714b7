"""The `rml` backend: the Runtime Monitoring Language of the published compiler and monitor."""

from collections.abc import Mapping
from typing import Any, ClassVar, Final

from backends.absences import refuse, without_vacuous
from backends.rml.reader.event_types import observed
from backends.rml.reader.monitor import formal, read
from backends.rml.writer import translate
from backends.rml.writer.terms import FUNCTIONS, KEYWORDS, TYPES, VALUES
from backends.rml.writer.windows import without_windows
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
from rvaft.core.passes import Pass, expand_times
from rvaft.core.property import Condition, Part, Property, Within, WithoutEvent
from rvaft.core.time_order import order_ends
from rvaft.errors import NotExpressible, Reason, unwritten
from rvaft.model.guards import Operator
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
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
"""RML for the LaTeX package `listings`, without colours."""


class RmlCapabilities(Backend):
    """The capabilities of RML, for all its text forms."""

    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends)
    operators: ClassVar[frozenset[Operator]] = LOGICAL | COMPARING | CALCULATING
    values: ClassVar[frozenset[Value]] = JSON_VALUES
    ties: ClassVar[Ties] = Ties.ANY
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Feature.TIME_POINTS: unwritten("windows (`within`) are the only condition on time that is written"),
        **{one: unwritten(f"RML has no `{one}`") for one in TEXTUAL | READING},
    }
    needs: ClassVar[Mapping[Capability, frozenset[Assumption]]] = {
        Within: frozenset({Assumption.TYPES, Assumption.PRESENT, Assumption.EXACT})
    }
    default_limit: ClassVar[int] = 20_000


class RmlBackend(RmlCapabilities):
    """Attack-fault trees in the Runtime Monitoring Language (RML).

    Trees without variables and conditions on time are expressible under every semantics; under
    `strict` and `projected`, trees with variables are too, apart from guards that order or search
    strings. `projected` and `consecutive` are also refused if relevance depends on such a guard, of
    `ignore` or of a node outside the branch.

    `limit` counts scenarios and alternatives of equations; each allows ten symbols of text and
    fifty steps of search.
    """

    name: ClassVar[str] = "rml"
    language: ClassVar[str] = "rml"
    suffix: ClassVar[str] = ".rml"
    remark: ClassVar[str] = "// {}\n"
    highlighting: ClassVar[Highlighting] = HIGHLIGHTING
    json_alone: ClassVar[bool] = True  # `not matches` accepts any other value
    says: ClassVar[frozenset[type[Part]]] = RmlCapabilities.says | {WithoutEvent}

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the text in RML."""
        prop = _sayable(prop, semantics)
        if prop.timed:
            prop = without_windows(prop)
            for each in self.passes:
                prop = each(prop)
        text, symbols, equations = translate(prop, semantics, limit=limit)
        return SpecificationText(text, Metrics(symbols=symbols, states=equations))

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """Return a monitor for any RML text; `atoms` is unused, because RML texts define their
        events.
        """
        return read(text)

    def formal(self, text: str) -> dict[str, Any]:
        """Return the abstract syntax of a text without shared variables."""
        return formal(text)

    def observed(
        self,
        text: str,
        *,
        atoms: Mapping[str, Pattern] | None = None,  # noqa: ARG002
    ) -> tuple[Observed, ...] | None:
        """Return patterns and guards of a text's event types, or None if they have no such form."""
        return observed(text)


def _sayable(prop: Property, semantics: Semantics) -> Property:
    """Return the property without clauses that every match holds; raises `NotExpressible` for others."""
    prop = without_vacuous(prop, semantics)
    refuse(prop, {"duration": unwritten("absent events are written without durations")})
    if prop.absences and semantics is not Semantics.SCATTERED:
        why = "absent events are written under `scattered`, and under `strict`, where they are never there"
        raise NotExpressible(unwritten(why), nodes=[clause.source.node for clause in prop.absences])
    return prop
