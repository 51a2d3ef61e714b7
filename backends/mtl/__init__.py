"""The `mtl` backend: past-time formulas for Reelay, over discrete time, that hold from the first detection on.

A comment says what each proposition asks of an event. The unit of `limit` is the events of all orders in which they may come. Reading a text needs
the package `reelay`, translating does not.
"""

import time
from collections.abc import Mapping
from typing import ClassVar

from backends.mtl.reader import compiled
from backends.mtl.translation import symbols, translation
from rvaft.backend import Backend, Metrics, Specification
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor

__all__ = ["MtlBackend"]


class MtlBackend(Backend):
    """Past MTL: what is `scattered`, without variables of several events and without times.

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
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    extra: ClassVar[str] = "mtl"
    modules: ClassVar[tuple[str, ...]] = ("reelay",)
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    unskipped: ClassVar[str] = "a chain of `once` skips what comes between its events"
    untimed: ClassVar[str] = "its discrete time counts events, and windows are of clocks"
    default_limit: ClassVar[int] = 5_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a formula; `TooLarge` beyond `limit` events of all orders, `NotExpressible` for what ties several events."""
        start, limit = time.perf_counter(), self.default_limit if limit is None else limit
        plain = self.plain(tree, Semantics(semantics))
        chains = translation(self, plain, Semantics(semantics), limit)
        header = "".join(f"{name} := {asked}\n" for name, asked in chains.propositions.items())
        formula = chains.reelay()
        metrics = Metrics(symbols(formula), seconds=time.perf_counter() - start)
        return Specification(f"/* rvaft\n{header}*/\n{formula}\n", self.language, metrics, self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> DetectionMonitor:
        """A monitor that asks Reelay; a proposition that the text does not define is as `atoms` says, or the event of its name.

        Raises `LanguageError`, `TooLarge`, `ToolMissing`.
        """
        self.require()
        return DetectionMonitor(compiled(text, tuple((atoms or {}).items())).first_detections)
