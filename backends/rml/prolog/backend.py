"""The `rml-prolog` backend: the text of `rml` as the Prolog module that the published monitor loads."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import ClassVar

from backends.rml.backend import RmlBackend
from rvaft.backend import Backend, Highlighting, Specification
from rvaft.monitors import Monitor
from rvaft.patterns import Pattern
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics


class RmlPrologBackend(Backend):
    """What the published RML compiler would make of the text of `rml`, ready to load without a compiler.

    The published monitor and ROSMonitoring's RML oracle both load it. It expresses what `rml` expresses, within the same limit.
    """

    name: ClassVar[str] = "rml-prolog"
    language: ClassVar[str] = "rml-prolog"
    suffix: ClassVar[str] = ".pl"
    highlighting: ClassVar[Highlighting] = Highlighting(
        "RMLProlog",
        # Terms without any space are as long as lines can get.
        r"""
\lstdefinelanguage{RMLProlog}[]{Prolog}{
  breakatwhitespace=false,
}
""",
    )
    form_of: ClassVar[str] = RmlBackend.name
    default_limit: ClassVar[int] = RmlBackend.default_limit

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a Prolog module; raises `NotExpressible` and `TooLarge`."""
        from backends.rml.prolog.writing import prolog  # noqa: PLC0415 -- imported on use

        start = perf_counter()
        made = RmlBackend().translate(tree, semantics, limit=limit)
        text = prolog(made.text)
        return Specification(text, self.language, replace(made.metrics, seconds=perf_counter() - start), self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs a text that this backend has written, under the rules of RML; raises `LanguageError` for other Prolog.

        Only the published monitor itself runs any Prolog form, be it written by hand or by the published compiler.
        """
        from backends.rml.prolog.reading import read  # noqa: PLC0415 -- imported on use

        return read(text)

    def masked(self, text: str, trace: Sequence[Json]) -> tuple[str, ...]:
        """As that of `rml`."""
        from backends.rml.prolog.reading import program  # noqa: PLC0415 -- imported on use
        from backends.rml.reading.deviations import touching  # noqa: PLC0415 -- imported on use

        return tuple(deviation.title for deviation in touching(program(text), trace))
