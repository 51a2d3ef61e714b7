"""The `ltlf` backend: linear temporal logic on finite traces, in Spot's syntax.

The text explains itself: a leading comment defines the atoms (event patterns and guards), which events are relevant, and the shared
subformulas. The unit of `limit` is subformulas made. Reading a text needs Spot, translating does not.
"""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from backends.ltlf.mona import MonaMonitor
from backends.ltlf.monitor import LtlfMonitor, observed
from backends.ltlf.translation import Translation
from rvaft.backend import Backend, Observed, Specification
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor

__all__ = ["LtlfBackend"]


class LtlfBackend(Backend):
    """LTLf in Spot's syntax: every tree under every semantics, but for late events.

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
    tools: ClassVar[tuple[str, ...]] = ("mona",)
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    untimed: ClassVar[str] = ""
    default_limit: ClassVar[int] = 200_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a formula; `TooLarge` beyond `limit` subformulas, `NotExpressible` for late events alone."""
        tree, start = self.plain(tree, Semantics(semantics)), time.perf_counter()
        limit = self.default_limit if limit is None else limit
        text, metrics = Translation(tree, Semantics(semantics), limit).text()
        metrics = replace(metrics, seconds=time.perf_counter() - start)
        return Specification(text, self.language, metrics, self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """A monitor that runs a formula in Spot's LTLf syntax, with or without a header.

        Raises `LanguageError`, and `ToolMissing` where Spot is not installed.
        """
        return LtlfMonitor(text, atoms or {})

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:
        """What the atoms of the formula ask of events, None where times are among it; raises `LanguageError` and `ToolMissing` as `read` does."""
        return observed(text, atoms or {})

    def read_with(self, tool: str, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """By `mona`: a monitor that runs the automaton which ltlf2dfa and MONA make of a formula without variables.

        Raises `LanguageError`; `ToolMissing` where Spot (whose parser reads the text), ltlf2dfa or MONA is not installed;
        `NotExpressible` where there are variables, `TooLarge` where there are too many atoms or MONA comes to no end.
        """
        if tool not in self.tools:
            return super().read_with(tool, text, atoms=atoms)
        return MonaMonitor(text, atoms or {})
