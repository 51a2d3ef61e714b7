"""The form of past MTL that R2U2 takes: a file for its compiler C2PO, in which every operator looks back by a bounded number of events.

A proposition is a boolean input, and a comment says what it asks of an event; input is one row of these for each event. The formula holds at
each event that ends an attack, for the first time at the detection. `true S` stands where `O` would: C2PO (4.1) keeps as many slots of memory for
an `O` as its bound is large, and two for the same said by `S`.
"""

import time
from typing import ClassVar, Final

from backends.mtl import MtlBackend
from backends.mtl.translation import symbols, translation
from rvaft.backend import Backend, Metrics, Specification
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict

HORIZON: Final = 2**30 - 1
"""How far operators look back: the largest bound to which R2U2 (4.1), with its 31 bits, can add the number of any event that it reaches."""


class MtlR2u2Backend(Backend):
    """What `mtl` says, for R2U2: of the first 1,073,741,824 events, which is why it is not called faithful.

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
    faithful: ClassVar[bool] = False
    form_of: ClassVar[str] = MtlBackend.name
    readable: ClassVar[bool] = False
    verdicts: ClassVar[frozenset[Verdict]] = MtlBackend.verdicts
    semantics: ClassVar[frozenset[Semantics]] = MtlBackend.semantics
    untimed: ClassVar[str] = MtlBackend.untimed
    default_limit: ClassVar[int] = MtlBackend.default_limit

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a file for C2PO; raises `NotExpressible` and `TooLarge` as `mtl` does."""
        start, limit = time.perf_counter(), self.default_limit if limit is None else limit
        chains = translation(self, self.plain(tree, Semantics(semantics)), Semantics(semantics), limit)
        formula = chains.c2po(HORIZON)
        header = "".join(f"-- {name} := {asked}\n" for name, asked in chains.propositions.items())
        text = (
            "-- rvaft: the first time that the formula holds is the detection; "
            f"it misses what comes after {HORIZON + 1} events\n{header}"
            f"INPUT\n    {', '.join(chains.propositions)}: bool;\nPTSPEC\n    detection: {formula};\n"
        )
        metrics = Metrics(symbols(formula), seconds=time.perf_counter() - start)
        return Specification(
            text, self.language, metrics, lambda _: MtlBackend().translate(tree, semantics, limit=limit).monitor()
        )
