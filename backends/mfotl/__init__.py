"""The `mfotl` backend: metric first-order temporal logic, for MonPoly and its verified kernel
VeriMon.

A leading comment defines the predicates as event columns (`backends.event_columns`). The last
argument of a predicate is the position of the event. The tools read the predicate types from a
separate file (`signature`). The `limit` counts atoms and comparisons.
"""

from typing import ClassVar

from backends.mfotl.predicates import MfotlHeader
from backends.mfotl.translation import MfotlFormula
from rvaft.backend import Backend, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, WithoutEvent
from rvaft.core.time_order import GUARDED_EVENTS
from rvaft.model.guards import Operator
from rvaft.model.verdict import Semantics, Verdict

__all__ = ["MfotlBackend"]


class MfotlBackend(Backend):
    """A closed formula of past MFOTL, true from the detection on, under every semantics.

    A cross-check runs it with `rvaft cross-check --monpoly PATH`; there is no reader.

    >>> from rvaft import loads
    >>> print(MfotlBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    (* rvaft
    break_in := { event: "break_in" }
    alarm := { event: "alarm" }
    *)
    EXISTS i1, i2. (((ONCE break_in(i1)) AND (ONCE alarm(i2))) AND (i1 < i2))
    """

    name: ClassVar[str] = "mfotl"
    language: ClassVar[str] = "mfotl"
    suffix: ClassVar[str] = ".mfotl"
    remark: ClassVar[str] = "(* {} *)\n"
    readable: ClassVar[bool] = False
    json_alone: ClassVar[bool] = True
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = GUARDED_EVENTS
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = JSON_VALUES | {Value.SOME_ITEM}
    ties: ClassVar[Ties] = Ties.ANY
    default_limit: ClassVar[int] = 5_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the formula; raises `NotExpressible` for calculations that doubles distort."""
        return SpecificationText(*MfotlFormula(prop, semantics, limit).text())

    @staticmethod
    def signature(text: str) -> str:
        """Return the signature of a text: its predicates with argument types.

        >>> from rvaft import loads
        >>> tree = loads("theft sand break_in alarm;")
        >>> print(MfotlBackend.signature(MfotlBackend().translate(tree, Semantics.SCATTERED).text), end="")
        break_in(position: int)
        alarm(position: int)
        """
        return MfotlHeader.read(text).signature()
