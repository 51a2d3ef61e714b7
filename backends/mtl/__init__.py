"""The `mtl` backend: past-time formulas for Reelay over discrete time, true from the detection on.

A comment defines the propositions. The `limit` counts events of all orders. Only reading needs the
package `reelay`.
"""

from collections.abc import Mapping
from typing import ClassVar, Final

from backends.absences import refuse
from backends.mtl.reader import compiled
from backends.mtl.translation import REELAY, WindowedFormula, symbols, translation
from rvaft.backend import Backend, Metrics, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Capability, Feature, Ties, Value
from rvaft.core.passes import Pass, expand_times
from rvaft.core.property import Condition, Part, Property, Within, WithoutEvent
from rvaft.core.time_order import order_ends
from rvaft.errors import NotExpressible, Reason, cannot, unwritten
from rvaft.model.expressions import time_text
from rvaft.model.guards import Operator
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor

__all__ = ["MtlBackend"]


_ONE_EVENT: Final = cannot("a proposition is about one event")


class MtlCapabilities(Backend):
    """The capabilities of past MTL, for all its text forms."""

    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, Within, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends)
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    values: ClassVar[frozenset[Value]] = JSON_VALUES | {Value.SOME_ITEM}
    ties: ClassVar[Ties] = Ties.NONE
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Within: unwritten("R2U2 counts steps, and windows are durations"),
        WithoutEvent: unwritten("texts for R2U2 are written without absent events"),
        Feature.TIME_POINTS: unwritten("windows (`within`) are the only condition on time that is written"),
        Ties.ALL_EVENTS: _ONE_EVENT,
        Ties.ANY: _ONE_EVENT,
    }
    default_limit: ClassVar[int] = 5_000


class MtlBackend(MtlCapabilities):
    """Past MTL, without variables over several events and without times.

    >>> from rvaft import loads
    >>> print(MtlBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    /* rvaft
    p1 := { event: "break_in" }
    p2 := { event: "alarm" }
    */
    once({p2: true} and pre(once({p1: true})))
    """

    name: ClassVar[str] = "mtl"
    language: ClassVar[str] = "mtl"
    suffix: ClassVar[str] = ".mtl"
    remark: ClassVar[str] = "/* {} */\n"
    extra: ClassVar[str] = "mtl"
    modules: ClassVar[tuple[str, ...]] = ("reelay",)

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the formula; raises `NotExpressible` for too long chains."""
        refuse(
            prop,
            {
                "shared": unwritten(
                    "a proposition is about one event, and an absent event shares variables with others"
                ),
            },
        )
        if prop.timed:
            return self._windowed(prop, semantics, limit)
        chains = translation(prop, semantics, limit)
        time = f"{time_text(prop.time)}, bounds in {chains.unit}\n" if chains.unit and prop.time is not None else ""
        header = time + "".join(f"{name} := {definition}\n" for name, definition in chains.definitions)
        formula = chains.formula(REELAY)
        return SpecificationText(f"/* rvaft\n{header}*/\n{formula}\n", Metrics(symbols(formula)))

    def _windowed(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the formula in dense time."""
        windows = [part.source.node for part in prop.parts if isinstance(part, Within)]
        if semantics is not Semantics.SCATTERED:
            raise NotExpressible(unwritten("windows are written under `scattered` alone"), nodes=windows)
        if prop.absences:
            raise NotExpressible(
                unwritten("absent events beside windows"), nodes=[one.source.node for one in prop.absences]
            )
        found = WindowedFormula(prop, limit)
        assert prop.time is not None
        lines = [f"{time_text(prop.time)}, bounds in {found.unit}"]
        lines += [f"{name} := {definition}" for name, definition in found.definitions]
        header = "\n".join(lines)
        return SpecificationText(f"/* rvaft\n{header}\n*/\n{found.text}\n", Metrics(symbols(found.text)))

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> DetectionMonitor:
        """Return a monitor that runs Reelay; `atoms` defines propositions that the text does not
        define.

        Other propositions match the event of their name.
        """
        self.require()
        program = compiled(text, tuple((atoms or {}).items()))
        return DetectionMonitor(program.first_detections, program.left_open)
