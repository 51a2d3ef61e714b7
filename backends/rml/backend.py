"""The `rml` backend: the text means the tree under the published RML compiler and monitor."""

from collections.abc import Mapping
from time import perf_counter
from typing import ClassVar

from rvaft.backend import Backend, Metrics, Specification
from rvaft.monitors import Monitor
from rvaft.patterns import Pattern
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics


class RmlBackend(Backend):
    """Attack-fault trees in the Runtime Monitoring Language (RML).

    Trees without variables are expressed under every semantics; under `strict` and `projected` also trees with variables, unless a
    guard orders strings. `limit` counts scenarios, and alternatives of the equations.
    """

    name: ClassVar[str] = "rml"
    language: ClassVar[str] = "rml"
    suffix: ClassVar[str] = ".rml"
    default_limit: ClassVar[int] = 100_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as an RML text; raises `NotExpressible` and `TooLarge`."""
        from backends.rml.translation import translate  # noqa: PLC0415 -- imported on use

        start = perf_counter()
        made = translate(tree, Semantics(semantics), limit=self.default_limit if limit is None else limit)
        metrics = Metrics(symbols=made.symbols, states=made.states, seconds=perf_counter() - start)
        return Specification(made.text, self.language, metrics, self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs an RML text, whoever wrote it; its texts define their events, so `atoms` is not looked at."""
        from backends.rml.reading.reader import read  # noqa: PLC0415 -- imported on use

        return read(text)
