"""Past MTL for R2U2: a file for its compiler C2PO, in which all operators have bounds.

Propositions are Boolean inputs, defined in a comment; each event is a row of inputs. The text uses
`true S` for `O`: C2PO 4.1 reserves memory proportional to the bound of `O`, but two slots for `S`.
"""

from typing import ClassVar, Final

from backends.mtl import MtlBackend, MtlCapabilities
from backends.mtl.translation import c2po, symbols, translation
from rvaft.backend import Metrics, SpecificationText
from rvaft.core.property import Part, Property, Within, WithoutEvent
from rvaft.model.verdict import Semantics

HORIZON: Final = 2**30 - 1
"""Bound of operators in events: the largest that R2U2 4.1 can add to any event number in 31 bits.
"""


class MtlR2u2Backend(MtlCapabilities):
    """The formulas of `mtl` for R2U2, faithful only for the first 1,073,741,824 events.

    >>> from rvaft import loads
    >>> print(MtlR2u2Backend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    -- rvaft: the first time that the formula holds is the detection; it misses what comes after 1073741824 events
    -- p1 := { event: "break_in" }
    -- p2 := { event: "alarm" }
    INPUT
        p1, p2: bool;
    PTSPEC
        detection: p2 && (true S[1,1073741823] (p1));
    """

    name: ClassVar[str] = "mtl-r2u2"
    language: ClassVar[str] = "c2po"
    suffix: ClassVar[str] = ".c2po"
    remark: ClassVar[str] = "-- {}\n"
    faithful: ClassVar[bool] = False
    form_of: ClassVar[str] = MtlBackend.name
    readable: ClassVar[bool] = False
    says: ClassVar[frozenset[type[Part]]] = MtlCapabilities.says - {Within, WithoutEvent}

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the file for C2PO."""
        mtl = MtlBackend()
        chains = translation(prop, semantics, limit)
        formula = chains.formula(c2po(HORIZON))
        header = "".join(f"-- {name} := {definition}\n" for name, definition in chains.definitions)
        text = (
            "-- rvaft: the first time that the formula holds is the detection; "
            f"it misses what comes after {HORIZON + 1} events\n{header}"
            f"INPUT\n    {', '.join(chains.propositions)}: bool;\nPTSPEC\n    detection: {formula};\n"
        )
        return SpecificationText(
            text, Metrics(symbols(formula)), lambda _: mtl.read(mtl.write(prop, semantics, limit).text)
        )
