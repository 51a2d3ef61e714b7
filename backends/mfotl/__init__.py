"""The `mfotl` backend: metric first-order temporal logic, for MonPoly and its formally verified kernel VeriMon.

The text explains itself: a leading comment defines the predicates as columns of an event
(`backends.event_columns`). The programs read the signature of the predicates from a file of its
own, which `signature` gives. The last argument of every predicate is the position of the event in
the trace. The unit of `limit` is atoms and comparisons of the formula.
"""

from typing import ClassVar

from backends.mfotl.monpoly import MfotlHeader
from backends.mfotl.translation import MfotlFormula
from rvaft.backend import Backend, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value
from rvaft.core.passes import Pass, bind_times, expand_times, order_ends, windows_to_guards
from rvaft.core.property import Condition, Part, Property
from rvaft.model.guards import Operator
from rvaft.model.verdict import Semantics, Verdict

__all__ = ["MfotlBackend"]


class MfotlBackend(Backend):
    """A closed formula of past MFOTL, true from the first detection on.

    Every tree under `scattered`, with variables and arithmetic.

    Nothing here runs it: in a comparison the program does that a path names (`rvaft cross-check --monpoly`).

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
    readable: ClassVar[bool] = False
    json_alone: ClassVar[bool] = True
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends, windows_to_guards, bind_times)
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS})
    values: ClassVar[frozenset[Value]] = JSON_VALUES
    ties: ClassVar[Ties] = Ties.ANY
    default_limit: ClassVar[int] = 5_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        """The formula; raises `NotExpressible` for what only Python computes alike, `TooLarge`."""
        return SpecificationText(*MfotlFormula(prop, limit).text())

    @staticmethod
    def signature(text: str) -> str:
        """The signature of a text of this backend: its predicates with the types of their arguments.

        >>> from rvaft import loads
        >>> tree = loads("theft sand break_in alarm;")
        >>> print(MfotlBackend.signature(MfotlBackend().translate(tree, Semantics.SCATTERED).text), end="")
        break_in(position: int)
        alarm(position: int)
        """
        return MfotlHeader.read(text).signature()
