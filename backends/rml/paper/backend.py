"""The `rml-paper` backend: to the letter, defects included."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import ClassVar

from backends.rml.listing import HIGHLIGHTING
from rvaft.backend import Backend, Highlighting, Metrics, Observed, Specification
from rvaft.errors import NotExpressible
from rvaft.monitors import Monitor
from rvaft.patterns import Pattern
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics


class RmlPaperBackend(Backend):
    """The paper's own translation: gates as printed, VOT unrolled, a union of the branches in their order, `all` behind.

    Not faithful: RML's union commits to its left operand, so a union of branches with a common start misses the later ones, and
    the unrolled VOT means exactly K and loses interleavings of compound children. `limit` counts the terms written,
    ten symbols of the unrolled VOT gates being allowed for each.
    """

    name: ClassVar[str] = "rml-paper"
    language: ClassVar[str] = "rml"
    suffix: ClassVar[str] = ".rml"
    highlighting: ClassVar[Highlighting] = HIGHLIGHTING
    faithful: ClassVar[bool] = False
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.STRICT, Semantics.PROJECTED})
    default_limit: ClassVar[int] = 20_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as an RML text; raises `NotExpressible` and `TooLarge`."""
        from backends.rml.paper.specification import specification  # noqa: PLC0415 -- imported on use

        semantics = Semantics(semantics)
        if semantics not in self.semantics:
            raise NotExpressible("the paper does not say how", backend=self.name, semantics=semantics)
        start = perf_counter()
        text, symbols, equations = specification(tree, semantics, self.default_limit if limit is None else limit)
        metrics = Metrics(symbols=symbols, states=equations, seconds=perf_counter() - start)
        return Specification(text, self.language, metrics, self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs an RML text; its texts define their events, so `atoms` is not looked at."""
        from backends.rml.reading.reader import read  # noqa: PLC0415 -- imported on use

        return read(text)

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:  # noqa: ARG002
        """What the event types that an RML text uses ask of events; None where patterns with guards cannot say it."""
        from backends.rml.reading.observed import observed  # noqa: PLC0415 -- imported on use

        return observed(text)

    def masked(self, text: str, trace: Sequence[Json]) -> tuple[str, ...]:
        """The titles of the rows in the table of deviations that the text touches on the trace."""
        from backends.rml.reading.deviations import touching  # noqa: PLC0415 -- imported on use

        return tuple(deviation.title for deviation in touching(text, trace))
