"""The `sigma` backend: rules for single events and one correlation of them, the format of detections that SIEM systems share.

The unit of `limit` is rules. Reading a text needs pySigma and its backend for SQLite, whose queries Python's sqlite3 runs; translating needs PyYAML.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from backends.sigma.reader import SigmaMonitor
from backends.sigma.translation import SigmaRules
from rvaft.backend import Backend, Metrics, Specification, stamped
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor

__all__ = ["SigmaBackend"]


class SigmaBackend(Backend):
    """Sigma correlations: under `scattered`, events in sequence, or any gates without order, where no event is two things at once.

    >>> from rvaft import loads
    >>> print(SigmaBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text.split("---")[-1], end="")
    <BLANKLINE>
    title: theft
    correlation:
      type: temporal_ordered
      rules:
      - break_in
      - alarm
      timespan: 50000d
    """

    name: ClassVar[str] = "sigma"
    language: ClassVar[str] = "sigma"
    suffix: ClassVar[str] = ".yml"
    also: ClassVar[tuple[str, ...]] = (".yaml",)
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    json_alone: ClassVar[bool] = True
    extra: ClassVar[str] = "sigma"
    modules: ClassVar[tuple[str, ...]] = ("sigma", "sigma.backends.sqlite", "yaml")
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    unskipped: ClassVar[str] = "a correlation says which events there are and not that there are none between"
    untimed: ClassVar[str] = "of times a correlation has its timespan alone"
    default_limit: ClassVar[int] = 100

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a correlation with its rules; `TooLarge` beyond `limit` rules, `NotExpressible`, `ToolMissing` without PyYAML."""
        semantics, start = Semantics(semantics), time.perf_counter()
        plain = self.plain(tree.changed(nodes=[replace(n, within=None) for n in tree.nodes.values()]), semantics)
        made = SigmaRules(tree, plain, semantics, self.default_limit if limit is None else limit)
        text, symbols = made.text()
        return Specification(text, self.language, Metrics(symbols, seconds=time.perf_counter() - start), self.read)

    def log(self, tree: RVAFT, trace: Sequence[Json]) -> str:
        """JSON Lines whose events have their time in `timestamp`."""
        return "".join(f"{json.dumps(event, ensure_ascii=False)}\n" for event in stamped(tree, trace, "timestamp"))

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that asks SQLite what pySigma makes of the rules, whoever wrote them; raises `LanguageError` and `ToolMissing`."""
        self.require()
        return SigmaMonitor(text)
