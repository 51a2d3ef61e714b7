"""The `mfotl` backend: metric first-order temporal logic, for MonPoly and its formally verified kernel VeriMon.

The text explains itself: a leading comment defines the predicates as columns of an event (`backends.event_columns`); `mfotl-signature` is the signature of the same text, which the programs want in a file of its own. The last
argument of every predicate is the position of the event in the trace. The unit of `limit` is atoms and comparisons of the formula.
"""

import time
from dataclasses import replace
from typing import ClassVar

from backends.mfotl.monpoly import MfotlHeader
from backends.mfotl.translation import MfotlFormula
from rvaft.backend import Backend, Specification
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict

__all__ = ["MfotlBackend", "MfotlSignatureBackend"]


class MfotlBackend(Backend):
    """A closed formula of past MFOTL, true from the first detection on: every tree under `scattered`, with variables and arithmetic.

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
    untimed: ClassVar[str] = ""
    default_limit: ClassVar[int] = 5_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a formula; `NotExpressible` for late events, multiplication and what else only Python computes alike, `TooLarge`."""
        tree, start = self.plain(tree, Semantics(semantics)), time.perf_counter()
        text, metrics = MfotlFormula(tree, self.default_limit if limit is None else limit).text()
        return Specification(text, self.language, replace(metrics, seconds=time.perf_counter() - start))


class MfotlSignatureBackend(MfotlBackend):
    """The signature of the text of `mfotl`: the predicates with the types of their arguments.

    >>> from rvaft import loads
    >>> print(MfotlSignatureBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED).text, end="")
    break_in(position: int)
    alarm(position: int)
    """

    name: ClassVar[str] = "mfotl-signature"
    language: ClassVar[str] = "mfotl-signature"
    suffix: ClassVar[str] = ".sig"
    form_of: ClassVar[str | None] = MfotlBackend.name

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The signature; raises what the formula does."""
        made = super().translate(tree, semantics, limit=limit)
        return replace(made, text=MfotlHeader.read(made.text).signature(), language=self.language)
